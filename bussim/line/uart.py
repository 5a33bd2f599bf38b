"""A UART's receiver: it cuts a line's level into characters and checks each.

It starts on a falling edge, samples at bit centres, and is ready for the next edge at the middle of
the (first) stop bit. A start bit that is high at its centre was a glitch: it waits for the next edge.
"""

from typing import NamedTuple

from bussim.line.characters import LineTiming
from bussim.line.wave import Wave
from bussim.units import round_half_up


class Sampled(NamedTuple):
    """One character as received. ``ready`` is when the receiver looks for the next edge."""

    start: int
    end: int
    ready: int
    value: int
    parity_ok: bool
    stop_ok: bool


class Uart:
    """A receiver with its own rate, format and clock. It keeps no state: the caller does."""

    __slots__ = ("_bits", "_end", "_fmt", "_samples", "timing")

    def __init__(self, timing: LineTiming) -> None:
        self.timing = timing
        self._fmt = timing.format
        self._bits = timing.format.data_bits
        # Bit centres and the character's end, each rounded once from the falling edge.
        self._samples = [
            round_half_up(timing.bit * (2 * number + 1) / 2) for number in range(timing.format.bits)
        ]
        self._end = timing.bits(timing.format.bits)

    def next_character(self, wave: Wave, ready: int) -> Sampled | None:
        """The next character that begins at or after ``ready``; None if the line stays idle."""
        samples, level = self._samples, wave.level
        while True:
            start = wave.next_fall(ready)
            if start is None:
                return None
            if level(start + samples[0]) == 0:
                break
            ready = start + samples[0]
        bits = self._bits
        value = 0
        for number in range(bits):
            value |= level(start + samples[1 + number]) << number
        at = 1 + bits
        parity_ok = True
        if self._fmt.parity != "N":
            parity_ok = level(start + samples[at]) == self._fmt.parity_bit(value)
            at += 1
        middle = start + samples[at]
        return Sampled(start, start + self._end, middle, value, parity_ok, level(middle) == 1)

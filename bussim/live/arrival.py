"""Characters out of chunks: when each was on the wire, as far as the system lets one know.

A system hands bytes over some time after they came, several at once. What is known is when a chunk
was read and how long a character takes at least; what is assumed is that the characters of a chunk
came back to back and that the last one had just ended. No character begins before the end of
what was heard or sent before it: where the chunk does not fit in between (a pseudo-terminal, on which
bytes take no time), its characters share the time that there is.
"""

from collections.abc import Sequence
from functools import lru_cache

from bussim.engines.contract import RxChar
from bussim.line.characters import CharFormat, LineTiming

#: A character with its first edge and the end of its last stop bit, in ticks.
Timed = tuple[RxChar, int, int]

#: What is wrong with a character: its parity, its stop bit (0: nothing).
PARITY, STOP = 1, 2
#: Every character that was received right, by its value.
GOOD = tuple(RxChar(value) for value in range(256))


@lru_cache(maxsize=16)
def characters_of(form: CharFormat, *, framed: bool = False) -> tuple[RxChar, ...]:
    """The characters by the bytes that a port hands over.

    ``framed``: a byte of a port that is open with 8N has the bit behind the seven data bits of ``form``,
    its parity or first stop bit. Otherwise the system has dealt with that, and does not report it.
    """
    if not framed:
        mask = (1 << form.data_bits) - 1
        return tuple(GOOD[value & mask] for value in range(256))
    rights = [value == framed_byte(form, value) for value in range(256)]
    return tuple(
        RxChar(value & 0x7F, form.parity == "N" or right, form.parity != "N" or right)
        for value, right in enumerate(rights)
    )


def framed_byte(form: CharFormat, value: int) -> int:
    """Seven data bits and the bit behind them, as a byte."""
    data = value & 0x7F
    return data | (1 if form.parity == "N" else form.parity_bit(data)) << 7


@lru_cache(maxsize=4096)
def _offsets(timing: LineTiming, count: int) -> tuple[int, ...]:
    """Where characters back to back begin, and where the last one ends, in ticks from the first edge."""
    return tuple(timing.characters(number) for number in range(count + 1))


def placed(data: bytes, start: int, timing: LineTiming) -> list[Timed]:
    """Whole bytes back to back from their first edge on."""
    ends = [start + offset for offset in _offsets(timing, len(data))]
    return [(GOOD[value], ends[at], ends[at + 1]) for at, value in enumerate(data)]


class Arrivals:
    """Gives each character of one port its times."""

    __slots__ = ("_timing", "busy_until")

    def __init__(self, timing: LineTiming) -> None:
        self._timing = timing
        #: End of what was heard or sent last.
        self.busy_until = 0

    def chunk(self, data: bytes, arrived: int, chars: Sequence[RxChar] = GOOD) -> list[Timed]:
        """What a chunk that was read at ``arrived`` has, in order; ``chars`` are the characters by byte."""
        count = len(data)
        offsets = _offsets(self._timing, count)
        begun = max(arrived - offsets[-1], self.busy_until)
        if arrived - begun >= offsets[-1]:
            ends = [begun + offset for offset in offsets]
        else:
            begun = min(begun, arrived)
            free = arrived - begun
            ends = [begun + free * number // count for number in range(count + 1)]
        self.busy_until = arrived
        return [(chars[value], ends[index], ends[index + 1]) for index, value in enumerate(data)]

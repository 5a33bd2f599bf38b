"""Characters out of chunks: when each was on the wire, as far as the system lets one know.

A system hands bytes over some time after they came, several at once. What is known is when a chunk
was read and how long a character takes at least; what is assumed is that the characters of a chunk
came back to back and that the last one had just ended. No character begins before the end of
what was heard or sent before it: where the chunk does not fit in between (a pseudo-terminal, on which
bytes take no time), its characters share the time that there is.
"""

from __future__ import annotations

from bussim.engines.contract import RxChar
from bussim.line.characters import LineTiming

#: A character with its first edge and the end of its last stop bit, in ticks.
Timed = tuple[RxChar, int, int]

_GOOD = tuple(RxChar(value) for value in range(256))


class Arrivals:
    """Gives each character of one port its times. The system checks parity and stop bits without a report."""

    __slots__ = ("_mask", "_timing", "busy_until")

    def __init__(self, timing: LineTiming) -> None:
        self._timing = timing
        self._mask = (1 << timing.format.data_bits) - 1
        #: End of what was heard or sent last.
        self.busy_until = 0

    def chunk(self, data: bytes, arrived: int) -> list[Timed]:
        """The characters of a chunk that was read at ``arrived``, in order."""
        count = len(data)
        timing, mask = self._timing, self._mask
        begun = max(arrived - timing.characters(count), self.busy_until)
        free = arrived - begun
        if free >= timing.characters(count):
            ends = [begun + timing.characters(number) for number in range(count)] + [arrived]
        else:
            begun = min(begun, arrived)
            free = arrived - begun
            ends = [begun + free * number // count for number in range(count + 1)]
        self.busy_until = arrived
        return [(_GOOD[value & mask], ends[index], ends[index + 1]) for index, value in enumerate(data)]

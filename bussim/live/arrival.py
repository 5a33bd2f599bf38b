"""Characters out of chunks: when each was on the wire, as far as the system lets one know.

A system hands bytes over some time after they came, several at once. What is known is when a chunk
was read and how long a character takes at least; what is assumed is that the characters of a chunk
came back to back and that the last one had just ended. No character begins before the end of
what was heard or sent before it: where the chunk does not fit in between (a pseudo-terminal, on which
bytes take no time), its characters share the time that there is.
"""

from __future__ import annotations

from functools import lru_cache

from bussim.engines.contract import RxChar
from bussim.line.characters import LineTiming

#: A character with its first edge and the end of its last stop bit, in ticks.
Timed = tuple[RxChar, int, int]

#: What is wrong with a character: its parity, its stop bit (0: nothing).
PARITY, STOP = 1, 2
#: Every character that was received right, by its value.
GOOD = tuple(RxChar(value) for value in range(256))


@lru_cache(maxsize=4096)
def _offsets(timing: LineTiming, count: int) -> tuple[int, ...]:
    """Where characters back to back begin, and where the last one ends, in ticks from the first edge."""
    return tuple(timing.characters(number) for number in range(count + 1))


def placed(data: bytes, start: int, timing: LineTiming) -> list[Timed]:
    """Whole bytes back to back from their first edge on."""
    ends = [start + offset for offset in _offsets(timing, len(data))]
    return [(GOOD[value], ends[at], ends[at + 1]) for at, value in enumerate(data)]


class Arrivals:
    """Gives each character of one port its times. The system checks parity and stop bits without a report.

    ``whole``: all eight bits of a byte count, whatever the format's number of data bits.
    """

    __slots__ = ("_mask", "_timing", "busy_until")

    def __init__(self, timing: LineTiming, *, whole: bool = False) -> None:
        self._timing = timing
        self._mask = 0xFF if whole else (1 << timing.format.data_bits) - 1
        #: End of what was heard or sent last.
        self.busy_until = 0

    def chunk(self, data: bytes, arrived: int) -> list[Timed]:
        """The characters of a chunk that was read at ``arrived``, in order."""
        count, mask = len(data), self._mask
        offsets = _offsets(self._timing, count)
        begun = max(arrived - offsets[-1], self.busy_until)
        if arrived - begun >= offsets[-1]:
            ends = [begun + offset for offset in offsets]
        else:
            begun = min(begun, arrived)
            free = arrived - begun
            ends = [begun + free * number // count for number in range(count + 1)]
        self.busy_until = arrived
        return [(GOOD[value & mask], ends[index], ends[index + 1]) for index, value in enumerate(data)]

"""A PLC's scan cycle: the instants of its ENDs, drawn in blocks and looked up when asked for.

There are 1,600 ENDs a second on a link of eight PLCs, and nobody looks at most of them; so an END is
no event. Only the one before a frame leaves, or the one after a reply is ready, is ever found.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from operator import sub
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np

_BLOCK = 512


class ScanCycle:
    """END instants of one PLC between RUN and STOP.

    ENDs may be asked for as far ahead as one likes, and back to the latest one before the present,
    which only ever moves forward.
    """

    def __init__(self, generator: np.random.Generator) -> None:
        self._generator = generator
        self._mean = 1
        self._jitter = 0
        self._ends: list[int] = []
        self._next_block: list[int] = []
        self._began = 0
        self._running = False
        #: Finished scans, their total and longest duration in ticks, over all RUNs.
        self.count = 0
        self.total = 0
        self.longest = 0
        self._counted_to = 0  # the END up to which scans are counted

    def run(self, now: int, mean: int, jitter: int, phase: int | None) -> int:
        """RUN at ``now`` with scans of ``mean`` ± ``jitter`` ticks, uniform, at least one tick each.

        The first END comes ``phase`` ticks later (None: uniform over a scan); returns its tick.
        """
        self._mean, self._jitter = mean, jitter
        if phase is None:
            phase = 1 + int(self._generator.random() * self._mean)
        self._began = self._counted_to = now
        self._running = True
        first = now + phase
        self._ends = [first]
        self._extend()
        return first

    def stop(self, now: int) -> None:
        """STOP: ENDs after ``now`` do not happen."""
        if self._running:
            self.count_up_to(now)
            del self._ends[bisect_right(self._ends, now) :]
            self._running = False

    def _extend(self) -> None:
        import numpy as np

        if self._jitter:
            spread = 2 * self._generator.random(_BLOCK) - 1
            scans = np.maximum(1, np.floor(self._mean + self._jitter * spread + 0.5)).astype(np.int64)
            self._ends += (self._ends[-1] + np.cumsum(scans)).tolist()
        else:
            last = self._ends[-1]
            self._ends += range(last + self._mean, last + self._mean * (_BLOCK + 1), self._mean)

    def _reach(self, tick: int, now: int) -> list[int]:
        """The ENDs from the latest one before ``now`` on (at least), drawn on until they pass a tick."""
        ends = self._ends
        while self._running and ends[-1] <= tick:
            if len(ends) > 2 * _BLOCK and ends[_BLOCK] < now:
                self.count_up_to(ends[_BLOCK])
                del ends[:_BLOCK]
            self._extend()
        return ends

    def latest_end(self, tick: int) -> int | None:
        """The latest END at or before a tick; None before the first one since RUN."""
        ends = self._ends
        if not ends:
            return None
        if self._running and ends[-1] <= tick:
            ends = self._reach(tick, tick)
        place = bisect_right(ends, tick)
        return ends[place - 1] if place else None

    def next_end(self, tick: int, now: int) -> int:
        """The first END at or after a tick, which may lie far ahead of ``now``. The PLC must be in RUN."""
        ends = self._reach(tick, now)
        return ends[bisect_left(ends, tick)]

    def count_up_to(self, tick: int) -> None:
        """Add the scans that ended by ``tick`` to the counts."""
        ends = self._reach(tick, tick)
        first, last = bisect_right(ends, self._counted_to), bisect_right(ends, tick)
        if last <= first:
            return
        previous = self._counted_to
        if previous == self._began and first == 0:
            # RUN to the first END is no whole scan.
            previous, first = ends[0], 1
        if last > first:
            self.longest = max(self.longest, ends[first] - previous)
            self.longest = max(self.longest, *map(sub, ends[first + 1 : last], ends[first : last - 1]), 0)
            self.total += ends[last - 1] - previous
            self.count += last - first
        self._counted_to = ends[last - 1]

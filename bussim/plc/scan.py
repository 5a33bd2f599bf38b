"""A PLC's scan cycle: the instants of its ENDs, drawn in blocks and looked up when asked for.

There are 1,600 ENDs a second on a link of eight PLCs, and most of them affect nothing; so an END is no
event. Only the one before a frame leaves, or the one after a reply is ready, is ever looked up.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable
from dataclasses import dataclass
from operator import sub
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np

_BLOCK = 512


@dataclass(frozen=True, slots=True)
class Scan:
    """A PLC's scan time without N:N: uniform over mean ± jitter (0 <= jitter < mean)."""

    mean: int
    jitter: int = 0


class ScanCycle:
    """END instants of one PLC between RUN and STOP.

    ENDs may be asked for as far ahead as needed, and back to the latest one before the present, which only
    ever moves forward. Scans that are not asked for are drawn and counted in blocks.

    A load makes scans longer (:meth:`set_load`). It changes no draw: the draw of a scan depends on its
    number since RUN alone.
    """

    def __init__(self, generator: np.random.Generator) -> None:
        self._generator = generator
        self._mean = 1
        self._jitter = 0
        self._running = False
        # ENDs in order: the first one's scan is counted already, the others stand in whole blocks.
        self._ends: list[int] = []
        self._longest_of: list[int] = []  # the longest scan of each of those blocks
        self._past = (0, 0, 0)  # count, total and longest of the scans before
        self._extra = 0  # by how much every scan is longer now
        # After the first load: drawn scans without it, and how many of them are in ``_ends``. ENDs
        # are then made one by one, since a change of load moves all that lie ahead.
        self._drawn: list[int] | None = None
        self._used = 0
        # Where every END is to be recorded: up to which tick they have been; those after it are kept.
        self._recorded: int | None = None
        #: Called with an END when those after it have moved.
        self.on_change: Callable[[int], None] | None = None
        #: Finished scans, their total and longest duration in ticks, over all RUNs, as of the latest
        #: :meth:`count_up_to`. From RUN to the first END is no whole scan.
        self.count = 0
        self.total = 0
        self.longest = 0

    def run(self, now: int, mean: int, jitter: int, phase: int | None) -> int:
        """RUN at ``now`` with scans of ``mean`` ± ``jitter`` ticks, uniform, at least one tick each.

        The first END comes ``phase`` ticks later (None: uniform over a scan); returns its tick.
        """
        self._mean, self._jitter = mean, jitter
        if phase is None:
            phase = 1 + int(self._generator.random() * self._mean)
        self._running = True
        first = now + phase
        self._ends = [first]
        self._longest_of = []
        self._extra, self._drawn, self._used = 0, None, 0
        return first

    def count_first(self, duration: int) -> None:
        """Count the time from RUN to the first END among the longest scans: it was a whole, long one."""
        count, total, longest = self._past
        self._past = (count, total, max(longest, duration))

    def stop(self, now: int) -> None:
        """STOP: ENDs after ``now`` do not happen."""
        if self._running:
            self.count_up_to(now)
            self._past = (self.count, self.total, self.longest)
            index = bisect_right(self._ends, now)
            self._ends = self._ends[index - 1 : index] if index else []
            self._longest_of = []
            self._running = False
            self._extra, self._drawn, self._used = 0, None, 0

    def keep_ends(self) -> None:
        """From now on, in RUN or not, ENDs are kept until :meth:`passed` has returned them."""
        self._recorded = -1

    def passed(self, tick: int) -> list[int]:
        """The ENDs up to a tick, not after the present, since the last call (after :meth:`keep_ends`)."""
        if self._recorded is None or not self._ends:
            return []
        ends = self._reach(tick, tick)
        found = ends[bisect_right(ends, self._recorded) : bisect_right(ends, tick)]
        self._recorded = max(self._recorded, tick)
        return found

    def set_load(self, end: int, extra: int) -> None:
        """From the scan that begins at ``end`` on, every scan lasts ``extra`` ticks longer, until changed.

        ``end`` is the latest END. Raises ValueError if it is no END of a PLC in RUN.
        """
        if extra == self._extra:
            return
        ends = self._ends
        index = bisect_left(ends, end)
        if not self._running or index == len(ends) or ends[index] != end:
            raise ValueError(f"tick {end} is no END of a PLC in RUN")
        if self._drawn is None:
            self._drawn = list(map(sub, ends[index + 1 :], ends[index:]))
        else:
            self._used -= len(ends) - index - 1
        del ends[index + 1 :]
        self._forget(index - 1)
        self._extra = extra
        if self.on_change is not None:
            self.on_change(end)

    def _forget(self, index: int) -> None:
        """Count and drop what lies before an entry of ``_ends``."""
        if self._recorded is not None:
            index = min(index, bisect_right(self._ends, self._recorded) - 1)
        if index > 0:
            self._leave(index, self._ends[index], self._longest(index))
            del self._ends[:index]
        self._longest_of.clear()

    def _reach(self, tick: int, now: int) -> list[int]:
        """The ENDs from the latest one before ``now`` on (at least), drawn on until they pass a tick."""
        ends = self._ends
        if self._recorded is not None:
            now = min(now, self._recorded)
        while self._running and ends[-1] <= tick:
            if self._drawn is not None:
                self._lengthen(self._drawn, tick, now)
                continue
            if self._jitter:
                self._draw(now)
            else:
                last, mean = ends[-1], self._mean
                self._append(list(range(last + mean, last + mean * (_BLOCK + 1), mean)), mean)
            if len(ends) > 2 * _BLOCK and ends[_BLOCK] < now:
                self._leave(_BLOCK, ends[_BLOCK], self._longest_of.pop(0))
                del ends[:_BLOCK]
        return ends

    def _lengthen(self, drawn: list[int], tick: int, now: int) -> None:
        """ENDs under a load: on until they pass a tick or the next block of scans is to be drawn."""
        if self._used == len(drawn):
            self._refill(drawn, now)
        ends, extra, used, known = self._ends, self._extra, self._used, len(drawn)
        last = ends[-1]
        while used < known and last <= tick:
            last += drawn[used] + extra
            ends.append(last)
            used += 1
        self._used = used

    def _refill(self, drawn: list[int], now: int) -> None:
        """Draw a block; what lies before the present, and scans that it is over for, are counted."""
        self._forget(bisect_left(self._ends, now) - 1)
        del drawn[: max(0, self._used - len(self._ends))]  # the rest may be taken back by a new load
        if not self._jitter:
            scans, total, longest = [self._mean] * _BLOCK, self._mean * _BLOCK, self._mean
        else:
            block = self._scans()
            scans, total, longest = block.tolist(), int(block.sum()), int(block.max())
        ends, extra = self._ends, self._extra
        last = ends[-1] + total + _BLOCK * extra
        if last < now:
            longest = max(longest + extra, self._longest(len(ends) - 1))
            self._leave(len(ends) - 1 + _BLOCK, last, longest)
            ends[:] = [last]
            drawn.clear()
        else:
            drawn += scans
        self._used = len(drawn) - _BLOCK if drawn else 0

    def _scans(self) -> np.ndarray:
        import numpy as np

        uniform = self._generator.random(_BLOCK)
        scans = (self._mean - self._jitter + 0.5 + 2 * self._jitter * uniform).astype(np.int64)
        return np.maximum(scans, 1, out=scans)

    def _draw(self, now: int) -> None:
        import numpy as np

        scans = self._scans()
        ends = self._ends
        last, longest = ends[-1] + int(scans.sum()), int(scans.max())
        if last < now:
            # These ENDs passed without being asked for: they go into the counts.
            self._leave(len(ends) - 1 + _BLOCK, last, max(longest, *self._longest_of, 0))
            self._longest_of.clear()
            ends[:] = [last]
        else:
            self._append((ends[-1] + np.cumsum(scans)).tolist(), longest)

    def _append(self, block: list[int], longest: int) -> None:
        self._ends += block
        self._longest_of.append(longest)

    def _leave(self, count: int, last: int, longest: int) -> None:
        """Count the next ``count`` scans, up to the END ``last``: they are kept no longer."""
        counted, total, record = self._past
        self._past = (counted + count, total + last - self._ends[0], max(record, longest))

    def latest_end(self, tick: int) -> int | None:
        """The latest END at or before a tick; None before the first one since RUN."""
        ends = self._ends
        if not ends:
            return None
        if self._running and ends[-1] <= tick:
            ends = self._reach(tick, tick)
        index = bisect_right(ends, tick)
        return ends[index - 1] if index else None

    def next_end(self, tick: int, now: int) -> int:
        """The first END at or after a tick, which may lie far ahead of ``now``. The PLC must be in RUN."""
        ends = self._reach(tick, now)
        return ends[bisect_left(ends, tick)]

    def count_up_to(self, tick: int) -> None:
        """Bring the counts up to the scans that had ended by ``tick``, not before the present."""
        ends = self._reach(tick, tick)
        count, total, longest = self._past
        last = bisect_right(ends, tick) - 1
        if last > 0:
            longest = max(longest, self._longest(last))
            count, total = count + last, total + ends[last] - ends[0]
        self.count, self.total, self.longest = count, total, longest

    def _longest(self, last: int) -> int:
        """The longest of the first ``last`` scans of ``_ends``, 0 if there are none."""
        ends = self._ends
        blocks = min(last // _BLOCK, len(self._longest_of))
        at = blocks * _BLOCK
        part = map(sub, ends[at + 1 : last + 1], ends[at:last])
        return max((*self._longest_of[:blocks], *part), default=0)

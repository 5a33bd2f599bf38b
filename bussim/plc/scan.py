"""A PLC's scan cycle: the instants of its ENDs, drawn in blocks and looked up when asked for.

There are 1,600 ENDs a second on a link of eight PLCs, and most of them affect nothing; so an END is no
event. Only the one before a frame leaves, or the one after a reply is ready, is ever looked up.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import sub
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np

_BLOCK = 512
_NEVER = 1 << 62

#: The shortest and the longest of some scans, in ticks; without any: (_NEVER, 0).
_Bounds = tuple[int, int]


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
        self._bounds: list[_Bounds] = []  # the shortest and the longest scan of each of those blocks
        self._past = (0, 0, 0)  # count, total and longest of the scans before
        self._since: _Bounds = (_NEVER, 0)  # of those since RUN
        self._before: int | None = None  # the END before the first of ``_ends``
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
        self._bounds = []
        self._since, self._before = (_NEVER, 0), None
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
            self._bounds = []
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

    def set_load(self, end: int, extra: int, now: int | None = None) -> None:
        """From the scan that begins at ``end`` on, every scan lasts ``extra`` ticks longer, until changed.

        ``end`` is the latest END; with ``now`` it may lie ahead of that tick, and no ENDs after ``now`` are
        given up. Raises ValueError if it is no END of a PLC in RUN.
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
        if index > _BLOCK or self._bounds:
            self._forget((index if now is None else bisect_left(ends, now)) - 1)
        self._extra = extra
        if self.on_change is not None:
            self.on_change(end)

    def _forget(self, index: int) -> None:
        """Count and drop what lies before an entry of ``_ends``."""
        if self._recorded is not None:
            index = min(index, bisect_right(self._ends, self._recorded) - 1)
        if index > 0:
            self._leave(index, self._ends[index], self._ends[index - 1], *self._extremes(index))
            del self._ends[:index]
        self._bounds.clear()

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
                self._append(list(range(last + mean, last + mean * (_BLOCK + 1), mean)), (mean, mean))
            if len(ends) > 2 * _BLOCK and ends[_BLOCK] < now:
                self._leave(_BLOCK, ends[_BLOCK], ends[_BLOCK - 1], *self._bounds.pop(0))
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
            scans, bounds = [self._mean] * _BLOCK, (self._mean, self._mean)
        else:
            block = self._scans()
            scans, bounds = block.tolist(), _bounds_of(block)
        ends, extra = self._ends, self._extra
        last = ends[-1] + sum(scans) + _BLOCK * extra
        if last < now:
            shortest, longest = self._extremes(len(ends) - 1)
            bounds = min(shortest, bounds[0] + extra), max(longest, bounds[1] + extra)
            self._leave(len(ends) - 1 + _BLOCK, last, last - scans[-1] - extra, *bounds)
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
        ends, bounds = self._ends, _bounds_of(scans)
        last = ends[-1] + int(np.add.reduce(scans))
        if last < now:
            # These ENDs passed without being asked for: they go into the counts.
            if self._bounds:
                bounds = _joined([bounds, *self._bounds])
                self._bounds.clear()
            self._leave(len(ends) - 1 + _BLOCK, last, last - int(scans[-1]), *bounds)
            ends[:] = [last]
        else:
            self._append((ends[-1] + np.cumsum(scans)).tolist(), bounds)

    def _append(self, block: list[int], bounds: _Bounds) -> None:
        self._ends += block
        self._bounds.append(bounds)

    def _leave(self, count: int, last: int, before: int, shortest: int, longest: int) -> None:
        """Count the next ``count`` scans, up to the ENDs ``before`` and ``last``: they are kept no longer."""
        counted, total, record = self._past
        least, most = self._since
        # Called at every END of a port that waits: comparisons are faster than min and max.
        self._since = (shortest if shortest < least else least), (longest if longest > most else most)
        longest = longest if longest > record else record
        self._past = counted + count, total + last - self._ends[0], longest
        self._before = before

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
            longest = max(longest, self._extremes(last)[1])
            count, total = count + last, total + ends[last] - ends[0]
        self.count, self.total, self.longest = count, total, longest

    def times(self, end: int) -> tuple[int, int, int]:
        """The scan before the latest END up to ``end``; the shortest and the longest since RUN, in ticks.

        Zeros before a whole one. ``end`` does not lie before the present.
        """
        ends = self._reach(end, end)
        last = bisect_right(ends, end) - 1
        before = ends[last - 1] if last > 0 else self._before
        if before is None:
            return 0, 0, 0
        return ends[last] - before, *_joined([self._since, self._extremes(last)])

    def _extremes(self, last: int) -> _Bounds:
        """The shortest and the longest of the first ``last`` scans of ``_ends``."""
        ends = self._ends
        blocks = self._bounds[: last // _BLOCK] if self._bounds else []
        at = len(blocks) * _BLOCK
        part = list(map(sub, ends[at + 1 : last + 1], ends[at:last]))
        bounds = min(part, default=_NEVER), max(part, default=0)
        return _joined([*blocks, bounds]) if blocks else bounds


def _joined(bounds: Sequence[_Bounds]) -> _Bounds:
    return min(least for least, _ in bounds), max(most for _, most in bounds)


def _bounds_of(scans: np.ndarray) -> _Bounds:
    import numpy as np

    return int(np.minimum.reduce(scans)), int(np.maximum.reduce(scans))

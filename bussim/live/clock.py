"""Real time in ticks: the only clock of bussim, and only for what runs on real ports."""

import time
from dataclasses import dataclass

from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND

#: 1e9 ns are 72e6 ticks: 125 ns are 9 ticks.
_TICKS, _NANOSECONDS = 9, 125
#: Lateness that is worth a warning, and may make an exchange fail (assumed).
LATE = 10 * TICKS_PER_MS


class Clock:
    """Ticks of 1/72 MHz since it was made. It never goes back, whatever happens to the time of day."""

    __slots__ = ("_origin",)

    def __init__(self) -> None:
        # perf_counter is monotonic everywhere; monotonic itself counts in 15 ms steps on Windows.
        self._origin = time.perf_counter_ns()

    def restart(self) -> None:
        """Count from 0 again."""
        self._origin = time.perf_counter_ns()

    def now(self) -> int:
        """The present tick."""
        return (time.perf_counter_ns() - self._origin) * _TICKS // _NANOSECONDS


def as_seconds(ticks: int) -> float:
    """A wait in ticks as seconds for the operating system, never below 0."""
    return ticks / TICKS_PER_SECOND if ticks > 0 else 0.0


@dataclass(slots=True)
class Lateness:
    """How much later than they were due things were done, in ticks."""

    worst: int = 0
    worst_at: int = 0
    total: int = 0
    count: int = 0
    latest: int = -1  # when it was last more than :data:`LATE`, and by how much
    latest_by: int = 0

    def add(self, late: int, now: int) -> None:
        """Something was due ``late`` ticks before ``now``."""
        self.total += late
        self.count += 1
        if late > LATE:
            self.latest, self.latest_by = now, late
        if late > self.worst:
            self.worst, self.worst_at = late, now

    @property
    def mean(self) -> float:
        """The mean, 0 where nothing was due."""
        return self.total / self.count if self.count else 0.0

    def spoils(self, begun: int, ended: int) -> bool:
        """Whether an exchange may have failed by it: a tenth of its time or more, and within it (assumed)."""
        return self.latest >= begun and 10 * self.latest_by >= ended - begun

"""Real time in ticks: the only clock of bussim, and only for what runs on real ports."""

from __future__ import annotations

import time

from bussim.units import TICKS_PER_SECOND

#: 1e9 ns are 72e6 ticks: 125 ns are 9 ticks.
_TICKS, _NANOSECONDS = 9, 125


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

"""Draws of a slave's turnaround."""

from __future__ import annotations

from bisect import bisect_right
from itertools import accumulate

from bussim.line.random_streams import Streams
from bussim.plc.profiles import Turnaround


class Turnarounds:
    """The turnarounds of one PLC, in ticks, one :meth:`draw` a reply."""

    __slots__ = ("_base", "_cumulative", "_draws", "_span", "_values")

    def __init__(self, distribution: Turnaround, streams: Streams, name: str) -> None:
        self._draws = streams.uniforms("turnaround", name)
        self._base = distribution.mean - distribution.jitter
        # Whole ticks from mean - jitter to mean + jitter, each as likely.
        self._span = 2 * distribution.jitter + 1
        self._values = distribution.values
        total = sum(distribution.weights)
        self._cumulative = [part / total for part in accumulate(distribution.weights)][:-1]

    def draw(self) -> int:
        """The next turnaround."""
        if self._values:
            return self._values[bisect_right(self._cumulative, next(self._draws))]
        return self._base + int(next(self._draws) * self._span)

"""Draws of a slave's turnaround."""

from __future__ import annotations

from bisect import bisect_right
from itertools import accumulate
from typing import TYPE_CHECKING

from bussim.line.random_streams import Streams
from bussim.plc.profiles import Turnaround

if TYPE_CHECKING:
    import numpy as np


class Turnarounds:
    """The turnarounds of one PLC, in ticks, one :meth:`draw` a reply."""

    __slots__ = ("_base", "_cumulative", "_draws", "_span", "_values", "longest", "shortest")

    def __init__(self, distribution: Turnaround, streams: Streams, name: str) -> None:
        self._draws = streams.uniforms("turnaround", name)
        self._base = distribution.mean - distribution.jitter
        # Whole ticks from mean - jitter to mean + jitter, each as likely.
        self._span = 2 * distribution.jitter + 1
        self._values = distribution.values
        #: The longest and the shortest one that can be drawn.
        self.longest = distribution.longest
        self.shortest = min(self._values) if self._values else self._base
        total = sum(distribution.weights)
        self._cumulative = [part / total for part in accumulate(distribution.weights)][:-1]

    def ahead(self, count: int) -> np.ndarray:
        """The next turnarounds, which are not drawn yet."""
        import numpy as np

        draws = self._draws.ahead(count)
        if self._values:
            return np.array(self._values)[np.searchsorted(self._cumulative, draws, side="right")]
        return self._base + (draws * self._span).astype(np.int64)

    def skip(self, count: int) -> None:
        """Draw so many turnarounds that :meth:`ahead` has shown."""
        self._draws.skip(count)

    def draw(self) -> int:
        """The next turnaround."""
        if self._values:
            return self._values[bisect_right(self._cumulative, next(self._draws))]
        return self._base + int(next(self._draws) * self._span)

"""A histogram of times in bins of 10 µs, with exact count, sum, minimum and maximum.

Its memory depends on how many different times occur, not on how often they do.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from bussim.results.numbers import ms
from bussim.units import TICKS_PER_US

if TYPE_CHECKING:
    import numpy as np

#: Width of a bin in ticks: 10 µs.
BIN_TICKS = 10 * TICKS_PER_US
_HALF_BIN = BIN_TICKS // 2

#: The quantiles of every report, by name, in thousandths.
QUANTILES = {"p50": 500, "p95": 950, "p99": 990, "p999": 999}

#: A quantile is known only where at least so many samples lie beyond it.
SAMPLES_BEYOND = 10


class Histogram:
    """Counts of times by bin; bin ``b`` holds the times that round to ``b * 10 µs``.

    ``count``, ``total`` (sum, in ticks), ``minimum`` and ``maximum`` (ticks, None when empty) are
    exact.
    """

    __slots__ = ("bins", "count", "maximum", "minimum", "total")

    def __init__(self) -> None:
        self.bins: Counter[int] = Counter()
        self.count = 0
        self.total = 0
        self.minimum: int | None = None
        self.maximum: int | None = None

    def add(self, ticks: int) -> None:
        """Count a time of ``ticks`` (>= 0)."""
        position = (ticks + _HALF_BIN) // BIN_TICKS
        self.bins[position] = self.bins.get(position, 0) + 1  # a missing key of a Counter costs a call
        self.count += 1
        self.total += ticks
        self._extend(ticks, ticks)

    def add_all(self, times: Sequence[int]) -> None:
        """Count many times (ticks) once each, faster than one by one."""
        if not times:
            return
        self.bins.update([(ticks + _HALF_BIN) // BIN_TICKS for ticks in times])
        self.count += len(times)
        self.total += sum(times)
        self._extend(min(times), max(times))

    def add_array(self, times: np.ndarray) -> None:
        """Count many times (ticks) once each, from an array."""
        import numpy as np

        if len(times):
            bins, counts = np.unique((times + _HALF_BIN) // BIN_TICKS, return_counts=True)
            for position, number in zip(bins.tolist(), counts.tolist(), strict=True):
                self.bins[position] += number
            self.count += len(times)
            self.total += int(times.sum())
            self._extend(int(times.min()), int(times.max()))

    def merge(self, other: Histogram) -> None:
        """Add all counts of another histogram."""
        self.bins.update(other.bins)
        self.count += other.count
        self.total += other.total
        if other.minimum is not None and other.maximum is not None:
            self._extend(other.minimum, other.maximum)

    def _extend(self, low: int, high: int) -> None:
        if self.minimum is None or low < self.minimum:
            self.minimum = low
        if self.maximum is None or high > self.maximum:
            self.maximum = high

    def bars(
        self, width: int, first: int | None = None, last: int | None = None, *, shift: int = 0
    ) -> dict[int, int]:
        """Counts of bars that are ``width`` bins wide, of the bins from ``first`` to ``last`` (None: all).

        The first bar begins ``shift`` bins before bin 0.
        """
        bars: Counter[int] = Counter()
        for position, times in self.bins.items():
            if (first is None or first <= position) and (last is None or position <= last):
                bars[(position + shift) // width] += times
        return bars

    @property
    def mean(self) -> float | None:
        """Mean in ticks, None when empty."""
        return self.total / self.count if self.count else None

    def quantile(self, thousandths: int) -> int | None:
        """The least bin that at least ``thousandths``/1000 of the samples do not exceed, in ticks.

        Within half a bin (5 µs) of the sample's own value and never outside minimum…maximum.
        None when fewer than :data:`SAMPLES_BEYOND` samples lie beyond it.
        """
        if not 0 < thousandths < 1000:
            raise ValueError(f"thousandths (={thousandths}) must be in [1...999].")
        rank = -(-thousandths * self.count // 1000)
        if self.count - rank < SAMPLES_BEYOND:
            return None
        seen = 0
        for position in sorted(self.bins):
            seen += self.bins[position]
            if seen >= rank:
                break
        value = position * BIN_TICKS
        if self.minimum is not None:
            value = max(value, self.minimum)
        if self.maximum is not None:
            value = min(value, self.maximum)
        return value

    def to_json(self) -> dict[str, Any]:
        """Plain data: times in ticks, ``bins`` as pairs of bin number and count in ascending order."""
        return {
            "count": self.count,
            "sum": self.total,
            "min": self.minimum,
            "max": self.maximum,
            "bins": [[position, self.bins[position]] for position in sorted(self.bins)],
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Histogram:
        """The histogram of :meth:`to_json`. Raises KeyError, TypeError or ValueError for anything else."""
        histogram = cls()
        histogram.bins = Counter({int(position): int(times) for position, times in data["bins"]})
        histogram.count, histogram.total = int(data["count"]), int(data["sum"])
        histogram.minimum = None if data["min"] is None else int(data["min"])
        histogram.maximum = None if data["max"] is None else int(data["max"])
        if histogram.count != sum(histogram.bins.values()):
            raise ValueError("the count is not the sum of the bins")
        return histogram


def bar_width(span: int, most: int) -> int:
    """The least of 1, 2, 5, 10… bins with which ``span`` bins make at most so many bars."""
    decade = 1
    while True:
        for width in (decade, 2 * decade, 5 * decade):
            if span <= width * most:
                return width
        decade *= 10


def quantiles(histogram: Histogram) -> dict[str, float | None]:
    """All of :data:`QUANTILES` in ms; None for one with too few samples beyond it."""
    return {name: ms(histogram.quantile(thousandths)) for name, thousandths in QUANTILES.items()}


def statistics(histogram: Histogram) -> dict[str, float | None]:
    """Quantiles, least, greatest and mean in ms."""
    return {
        **quantiles(histogram),
        "max": ms(histogram.maximum),
        "min": ms(histogram.minimum),
        "mean": ms(histogram.mean),
    }

"""A histogram of times in bins of 10 µs, with exact count, sum, minimum and maximum.

Its memory depends on how many different times occur, not on how often they do.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from bussim.units import TICKS_PER_US

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
        self.bins: dict[int, int] = {}
        self.count = 0
        self.total = 0
        self.minimum: int | None = None
        self.maximum: int | None = None

    def add(self, ticks: int) -> None:
        """Count a time of ``ticks`` (>= 0)."""
        position = (ticks + _HALF_BIN) // BIN_TICKS
        self.bins[position] = self.bins.get(position, 0) + 1
        self.count += 1
        self.total += ticks
        if self.maximum is None or ticks > self.maximum:
            self.maximum = ticks
        if self.minimum is None or ticks < self.minimum:
            self.minimum = ticks

    def add_all(self, times_: Sequence[int]) -> None:
        """Count many times (ticks) once each, faster than one by one."""
        if not times_:
            return
        bins = self.bins
        for position, times in Counter([(t + _HALF_BIN) // BIN_TICKS for t in times_]).items():
            bins[position] = bins.get(position, 0) + times
        self.count += len(times_)
        self.total += sum(times_)
        low, high = min(times_), max(times_)
        self.minimum = low if self.minimum is None else min(low, self.minimum)
        self.maximum = high if self.maximum is None else max(high, self.maximum)

    def merge(self, other: Histogram) -> None:
        """Add all counts of another histogram."""
        self._add(other, 1)
        if other.maximum is not None:
            self.maximum = other.maximum if self.maximum is None else max(self.maximum, other.maximum)
        if other.minimum is not None:
            self.minimum = other.minimum if self.minimum is None else min(self.minimum, other.minimum)

    def subtract(self, other: Histogram) -> None:
        """Subtract all counts of another histogram; counts may become negative.

        Minimum and maximum stay: they cover everything that was ever added.
        """
        self._add(other, -1)

    def _add(self, other: Histogram, sign: int) -> None:
        for position, times in other.bins.items():
            left = self.bins.get(position, 0) + sign * times
            if left:
                self.bins[position] = left
            else:
                del self.bins[position]
        self.count += sign * other.count
        self.total += sign * other.total

    def bars(self, width: int, first: int | None = None, last: int | None = None) -> dict[int, int]:
        """Counts of bars that are ``width`` bins wide, of the bins from ``first`` to ``last`` (None: all)."""
        bars: dict[int, int] = {}
        for position, times in self.bins.items():
            if (first is None or first <= position) and (last is None or position <= last):
                bars[position // width] = bars.get(position // width, 0) + times
        return bars

    def copy(self) -> Histogram:
        """An independent histogram with the same counts."""
        twin = Histogram()
        twin.bins = dict(self.bins)
        twin.count, twin.total = self.count, self.total
        twin.minimum, twin.maximum = self.minimum, self.maximum
        return twin

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
        histogram.bins = {int(position): int(times) for position, times in data["bins"]}
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

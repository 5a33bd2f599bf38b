"""Statistics of a histogram as ``summary.json`` has them, in ms."""

from __future__ import annotations

from bussim.results.meters.histogram import QUANTILES, Histogram
from bussim.results.numbers import ms


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

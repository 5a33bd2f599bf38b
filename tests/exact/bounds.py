"""Bounds of statistical tests, from the variance of what is tested; false alarms once in a million."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from bussim.exact.scan.mixture import Distribution

#: Kolmogorov's statistic times √n exceeds this once in a million: √(-ln(α / 2) / 2).
KOLMOGOROV = math.sqrt(-math.log(5e-7) / 2)
#: So many standard deviations are exceeded once in 1.7 million.
SIGMAS = 5.0


def kolmogorov(distribution: Distribution, sample: Sequence[float]) -> float:
    """√n times the greatest distance between a distribution and a sample (ticks); atoms are allowed."""
    ordered = np.sort(np.asarray(sample, dtype=np.float64))
    n = ordered.size
    values = np.unique(ordered)
    # A tick's half beside each value: atoms of the distribution lie on whole ticks.
    right, left = 1 - distribution.tail(values + 0.5), 1 - distribution.tail(values - 0.5)
    seen = np.searchsorted(ordered, values, side="right") / n
    before = np.searchsorted(ordered, values, side="left") / n
    return float(math.sqrt(n) * max(np.abs(right - seen).max(), np.abs(left - before).max()))


def off_by(count: int, tries: int, probability: float, overdispersion: float = 1.0) -> float:
    """How many standard deviations a count lies from its mean; ``overdispersion`` multiplies its variance."""
    variance = tries * probability * (1 - probability) * overdispersion
    return abs(count - tries * probability) / math.sqrt(variance + 1e-12)

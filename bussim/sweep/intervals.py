"""Means of repeated runs and their 95 % confidence intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import cos, fsum, isfinite, pi, sin, sqrt
from statistics import NormalDist

#: How often an interval covers the true mean, for figures that are spread normally.
CONFIDENCE = 0.95

# The exact series has as many terms as half the degrees of freedom; beyond so many the expansion
# around the normal distribution is as accurate as a double.
_EXPANDED_FROM = 200
_HALVINGS = 60


@dataclass(frozen=True, slots=True)
class Mean:
    """A mean and the limits of its confidence interval, None where they are not known."""

    mean: float | None
    low: float | None = None
    high: float | None = None


def mean_of(values: Sequence[float | None], *, events: bool = False) -> Mean:
    """The mean of a figure over the repeats of a point, with its 95 % confidence interval.

    The interval is Student's, mean ± t · s / √n with n − 1 degrees of freedom: for a handful of
    repeats the normal distribution's 1.96 would be far too small (n = 5: 2.78). It ends at 0 for figures that
    are never less, which takes nothing from its coverage. The repeats are independent;
    each figure is itself a mean or a count over many link scans, so that it is roughly normal.

    Where a figure is None in a repeat (a quantile that takes more scans) the mean is None as well:
    the others alone would be a choice that depends on the result. One repeat has no interval. Nor
    has a count of ``events`` that is 0 in every repeat: never seen is not never.
    """
    numbers = [value for value in values if value is not None]
    count = len(numbers)
    if not count or count < len(values):
        return Mean(None)
    mean = _rounded(fsum(numbers) / count)
    if count == 1 or (events and not any(numbers)):
        return Mean(mean)
    exact = fsum(numbers) / count
    spread = sqrt(fsum((value - exact) ** 2 for value in numbers) / (count - 1))
    half = student_t(count - 1) * spread / sqrt(count)
    low = exact - half
    if min(numbers) >= 0:  # times and counts, which are never less
        low = max(low, 0.0)
    return Mean(mean, _rounded(low), _rounded(exact + half))


def _rounded(value: float) -> float:
    return float(f"{value:.10g}") if isfinite(value) else value


@lru_cache(maxsize=4096)
def student_t(degrees: int, confidence: float = CONFIDENCE) -> float:
    """The t that |T| exceeds with probability 1 − ``confidence``, for whole ``degrees`` >= 1.

    Exact to about 1e-9 of its value: for whole degrees of freedom the distribution of |T| is a finite sum
    (Abramowitz and Stegun, Handbook of Mathematical Functions, 26.7.3 and 26.7.4), which is solved
    by halving; for many degrees it is expanded around the normal distribution (the same, 26.7.5).
    """
    if degrees < 1:
        raise ValueError(f"degrees (={degrees}) must be at least 1.")
    if not 0 < confidence < 1:
        raise ValueError(f"confidence (={confidence}) must be between 0 and 1.")
    if degrees > _EXPANDED_FROM:
        return _expanded(degrees, NormalDist().inv_cdf((1 + confidence) / 2))
    # Halving the angle atan(t / √degrees), which runs from 0 to π/2 whatever t is.
    low, high = 0.0, pi / 2
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if _within(middle, degrees) < confidence else (low, middle)
    return sqrt(degrees) * sin(low) / cos(low)


def _within(angle: float, degrees: int) -> float:
    """P(|T| <= √degrees · tan angle), for 0 <= angle < π/2."""
    square = cos(angle) ** 2
    if degrees % 2:
        total, term = 0.0, cos(angle)
        for number in range(1, degrees - 1, 2):
            total += term
            term *= square * (number + 1) / (number + 2)
        return 2 / pi * (angle + sin(angle) * total)
    total, term = 0.0, 1.0
    for number in range(0, degrees - 1, 2):
        total += term
        term *= square * (number + 1) / (number + 2)
    return sin(angle) * total


def _expanded(n: int, z: float) -> float:
    return (
        z
        + (z**3 + z) / (4 * n)
        + (5 * z**5 + 16 * z**3 + 3 * z) / (96 * n**2)
        + (3 * z**7 + 19 * z**5 + 17 * z**3 - 15 * z) / (384 * n**3)
        + (79 * z**9 + 776 * z**7 + 1482 * z**5 - 1920 * z**3 - 945 * z) / (92160 * n**4)
    )

"""Estimates with their confidence intervals, and the distance of a sample from a distribution.

Clopper and Pearson's interval (Biometrika 26, 1934), a likelihood interval for one parameter, and the
Kolmogorov-Smirnov distance with its asymptotic distribution (Numerical Recipes, 14.3).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import exp, expm1, fsum, log, log1p, sqrt
from statistics import NormalDist

#: How often an interval covers the truth.
CONFIDENCE = 0.95
_NORMAL = NormalDist().inv_cdf((1 + CONFIDENCE) / 2)
#: Half of chi-square's 95 % point with one degree of freedom: the fall of the log likelihood.
FALL = _NORMAL**2 / 2


@dataclass(frozen=True, slots=True)
class Estimate:
    """A value with its 95 % confidence interval (None where it is not known) and its sample size."""

    value: float
    low: float | None
    high: float | None
    count: int

    def widened(self, by: float) -> Estimate:
        """The same of a time that is not below 0, its interval longer at both ends: its clock is coarse."""
        low = None if self.low is None else max(min(0, self.value), self.low - by)
        return replace(self, low=low, high=None if self.high is None else self.high + by)


def mean(values: Sequence[float]) -> Estimate:
    """The mean of many values, with the normal distribution's interval. Raises ValueError without any."""
    count = len(values)
    if not count:
        raise ValueError("no values")
    middle = fsum(values) / count
    if count == 1:
        return Estimate(middle, None, None, 1)
    spread = sqrt(fsum((value - middle) ** 2 for value in values) / (count - 1))
    half = _NORMAL * spread / sqrt(count)
    return Estimate(middle, middle - half, middle + half, count)


def median(values: Sequence[int]) -> Estimate:
    """The lower median of many values, with the interval between two of them. Raises ValueError without any.

    Of order statistics (binomial with one half, rounded outwards): it contains the median that it is of.
    """
    if not values:
        raise ValueError("no values")
    ordered, count = sorted(values), len(values)
    half = _NORMAL * sqrt(count) / 2
    low, high = max(0, int(count / 2 - half)), min(count - 1, int(count / 2 + half) + 1)
    return Estimate(ordered[(count - 1) // 2], ordered[low], ordered[high], count)


def proportion(hits: int, trials: int) -> Estimate:
    """A probability from ``hits`` of ``trials``, with Clopper and Pearson's exact interval."""
    if not 0 <= hits <= trials or not trials:
        raise ValueError(f"{hits} of {trials}")
    from scipy.special import betaincinv

    tail = (1 - CONFIDENCE) / 2
    low = float(betaincinv(hits, trials - hits + 1, tail)) if hits else 0.0
    high = float(betaincinv(hits + 1, trials - hits, 1 - tail)) if hits < trials else 1.0
    return Estimate(hits / trials, low, high, trials)


def bit_error_rate(frames: Mapping[int, tuple[int, int]]) -> Estimate | None:
    """The bit error rate from frames by their size in bits: how many were sound and how many damaged.

    A frame of n bits is sound with probability (1 - ber)^n: the most likely rate, and the interval in
    which the likelihood falls by less than chi-square's 95 % point. None without frames.
    """
    sound = {bits: counts[0] for bits, counts in frames.items()}
    damaged = {bits: counts[1] for bits, counts in frames.items() if counts[1]}
    count = sum(sound.values()) + sum(damaged.values())
    if not count:
        return None

    def likelihood(rate: float) -> float:
        whole = log1p(-rate)
        total = fsum(number * bits * whole for bits, number in sound.items())
        return total + fsum(number * log(-expm1(bits * whole)) for bits, number in damaged.items())

    if not damaged:
        high = FALL / sum(bits * number for bits, number in sound.items())
        return Estimate(0.0, 0.0, high, count)
    if not any(sound.values()):
        return Estimate(0.5, None, 0.5, count)
    from scipy.optimize import brentq, minimize_scalar

    # On a logarithmic scale, between a rate at which no damage is likely and one at which nothing is sound.
    ends = log(1e-15), log(0.5)
    best = float(minimize_scalar(lambda x: -likelihood(exp(x)), bounds=ends, method="bounded").x)
    least = likelihood(exp(best)) - FALL

    def above(x: float) -> float:
        return likelihood(exp(x)) - least

    low, high = (exp(brentq(above, best, end) if above(end) < 0 else end) for end in ends)
    return Estimate(exp(best), low, high, count)


@dataclass(frozen=True, slots=True)
class Fit:
    """How two samples, or a sample and a distribution, agree: their distance and how likely it is."""

    distance: float
    p: float


def against_uniform(values: Sequence[float], low: float, high: float) -> Fit:
    """The distance of a sample from the uniform distribution over ``low`` … ``high``."""
    ordered, count = sorted(values), len(values)
    span = high - low
    distance = 0.0
    for rank, value in enumerate(ordered):
        distribution = min(1.0, max(0.0, (value - low) / span)) if span > 0 else 1.0
        distance = max(distance, abs(distribution - rank / count), abs((rank + 1) / count - distribution))
    return Fit(distance, kolmogorov_p(distance, count))


def kolmogorov_p(distance: float, size: float) -> float:
    """The probability of at least this distance of a sample from its distribution.

    For independent values; with many equal ones it is too large, never too small. Of two samples ``size`` is
    the product of their sizes over the sum.
    """
    from scipy.special import kolmogorov

    root = sqrt(size)
    return float(kolmogorov((root + 0.12 + 0.11 / root) * distance))

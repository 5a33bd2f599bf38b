"""Estimates with their confidence intervals, and the distance of two samples.

Clopper and Pearson's interval (Biometrika 26, 1934), a likelihood interval for one parameter, and the
Kolmogorov-Smirnov distance with its asymptotic distribution (Numerical Recipes, 14.3).
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import exp, expm1, fsum, log, log1p, sqrt
from statistics import NormalDist

#: How often an interval covers the truth.
CONFIDENCE = 0.95
_NORMAL = NormalDist().inv_cdf((1 + CONFIDENCE) / 2)
#: Half of chi-square's 95 % point with one degree of freedom: the fall of the log likelihood.
_FALL = _NORMAL**2 / 2
_STEPS = 200


@dataclass(frozen=True, slots=True)
class Estimate:
    """A value with its 95 % confidence interval (None where it is not known) and its sample size."""

    value: float
    low: float | None
    high: float | None
    count: int


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


def _root(rising: Callable[[float], float], low: float, high: float) -> float:
    """Where a rising function crosses zero."""
    for _ in range(_STEPS):
        middle = (low + high) / 2
        if rising(middle) < 0:
            low = middle
        else:
            high = middle
    return (low + high) / 2


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
        high = _FALL / sum(bits * number for bits, number in sound.items())
        return Estimate(0.0, 0.0, high, count)
    if not any(sound.values()):
        return Estimate(0.5, None, 0.5, count)
    best = _highest(likelihood, 1e-15, 0.5)
    least = likelihood(best) - _FALL
    low = _crossing(lambda rate: likelihood(rate) - least, 1e-15, best)
    high = _crossing(lambda rate: least - likelihood(rate), best, 0.5)
    return Estimate(best, low, high, count)


def _highest(function: Callable[[float], float], low: float, high: float) -> float:
    """Where a function with one hill is highest, by golden section on a logarithmic scale."""
    golden = (sqrt(5) - 1) / 2
    a, b = log(low), log(high)
    for _ in range(_STEPS):
        c, d = b - golden * (b - a), a + golden * (b - a)
        if function(exp(c)) >= function(exp(d)):
            b = d
        else:
            a = c
    return exp((a + b) / 2)


def _crossing(rising: Callable[[float], float], low: float, high: float) -> float:
    """Where a rising function crosses zero, searched on a logarithmic scale."""
    return exp(_root(lambda x: rising(exp(x)), log(low), log(high)))


@dataclass(frozen=True, slots=True)
class Fit:
    """How two samples, or a sample and a distribution, agree: their distance and how likely it is."""

    distance: float
    p: float


def compare(first: Sequence[float], second: Sequence[float]) -> Fit:
    """The Kolmogorov-Smirnov distance of two samples. Raises ValueError if one is empty.

    ``p`` is the probability of at least this distance if both came from one distribution (for independent
    samples; with many equal values it is too large, never too small).
    """
    if not first or not second:
        raise ValueError("an empty sample")
    one, two = sorted(first), sorted(second)
    distance = max(
        abs(bisect_right(one, value) / len(one) - bisect_right(two, value) / len(two))
        for value in {*one, *two}
    )
    return Fit(distance, _kolmogorov(distance, len(one) * len(two) / (len(one) + len(two))))


def against_uniform(values: Sequence[float], low: float, high: float) -> Fit:
    """The distance of a sample from the uniform distribution over ``low`` … ``high``."""
    ordered, count = sorted(values), len(values)
    span = high - low
    distance = 0.0
    for rank, value in enumerate(ordered):
        distribution = min(1.0, max(0.0, (value - low) / span)) if span > 0 else 1.0
        distance = max(distance, abs(distribution - rank / count), abs((rank + 1) / count - distribution))
    return Fit(distance, _kolmogorov(distance, count))


def _kolmogorov(distance: float, size: float) -> float:
    from scipy.special import kolmogorov

    root = sqrt(size)
    return float(kolmogorov((root + 0.12 + 0.11 / root) * distance))

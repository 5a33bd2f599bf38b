"""Means of repeated runs and their 95 % confidence intervals."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import ceil, exp, floor, fsum, isfinite, log10, sqrt

#: How often an interval covers the true mean, for figures that are spread normally.
CONFIDENCE = 0.95
#: Repeats are enough for a mean from so many on, where its interval is within so much of it on either side.
LEAST_REPEATS, WITHIN = 3, 0.1


@dataclass(frozen=True, slots=True)
class Mean:
    """A mean and the limits of its confidence interval, None where they are not known.

    ``needed`` is how many repeats would be enough for it (see :data:`WITHIN`), by the spread of those
    that there are; None where nothing is known of the spread, or the mean is 0.
    """

    mean: float | None
    low: float | None = None
    high: float | None = None
    needed: int | None = None

    def too_few(self, repeats: int) -> bool:
        """Whether so many repeats are known to be too few."""
        return self.needed is not None and self.needed > repeats


def mean_of(values: Sequence[float | None], *, events: bool = False) -> Mean:
    """The mean of a figure over the repeats of a point, with its 95 % confidence interval.

    The interval is Student's, mean ± t · s / √n with n − 1 degrees of freedom: for a handful of
    repeats the normal distribution's 1.96 would be far too small (n = 5: 2.78). It ends at 0 for figures that
    are never less, which takes nothing from its coverage. The repeats are independent;
    each figure is itself a mean or a count over many link scans, so that it is roughly normal.

    Counts of rare ``events``, and shares of them, are not. Theirs is that of the mean's logarithm, which is
    above 0 and longer upwards, and a whole count's spread is at least the √mean of Poisson's distribution,
    which a few repeats may not show.

    Where a figure is None in a repeat (a quantile that takes more scans) the mean is None as well:
    the others alone would be a choice that depends on the result. One repeat has no interval. Nor
    has a count of ``events`` that is 0 in every repeat: never seen is not never.
    """
    numbers = [value for value in values if value is not None]
    count = len(numbers)
    if not count or count < len(values):
        return Mean(None)
    mean = fsum(numbers) / count
    if count == 1 or (events and not any(numbers)):
        return Mean(_rounded(mean))
    spread = sqrt(fsum((value - mean) ** 2 for value in numbers) / (count - 1))
    counts = events and all(isinstance(value, int) for value in numbers)
    if counts:
        spread = max(spread, sqrt(mean))
    half = student_t(count - 1) * spread / sqrt(count)
    low, high = mean - half, mean + half
    if events:
        low, high = mean * exp(-half / mean), mean * exp(half / mean)
        high = high if counts else min(high, 1.0)
    elif min(numbers) >= 0:  # times and counts, which are never less
        low = max(low, 0.0)
    return Mean(_rounded(mean), _rounded(low), _rounded(high), _needed(mean, spread))


def _needed(mean: float, spread: float) -> int | None:
    if mean <= 0:
        return None
    repeats = max(LEAST_REPEATS, ceil((student_t(1_000_000) * spread / (WITHIN * mean)) ** 2))
    while student_t(repeats - 1) * spread / sqrt(repeats) > WITHIN * mean:
        repeats += 1
    return repeats


def _rounded(value: float) -> float:
    return float(f"{value:.10g}") if isfinite(value) else value


@lru_cache(maxsize=4096)
def student_t(degrees: int, confidence: float = CONFIDENCE) -> float:
    """The t that |T| exceeds with probability 1 − ``confidence``, for whole ``degrees`` >= 1."""
    if degrees < 1:
        raise ValueError(f"degrees (={degrees}) must be at least 1.")
    if not 0 < confidence < 1:
        raise ValueError(f"confidence (={confidence}) must be between 0 and 1.")
    from scipy.special import stdtrit

    return float(stdtrit(degrees, (1 + confidence) / 2))


#: What a text ends with where the repeats are too few, and where an event was in no run.
TOO_FEW, NEVER = "*", "°"


def with_interval(mean: Mean, values: Sequence[float | None]) -> str:
    """A mean as ``50.424 ± 0.056``, the interval rounded up.

    ``values`` are the runs. Where they are too few it is the least and the greatest of them, with
    :data:`TOO_FEW` behind; of events that were in no run ``0`` with :data:`NEVER`.
    """
    if mean.mean is None:
        return "–"
    if mean.too_few(len(values)):
        known = [value for value in values if value is not None]
        return "–".join(dict.fromkeys(_plain(value) for value in (min(known), max(known)))) + TOO_FEW
    if mean.low is None or mean.high is None:
        return _plain(mean.mean) + (NEVER if not mean.mean and len(values) > 1 else "")
    half = max(mean.high - mean.mean, mean.mean - mean.low)
    if not half:
        return f"{_plain(mean.mean)} ± 0"
    decimals = min(max(0, 1 - floor(log10(half))), 6)
    return f"{mean.mean:,.{decimals}f} ± {ceil(round(half * 10**decimals, 6)) / 10**decimals:,.{decimals}f}"


def _plain(value: float) -> str:
    """A number by itself: whole, with two decimals, or below 1 with three digits."""
    if value == int(value):
        return f"{value:,.0f}"
    return f"{value:,.2f}" if abs(value) >= 1 else f"{value:.3g}"


def footnotes(texts: str, repeats: int, needed: Mapping[str, int] | None = None) -> list[str]:
    """What the marks in texts mean; ``needed`` is how many repeats are enough, by figure.

    Of n runs (1 − p)^n is the chance that an event which a run has with the chance p is in none.
    """
    found = []
    if TOO_FEW in texts:
        more = ", ".join(f"{number:,} ({title})" for title, number in (needed or {}).items())
        text = f"{repeats} repeats are too few for a mean within ±{100 * WITHIN:g} %"
        found.append(f"{TOO_FEW} least and greatest run: {text}{more and f'; it takes at least {more}'}")
    if NEVER in texts:
        most = ceil(100 * (1 - (1 - CONFIDENCE) ** (1 / repeats)))
        found.append(f"{NEVER} in none of {repeats} runs; with 95 % confidence in at most {most} % of all")
    return found

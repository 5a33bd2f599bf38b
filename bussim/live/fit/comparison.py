"""Whether a simulation of the estimates behaves like the recording that they are of, tail included."""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from math import erfc, sqrt
from statistics import fmean, variance

from bussim.live.fit.statistics import Fit, kolmogorov_p
from bussim.units import milliseconds

#: They differ if a figure would by chance less often than this, whatever the number of figures.
_DIFFERS = 0.01
#: Values that follow each other may depend on each other: so many are one in the tail.
_BLOCK = 20
#: Shares of the recording beyond which the tail is compared, and the least values that have one.
_TAIL, _LEAST = (0.1, 0.01, 0.001), 100
#: Times that differ by less of their mean are alike; more values than this tell nothing that matters.
_ALIKE, _MOST = 0.002, 2000


@dataclass(frozen=True, slots=True)
class Behaviour:
    """What a line did: durations in order (ticks), attempts and how many failed, and what is counted.

    ``again``: the share of attempts behind a failed one that failed, too. ``load`` is None on an N:N link,
    ``distances`` are what its mean is made of; ``station_errors`` is None where there are none to count.
    """

    times: Sequence[int]
    distances: Sequence[int]
    failed: int
    attempts: int
    again: float | None
    load: float | None = None
    station_errors: int | None = None


@dataclass(frozen=True, slots=True)
class Figure:
    """A figure of both, and the probability of such a difference by chance."""

    name: str
    measured: float
    simulated: float
    p: float


@dataclass(frozen=True, slots=True)
class Comparison:
    """All figures, and those that differ. ``tail``: there were enough values to judge it."""

    fit: Fit
    figures: tuple[Figure, ...]
    tail: bool

    @property
    def differs(self) -> tuple[Figure, ...]:
        """The figures that differ by more than chance."""
        return tuple(each for each in self.figures if each.p * len(self.figures) < _DIFFERS)

    @property
    def verdict(self) -> str:
        """Whether the simulation behaves like the recording."""
        return "differs" if self.differs else "agrees"


def compare(measured: Behaviour, simulated: Behaviour, resolution: int = 0) -> Comparison:
    """The figures of a recording, whose times are exact to ``resolution`` ticks, against a simulation's.

    Raises ValueError if one has no times.
    """
    both = measured, simulated
    if not all(each.times for each in both):
        raise ValueError("no times to compare")
    grain = 2 * resolution + _ALIKE * fmean(measured.times)
    distance = _distance(sorted(measured.times), sorted(simulated.times), grain)
    one, two = (min(_MOST, len(each.times) / _dependence(each.times)) for each in both)
    fit = Fit(distance, kolmogorov_p(distance, one * two / (one + two)))
    figures = [Figure("distribution", 0.0, distance, fit.p), _mean(measured, simulated, resolution)]
    failures = [(each.failed, each.attempts) for each in both]
    figures.append(_shares("failed_attempts", failures, max(_groups(each) for each in both)))
    errors = [(each.station_errors, each.attempts) for each in both if each.station_errors is not None]
    if len(errors) == len(both):
        figures.append(_shares("station_errors", errors, 1.0))
    tail = min(len(each.times) for each in both) >= _LEAST
    if tail:
        ordered = sorted(measured.times)
        for share in _TAIL:
            limit = ordered[len(ordered) - 1 - int(len(ordered) * share)]
            figures.append(_beyond(f"beyond_{1 - share:.1%}", measured, simulated, limit, grain))
        figures.append(_longest(measured, simulated, grain))
    return Comparison(fit, tuple(figures), tail)


def _distance(one: Sequence[int], two: Sequence[int], grain: float) -> float:
    """Kolmogorov and Smirnov's distance of two sorted samples, whose values are alike within a grain."""

    def above(first: Sequence[int], second: Sequence[int]) -> float:
        return max(
            (rank + 1) / len(first) - bisect_right(second, value + grain) / len(second)
            for rank, value in enumerate(first)
        )

    return max(0.0, above(one, two), above(two, one))


def _dependence(values: Sequence[int]) -> float:
    """By how much the variance of a mean is larger than if the values were independent; at least 1."""
    blocks = [fmean(values[at : at + _BLOCK]) for at in range(0, len(values) - _BLOCK + 1, _BLOCK)]
    whole = variance(values) if len(values) > 1 else 0.0
    return max(1.0, _BLOCK * variance(blocks) / whole) if len(blocks) > 2 and whole else 1.0


def _groups(behaviour: Behaviour) -> float:
    """The same of failures of which one brings the next about with the probability ``again``."""
    if behaviour.again is None or not 0 < behaviour.failed < behaviour.attempts:
        return 1.0
    share = behaviour.failed / behaviour.attempts
    follows = min(0.95, max(0.0, (behaviour.again - share) / (1 - share)))
    return (1 + follows) / (1 - follows)


def _mean(measured: Behaviour, simulated: Behaviour, resolution: int) -> Figure:
    both = [each for each in (measured, simulated) if len(each.distances) > 1]
    means = [fmean(each.distances) for each in both]
    p = 1.0
    if len(both) == 2:
        known = [
            variance(each.distances) * _dependence(each.distances) / len(each.distances) for each in both
        ]
        apart = max(0.0, abs(means[0] - means[1]) - 2 * resolution - _ALIKE * means[0])
        p = erfc(apart / sqrt(2 * sum(known))) if any(known) else float(not apart)
    if measured.load is not None and simulated.load is not None:
        return Figure("load", measured.load, simulated.load, p)
    first, second = (milliseconds(mean) for mean in (means if len(means) == 2 else (0, 0)))
    return Figure("mean_ms", first, second, p)


def _shares(name: str, counts: Sequence[tuple[int, int]], groups: float) -> Figure:
    """Two shares by Fisher's exact test; only one of so many trials is independent of the others."""
    import numpy as np
    from scipy.stats import fisher_exact

    table = np.array([[hits, max(0, trials - hits)] for hits, trials in counts]) / groups
    shares = [hits / max(1, trials) for hits, trials in counts]
    return Figure(name, shares[0], shares[1], float(fisher_exact(np.rint(table).astype(int)).pvalue))


def _blocks_beyond(behaviour: Behaviour, limit: float) -> tuple[int, int]:
    times = behaviour.times
    starts = range(0, len(times), _BLOCK)
    return sum(max(times[at : at + _BLOCK]) > limit for at in starts), len(starts)


def _beyond(name: str, measured: Behaviour, simulated: Behaviour, limit: int, grain: float) -> Figure:
    """The shares of times beyond a limit; that of a simulation may be taken anywhere within the grain."""
    counted = _blocks_beyond(measured, limit)
    low, high = both = [_blocks_beyond(simulated, limit + by) for by in (grain, -grain)]
    within = low[0] * counted[1] <= counted[0] * low[1] and counted[0] * high[1] <= high[0] * counted[1]
    p = 1.0 if within else max(_shares(name, [counted, each], 1.0).p for each in both)
    shares = [sum(time > limit for time in each.times) / len(each.times) for each in (measured, simulated)]
    return Figure(name, shares[0], shares[1], p)


def _longest(measured: Behaviour, simulated: Behaviour, grain: float) -> Figure:
    """How likely so many of the longest times are all in one of the two."""
    both = measured, simulated
    longest = [max(each.times) for each in both]
    beyond = [_blocks_beyond(each, other + grain) for each, other in zip(both, longest[::-1], strict=True)]
    blocks = sum(number for _, number in beyond)
    p = min(2 * (number / blocks) ** hits if hits else 1.0 for hits, number in beyond)
    return Figure("longest_ms", milliseconds(longest[0]), milliseconds(longest[1]), min(1.0, p))

"""The distribution of a station's turnaround, from measured ones."""

from collections.abc import Sequence
from dataclasses import dataclass

from bussim.live.fit.statistics import Fit, against_uniform

#: A uniform distribution is kept unless a sample is less likely than this under it.
_DOUBT = 0.01
#: Values of a measured distribution.
_VALUES = 32
#: So many are compared at most: with more every real sample differs from every distribution.
_COMPARED = 2000


@dataclass(frozen=True, slots=True)
class TurnaroundDistribution:
    """Mean and jitter in ticks; where a uniform distribution does not fit, ``values`` of equal weight.

    ``fit`` is the distance of the sample from the uniform distribution.
    """

    mean: int
    jitter: int
    values: tuple[int, ...]
    fit: Fit


def distribution_of(turnarounds: Sequence[int]) -> TurnaroundDistribution:
    """The distribution of at least one turnaround (ticks).

    The ends of a uniform distribution are those of the sample, moved outwards by what its size hides on
    the average; its middle is the sample's mean.
    """
    count = len(turnarounds)
    middle = sum(turnarounds) / count
    low, high = min(turnarounds), max(turnarounds)
    half = (high - low) / 2 * ((count + 1) / (count - 1) if count > 1 else 1)
    half = min(half, middle)  # no turnaround is below 0
    step = -(-count // _COMPARED)
    fit = against_uniform(turnarounds[::step], middle - half, middle + half)
    values: tuple[int, ...] = ()
    if fit.p < _DOUBT and low < high:
        ordered = sorted(turnarounds)
        values = tuple(ordered[(2 * number + 1) * count // (2 * _VALUES)] for number in range(_VALUES))
    return TurnaroundDistribution(round(middle), round(half), values, fit)

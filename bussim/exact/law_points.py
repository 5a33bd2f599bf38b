"""Points of a distribution for a drawing: few enough for a page, and steps stay steps."""

from typing import NamedTuple

import numpy as np

from bussim.exact.metrics import tail_curve
from bussim.exact.scan.mixture import Distribution
from bussim.exact.scan.turnaround_sums import Codes, Floats
from bussim.units import TICKS_PER_MS

#: Points in each step that shows, by parts of its width: it is steepest at its end. A step shows whose weight
#: is more than this part of all beyond it; so many are looked at, the highest ones.
_WITHIN = np.unique(np.concatenate((np.arange(1, 8) / 8, 1 - 0.5 ** np.arange(1, 12))))
_SHOWS, _STEPS = 0.05, 60
#: Below this part of the least probability a curve has reached its end.
_NOTHING = 1e-3


class LawPoints(NamedTuple):
    """Points of P(time > x) from left to right: x in ms, and the probabilities."""

    x: list[float]
    y: list[float]


def law_points(distribution: Distribution, least: float = 1e-9, points: int = 1_300) -> LawPoints:
    """At most ``points`` points of P(time > x), from 1 down to the probability ``least``.

    They are for lines between them on a logarithmic axis of probabilities. Where a time has a probability of
    its own there is a point just before it. Of more points than are wanted those go that lie nearest to the
    line between their neighbours.

    Raises ValueError for ``least`` beyond 0 and 1, and for less than two points.
    """
    if not (0 < least < 1 and points > 1):
        raise ValueError(f"least is {least!r}, allowed are numbers between 0 and 1; points: {points}, from 2")
    x, y = tail_curve(distribution, least, points)
    begin, end, weight = distribution.shift, distribution.upper, distribution.weight
    high = np.flatnonzero(weight >= least)
    height = weight[high] / (weight[high] + distribution.tail(end[high]))
    steps = high[(height > _SHOWS) & (height >= np.sort(height)[-_STEPS:][0])]
    within = begin[steps, None] + (end - begin)[steps, None] * _WITHIN
    # Just before a jump, and in a step that takes a time.
    more = np.concatenate((within.ravel(), begin[high][end[high] == begin[high]] - 1)) / TICKS_PER_MS
    more = more[(more > x[0]) & (more < x[-1])]
    x, place = np.unique(np.concatenate((x, more)), return_index=True)
    y = np.concatenate((y, distribution.tail(more * TICKS_PER_MS)))[place]
    kept = _kept(x, np.log(np.maximum(y, _NOTHING * least)), points)
    return LawPoints(x[kept].tolist(), y[kept].tolist())


def _kept(x: Floats, y: Floats, points: int) -> Codes:
    """The indices of the points that stay, by turns of the odd and the even ones that are left."""
    kept, odd = np.arange(x.size), 0
    while kept.size > points:
        odd = 1 - odd
        inner = np.arange(2 - odd, kept.size - 1, 2)
        left, at, right = kept[inner - 1], kept[inner], kept[inner + 1]
        line = y[left] + (y[right] - y[left]) * (x[at] - x[left]) / (x[right] - x[left])
        nearest = np.argsort(np.abs(y[at] - line), kind="stable")
        few = min(kept.size - points, -(-inner.size // 4))
        kept = np.delete(kept, inner[nearest[:few]])
    return kept

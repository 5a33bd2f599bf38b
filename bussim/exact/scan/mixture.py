"""A distribution as components: weighted, shifted sums of turnarounds.

A link scan in which so many attempts failed in such ways lasts a fixed time plus the spreads of the
turnarounds in it. So the distribution is a sum of *components*, each with a weight, a shift and a code
that names its sum of spreads (:mod:`bussim.exact.scan.turnaround_sums`). A probability is a sum of
positive terms; nothing is subtracted from 1, and no transform of the whole distribution rounds its tail
away.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bussim.exact.scan.turnaround_sums import Codes, Floats, TurnaroundSums, by_code

#: Components lighter than this are dropped.
FLOOR = 1e-30

#: A search cuts its bracket into so many parts at once. First tables narrow it down to a part of
#: the narrowest spread; then exact tails are computed so far around, until they differ by so little
#: that the tail is straight between them, or are so close (ticks) that it jumps there.
_CUTS = np.arange(1, 48) / 48
_ENDS = np.arange(9) / 8
_ROUGH, _REACH = 1 / 128, 1 / 64
_STRAIGHT, _NARROW = 0.01, 1e-3
#: About so many pairs of (x, component) are computed at once.
_PAIRS = 2_000_000


@dataclass(frozen=True, slots=True, eq=False)
class Distribution:
    """The distribution of a duration in ticks.

    ``shift`` (ticks), ``code`` and ``weight`` have one entry a component; ``sums`` knows the codes. The
    weights add up to 1 but for ``lost``, the weight of components that were dropped.
    """

    shift: Floats
    code: Codes
    weight: Floats
    sums: TurnaroundSums
    lost: float = 0.0

    @property
    def upper(self) -> Floats:
        """The greatest value of each component, in ticks; the least is its shift."""
        return self.shift + self.sums.widths(self.code)

    @property
    def middle(self) -> Floats:
        """The mean of each component, in ticks."""
        return self.shift + self.sums.means(self.code)

    @property
    def support(self) -> tuple[float, float]:
        """Least and greatest value, in ticks."""
        return float(self.shift.min()), float(self.upper.max())

    @property
    def mean(self) -> float:
        """The mean, in ticks."""
        return float(self.weight @ self.middle / self.weight.sum())

    @property
    def variance(self) -> float:
        """The variance, in ticks²."""
        away = self.middle - self.mean
        within = self.sums.variances(self.code)
        return float(self.weight @ (away * away + within) / self.weight.sum())

    # -- tails -------------------------------------------------------------------------------------

    def tail(self, x: ArrayLike) -> Floats:
        """P(duration > x) for any shape of x, in ticks."""
        x = np.asarray(x, dtype=np.float64)
        flat = x.reshape(-1)
        beyond = _sum_beyond(self.shift, self.weight, flat)
        # The weights add up to 1 but for rounding, which must not show as more than that.
        return np.minimum(beyond + self._within(flat, self.sums.tail), 1.0).reshape(x.shape)

    def excess(self, x: ArrayLike) -> Floats:
        """E[max(0, duration - x)] in ticks: the integral of the tail from x on."""
        x = np.asarray(x, dtype=np.float64)
        flat = x.reshape(-1)
        beyond = _sum_beyond(self.shift, self.weight * self.middle, flat)
        beyond -= flat * _sum_beyond(self.shift, self.weight, flat)
        return (np.maximum(beyond, 0.0) + self._within(flat, self.sums.excess)).reshape(x.shape)

    def _within(self, x: Floats, part: Callable[[int, Floats], Floats]) -> Floats:
        """The sum of weight × ``part`` over the components that x lies in."""
        order = np.argsort(x, kind="stable")
        begin, end = (np.searchsorted(x[order], edges) for edges in (self.shift, self.upper))
        total = np.zeros(x.size)
        counts = np.maximum(end - begin, 0)
        parts = np.flatnonzero(np.diff(np.cumsum(counts) // _PAIRS, prepend=0))
        for chosen in np.split(np.arange(counts.size), parts):
            component = np.repeat(chosen, counts[chosen])
            first = np.cumsum(counts[chosen]) - counts[chosen]
            at = order[np.arange(component.size) - np.repeat(first - begin[chosen], counts[chosen])]
            values = by_code(part, self.code[component], x[at] - self.shift[component])
            total += np.bincount(at, weights=self.weight[component] * values, minlength=x.size)
        return total

    # -- quantiles ---------------------------------------------------------------------------------

    def quantile(self, q: float) -> float:
        """The least x, in ticks, with P(duration > x) <= q (0 < q < 1).

        Between two components the tail is flat; there it is the upper end of the lower component.
        """
        if not 0.0 < q < 1.0:
            raise ValueError(f"q is {q!r}, allowed are numbers between 0 and 1")
        upper = self.upper
        low = _edge(self.shift, self.weight, q)
        high = _edge(upper, self.weight, q)
        if low >= high:
            return high
        # The lightest components change the tail by less than 1e-10 of q.
        heavy = self.weight > q * 1e-10 / self.shift.size
        inner = _Segment(0.0, self.shift, upper, self.code, self.weight, self.sums).between(low, high, heavy)
        left, right = inner.rough(q, low, high)
        while True:
            near = inner.between(left, right)
            cuts = left + (right - left) * _ENDS
            tails = near.tail(cuts)
            index = int(np.count_nonzero(tails > q))
            if index == 0 and left > low:
                left, right = low, left
            elif index == cuts.size and right < high:
                left, right = right, high
            elif index in (0, cuts.size):
                return float(left if index == 0 else right)
            else:
                left, right = float(cuts[index - 1]), float(cuts[index])
                above, below = float(tails[index - 1]), float(tails[index])
                if self.sums.smooth and above - below <= _STRAIGHT * above:
                    return left + (right - left) * (above - q) / (above - below)
                if right - left <= max(_NARROW, 4 * np.spacing(right)):
                    return right


def _edge(edges: Floats, weight: Floats, q: float) -> float:
    """The edge at and above which components of more than q lie, but not above it.

    ``edges`` are the upper or the lower ends of the components.
    Taken from the lower ends it is a lower bound of the quantile, from the upper ends an upper one.
    """
    order = np.argsort(-edges, kind="stable")
    beyond = np.cumsum(weight[order])
    return float(edges[order[min(int(np.searchsorted(beyond, q, side="right")), order.size - 1)]])


class _Segment(NamedTuple):
    """A distribution between two x: components that lie beyond count whole, those before it not at all."""

    whole: float
    shift: Floats
    upper: Floats
    code: Codes
    weight: Floats
    sums: TurnaroundSums

    def between(self, low: float, high: float, heavy: NDArray[np.bool_] | None = None) -> _Segment:
        """The part of it between two x, of the heavy components only, where that is given."""
        above = self.shift >= high
        inside = ~above & (self.upper > low)
        chosen = np.nonzero(inside if heavy is None else inside & heavy)[0]
        parts = self.shift[chosen], self.upper[chosen], self.code[chosen], self.weight[chosen]
        return _Segment(self.whole + float(self.weight[above].sum()), *parts, self.sums)

    def rough(self, q: float, low: float, high: float) -> tuple[float, float]:
        """Bounds around the quantile by tables of the spreads' tails; it may lie outside all the same."""
        width = self.sums.narrowest
        left, right, inner = low, high, self
        while right - left > _ROUGH * width:
            inner = inner.between(left, right)
            cuts = left + (right - left) * _CUTS
            parts = inner.sums.rough_tail(inner.code, cuts[:, None] - inner.shift)
            tails = inner.whole + np.einsum("ij,j->i", parts, inner.weight)
            index = int(np.count_nonzero(tails > q))  # the tail never rises: all before it are above
            left = float(cuts[index - 1]) if index else left
            right = float(cuts[index]) if index < cuts.size else right
        return max(low, left - _REACH * width), min(high, right + _REACH * width)

    def tail(self, x: Floats) -> Floats:
        """P(duration > x) for x between the two."""
        total = np.full(x.size, self.whole)
        for code in set(self.code.tolist()):
            chosen = np.nonzero(self.code == code)[0]
            parts = self.sums.tail(code, x[:, None] - self.shift[chosen])
            total += np.einsum("ij,j->i", parts, self.weight[chosen])
        return total


def _sum_beyond(edges: Floats, values: Floats, x: Floats) -> Floats:
    """For each x the sum of the values whose edge lies above it, the smallest terms first."""
    order = np.argsort(edges, kind="stable")
    sums = np.concatenate((np.cumsum(values[order][::-1])[::-1], [0.0]))
    return np.asarray(sums[np.searchsorted(edges[order], x, side="right")], dtype=np.float64)


def merged(shift: Floats, code: Codes, weight: Floats) -> tuple[Floats, Codes, Floats]:
    """Components with equal shift and code put together. ``weight`` may have further axes after the first."""
    if shift.size == 0:
        return shift, code, weight
    order = np.lexsort((code, shift))
    shift, code, weight = shift[order], code[order], weight[order]
    new = np.empty(shift.size, dtype=bool)
    new[0] = True
    np.logical_or(shift[1:] != shift[:-1], code[1:] != code[:-1], out=new[1:])
    starts = np.nonzero(new)[0]
    return shift[starts], code[starts], np.add.reduceat(weight, starts, axis=0)

"""Distributions of sums of independent turnarounds, the continuous part of a link scan.

A turnaround is its least value plus a *spread*, from 0 to a width. Sums are named by a code that
counts how many spreads of each kind they have; the least values belong to the components' shifts.
Everything is computed from positive terms, so that a tail is as exact, relatively, as the middle.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from math import gcd
from threading import Lock

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bussim.plc.profiles import Turnaround
from bussim.units import TICKS_PER_US

Floats = NDArray[np.float64]
Codes = NDArray[np.int64]

#: Bits of a code for the count of one kind, how many kinds of turnaround fit, and the bits of all counts:
#: those of the turnarounds and that of the ends of torn replies.
DIGIT = 11
MAX_KINDS = 4
COUNTS = DIGIT * (MAX_KINDS + 1)
#: The greatest count.
MOST = (1 << DIGIT) - 1
_MASK = MOST

#: Steps (ticks) of the grid on which spreads of several kinds are added up: the fine one while the
#: widest spread has no more cells than this on it.
_FINE, _COARSE, _FINE_CELLS = TICKS_PER_US, 10 * TICKS_PER_US, 2_000


def spread_of(distribution: Turnaround) -> tuple[int, int]:
    """Least value and width of a turnaround, in ticks."""
    if distribution.values:
        return min(distribution.values), max(distribution.values) - min(distribution.values)
    return distribution.mean - distribution.jitter, 2 * distribution.jitter


def irwin_hall_tail(count: int, z: ArrayLike) -> Floats:
    """P(U1 + … + Ucount > z) for independent U, uniform over [0, 1].

    By the recursion of B-splines from the upper end, whose terms are all positive: the relative
    error stays near that of the additions for any z, also where the result is 1e-300.
    """
    t = count - np.asarray(z, dtype=np.float64)
    if count == 0:
        return (t > 0).astype(np.float64)
    # The tail is the distribution function at t: the sum of the splines of order count+1 at t, t-1, ….
    inside = _splines(count + 1, np.clip(t, 0.0, count)).sum(axis=0)
    return np.asarray(np.where(t >= count, 1.0, inside), dtype=np.float64)


#: Points a unit of the table that searches use, and the counts that it has at most.
_TABLE_POINTS = 64
TABLE_COUNTS = 48


@lru_cache(maxsize=4)
def _table(counts: int) -> Floats:
    """Entry (m, i): P(sum of m uniforms > i / 64), for m up to ``counts``, then zeros."""
    z = np.arange(counts * _TABLE_POINTS + 2) / _TABLE_POINTS
    table = np.stack([irwin_hall_tail(count, z) for count in range(counts + 1)])
    table.setflags(write=False)
    return table


def irwin_hall_excess(count: int, z: ArrayLike) -> Floats:
    """E[max(0, U1 + … + Ucount - z)], the integral of the tail from z on."""
    z = np.asarray(z, dtype=np.float64)
    if count == 0:
        return np.asarray(np.maximum(-z, 0.0), dtype=np.float64)
    t = np.clip(count - z, 0.0, count)
    splines = _splines(count + 2, t)
    weights = np.arange(1, splines.shape[0] + 1, dtype=np.float64)
    return np.asarray(np.tensordot(weights, splines, axes=1) + np.maximum(-z, 0.0), dtype=np.float64)


def _splines(order: int, t: Floats) -> Floats:
    """Cardinal B-splines of an order on [0, order] at t, t-1, …, t-order+1 (first axis)."""
    cells = np.arange(order, dtype=np.float64).reshape((order,) + (1,) * t.ndim)
    x = t - cells
    splines = ((x >= 0.0) & (x < 1.0)).astype(np.float64)
    for rank in range(2, order + 1):
        # N_r(x) = (x N_(r-1)(x) + (r - x) N_(r-1)(x - 1)) / (r - 1)
        upper = splines[1:] * (rank - x[:-1])
        splines *= x
        splines[:-1] += upper
        splines /= rank - 1
    return splines


@dataclass(frozen=True, slots=True)
class _Kind:
    """One kind of spread: uniform over [0, width] ticks, or atoms with probabilities."""

    width: float
    mean: float
    variance: float
    atoms: tuple[tuple[int, float], ...]


@lru_cache(maxsize=64)
def _kind_of(distribution: Turnaround) -> _Kind:
    least, width = spread_of(distribution)
    if not distribution.values:
        # Whole ticks are drawn, which makes the variance larger by a factor 1 + 2/width: neglected.
        return _Kind(float(width), width / 2, width * width / 12, ())
    total = sum(distribution.weights)
    chances: dict[int, float] = {}
    for value, weight in zip(distribution.values, distribution.weights, strict=True):
        chances[value - least] = chances.get(value - least, 0.0) + weight / total
    mean = sum(value * chance for value, chance in chances.items())
    variance = sum((value - mean) ** 2 * chance for value, chance in chances.items())
    return _Kind(float(width), mean, variance, tuple(sorted(chances.items())))


def _kinds_of(distributions: Iterable[Turnaround]) -> tuple[_Kind, ...]:
    return tuple(
        dict.fromkeys(kind for distribution in distributions if (kind := _kind_of(distribution)).width > 0)
    )


def count_kinds(distributions: Iterable[Turnaround]) -> int:
    """How many kinds of spread these turnarounds have, constant ones left out."""
    return len(_kinds_of(distributions))


class TurnaroundSums:
    """Sums of spreads of up to four kinds of turnaround; constant turnarounds have none.

    ``ends``, in ticks, is when the last character that is read of a torn reply ends, counted from
    the reply's end: a spread of a kind of its own (None: at the reply's end), with ``shifted`` only of
    those that do not end there. A code has 11 bits for each kind's count, so that codes add as the sums do.
    """

    def __init__(
        self, distributions: Iterable[Turnaround], ends: Turnaround | None = None, *, shifted: bool = False
    ) -> None:
        self.shifted = shifted
        distributions = tuple(distributions)
        kinds = _kinds_of(distributions)
        self._kinds = dict(enumerate(kinds))
        if len(self._kinds) > MAX_KINDS:
            raise ValueError(f"{len(self._kinds)} kinds of turnaround, at most {MAX_KINDS} are worked out")
        self._units = {kind: 1 << (DIGIT * digit) for digit, kind in self._kinds.items()}
        #: Of the end of a torn reply: code, earliest and mean in ticks.
        self.torn, self.earliest, self.torn_mean = 0, 0, 0.0
        self._every = self._kinds
        if ends is not None:
            kind = _kind_of(ends)
            self.torn, self.earliest = 1 << (DIGIT * MAX_KINDS), spread_of(ends)[0]
            self.torn_mean = self.earliest + kind.mean
            self._every = {**self._kinds, MAX_KINDS: kind}
        #: Whether no sum of at least one spread has atoms.
        self.smooth = not any(kind.atoms for kind in kinds)
        if self.torn and any(spread_of(distribution)[1] == 0 for distribution in distributions):
            self.smooth = False

    def unit(self, distribution: Turnaround) -> int:
        """The code of one turnaround of this distribution, 0 if it is constant."""
        return self._units.get(_kind_of(distribution), 0)

    def counts(self, codes: Codes) -> list[Codes]:
        """How often each kind occurs."""
        return [(codes >> (DIGIT * digit)) & _MASK for digit in self._every]

    def _linear(self, codes: Codes, factors: list[float]) -> Floats:
        total = np.zeros(codes.shape, dtype=np.float64)
        for count, factor in zip(self.counts(codes), factors, strict=True):
            total += count * factor
        return total

    def widths(self, codes: Codes) -> Floats:
        """The greatest value of each sum, in ticks; the least is 0."""
        return self._linear(codes, [kind.width for kind in self._every.values()])

    def means(self, codes: Codes) -> Floats:
        """The mean of each sum, in ticks."""
        return self._linear(codes, [kind.mean for kind in self._every.values()])

    def variances(self, codes: Codes) -> Floats:
        """The variance of each sum, in ticks²."""
        return self._linear(codes, [kind.variance for kind in self._every.values()])

    @property
    def narrowest(self) -> float:
        """The width of the narrowest spread, in ticks; 1 where there is none."""
        return min((kind.width for kind in self._every.values()), default=1.0)

    @property
    def _uniform(self) -> float:
        """The width where all spreads are uniform of one width, else 0."""
        if len(self._kinds) == 1 and not self._kinds[0].atoms:
            return self._kinds[0].width
        return 0.0

    def tail(self, code: int, y: Floats) -> Floats:
        """P(sum > y), y in ticks."""
        if code == 0:
            return (y < 0).astype(np.float64)
        if self._uniform and not code >= self.torn > 0:
            return irwin_hall_tail(code, y / self._uniform)
        return self._grid_sums(code).tail(code, y)

    def rough_tail(self, codes: Codes, y: Floats) -> Floats:
        """P(sum > y) for arrays of codes and ticks that broadcast, to about 1e-4: for searches."""
        width = self._uniform
        most = int(codes.max(initial=0))
        if width and most <= TABLE_COUNTS:
            table = _table(next(size for size in (12, 24, TABLE_COUNTS) if most <= size))
            position = np.clip(y * (_TABLE_POINTS / width), 0.0, table.shape[1] - 2.0)
            index = position.astype(np.int64)
            at = codes * table.shape[1] + index
            flat = table.reshape(-1)
            low = flat[at]
            return np.asarray(np.where(y < 0, 1.0, low + (position - index) * (flat[at + 1] - low)))
        codes = np.broadcast_to(codes, y.shape)
        inside = (y >= 0) & (y < self.widths(codes))
        # Beyond its ends a sum's tail is known without a grid.
        result = (y < 0).astype(np.float64)
        result[inside] = by_code(self.tail, codes[inside], y[inside])
        return result

    def excess(self, code: int, y: Floats) -> Floats:
        """E[max(0, sum - y)] in ticks, y in ticks."""
        if code == 0:
            return np.maximum(-y, 0.0)
        if self._uniform and not code >= self.torn > 0:
            return self._uniform * irwin_hall_excess(code, y / self._uniform)
        return self._grid_sums(code).excess(code, y)

    def _grid_sums(self, code: int) -> _Grid:
        return _grid_of(tuple((self._every if code >= self.torn > 0 else self._kinds).items()))


#: Masses up to this are left out at both ends of a sum: no component that matters is as light.
_NOTHING = 1e-40
#: Bytes that are kept of what was worked out, each of three kinds.
_KEPT_BYTES = 1 << 26


class _Kept:
    """Offsets and values by code: those used last, as many as :data:`_KEPT_BYTES` hold; for many threads."""

    def __init__(self) -> None:
        self._found: dict[int, tuple[float, Floats]] = {}
        self._bytes = 0
        self._lock = Lock()

    def get(self, code: int) -> tuple[float, Floats] | None:
        with self._lock:
            if (found := self._found.pop(code, None)) is not None:
                self._found[code] = found  # dictionaries keep their order: what was used last stands last
            return found

    def keep(self, code: int, found: tuple[float, Floats]) -> None:
        with self._lock:
            if code in self._found:  # another thread was faster
                return
            self._found[code] = found
            self._bytes += found[1].nbytes
            while self._bytes > _KEPT_BYTES and len(self._found) > 1:
                self._bytes -= self._found.pop(next(iter(self._found)))[1].nbytes


@lru_cache(maxsize=4)
def _grid_of(kinds: tuple[tuple[int, _Kind], ...]) -> _Grid:
    """The grid of these kinds by digit, which a link shares with those of another timeout or more retries."""
    return _Grid(dict(kinds))


class _Grid:
    """Sums of spreads of several kinds, or of discrete ones, as masses on a grid.

    Discrete spreads alone keep their own step (the greatest common divisor of their values) and are
    exact. A uniform spread beside others is cut into cells of 1 µs (10 µs if it is wide), each a mass
    in the middle; the tail is then read by linear interpolation, which is wrong by less than one
    cell's step in y.

    Each sum is made from one with a spread less. Those of torn replies, whose ends are many atoms, have at
    least as many turnarounds; taking these off first leaves few sums to add ends to.
    """

    def __init__(self, digits: Mapping[int, _Kind]) -> None:
        kinds = list(digits.values())
        self._stepwise = all(kind.atoms for kind in kinds)
        widest = max(kind.width for kind in kinds)
        self._step = float(_FINE if widest <= _FINE * _FINE_CELLS else _COARSE)
        if self._stepwise:
            step = gcd(*(value for kind in kinds for value, _ in kind.atoms))
            if sum(kind.width for kind in kinds) <= step * _FINE_CELLS * len(kinds):
                self._step = float(step)
            else:
                self._stepwise = False
        self._uniform = {digit for digit, kind in digits.items() if not kind.atoms}
        self._singles = {digit: self._masses(kind) for digit, kind in digits.items()}
        self._sums, self._tails, self._excesses = _Kept(), _Kept(), _Kept()

    def _masses(self, kind: _Kind) -> tuple[float, Floats]:
        """Offset (ticks) of the first mass, and the masses."""
        step = self._step
        if kind.atoms:
            masses = np.zeros(int(kind.width / step) + 2)
            for value, chance in kind.atoms:
                cell, part = divmod(value, step)
                masses[int(cell)] += chance * (1 - part / step)
                masses[int(cell) + 1] += chance * part / step
            return 0.0, np.trim_zeros(masses, "b")
        cells = max(1, round(kind.width / step))
        # Centred, so that the mean is right where the width is no multiple of the step.
        return (kind.width - (cells - 1) * step) / 2, np.full(cells, 1.0 / cells)

    def _sum(self, code: int) -> tuple[float, Floats]:
        """Offset (ticks) of the first mass of a sum, and the masses."""
        if code == 0:
            return 0.0, np.ones(1)
        found = self._sums.get(code)
        if found is None:
            counts = {digit: code >> (DIGIT * digit) & _MASK for digit in self._singles}
            torn = counts.pop(MAX_KINDS, 0)
            digit = MAX_KINDS if sum(counts.values()) <= torn else max(p for p in counts if counts[p])
            offset, masses = self._sum(code - (1 << (DIGIT * digit)))
            more, single = self._singles[digit]
            if digit in self._uniform:
                masses = _moving_sums(masses, single.size) * single[0]
            else:
                masses = np.convolve(masses, single)
            inside = np.flatnonzero(masses > _NOTHING)
            start = offset + more + float(inside[0]) * self._step
            found = start, masses[inside[0] : inside[-1] + 1].copy()
            self._sums.keep(code, found)
        return found

    def _tail_of(self, code: int) -> tuple[float, Floats]:
        """Offset (ticks) of the first mass, and P(sum > …) from before it to after the last."""
        found = self._tails.get(code)
        if found is None:
            offset, masses = self._sum(code)
            found = offset, np.concatenate((_from_end(masses), [0.0]))
            self._tails.keep(code, found)
        return found

    def tail(self, code: int, y: Floats) -> Floats:
        """P(sum > y)."""
        offset, tail = self._tail_of(code)
        position = (y - offset) / self._step
        if self._stepwise:
            index = np.clip(np.floor(position + 1e-9).astype(np.int64) + 1, 0, tail.size - 1)
            return np.asarray(tail[index], dtype=np.float64)
        # A cell's mass is spread over the cell: half of it lies above its middle.
        position = np.clip(position + 0.5, 0.0, tail.size - 1.0)
        index = np.minimum(position.astype(np.int64), tail.size - 2)
        return np.asarray(tail[index] + (position - index) * (tail[index + 1] - tail[index]))

    def excess(self, code: int, y: Floats) -> Floats:
        """E[max(0, sum - y)]."""
        offset, tail = self._tail_of(code)
        found = self._excesses.get(code)
        if found is None:
            found = offset, np.concatenate((_from_end(tail[1:]), [0.0]))  # beyond each mass
            self._excesses.keep(code, found)
        index = np.clip(np.ceil((y - offset) / self._step), 0, tail.size - 1).astype(np.int64)
        left = np.maximum(offset + self._step * index - y, 0.0)
        return np.asarray(tail[index] * left + self._step * found[1][index])


def _from_end(values: Floats) -> Floats:
    """For each value the sum of it and all after it."""
    return np.asarray(np.cumsum(values[::-1])[::-1], dtype=np.float64)


def _moving_sums(values: Floats, count: int) -> Floats:
    """The sums of ``count`` neighbours, from the first value alone to the last, of sums of 1, 2, 4, … ."""
    total = np.zeros(values.size + count - 1)
    at, width = 0, 1
    while True:
        if count & width:
            total[at : at + values.size] += values
            at += width
        if 2 * width > count:
            return total
        twice = np.zeros(values.size + width)
        twice[: values.size] = values
        twice[width:] += values
        values, width = twice, 2 * width


def by_code(part: Callable[[int, Floats], Floats], codes: Codes, y: Floats) -> Floats:
    """``part`` of each pair of a code and y."""
    result, order = np.empty(y.size), np.argsort(codes, kind="stable")
    for chosen in np.split(order, np.flatnonzero(np.diff(codes[order])) + 1) if y.size else ():
        result[chosen] = part(int(codes[chosen[0]]), y[chosen])
    return result

"""Figures of one link for all its settings at once: attempts × timeouts.

On a line without memory the probabilities of an attempt do not depend on the setting, and the components
of a scan depend on the number of attempts only; a timeout moves them. Components with equally many
timeouts in them form a *row*, whose tail is put on a grid of 10 µs once; a quantile for any timeout is
then found by moving the rows. With bursts the chances depend on the timeout as well: see
:mod:`bussim.exact.sizing.grid_bursts`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from bussim.exact.link import TIMEOUT_UNIT, LinkModel, Station
from bussim.exact.metrics import YEAR
from bussim.exact.scan.memoryless import (
    ScanTerms,
    any_flag,
    fails_of,
    mean_exchange,
    probabilities_of,
    scan_terms,
)
from bussim.exact.scan.outages import clean_scan, detection_means, ride_throughs
from bussim.exact.scan.turnaround_sums import Floats
from bussim.exact.sizing.grid_bursts import BurstStacks
from bussim.exact.solve import Solved
from bussim.plc.profiles import MAX_RETRIES
from bussim.units import TICKS_PER_US

#: Step of a row's grid in ticks, and the most cells that all rows have together.
_STEP, _CELLS = 10.0 * TICKS_PER_US, 4_000_000
#: Components and ends of rows lighter than these parts of a level do not move its quantile.
_LIGHT = 1e-5
#: A quantile is searched until it is known to so many ticks (0.5 µs).
_NEAR = TICKS_PER_US / 2


class Grid:
    """Figures of a link by attempts (first axis) and timeout (second axis). Times in ticks.

    ``errors_per_year`` counts scans in which a living station is in error, of all of them together;
    ``error_per_scan`` is that of the worst station; ``silence`` and ``corruption`` are ride-throughs.
    ``quantiles`` has the scan time exceeded with each level's probability, ``over`` the probability
    to exceed each deadline. Where ``valid`` is false (a reply would not fit the timeout), and where
    something was not asked for, figures are NaN.
    """

    def __init__(
        self,
        model: LinkModel,
        attempts: tuple[int, ...],
        timeouts: tuple[int, ...],
        levels: Sequence[float],
        deadlines: Sequence[int],
    ) -> None:
        self.model = model
        self.attempts = attempts
        self.timeouts = timeouts
        self.valid = np.array(timeouts, dtype=np.float64) >= model.least_timeout()
        shape = (len(attempts), len(timeouts))
        every = np.full((8 + len(levels) + len(deadlines), *shape), np.nan)
        self.mean, self.error_per_scan, self.errors_per_year, self.one_dead = every[:4]
        self.detect_mean, self.detect_longest, self.silence, self.corruption = every[4:8]
        self.quantiles = dict(zip(levels, every[8:], strict=False))
        self.over = dict(zip(deadlines, every[8 + len(levels) :], strict=True))
        self._every = every

    def blank_invalid(self) -> None:
        """Make the figures of settings for which the closed form does not hold NaN."""
        self._every[:, :, ~self.valid] = np.nan

    def at(self, attempts: int, timeout: int) -> tuple[int, int]:
        """Indices of a setting."""
        return self.attempts.index(attempts), self.timeouts.index(timeout)


def all_timeouts(model: LinkModel) -> tuple[int, ...]:
    """Every timeout that D8180 of the master's profile can say, in ticks."""
    low, high = model.timeout_range
    return tuple(TIMEOUT_UNIT * unit for unit in range(low, high + 1))


def evaluate(
    model: LinkModel,
    attempts: Iterable[int] = range(1, MAX_RETRIES + 2),
    timeouts: Sequence[int] | None = None,
    levels: Sequence[float] = (1e-3, 1e-6),
    deadlines: Sequence[int] = (),
    *,
    details: bool = True,
) -> Grid:
    """All settings of a link, whose own setting does not matter.

    ``levels`` are probabilities of exceeding, ``deadlines`` ticks. Without ``details`` only mean,
    errors and quantiles are worked out. With bursts, quantiles and deadlines take a distribution per setting
    (milliseconds each); pass no levels where they are not needed. Raises ValueError where the closed
    form holds for no setting (:attr:`LinkModel.obstacles`).
    """
    if model.obstacles:
        raise ValueError("; ".join(model.obstacles))
    many = tuple(attempts)
    ticks = tuple(all_timeouts(model) if timeouts is None else timeouts)
    tau = np.array(ticks, dtype=np.float64)
    worker = _Memoryless(model, tau) if model.noise.memoryless else _Bursts(model, tau)
    grid = Grid(model, many, ticks, levels, deadlines)
    for row, count in enumerate(many):
        worker.fill(grid, row, count, details=details)
    grid.blank_invalid()
    return grid


def _fill_outages(grid: Grid, row: int, count: int, mean: Floats, square: Floats) -> None:
    """Detection and ride-through, given the scan's mean and mean square."""
    model, tau = grid.model.with_setting(count, 0), np.array(grid.timeouts, dtype=np.float64)
    wait = model.gap + model.poll + tau
    if not model.alive:
        return
    means = [detection_means(model, station, count, tau, mean, square) for station in model.alive]
    grid.detect_mean[row] = np.max(np.stack(means), axis=0)
    longest = [_others_clean(model, station, wait) + count * wait for station in model.alive]
    grid.detect_longest[row] = np.max(np.stack(longest), axis=0)
    grid.silence[row], grid.corruption[row] = ride_throughs(model, count, tau)


def _others_clean(model: LinkModel, station: Station, wait: Floats) -> Floats:
    """The longest scan without failed attempts and without one station's slot (the model's timeout is 0)."""
    own = model.answered(station) - station.extra + station.slowest
    dead = model.attempts_at(flagged=True) * len(model.dead)
    return clean_scan(model, slowest=True) - own + dead * (wait - model.gap - model.poll)


class _Memoryless:
    """Fills rows of a grid on a line without memory."""

    def __init__(self, model: LinkModel, tau: Floats) -> None:
        self.model, self.tau = model, tau
        self.probabilities = probabilities_of(model)

    def fill(self, grid: Grid, row: int, count: int, *, details: bool) -> None:
        """One number of attempts."""
        model, tau = self.model.with_setting(count, 0), self.tau
        waits = fixed = 0.0
        all_fails, exchanges = [], []
        for station, probabilities in zip(model.stations, self.probabilities, strict=True):
            mean = mean_exchange(model, station, probabilities)
            waits, fixed = waits + mean.waits, fixed + mean.fixed
            exchanges.append(mean)
            all_fails.append(fails_of(probabilities, count, model.absent))
        errors = [f.error for f, s in zip(all_fails, model.stations, strict=True) if s.alive]
        parameters = model.parameters_cost
        grid.mean[row] = model.base + fixed + waits * tau + parameters * any_flag(all_fails)
        grid.error_per_scan[row] = max(errors, default=np.nan)
        grid.errors_per_year[row] = YEAR / grid.mean[row] * sum(errors)
        if details:
            dead = model.attempts_at(flagged=True) * (model.gap + model.poll + tau)
            gains = [
                dead - mean.fixed - mean.waits * tau
                for mean, station in zip(exchanges, model.stations, strict=True)
                if station.alive
            ]
            if gains:
                gain = np.max(np.stack(gains), axis=0)
                grid.one_dead[row] = model.base + fixed + waits * tau + gain + parameters
        wanted = [*grid.quantiles, *([1e-6] if details or grid.over else [])]
        if not wanted:
            return
        terms = scan_terms(model, _LIGHT * min(wanted), self.probabilities)
        if details:
            _fill_outages(grid, row, count, grid.mean[row], _mean_square(terms, tau))
        if grid.quantiles or grid.over:
            rows = _Rows.of(terms)
            for level, values in grid.quantiles.items():
                values[row] = rows.quantile(level, tau)
            for deadline, values in grid.over.items():
                values[row] = rows.tail(np.full(tau.size, float(deadline)), tau)


def _mean_square(terms: ScanTerms, tau: Floats) -> Floats:
    """E[scan²] in ticks² for each timeout."""
    middle = terms.fixed + terms.sums.means(terms.code)
    own = float(terms.weight @ (middle * middle + terms.sums.variances(terms.code)))
    cross, square = float(terms.weight @ (middle * terms.waits)), float(terms.weight @ terms.waits**2)
    return own + 2 * cross * tau + square * tau * tau


@dataclass(frozen=True, slots=True, eq=False)
class _Rows:
    """Tails of the components with 0, 1, … timeouts in them, on a grid from ``first`` on.

    ``tails`` has one row each: entry i is the weight beyond ``first`` + i × ``step``.
    """

    first: float
    step: float
    tails: Floats

    @classmethod
    def of(cls, terms: ScanTerms) -> _Rows:
        first = math.floor(terms.fixed.min() / _STEP) * _STEP
        last = float((terms.fixed + terms.sums.widths(terms.code)).max())
        count = int(terms.waits.max()) + 1
        step = max(_STEP, (last - first) * count / _CELLS)
        cells = int((last - first) / step) + 3
        masses = np.zeros(count * cells)
        place = (terms.fixed - first) / step
        index = np.floor(place)
        widths = terms.sums.widths(terms.code)
        for code in np.unique(terms.code).tolist():
            chosen = np.nonzero(terms.code == code)[0]
            reach = int(widths[chosen[0]] / step) + 2
            # Weight in each cell that a component touches: differences of its tail at the cells' edges.
            edges = (np.arange(reach + 1) - (place[chosen] - index[chosen])[:, None]) * step
            beyond = terms.sums.rough_tail(terms.code[chosen][:, None], edges)
            parts = (beyond[:, :-1] - beyond[:, 1:]) * terms.weight[chosen][:, None]
            at = (terms.waits[chosen] * cells + index[chosen].astype(np.int64))[:, None] + np.arange(reach)
            np.add.at(masses, at, parts)
        tails = np.cumsum(masses.reshape(count, cells)[:, ::-1], axis=1)[:, ::-1]
        return cls(first, step, np.ascontiguousarray(tails))

    def tail(self, x: Floats, tau: Floats) -> Floats:
        """P(scan > x) for pairs of x and timeout."""
        count, cells = self.tails.shape
        waits = np.arange(count)
        place = np.clip((x[:, None] - self.first - waits * tau[:, None]) / self.step, 0.0, cells - 2.0)
        index = place.astype(np.int64)
        at = index + waits * cells
        flat = self.tails.reshape(-1)
        low = flat[at]
        beyond = (low + (place - index) * (flat[at + 1] - low)).sum(axis=1)
        return np.asarray(np.minimum(beyond, 1.0), dtype=np.float64)

    def quantile(self, level: float, tau: Floats) -> Floats:
        """The least x with P(scan > x) <= level, for each timeout."""
        weight = self.tails[:, 0]
        # Where a row's tail begins to fall, and where it is as good as over.
        begin = self.first + self.step * ((self.tails >= weight[:, None]).sum(axis=1) - 1)
        over = self.first + self.step * (self.tails > _LIGHT * level).sum(axis=1)
        moved = np.arange(weight.size)[:, None] * tau
        low = _edges(begin[:, None] + moved, weight, level)
        high = np.maximum(low, _edges(over[:, None] + moved, weight, level))
        whole = np.where(begin[:, None] + moved >= high, weight[:, None], 0.0).sum(axis=0)
        partial = (begin[:, None] + moved < high) & (over[:, None] + moved > low)
        single = partial.sum(axis=0) == 1
        result = high.copy()
        # Most often one row alone decides: its tail is inverted. Else the sum of tails is halved down to it.
        row = np.argmax(partial, axis=0)
        for number in np.unique(row[single]).tolist():
            chosen = np.nonzero(single & (row == number))[0]
            inside = self._inverse(self.tails[number], level - whole[chosen])
            result[chosen] = np.clip(inside + number * tau[chosen], low[chosen], high[chosen])
        rest = np.nonzero(~single & (high > low))[0]
        if rest.size:
            left, right, timeouts = low[rest], high[rest], tau[rest]
            while float((right - left).max()) > _NEAR:
                middle = (left + right) / 2
                above = self.tail(middle, timeouts) > level
                left, right = np.where(above, middle, left), np.where(above, right, middle)
            result[rest] = right
        return result

    def _inverse(self, tail: Floats, level: Floats) -> Floats:
        """The least y at which a row's tail is at most so much."""
        place = np.clip(np.searchsorted(-tail, -level, side="left"), 1, tail.size - 1)
        above, below = tail[place - 1], tail[place]
        part = np.divide(above - level, above - below, out=np.ones_like(level), where=above > below)
        return np.asarray(self.first + self.step * (place - 1 + np.clip(part, 0.0, 1.0)), dtype=np.float64)


def _edges(edges: Floats, weight: Floats, level: float) -> Floats:
    """For each column the edge at and above which more than ``level`` lies, but not above it."""
    order = np.argsort(-edges, axis=0, kind="stable")
    beyond = np.cumsum(weight[order], axis=0)
    place = np.minimum((beyond <= level).sum(axis=0), weight.size - 1)
    found = np.take_along_axis(edges, np.take_along_axis(order, place[None], axis=0), axis=0)
    return np.asarray(found[0], dtype=np.float64)


class _Bursts:
    """Fills rows of a grid on a line with bursts."""

    def __init__(self, model: LinkModel, tau: Floats) -> None:
        self.model = model
        self.stacks = BurstStacks(model, tau)

    def fill(self, grid: Grid, row: int, count: int, *, details: bool) -> None:
        """One number of attempts."""
        alive = self.model.alive
        moments = self.stacks.moments(count)
        grid.mean[row] = moments.mean
        grid.error_per_scan[row] = np.max(moments.errors, axis=0) if alive else np.nan
        grid.errors_per_year[row] = YEAR / moments.mean * np.sum(moments.errors, axis=0)
        if details and alive:
            _fill_outages(grid, row, count, moments.mean, moments.square)
            means = [self.stacks.moments(count, dead=station.number).mean for station in alive]
            grid.one_dead[row] = np.max(np.stack(means), axis=0)
        if not grid.quantiles and not grid.over:
            return
        for column, timeout in enumerate(grid.timeouts):
            if not grid.valid[column]:
                continue
            distribution = Solved(self.model.with_setting(count, timeout)).distribution
            for level, values in grid.quantiles.items():
                values[row, column] = distribution.quantile(level)
            for deadline, values in grid.over.items():
                values[row, column] = float(distribution.tail(float(deadline)))

"""Figures of one link for all its settings at once: attempts × timeouts.

Means and chances of error: :mod:`bussim.exact.bursts.timeout_stacks`. On a line without memory the
components of a scan depend on the number of attempts only; a timeout moves them. Components with equally
many timeouts in them form a *row*, whose tail is put on a grid of 10 µs once; a tail for any timeout is
then found by moving the rows.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from bussim.exact.bursts.exchange import different
from bussim.exact.bursts.timeout_stacks import Scans, TimeoutStacks
from bussim.exact.link import LinkModel
from bussim.exact.metrics import YEAR
from bussim.exact.scan.memoryless import ScanComponents, scan_components
from bussim.exact.scan.outages import longest_unnoticed, ride_through
from bussim.exact.scan.turnaround_sums import Floats
from bussim.exact.solve import Solved
from bussim.units import TICKS_PER_US

#: Step of a row's grid in ticks, and the most cells that all rows have together.
_STEP, _CELLS = 10.0 * TICKS_PER_US, 4_000_000
#: Components lighter than this are left out; what they weigh together counts as beyond every deadline.
_LIGHT = 1e-14


class Grid:
    """Figures of a link by attempts (first axis) and timeout (second axis). Times in ticks.

    ``error_per_scan`` counts the living stations in error at a scan's end, ``onset_per_scan`` those that were
    not so at the scan before; ``errors`` and ``onsets`` are the same a year, at the rate of scans that the
    shortest timeout gives: a longer one makes scans slower, and thereby errors fewer, which is no merit.
    ``silence`` is the ride-through. ``over`` has the probability that a scan exceeds each deadline. Where
    ``valid`` is false (a reply would not fit the timeout), and where a figure was not asked for, it is NaN.
    """

    def __init__(
        self, model: LinkModel, attempts: tuple[int, ...], timeouts: tuple[int, ...], deadlines: Sequence[int]
    ) -> None:
        self.model = model
        self.attempts = attempts
        self.timeouts = timeouts
        self.valid = np.array(timeouts, dtype=np.float64) >= model.least_timeout()
        every = np.full((9 + len(deadlines), len(attempts), len(timeouts)), np.nan)
        self.mean, self.error_per_scan, self.onset_per_scan, self.one_dead = every[:4]
        self.detect_mean, self.detect_longest, self.silence, self.errors, self.onsets = every[4:9]
        self.over = dict(zip(deadlines, every[9:], strict=True))
        self._every = every

    def finish(self) -> None:
        """Work out the figures a year; those of settings without a closed form become NaN."""
        scans = YEAR / self.mean[:, [int(np.argmax(self.valid))]]
        self.errors[:], self.onsets[:] = scans * self.error_per_scan, scans * self.onset_per_scan
        self._every[:, :, ~self.valid] = np.nan

    def take_worse(self, other: Grid) -> None:
        """Take over what is worse in a grid of the same attempts, as far as that has it.

        Ride-through depends neither on noise nor on stations; of all other figures more is worse. A timeout
        between two of the other grid takes the shorter one's errors, which are not fewer.
        """
        column = np.searchsorted(other.timeouts, self.timeouts, side="right") - 1
        own = self._every[: len(other._every)]
        np.fmax(own, other._every[:, :, column], out=own)

    def at(self, attempts: int, timeout: int) -> tuple[int, int]:
        """Indices of a setting."""
        return self.attempts.index(attempts), self.timeouts.index(timeout)


def evaluate(
    model: LinkModel,
    attempts: Iterable[int],
    timeouts: Iterable[int],
    deadlines: Sequence[int] = (),
    *,
    details: bool = True,
) -> Grid:
    """All settings of a link, whose own setting does not matter.

    ``timeouts`` and ``deadlines`` in ticks. Without ``details`` only mean and errors are worked out. With
    bursts, deadlines take a distribution per setting (milliseconds each). Raises ValueError where the
    closed form holds for no setting (:attr:`LinkModel.obstacles`).
    """
    if model.obstacles:
        raise ValueError("; ".join(model.obstacles))
    grid = Grid(model, tuple(attempts), tuple(timeouts), deadlines)
    tau = np.array(grid.timeouts, dtype=np.float64)
    stacks = TimeoutStacks(model, tau)
    for row, count in enumerate(grid.attempts):
        _fill(grid, row, count, stacks, details=details)
    grid.finish()
    return grid


def worst_of(grids: Iterable[Grid]) -> Grid:
    """The worst figures that each setting has in grids of the same settings."""
    first, *others = grids
    worst = Grid(first.model, first.attempts, first.timeouts, tuple(first.over))
    for grid in (first, *others):
        worst.take_worse(grid)
    return worst


def _fill(grid: Grid, row: int, count: int, stacks: TimeoutStacks, *, details: bool) -> None:
    model, tau, alive = grid.model.with_setting(count, 0), stacks.tau, grid.model.alive
    scans = Scans(stacks, count)
    grid.mean[row] = scans.mean[0]
    errors, onsets = scans.fails
    grid.error_per_scan[row], grid.onset_per_scan[row] = errors.sum(axis=0)[0], onsets.sum(axis=0)[0]
    if details and alive:
        choices = [[station.number] for station in different(model).values()]
        grid.one_dead[row] = Scans(stacks, count, choices).mean.max(axis=0)
        grid.detect_mean[row] = scans.noticed(grid.mean[row])
        longest = [longest_unnoticed(model, station, tau) for station in alive]
        grid.detect_longest[row] = np.max(longest, axis=0)
        grid.silence[row] = ride_through(model, count, tau).silence
    if grid.over and model.noise.memoryless:
        components = scan_components(model, _LIGHT)
        rows = _Rows.of(components)
        for deadline, values in grid.over.items():
            values[row] = rows.tail(np.full(tau.size, float(deadline)), tau) + components.lost
    elif grid.over:
        for column in np.flatnonzero(grid.valid).tolist():
            distribution = Solved(model.with_setting(count, grid.timeouts[column])).distribution
            for deadline, values in grid.over.items():
                values[row, column] = float(distribution.tail(float(deadline)))


@dataclass(frozen=True, slots=True, eq=False)
class _Rows:
    """Tails of the components with 0, 1, … timeouts in them, on a grid from ``first`` on.

    ``tails`` has one row each: entry i is the weight beyond ``first`` + i × ``step``.
    """

    first: float
    step: float
    tails: Floats

    @classmethod
    def of(cls, scan: ScanComponents) -> _Rows:
        first = math.floor(scan.fixed.min() / _STEP) * _STEP
        last = float((scan.fixed + scan.sums.widths(scan.code)).max())
        count = int(scan.waits.max()) + 1
        step = max(_STEP, (last - first) * count / _CELLS)
        cells = int((last - first) / step) + 3
        masses = np.zeros(count * cells)
        position = (scan.fixed - first) / step
        index = np.floor(position)
        widths = scan.sums.widths(scan.code)
        for code in np.unique(scan.code).tolist():
            chosen = np.nonzero(scan.code == code)[0]
            reach = int(widths[chosen[0]] / step) + 2
            # Weight in each cell that a component touches: differences of its tail at the cells' edges.
            edges = (np.arange(reach + 1) - (position[chosen] - index[chosen])[:, None]) * step
            beyond = scan.sums.rough_tail(scan.code[chosen][:, None], edges)
            parts = (beyond[:, :-1] - beyond[:, 1:]) * scan.weight[chosen][:, None]
            at = (scan.waits[chosen] * cells + index[chosen].astype(np.int64))[:, None] + np.arange(reach)
            np.add.at(masses, at, parts)
        tails = np.cumsum(masses.reshape(count, cells)[:, ::-1], axis=1)[:, ::-1]
        return cls(first, step, np.ascontiguousarray(tails))

    def tail(self, x: Floats, tau: Floats) -> Floats:
        """P(scan > x) for pairs of x and timeout."""
        count, cells = self.tails.shape
        waits = np.arange(count)
        position = np.clip((x[:, None] - self.first - waits * tau[:, None]) / self.step, 0.0, cells - 2.0)
        index = position.astype(np.int64)
        at = index + waits * cells
        flat = self.tails.reshape(-1)
        low = flat[at]
        beyond = (low + (position - index) * (flat[at + 1] - low)).sum(axis=1)
        return np.asarray(np.minimum(beyond, 1.0), dtype=np.float64)

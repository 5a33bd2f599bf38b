"""Means of the whole scans that a transaction costs, where the scans' jitter makes them random.

From the END that sends a request on, active scans follow one another until their sum has reached what
the transaction needs; then idle ones until the interval is over as well. How many scans that takes is a
first passage of a sum of independent uniform variables, and by Wald's identity its mean number times the
mean scan is the mean time. The distribution of the sum is carried from scan to scan on a grid, all of it
from positive terms, each cell's mass taken as uniform over the cell: the error falls with the square of
the cell.
"""

from dataclasses import dataclass, field

import numpy as np

from bussim.exact.scan.turnaround_sums import Floats, irwin_hall_tail

#: Cells of the grid in a scan's width, and in the spread of what is needed.
_CELLS, _SPREAD_CELLS = 64, 4_096
#: What may be left of a distribution when it is done.
_LEFT = 1e-13


def mean_whole_scans(
    need: int, spread: int, active: int, idle: int, width: int, interval: int
) -> tuple[float, float]:
    """Mean ticks from sending to taking over, and from there to sending the next request.

    What a transaction needs is uniform over ``need`` (> 0) … ``need + spread``, an active scan uniform over
    ``active`` (> 0) … ``active + width``, an idle one over ``idle`` (> 0) … ``idle + width``. The interval
    counts from the moment when the need is met.
    """
    if not spread and not width:
        taken = -(-need // active) * active
        return float(taken), float(max(1, -(-(need + interval - taken) // idle)) * idle)
    passed = _first_passage(need, spread, active, width, keep=interval > idle)
    scans = 1.0
    more = 1
    while more * idle < interval:  # the sum of so many idle scans may not be enough
        scans += _still_short(passed, interval - more * idle, width, more)
        more += 1
    return passed.scans * (active + width / 2), scans * (idle + width / 2)


@dataclass(slots=True)
class _Passed:
    """Mean number of scans, and by how much their sum overshoots (with the mass of each)."""

    scans: float = 0.0
    overshoots: list[Floats] = field(default_factory=list)
    masses: list[Floats] = field(default_factory=list)


def _first_passage(need: int, spread: int, active: int, width: int, *, keep: bool) -> _Passed:
    # What is needed beyond ``need`` is counted off the sum's start.
    cell = max(width / _CELLS, spread / _SPREAD_CELLS)
    in_scan = round(width / cell)
    if in_scan and in_scan < _CELLS:
        cell = width / in_scan
    in_spread = max(1, round(spread / cell))
    mass = np.full(in_spread, 1 / in_spread)
    first = -spread / 2 - cell * (in_spread - 1) / 2
    in_scan = max(1, in_scan)
    step = active + width / 2 - cell * (in_scan - 1) / 2
    passed = _Passed()
    while (left := float(mass.sum())) > _LEFT:
        passed.scans += left
        mass = _boxcar(mass, in_scan)
        first += step
        over = first + cell * (np.arange(mass.size) + 0.5) - need  # the cell's upper end
        part = np.clip(over / cell, 0.0, 1.0)
        if keep:
            crossed = part > 0
            passed.overshoots.append(np.where(part < 1, over / 2, over - cell / 2)[crossed])
            passed.masses.append((mass * part)[crossed])
        mass = mass * (1 - part)
        mass = mass[: int(np.count_nonzero(part < 1))]
    return passed


def _boxcar(mass: Floats, cells: int) -> Floats:
    """The distribution of the sum with an independent one that is uniform over so many cells."""
    if cells == 1:
        return mass
    padded = np.concatenate((mass, np.zeros(cells - 1)))
    sums = np.cumsum(padded)
    sums[cells:] -= sums[:-cells].copy()
    return np.asarray(np.maximum(sums, 0.0) / cells, dtype=np.float64)


def _still_short(passed: _Passed, room: int, width: int, scans: int) -> float:
    """P(the overshoot and so many scans' spreads together are less than ``room``)."""
    short = 0.0
    for overshoot, mass in zip(passed.overshoots, passed.masses, strict=True):
        free = room - overshoot
        chance = 1 - irwin_hall_tail(scans, free / width) if width else (free > 0).astype(np.float64)
        short += float((mass * chance).sum())
    return short

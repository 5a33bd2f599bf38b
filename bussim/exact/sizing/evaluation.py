"""All settings of a link against goals: which meet which, under every reading of the assumptions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bussim.exact.link import TIMEOUT_UNIT, LinkModel
from bussim.exact.metrics import YEAR
from bussim.exact.refresh import gap_distributions
from bussim.exact.scan.turnaround_sums import Floats
from bussim.exact.sizing.goals import Goals
from bussim.exact.sizing.grid import Grid, evaluate
from bussim.exact.solve import Solved
from bussim.plc.profiles import MAX_RETRIES, AbsentStation, Attempts, attempts_per_poll
from bussim.units import TICKS_PER_MS

Mask = NDArray[np.bool_]

#: With bursts, timeouts at which a heartbeat is evaluated, for each number of attempts.
_BURST_SAMPLES = 8
#: Components lighter than this are dropped from the gaps: a few a year are looked for, of 1e9.
_GAP_FLOOR = 1e-14


def timeout_floor(model: LinkModel) -> int:
    """The least timeout in ticks that is ever recommended, a multiple of 10 ms.

    The longest legitimate reply, plus its slave's longest PLC scan, plus one 10 ms tick: should
    the board reply at END and not on its own, as assumed, its replies still come in time.
    """
    longest = max((s.slowest + s.reply + s.scan for s in model.alive), default=0)
    return math.ceil((longest + 10 * TICKS_PER_MS) / TIMEOUT_UNIT) * TIMEOUT_UNIT


class Checked:
    """A grid by attempts and timeout, and for each goal where it is met.

    ``met`` and ``values`` (the figure that each goal limits) have an entry for every goal but the heartbeat,
    which takes a distribution per setting and is asked for one by one: :meth:`heartbeat_met`.
    """

    def __init__(self, grid: Grid, goals: Goals) -> None:
        self.grid = grid
        self.goals = goals
        self.values: dict[str, Floats] = {"errors": grid.errors_per_year}
        self.met: dict[str, Mask] = {"errors": grid.errors_per_year <= goals.errors}
        if goals.scan is not None:
            self.values["scan"] = grid.over[goals.scan[0]]
            self.met["scan"] = self.values["scan"] <= goals.scan[1]
        if goals.dead is not None:
            self.values["dead"] = grid.one_dead
            self.met["dead"] = grid.one_dead <= goals.dead
        if goals.ride is not None:
            self.values["ride"] = grid.silence
            self.met["ride"] = grid.silence >= goals.ride
        #: How often a year a heartbeat is missed falsely, for the settings that were evaluated.
        self.missed = np.full(grid.mean.shape, np.nan)

    @property
    def candidates(self) -> Mask:
        """Where every goal but the heartbeat is met."""
        return np.asarray(np.logical_and.reduce(list(self.met.values())) & self.grid.valid, dtype=np.bool_)

    @property
    def evaluated(self) -> Mask:
        """Settings at which a heartbeat is worth looking at: all, but with bursts only some timeouts."""
        columns = np.ones(len(self.grid.timeouts), dtype=np.bool_)
        if self.goals.heartbeat is not None and not self.grid.model.noise.memoryless:
            columns[:] = False
            columns[np.geomspace(1, columns.size, _BURST_SAMPLES).astype(np.int64) - 1] = True
        return np.broadcast_to(columns, self.grid.mean.shape)

    def heartbeat_met(self, row: int, column: int) -> bool:
        """Whether a heartbeat is missed seldom enough with one setting; True where none is wanted."""
        if self.goals.heartbeat is None:
            return True
        preset, most = self.goals.heartbeat
        grid = self.grid
        if grid.model.noise.memoryless and bool((self.missed[row, :column] > most).any()):
            return False  # with as many attempts, a longer timeout only lengthens the gaps
        if np.isnan(self.missed[row, column]):
            model = grid.model.with_setting(grid.attempts[row], grid.timeouts[column])
            self.missed[row, column] = missed_per_year(Solved(model), preset)
        return bool(self.missed[row, column] <= most)


def least(views: Sequence[tuple[Checked, Sequence[int]]]) -> tuple[int, int] | None:
    """The least setting that meets all goals in every view, as (retries, column of the timeout), or None.

    Least is the shortest scan with a dead station, the longest of the views'; then the soonest
    noticed, then the fewest errors. A view is a checked grid and its row for each number of retries.
    """
    met = np.logical_and.reduce([(view.candidates & view.evaluated)[list(rows)] for view, rows in views])
    retries, columns = np.nonzero(met)
    if not retries.size:
        return None
    keys = []
    for values in ("one_dead", "detect_mean", "errors_per_year"):
        worst = np.max(np.stack([getattr(view.grid, values)[list(rows)] for view, rows in views]), axis=0)
        keys.append(worst[retries, columns])
    for place in np.lexsort((columns, retries, *reversed(keys))).tolist():
        chosen = int(retries[place]), int(columns[place])
        if all(view.heartbeat_met(rows[chosen[0]], chosen[1]) for view, rows in views):
            return chosen
    return None


def rows_of(checked: Checked, reading: Attempts) -> list[int]:
    """The row of a grid for D8179 = 0, 1, … 10."""
    return [checked.grid.attempts.index(attempts_per_poll(reading, r)) for r in range(MAX_RETRIES + 1)]


def evaluate_goals(model: LinkModel, goals: Goals, absent: AbsentStation | None = None) -> Checked:
    """All settings from the timeout floor on, for 1 to 11 attempts."""
    if absent is not None:
        model = replace(model, absent=absent)
    top = model.timeout_range[1] * TIMEOUT_UNIT
    low = max(timeout_floor(model), model.timeout_range[0] * TIMEOUT_UNIT)
    timeouts = tuple(range(low, top + 1, TIMEOUT_UNIT))
    deadlines = () if goals.scan is None else (goals.scan[0],)
    return Checked(evaluate(model, range(1, MAX_RETRIES + 2), timeouts, deadlines), goals)


def missed_per_year(solved: Solved, preset: int) -> float:
    """How often a year a heartbeat's watchdog (ticks) runs out although all stations live, worst pair.

    The heartbeat is a word that changes in every PLC scan of its source; the longest PLC scans of
    both stations are taken off the preset.
    """
    model = solved.model
    worst = 0.0
    known: dict[tuple[int, int], float] = {}
    for gap in gap_distributions(solved, _GAP_FLOOR, by_place=False).values():
        scans = model.scans_between(gap.source, gap.receiver)
        key = (id(gap.distribution), scans)
        if key not in known:
            beyond = float(gap.distribution.tail(float(preset - scans))) + gap.distribution.lost
            known[key] = beyond * gap.per_scan * YEAR / solved.distribution.mean
        worst = max(worst, known[key])
    return worst

"""All settings of a link against goals: which meet which, under every reading of the assumptions."""

import math
from bisect import bisect_left
from collections.abc import Collection, Iterable, Sequence
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from bussim.exact.bursts.exchange import line_of, poll_path
from bussim.exact.link import MASTER, TIMEOUT_UNIT, LinkModel
from bussim.exact.metrics import YEAR
from bussim.exact.refresh import gap_distributions
from bussim.exact.scan.mixture import Distribution
from bussim.exact.scan.outages import clean_scan
from bussim.exact.scan.turnaround_sums import Floats
from bussim.exact.sizing.goals import Goals
from bussim.exact.sizing.grid import Grid, evaluate, worst_of
from bussim.exact.sizing.noise_levels import BAD, LEVELS, weaker_bursts, with_level
from bussim.exact.solve import Solved
from bussim.plc.profiles import MAX_RETRIES, Attempts, attempts_per_poll
from bussim.units import TICKS_PER_MS

Mask = NDArray[np.bool_]

#: With bursts, so many timeouts at which a heartbeat is evaluated for each number of attempts, and so many at
#: which errors under weaker bursts are.
_BURST_SAMPLES, _WEAKER_SAMPLES = 8, 30
#: Components lighter than this are dropped from the gaps: a few a year are looked for, of 1e9.
_GAP_FLOOR = 1e-14
#: How far the steps of a grid may put the chance of a scan over a deadline off, as a part of it.
_GRID_ERROR = 1e-3
#: With more station errors a scan than this a link is out of order, whatever the goal allows: only up to
#: there more noise always makes all figures worse.
MOST_ERRORS = 0.05


def timeout_floor(model: LinkModel) -> int:
    """The least timeout in ticks that is ever recommended, a multiple of 10 ms.

    The longest legitimate reply, plus its slave's longest PLC scan, plus one 10 ms tick: should
    the board reply at END and not on its own, as assumed, its replies still come in time.
    """
    longest = max((s.slowest + s.reply + s.scan for s in model.stations), default=0)
    return math.ceil((longest + 10 * TICKS_PER_MS) / TIMEOUT_UNIT) * TIMEOUT_UNIT


class Checked:
    """A grid by attempts and timeout, and for each goal where it is met.

    ``views`` are the links with the noise under which the goals must be met, ``grid`` has the worst figures
    of them. ``met`` and ``values`` (the figure that a goal limits) have an entry for every goal but the
    heartbeat, which takes a distribution per setting and is asked for one by one: :meth:`heartbeat_met`.
    """

    def __init__(self, views: Sequence[LinkModel], grid: Grid, goals: Goals) -> None:
        self.views = views
        self.grid = grid
        self.goals = goals
        self.values: dict[str, Floats] = {
            "errors": grid.errors,
            "onsets": grid.onsets,
            "dead": grid.one_dead,
            "ride": grid.silence,
        }
        few = grid.error_per_scan <= MOST_ERRORS
        self.met: dict[str, Mask] = {"errors": few & (grid.errors <= goals.errors)}
        if goals.onsets is not None:
            self.met["onsets"] = grid.onsets <= goals.onsets
        if goals.scan is not None:
            self.values["scan"] = self._over(*goals.scan)
            self.met["scan"] = self.values["scan"] <= goals.scan[1]
        if goals.dead is not None:
            self.met["dead"] = grid.one_dead <= goals.dead
        if goals.ride:
            self.met["ride"] = grid.silence >= goals.ride
        #: How often a year a heartbeat is missed falsely, for the settings that were evaluated, and those
        #: with which it is so too often.
        self.missed = np.full(grid.mean.shape, np.nan)
        self.refused = np.zeros(grid.mean.shape, dtype=np.bool_)

    def _over(self, deadline: int, level: float) -> Floats:
        """The chance of a scan over a deadline; where the grid's steps might decide, by the law itself."""
        over: Floats = self.grid.over[deadline].copy()
        if not self.memoryless:
            return over  # the law's own
        for row, column in np.argwhere(np.abs(over - level) <= _GRID_ERROR * level).tolist():
            setting = self.grid.attempts[row], self.grid.timeouts[column]
            laws = (Solved(view.with_setting(*setting)).distribution for view in self.views)
            over[row, column] = max(float(law.tail(float(deadline))) for law in laws)
        return over

    @property
    def names(self) -> tuple[str, ...]:
        """The goals."""
        return (*self.met, *(["heartbeat"] if self.goals.heartbeat is not None else []))

    @property
    def memoryless(self) -> bool:
        """Whether no noise has a memory."""
        return all(view.noise.memoryless for view in self.views)

    def candidates(self, names: Iterable[str]) -> Mask:
        """Where the named goals are met, the heartbeat left out."""
        masks = [self.met[name] for name in names if name != "heartbeat"]
        return np.asarray(np.logical_and.reduce([self.grid.valid & self.evaluated, *masks]), dtype=np.bool_)

    @property
    def evaluated(self) -> Mask:
        """Settings at which a heartbeat is worth evaluating: all, but with bursts only some timeouts."""
        columns = np.ones(len(self.grid.timeouts), dtype=np.bool_)
        if self.goals.heartbeat is not None and not self.memoryless:
            columns[:] = False
            columns[np.geomspace(1, columns.size, _BURST_SAMPLES).astype(np.int64) - 1] = True
        return np.broadcast_to(columns, self.grid.mean.shape)

    def heartbeat_met(self, row: int, column: int) -> bool:
        """Whether a heartbeat is missed seldom enough with one setting; True where none is wanted."""
        if self.goals.heartbeat is None:
            return True
        preset, most = self.goals.heartbeat
        # With as many attempts, a longer timeout only lengthens the gaps.
        known = self.refused[row, : column + 1] if self.memoryless else self.refused[row, [column]]
        if not known.any():
            views = self._with_setting(row, column)[::-1]  # at the level bad, which takes least time, first
            self.refused[row, column] = self.hopeless(row, column) or any(
                missed_per_year(view, preset) > most for view in views
            )
        return not known.any()

    def missed_at(self, row: int, column: int) -> float:
        """How often a year a heartbeat is missed falsely with one setting."""
        if self.goals.heartbeat is not None and np.isnan(self.missed[row, column]):
            preset = self.goals.heartbeat[0]
            views = self._with_setting(row, column)
            self.missed[row, column] = max(missed_per_year(view, preset) for view in views)
        return float(self.missed[row, column])

    def hopeless(self, row: int, column: int) -> bool:
        """Whether a heartbeat is missed too often with one setting for a reason that is seen at once."""
        return (
            self.goals.heartbeat is not None and self.missed_at_least(row, column) > self.goals.heartbeat[1]
        )

    def missed_at_least(self, row: int, column: int) -> float:
        """A lower bound of :meth:`missed_at`, at once."""
        preset = self.goals.heartbeat[0] if self.goals.heartbeat is not None else 0
        return max(missed_at_least(view, preset) for view in self._with_setting(row, column))

    def _with_setting(self, row: int, column: int) -> list[LinkModel]:
        setting = self.grid.attempts[row], self.grid.timeouts[column]
        return [view.with_setting(*setting) for view in self.views]

    def meeting(self, names: Collection[str], rows: Sequence[int]) -> Mask:
        """Where settings of these rows meet the named goals, a heartbeat too."""
        met = self.candidates(names)[list(rows)]
        for row, own in zip(rows, met, strict=True):
            columns = np.flatnonzero(own).tolist() if "heartbeat" in names else []
            if columns and self.memoryless and self.heartbeat_met(row, columns[0]):
                refused = partial(lambda row, column: not self.heartbeat_met(row, column), row)
                own[columns[bisect_left(columns, x=True, key=refused) :]] = False
            elif columns:
                own[columns] = [not self.memoryless and self.heartbeat_met(row, each) for each in columns]
        return met

    def shortest(self, names: Collection[str], rows: Iterable[int]) -> list[tuple[int, int]]:
        """The settings (row, column) with the shortest timeout of each row that meets the named goals."""
        found = []
        for row, own in enumerate(self.candidates(names)):
            columns = np.flatnonzero(own).tolist() if row in rows else []
            if "heartbeat" in names:  # without bursts a longer timeout is of no help
                columns = [
                    each
                    for each in columns[: 1 if self.memoryless else None]
                    if self.heartbeat_met(row, each)
                ]
            found += [(row, column) for column in columns[:1]]
        return found


def least(views: Sequence[tuple[Checked, Sequence[int]]]) -> tuple[int, int] | None:
    """The least setting that meets all goals in every view, as (retries, column of the timeout), or None.

    Least is the shortest scan with a dead station, the longest of the views'; then the soonest
    noticed, then the fewest errors. A view is a checked grid and its row for each number of retries.
    """
    met = np.logical_and.reduce([view.candidates(view.names)[list(rows)] for view, rows in views])
    if all(view.memoryless for view, _ in views):  # else a heartbeat may need a longer timeout
        met &= np.cumsum(met, axis=1) == 1
    retries, columns = np.nonzero(met)
    if not retries.size:
        return None
    keys = []
    for values in ("one_dead", "detect_mean", "errors"):
        worst = np.max(np.stack([getattr(view.grid, values)[list(rows)] for view, rows in views]), axis=0)
        # Times that differ by rounding only are equal: with probe more attempts cost a dead station nothing.
        keys.append((worst if values == "errors" else np.round(worst))[retries, columns])
    for index in np.lexsort((columns, retries, *reversed(keys))).tolist():
        chosen = int(retries[index]), int(columns[index])
        if all(view.heartbeat_met(rows[chosen[0]], chosen[1]) for view, rows in views):
            return chosen
    return None


def rows_of(checked: Checked, reading: Attempts) -> list[int]:
    """The row of a grid for D8179 = 0, 1, … 10."""
    return [checked.grid.attempts.index(attempts_per_poll(reading, r)) for r in range(MAX_RETRIES + 1)]


def noise_views(*lines: LinkModel) -> tuple[LinkModel, ...]:
    """Links under each noise at which their goals must be met.

    What is entered is never known to a factor, so the level ``bad`` counts beside it, as it stands for noise
    that is not known at all: entering some noise, or more, never leads to fewer attempts, and never meets a
    goal for errors, a dead station or an interruption that was refused.
    Stronger bursts may cause fewer errors than weaker ones: of these, the worst counts
    (:func:`~bussim.exact.sizing.noise_levels.weaker_bursts`), at eight levels a decade, between which errors
    may be up to 5 % more. Means rise with the noise. Heartbeats and the chance of a scan over a deadline are
    judged with the bursts as entered; weaker ones had up to twice as many such scans. So without bursts no
    such goal that was refused is met with more noise; stronger bursts may meet one that weaker ones did not.
    """
    levels = ((line, with_level(line, LEVELS[BAD])) for line in lines)
    return tuple(view for line, bad in levels for view in ((line, bad) if line.noisy else (bad,)))


def evaluate_goals(
    model: LinkModel, goals: Goals, *, alone: bool = False, lines: tuple[LinkModel, ...] = ()
) -> Checked:
    """All settings from the timeout floor on, for 1 to 11 attempts.

    The goals must be met by the link as it is and by the complete one, or by the ``lines`` that are given.
    ``alone``: with the link's own noise only, however little it is.
    """
    lines = lines or model.lines
    views = lines if alone else noise_views(*lines)
    weaker = () if alone else tuple(view for line in lines for view in weaker_bursts(line))
    return Checked(views, _worst_grid(views, weaker, () if goals.scan is None else (goals.scan[0],)), goals)


@lru_cache(maxsize=64)
def _worst_grid(
    views: tuple[LinkModel, ...], weaker: tuple[LinkModel, ...], deadlines: tuple[int, ...]
) -> Grid:
    model = views[0]
    top = model.timeout_range[1] * TIMEOUT_UNIT
    low = max(timeout_floor(model), model.timeout_range[0] * TIMEOUT_UNIT)
    timeouts = tuple(range(low, top + 1, TIMEOUT_UNIT))
    grid = worst_of(_grid(view, timeouts, deadlines) for view in views)
    some = np.unique(np.geomspace(1, len(timeouts), _WEAKER_SAMPLES).astype(np.int64)) - 1
    sampled = tuple(timeouts[column] for column in some.tolist())
    for view in weaker:
        grid.take_worse(_errors(view, sampled))
    return grid


@lru_cache(maxsize=128)
def _grid(model: LinkModel, timeouts: tuple[int, ...], deadlines: tuple[int, ...]) -> Grid:
    return evaluate(model, range(1, MAX_RETRIES + 2), timeouts, deadlines)


@lru_cache(maxsize=256)
def _errors(model: LinkModel, timeouts: tuple[int, ...]) -> Grid:
    return evaluate(model, range(1, MAX_RETRIES + 2), timeouts, details=False)


@lru_cache(maxsize=512)
def _gaps(model: LinkModel) -> tuple[tuple[Distribution, int], ...]:
    """The refresh gaps of all pairs that differ: distribution, and PLC scans of both."""
    found = {}
    for gap in gap_distributions(Solved(model), _GAP_FLOOR, by_position=False).values():
        scans = model.scans_between(gap.source, gap.receiver)
        found[id(gap.distribution), scans] = (gap.distribution, scans)
    return tuple(found.values())


def missed_at_least(model: LinkModel, preset: int) -> float:
    """A lower bound of :func:`missed_per_year` that takes no distribution.

    The master's data frame is not repeated: after so many damaged ones in a row that scans without errors
    fill the preset, the heartbeat is missed.
    """
    clean = clean_scan(model, slowest=False)
    line = line_of(model)
    found = 0.0
    for station in (*model.stations, *model.listeners):
        in_a_row = max(0, preset - model.scans_between(MASTER, station.number)) // clean
        hit = line.outcome(poll_path(model, station.number), model.data_bits).hit.sum(axis=1).min()
        found = max(found, float(hit) ** in_a_row if station.hears else 0.0)
    return YEAR / clean * found


def least_preset(model: LinkModel, most: float) -> float:
    """The shortest preset (ticks) of a heartbeat missed at most so often a year; infinite for none."""
    chance = most * clean_scan(model, slowest=False) / YEAR
    found = 0.0
    for gaps, scans in _gaps(model):
        if gaps.lost >= chance:
            return math.inf
        found = max(found, scans + gaps.quantile(min(chance - gaps.lost, 0.999)))
    return found


def missed_per_year(model: LinkModel, preset: int) -> float:
    """How often a year a heartbeat's watchdog (ticks) runs out although all stations live, worst pair.

    The heartbeat is a word that changes in every PLC scan of its source; the longest PLC scans of
    both stations are taken off the preset. There are as many gaps a year as scans without errors: that
    noise makes scans slower, and thereby gaps fewer, is no merit.
    """
    year = YEAR / clean_scan(model, slowest=False)
    return year * max(float(gaps.tail(float(preset - scans))) + gaps.lost for gaps, scans in _gaps(model))

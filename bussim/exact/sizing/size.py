"""Which D8179 and D8180 a link should have: what ``bussim size`` prints and its JSON form."""

from dataclasses import dataclass, field, replace

import numpy as np

from bussim.exact.link import TIMEOUT_UNIT, LinkModel
from bussim.exact.sizing.assumptions import Assumption, assumptions, refused_otherwise
from bussim.exact.sizing.choice import Choice, choice_of, recommend
from bussim.exact.sizing.evaluation import Checked, evaluate_goals, least, rows_of, timeout_floor
from bussim.exact.sizing.goals import Goals
from bussim.exact.sizing.margin import Margin, margins
from bussim.exact.sizing.noise_levels import BAD, LEVELS, NoiseLevels, noise_levels_of, with_level
from bussim.exact.sizing.unmet_goals import Unmet, unmet_goals
from bussim.exact.solve import Solved
from bussim.exact.text import in_ms, ms, ms_at_most
from bussim.plc.profiles import MAX_RETRIES, AbsentStation, Attempts, attempts_per_poll
from bussim.scenario.provenance import ASSUMED, ENTERED, GOALS, LEVEL, NOISE, classes
from bussim.units import TICKS_PER_SECOND
from bussim.words.language import say

#: Chances of an error within this factor count as equal on the Pareto front, and the longest scan with a
#: dead station, in ticks, that is considered there.
_EQUAL = 1.25
_LONGEST = TICKS_PER_SECOND


@dataclass(frozen=True, slots=True)
class Robust:
    """The least setting that meets the goals under every reading of the assumptions.

    ``choices`` has it under each (reading of D8179, policy for absent stations).
    """

    retries: int
    timeout: int
    choices: dict[tuple[Attempts, AbsentStation], Choice]

    def to_json(self) -> dict[str, object]:
        """The setting, and its figures under each reading."""
        return {
            "D8179": self.retries,
            "D8180": self.timeout // TIMEOUT_UNIT,
            "readings": [
                {"attempts_means": str(reading), "absent_station": str(absent), **choice.to_json()}
                for (reading, absent), choice in self.choices.items()
            ],
        }


@dataclass(frozen=True, slots=True)
class Sizing:
    """A recommendation for one link, or why there is none.

    ``floor`` is the least timeout considered (ticks). ``decided`` says of a line with stations that
    do not reply whether it needs the recommended setting as it is or complete, and what else would do.
    ``noise_levels`` is there where the link has no noise. ``front`` are the recommended setting and those
    that no other one beats in errors, scan with one dead and detection together; ``front_longer`` more of
    them have scans of over a second and are left out. ``margins`` say what more noise does to the recommended
    setting, ``assumptions`` what it rests on, what changes it most first, ``otherwise`` what would meet the
    goals, where none does, if an assumption did not hold. ``checked`` has the grid.
    """

    model: LinkModel
    goals: Goals
    valid: bool
    reasons: tuple[str, ...]
    floor: int = 0
    recommended: Choice | None = None
    decided: str = ""
    robust: Robust | None = None
    front: tuple[Choice, ...] = ()
    front_longer: int = 0
    unmet: tuple[Unmet, ...] = ()
    robust_unmet: tuple[str, ...] = ()
    noise_levels: NoiseLevels | None = None
    margins: tuple[Margin, ...] = ()
    assumptions: tuple[Assumption, ...] = ()
    otherwise: tuple[str, ...] = ()
    checked: Checked | None = field(default=None, compare=False)

    @property
    def level(self) -> str:
        """The noise that the false station errors of the recommended setting are for, in words."""
        if not self.model.noisy or self.recommended is None:
            return say("size_level_bad")
        entered, best = self.margins[0], self.recommended
        bad = with_level(self.model.lines[-1], LEVELS[BAD]).with_setting(best.attempts, best.timeout)
        stations = zip(bad.stations, Solved(bad).fails, strict=True)
        if entered.per_scan < sum(fails.error for station, fails in stations if station.alive):
            return say("size_level_more")
        return say("size_level_weaker" if entered.weaker else "size_level_entered")

    @property
    def figures(self) -> dict[str, str]:
        """What the goals ``onsets``, ``scan`` and ``heartbeat`` limit, of the recommended setting."""
        best, checked = self.recommended, self.checked
        if best is None or checked is None:
            return {}
        at = checked.grid.at(best.attempts, best.timeout)
        found: dict[str, str] = {}
        for name in ("onsets", "scan", "heartbeat"):
            if name in checked.names:
                value = checked.missed_at(*at) if name == "heartbeat" else float(checked.values[name][at])
                found[name] = self.goals.figure(name, value)
        return found

    def apart(self) -> str:
        """How far the robust setting lies from the recommended one, in words."""
        best, safe = self.recommended, self.robust
        if best is None:
            return ""
        if safe is None:
            return say("size_apart_none")
        if (safe.retries, safe.timeout) == (best.retries, best.timeout):
            return say("size_apart_same")
        worst = max(choice.dead for choice in safe.choices.values())
        units = safe.timeout // TIMEOUT_UNIT
        return say("size_apart", retries=safe.retries, units=units, worst=ms_at_most(worst))

    def mov_lines(self) -> list[str]:
        """Instructions for the master's setting program, with what they mean behind a semicolon."""
        best = self.recommended
        if best is None:
            return []
        retries = say("mov_retries", attempts=best.attempts, reading=str(self.model.reading))
        lines = {
            f"LD {self.model.set_under}": say(
                "mov_first_step" if self.model.set_under == "M8038" else "mov_first_scan"
            ),
            f"MOV K{best.retries} D8179": retries,
            f"MOV K{best.d8180} D8180": say("mov_timeout", time=ms(best.timeout)),
        }
        return [say("mov_line", code=code, meaning=meaning) for code, meaning in lines.items()]

    def neighbours(self) -> list[tuple[int, int]]:
        """The chosen (retries, timeout in ticks), one retry less and none, for a check by simulation.

        Without retries errors are frequent enough to be compared.
        """
        best = self.recommended
        if best is None:
            return []
        every = dict.fromkeys((best.retries, max(0, best.retries - 1), 0))
        return [(retries, best.timeout) for retries in every]

    def classes(self) -> dict[str, dict[str, str]]:
        """Where the inputs come from, and the class of each figure."""
        inputs = {**self.model.inputs, LEVEL: ASSUMED}
        inputs[GOALS] = ENTERED if {"errors", "ride"} <= set(self.goals.given) else ASSUMED
        errors = "false_errors_per_year", "false_error_onsets_per_year"
        figures = ("mean_ms", *errors, "one_dead_ms", "detect_ms", "ride_through_ms")
        found = classes({**inputs, NOISE: ASSUMED}, ("timeout_floor_ms", *figures))
        return {**found, "inputs": inputs}

    def to_json(self) -> dict[str, object]:
        """One link of the JSON form, times in ms."""
        return {
            "valid": self.valid,
            "reasons": list(self.reasons),
            "notes": list(self.model.notes),
            "not_replying": list(self.model.not_replying),
            "assumed_noise": None if self.noise_levels is None else "ladder",
            "goals": list(self.goals.texts().values()),
            "goal_figures": self.figures,
            "timeout_floor_ms": in_ms(self.floor),
            "recommended": None if self.recommended is None else self.recommended.to_json(),
            "decided": self.decided,
            "robust": None if self.robust is None else self.robust.to_json(),
            "robust_unmet": list(self.robust_unmet),
            "apart": self.apart(),
            "pareto": [choice.to_json() for choice in self.front],
            "pareto_above_1_s": self.front_longer,
            "unmet": [unmet.to_json() for unmet in self.unmet],
            "ladder": None if self.noise_levels is None else self.noise_levels.to_json(),
            "margins": [margin.to_json() for margin in self.margins],
            "assumptions": [assumption.to_json() for assumption in self.assumptions],
            "otherwise": list(self.otherwise),
            "rests_on": self.classes(),
            "mov": self.mov_lines(),
        }


def size(model: LinkModel, goals: Goals | None = None) -> Sizing:
    """Choose D8179 and D8180 of a link; the setting that the model has does not matter.

    Without noise nothing could be concluded from the errors, and noise that is entered is never known to a
    factor: the goals must be met at the level ``bad`` as well
    (:func:`~bussim.exact.sizing.evaluation.noise_views`).
    """
    goals = goals or Goals()
    if model.obstacles:
        return Sizing(model, goals, valid=False, reasons=model.obstacles)
    if not model.stations:
        return Sizing(model, goals, valid=False, reasons=(say("size_no_slave"),))
    floor = timeout_floor(model)
    if floor > model.timeout_range[1] * TIMEOUT_UNIT:
        reason = say("size_floor", floor=ms(floor), most=ms(model.timeout_range[1] * TIMEOUT_UNIT))
        return Sizing(model, goals, valid=False, reasons=(reason,), floor=floor)
    views = {absent: evaluate_goals(replace(model, absent=absent), goals) for absent in AbsentStation}
    checked = views[model.absent]
    recommended = recommend(model, goals)
    robust, why_not = _robust(views)
    front, longer = _front(checked, model.reading, recommended)
    timeout = recommended.timeout if recommended else checked.grid.timeouts[0]
    return Sizing(
        model,
        goals,
        valid=True,
        reasons=(),
        floor=floor,
        recommended=recommended,
        decided=_decided(model, goals, recommended),
        robust=robust,
        front=front,
        front_longer=longer,
        unmet=() if recommended else unmet_goals(model, goals, checked),
        robust_unmet=why_not,
        noise_levels=None if model.noisy else noise_levels_of(model, timeout),
        margins=margins(model, goals, recommended),
        assumptions=assumptions(model, goals, recommended) if recommended else (),
        otherwise=() if recommended else refused_otherwise(model, goals),
        checked=checked,
    )


def _decided(model: LinkModel, wanted: Goals, best: Choice | None) -> str:
    """Which line needs the recommended setting: as it is, or complete; what would do for either alone."""
    if len(model.lines) == 1:
        return say("size_all_dead") if model.dead else ""
    need, said = [], []
    for name, line in zip((say("size_as_is"), say("size_complete")), model.lines, strict=True):
        alone = recommend(model, wanted, lines=(line,))
        if alone is not None and (
            best is None or (alone.retries, alone.timeout) != (best.retries, best.timeout)
        ):
            said.append(say("size_alone", name=name, retries=alone.retries, units=alone.d8180))
        else:
            need.append(name)
    if best is not None:
        said.insert(0, say("size_needs", states=need) if need else say("size_needs_both"))
    return say("size_two_lines", said=said) if said else say("size_two_lines_only")


def _robust(views: dict[AbsentStation, Checked]) -> tuple[Robust | None, tuple[str, ...]]:
    """The least setting that meets all goals under every reading; else the readings that stand in its way."""
    readings = {
        (reading, absent): (views[absent], rows_of(views[absent], reading))
        for reading in Attempts
        for absent in AbsentStation
    }
    chosen = least(list(readings.values()))
    if chosen is not None:
        retries, timeout = chosen[0], views[AbsentStation.FULL].grid.timeouts[chosen[1]]
        found = {key: choice_of(view.grid, key[0], retries, timeout) for key, (view, _) in readings.items()}
        return Robust(retries, timeout, found), ()
    failing = tuple(
        say("size_not_under", reading=str(reading), absent=str(absent))
        for (reading, absent), view in readings.items()
        if least([view]) is None
    )
    return None, failing or (say("size_not_all"),)


def _front(checked: Checked, reading: Attempts, recommended: Choice | None) -> tuple[tuple[Choice, ...], int]:
    """The settings that no other beats in errors, scan with one dead and detection, shortest scan first.

    Errors are compared by their chance in a scan; within a quarter they count as equal. Of settings with the
    same attempts (D8179 0 and 1, read as exactly D8179) the lower one stands. Scans of over a second are only
    counted, but for the shortest and the recommended setting, which is always there.
    """
    grid = checked.grid
    rows = {attempts_per_poll(reading, r): r for r in range(MAX_RETRIES, -1, -1)}
    points = []
    for attempts, retries in sorted(rows.items()):
        i = grid.attempts.index(attempts)
        for j in np.nonzero(grid.valid)[0].tolist():
            figures = (grid.one_dead, grid.detect_mean, grid.error_per_scan)
            points.append((tuple(float(values[i, j]) for values in figures), retries, grid.timeouts[j]))
    points.sort()
    front: list[Choice] = []
    longer = 0
    best: list[tuple[float, float]] = []  # (detect, errors) of the front so far
    for (dead, detect, errors), retries, timeout in points:
        wanted = recommended is not None and (retries, timeout) == (recommended.retries, recommended.timeout)
        if not wanted and any(d <= detect and e <= _EQUAL * errors for d, e in best):
            continue
        best.append((detect, errors))
        if front and dead > _LONGEST and not wanted:
            longer += 1
        else:
            front.append(choice_of(grid, reading, retries, timeout))
    return tuple(front), longer

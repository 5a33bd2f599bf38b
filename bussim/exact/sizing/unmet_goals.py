"""Goals that no setting meets: which stand against each other, by how much, and what would help."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, islice
from typing import Any, NamedTuple

import numpy as np

from bussim.engines.nn.frames import data_chars
from bussim.exact.link import TIMEOUT_UNIT, LinkModel, frame_ticks
from bussim.exact.sizing.evaluation import Checked, Mask, evaluate_goals, least, least_preset, rows_of
from bussim.exact.sizing.goals import Goals, Rate
from bussim.exact.sizing.noise_levels import scaled_noise
from bussim.exact.solve import Solved
from bussim.exact.text import at_least, at_most, ms_at_most
from bussim.units import TICKS_PER_MS
from bussim.wording import about
from bussim.words.language import say

#: How much less noise is tried.
_LESS = (2, 5, 10, 20, 50, 100, 1_000, 10_000)
#: So many combinations of changes are searched for, of so many changes each at most.
_COMBINATIONS, _CHANGES = 4, 3
#: A probability of a scan over a deadline from which on it tells nothing.
_HOPELESS = 0.99


class Changed(NamedTuple):
    """A link, its goals, and by how many times its noise was made less."""

    model: LinkModel
    goals: Goals
    less: int = 1


@dataclass(frozen=True, slots=True)
class Unmet:
    """What cannot be met: one goal by itself, or several only together.

    ``goals`` are names; each of them left out, the others can be met. ``text`` says it with numbers,
    ``helps`` what would make all goals possible.
    """

    goals: tuple[str, ...]
    text: str
    helps: tuple[str, ...]

    def to_json(self) -> dict[str, object]:
        """As plain data."""
        return {"goals": list(self.goals), "text": self.text, "helps": list(self.helps)}


def no_help() -> str:
    """What is said where no combination of changes helps."""
    return say("help_none", number=_CHANGES)


def unmet_goals(model: LinkModel, goals: Goals, checked: Checked) -> tuple[Unmet, ...]:
    """Why no setting meets all goals: all smallest sets of goals that stand against each other."""
    index = sorted(set(rows_of(checked, model.reading)))
    sets = conflicts(checked, index)
    helps = tuple(change.text for change in helpful_changes(model, goals)) if sets else ()
    return tuple(Unmet(names, _conflict(checked, index, names), helps) for names in sets)


def conflicts(checked: Checked, index: Sequence[int]) -> list[tuple[str, ...]]:
    """All sets of goals that no setting of these rows meets and of which no smaller part is such a set."""
    return smallest_sets(checked.names, lambda names: bool(checked.shortest(names, index)))


def smallest_sets(goals: Sequence[str], possible: Callable[[tuple[str, ...]], bool]) -> list[tuple[str, ...]]:
    """All sets of goals that are not possible and of which no smaller part is such a set."""
    found: list[tuple[str, ...]] = []
    for size in range(1, len(goals) + 1):
        for names in combinations(goals, size):
            if not any(set(smaller) <= set(names) for smaller in found) and not possible(names):
                found.append(names)
    return found


def _conflict(checked: Checked, index: list[int], names: tuple[str, ...]) -> str:
    texts = checked.goals.texts()
    if len(names) == 1:
        best = _best(checked, index, names[0], checked.candidates(())[index])
        return say("unmet_alone", goal=texts[names[0]], best=best)
    parts = []
    for name in names:
        others = [other for other in names if other != name]
        best = _best(checked, index, name, checked.meeting(others, index))
        parts.append(say("unmet_given", goals=[texts[other] for other in others], best=best))
    return say("unmet_together", goals=[texts[name] for name in names], parts=parts)


def best_value(
    checked: Checked, index: Sequence[int], name: str, among: Mask
) -> tuple[float, int, int] | None:
    """The best value that a goal's figure has among settings, with its row of ``index`` and its column."""
    if name == "heartbeat":  # with the shortest timeout of each row
        for row, column in _shortest(index, among):
            if not checked.hopeless(row, column):
                checked.missed_at(row, column)
    every = checked.missed if name == "heartbeat" else checked.values[name]
    values = np.where(among, every[list(index)], np.nan)
    if np.isnan(values).all():
        return None
    best = int(np.nanargmax(values) if name == "ride" else np.nanargmin(values))
    row, column = divmod(best, values.shape[1])
    return float(values[row, column]), row, column


def _shortest(index: Sequence[int], among: Mask) -> list[tuple[int, int]]:
    """The setting with the shortest timeout of each row that has one."""
    return [(row, int(np.argmax(met))) for row, met in zip(index, among, strict=True) if met.any()]


def _best(checked: Checked, index: list[int], name: str, among: Mask) -> str:
    found = best_value(checked, index, name, among)
    if found is None:
        bound = min(checked.missed_at_least(*setting) for setting in _shortest(index, among))
        return say("unmet_misses", number=about(at_least(bound)))
    value, row, column = found
    shown = checked.goals.figure(name, value)
    if name == "scan" and value > _HOPELESS:
        return _deadline(checked, index, among)
    attempts, units = checked.grid.attempts[index[row]], checked.grid.timeouts[column] // TIMEOUT_UNIT
    return say("unmet_best", figure=shown, attempts=attempts, units=units)


def _deadline(checked: Checked, index: list[int], among: Mask) -> str:
    """The least deadline that some setting keeps as seldom exceeded as is wanted, rounded up, with it."""
    found = [
        (_least_time(checked, setting, "scan", checked.goals), *setting)
        for setting in _shortest(index, among)
    ]
    time, row, column = min(found)
    attempts, units = checked.grid.attempts[row], checked.grid.timeouts[column] // TIMEOUT_UNIT
    return say("unmet_deadline", time=ms_at_most(time), attempts=attempts, units=units)


# -- what would help ------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Change:
    """Changes of the link or its goals that make all goals possible together: the solver met them."""

    text: str
    model: LinkModel
    goals: Goals


@dataclass(frozen=True, slots=True)
class _Kind:
    """One kind of change, the smallest first. ``name`` is the goal whose limit is moved, else empty."""

    name: str
    steps: tuple[Callable[[Changed], Changed], ...]


def helpful_changes(model: LinkModel, goals: Goals) -> list[Change]:
    """Changes that help, of as few kinds at once as do; of each kind the smallest that does."""
    kinds = list(_kinds(model, goals))
    for count in range(1, _CHANGES + 1):
        each = (_smallest(model, goals, chosen) for chosen in combinations(kinds, count))
        most = len(kinds) if count == 1 else _COMBINATIONS
        if found := list(islice(filter(None, each), most)):
            return found
    return []


def _kinds(model: LinkModel, goals: Goals) -> Iterator[_Kind]:
    if model.dead and model.alive:
        yield _Kind("", (_complete,))
    if fewer := range(len(model.stations) - 1, 0, -1):
        yield _Kind("", tuple(partial(_fewer, count) for count in fewer))
    if model.mode:
        yield _Kind("", tuple(partial(_simpler, mode) for mode in range(model.mode - 1, -1, -1)))
    if model.noisy:
        yield _Kind("", tuple(partial(_quieter, less) for less in _LESS))
    for name in goals.forms():
        if name == "ride" and not goals.ride:
            continue
        yield _Kind(name, (partial(_without_limit, name),))


def _complete(now: Changed) -> Changed:
    return now._replace(model=now.model.complete)


def _fewer(count: int, now: Changed) -> Changed:
    return now._replace(model=replace(now.model, stations=now.model.stations[:count]))


def _simpler(mode: int, now: Changed) -> Changed:
    return now._replace(model=with_mode(now.model, mode))


def _quieter(less: int, now: Changed) -> Changed:
    return now._replace(model=scaled_noise(now.model, 1 / less), less=less)


def _without_limit(name: str, now: Changed) -> Changed:
    return now._replace(goals=replace(now.goals, **_NO_LIMIT[name]))


def _smallest(model: LinkModel, goals: Goals, kinds: Sequence[_Kind]) -> Change | None:
    """The smallest changes of these kinds that help together, or None where the largest do not."""
    steps = [len(kind.steps) - 1 for kind in kinds]

    def changed(at: Sequence[int]) -> Changed:
        now = Changed(model, goals)
        for kind, step in zip(kinds, at, strict=True):
            now = kind.steps[step](now)
        return now

    def works(at: Sequence[int]) -> bool:
        now = changed(at)
        return _setting(now.model, now.goals) is not None

    if not works(steps):
        return None
    for index, kind in enumerate(kinds):
        tried = [[*steps[:index], step, *steps[index + 1 :]] for step in range(len(kind.steps))]
        steps = next(filter(works, tried))
    now = changed(steps)
    for kind in kinds:
        if kind.name:
            now = now._replace(goals=_no_further(now.model, now.goals, kind.name, goals))
    chosen = _setting(now.model, now.goals)
    if chosen is None:
        return None
    timed = model.noise.chains and {kind.name for kind in kinds} & {"scan", "heartbeat"}
    setting = say("help_setting_bursts" if timed else "help_setting", retries=chosen[0], units=chosen[1])
    change = say("help_all", changes=_changes(model, goals, now))
    return Change(say("help_then", change=change, setting=setting), now.model, now.goals)


def _no_further(model: LinkModel, goals: Goals, name: str, given: Goals) -> Goals:
    """The goals with one of them, which they leave without a limit, as strict as the others allow.

    Its figure is rounded to the safe side. With bursts a longer timeout than the shortest that meets the
    others might allow a deadline or a preset to be a little stricter still.
    """
    checked = evaluate_goals(model, goals)
    index = rows_of(checked, model.reading)
    if name in ("scan", "heartbeat"):
        values = (
            _least_time(checked, setting, name, given) for setting in checked.shortest(checked.names, index)
        )
        return _limited(goals, name, min(values, default=math.inf), given)
    others = checked.meeting([each for each in checked.names if each != name], index)
    found = best_value(checked, index, name, others)
    return goals if found is None else _limited(goals, name, found[0], given)


def _least_time(checked: Checked, setting: tuple[int, int], name: str, given: Goals) -> float:
    """The least deadline or preset (ticks) with one setting."""
    row, column = setting
    views = [
        view.with_setting(checked.grid.attempts[row], checked.grid.timeouts[column]) for view in checked.views
    ]
    if name == "scan" and given.scan is not None:
        return max(Solved(view).distribution.quantile(given.scan[1]) for view in views)
    if given.heartbeat is None:
        raise ValueError(f"{name} has no limit")
    return max(least_preset(view, given.heartbeat[1]) for view in views)


def _limited(goals: Goals, name: str, value: float, given: Goals) -> Goals:
    """The goals with one of them limited to a figure, rounded to the safe side, and else as it was given."""
    if math.isinf(value):
        return goals
    ms, tens = (math.ceil(value / unit - 1e-9) * unit for unit in (TICKS_PER_MS, 10 * TICKS_PER_MS))
    match name:
        case "ride":
            return replace(goals, ride=int(value // TICKS_PER_MS) * TICKS_PER_MS)
        case "dead":
            return replace(goals, dead=ms)
        case "scan":
            return replace(goals, scan=(ms, (given.scan or (0, 1.0))[1]))
        case "heartbeat":
            return replace(goals, heartbeat=(tens, (given.heartbeat or (0, 1.0))[1]))
        case "errors":
            return replace(goals, errors=_rounded(given.errors, value))
        case _:
            return replace(goals, onsets=_rounded(given.onsets or 1.0, value))


def _rounded(given: float, value: float) -> Rate:
    """A rate a year that is not less than a value, in the unit of the given one."""
    unit = Rate.of(given).unit
    return Rate(at_most(value / float(Rate(1.0, unit)), 1), unit)


#: Each goal without a limit, by its name; of errors more a year than there are scans.
_NO_LIMIT: dict[str, dict[str, Any]] = {
    "errors": {"errors": 1e12},
    "onsets": {"onsets": None},
    "scan": {"scan": None},
    "dead": {"dead": None},
    "ride": {"ride": 0},
    "heartbeat": {"heartbeat": None},
}


def _setting(model: LinkModel, goals: Goals) -> tuple[int, int] | None:
    """D8179 and D8180 of the least setting that meets all goals, or None."""
    checked = evaluate_goals(model, goals)
    chosen = least([(checked, rows_of(checked, model.reading))])
    if chosen is None:
        return None
    return chosen[0], checked.grid.timeouts[chosen[1]] // TIMEOUT_UNIT


def _changes(model: LinkModel, goals: Goals, now: Changed) -> list[str]:
    """What differs from a link and its goals, in words."""
    parts = []
    if len(now.model.stations) != len(model.stations):
        new, old = len(now.model.stations) + 1, len(model.stations) + 1
        parts.append(say("help_stations", new=new, old=old))
    if model.alive and len(now.model.dead) < len(model.dead[: len(now.model.stations)]):
        parts.append(say("help_complete"))
    if now.model.mode != model.mode:
        parts.append(say("help_mode", new=now.model.mode, old=model.mode))
    if now.less > 1:
        parts.append(say("help_noise", times=now.less))
    after, limits = now.goals.texts(), goals.limits()
    return parts + [
        say("help_goal", new=after.get(name, say("goal_no_ride")), old=limits[name])
        for name, text in goals.texts().items()
        if after.get(name) != text
    ]


def with_mode(model: LinkModel, mode: int) -> LinkModel:
    """The same link in another refresh mode."""
    ratio = frame_ticks(data_chars(mode)) / frame_ticks(data_chars(model.mode))
    return replace(
        model,
        mode=mode,
        data=round(model.data * ratio),
        stations=tuple(replace(s, reply=round(s.reply * ratio)) for s in model.stations),
    )

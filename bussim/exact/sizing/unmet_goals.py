"""Goals that no setting meets: which stand against each other, by how much, and what would help."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, islice
from typing import NamedTuple

import numpy as np

from bussim.engines.nn.frames import data_chars
from bussim.exact.link import TIMEOUT_UNIT, LinkModel, frame_ticks
from bussim.exact.scan.outages import longest_scan
from bussim.exact.sizing.evaluation import Checked, Mask, evaluate_goals, least, rows_of
from bussim.exact.sizing.goals import Goals, Rate
from bussim.exact.sizing.noise_levels import scaled_noise
from bussim.exact.solve import Solved
from bussim.exact.text import at_least, at_most, ms_at_most
from bussim.plc.profiles import MAX_RETRIES
from bussim.units import TICKS_PER_MS, UNIT_TICKS
from bussim.wording import about

#: How much less noise is tried, and how much further deadlines and presets are set first.
_LESS = (2, 5, 10, 20, 50, 100, 1_000, 10_000)
_UNITS = {"scan": TICKS_PER_MS, "heartbeat": 10 * TICKS_PER_MS}  # of deadlines and presets, in ticks
_FURTHER = (1.1, 1.25, 1.5, 2, 3, 5, 10)
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


def unmet_goals(model: LinkModel, goals: Goals, checked: Checked) -> tuple[Unmet, ...]:
    """Why no setting meets all goals: all smallest sets of goals that stand against each other."""
    index = sorted(set(rows_of(checked, model.reading)))
    sets = conflicts(checked, index)
    helps = tuple(change.text for change in helpful_changes(model, goals)) if sets else ()
    return tuple(Unmet(names, _conflict(checked, index, names), helps) for names in sets)


def conflicts(checked: Checked, index: Sequence[int]) -> list[tuple[str, ...]]:
    """All sets of goals that no setting of these rows meets and of which no smaller part is such a set."""
    found: list[tuple[str, ...]] = []
    for size in range(1, len(checked.names) + 1):
        for names in combinations(checked.names, size):
            known = any(set(smaller) <= set(names) for smaller in found)
            if not known and not checked.possible(names, index):
                found.append(names)
    return found


def _conflict(checked: Checked, index: list[int], names: tuple[str, ...]) -> str:
    texts = checked.goals.texts()
    if len(names) == 1:
        best = _best(checked, index, names[0], checked.candidates(())[index])
        return f"{texts[names[0]]}: no setting does; {best}"
    parts = []
    for name in names:
        others = [other for other in names if other != name]
        given = " and ".join(texts[other] for other in others)
        parts.append(f"with {given}, {_best(checked, index, name, checked.candidates(others)[index])}")
    return f"{' and '.join(texts[name] for name in names)}: not together; {'; '.join(parts)}"


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
        return f"each setting misses it {about(at_least(bound))} times a year or more"
    value, row, column = found
    shown = checked.goals.figure(name, value)
    if name == "scan" and value > _HOPELESS:
        least_one = _deadline(checked, index, among)
        return f"practically every scan takes longer; the least deadline that does is {least_one}"
    attempts = checked.grid.attempts[index[row]]
    return f"the best is {shown} (attempts {attempts}, D8180 {checked.grid.timeouts[column] // TIMEOUT_UNIT})"


def _deadline(checked: Checked, index: list[int], among: Mask) -> str:
    """The least deadline that some setting keeps as seldom exceeded as is wanted, rounded up, with it."""
    chance = (checked.goals.scan or (0, 1.0))[1]
    found = []
    for row, column in _shortest(index, among):
        setting = checked.grid.attempts[row], checked.grid.timeouts[column]
        views = (view.with_setting(*setting) for view in checked.views)
        found.append((max(Solved(view).distribution.quantile(chance) for view in views), *setting))
    time, attempts, timeout = min(found)
    return f"{ms_at_most(time)} (attempts {attempts}, D8180 {timeout // TIMEOUT_UNIT})"


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
    fewer = [
        count
        for count in range(len(model.stations) - 1, 0, -1)
        if any(s.alive for s in model.stations[:count])
    ]
    if fewer:
        yield _Kind("", tuple(partial(_fewer, count) for count in fewer))
    if model.mode:
        yield _Kind("", tuple(partial(_simpler, mode) for mode in range(model.mode - 1, -1, -1)))
    if model.noisy:
        yield _Kind("", tuple(partial(_quieter, less) for less in _LESS))
    for name in goals.forms():
        if name == "ride" and not goals.ride:
            continue
        yield _Kind(name, tuple(partial(_with_goals, each) for each in relaxed(model, goals, name)))


def _fewer(count: int, now: Changed) -> Changed:
    return now._replace(model=replace(now.model, stations=now.model.stations[:count]))


def _simpler(mode: int, now: Changed) -> Changed:
    return now._replace(model=with_mode(now.model, mode))


def _quieter(less: int, now: Changed) -> Changed:
    return now._replace(model=scaled_noise(now.model, 1 / less), less=less)


def _with_goals(change: Callable[[Goals], Goals], now: Changed) -> Changed:
    return now._replace(goals=change(now.goals))


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
        # A goal that is easier to meet is met by whatever met it before.
        steps = tried[bisect_left(tried, x=True, key=works)] if kind.name else next(filter(works, tried))
    now = changed(steps)
    for kind in kinds:
        if kind.name:
            now = now._replace(goals=_no_further(now.model, now.goals, kind.name, goals))
    setting = _setting(now.model, now.goals)
    return (
        None
        if setting is None
        else Change(f"{_changes(model, goals, now)} (then {setting})", now.model, now.goals)
    )


def _no_further(model: LinkModel, goals: Goals, name: str, given: Goals) -> Goals:
    """The goals with one of them as strict as the others allow, its figure rounded to the safe side."""
    if name in ("scan", "heartbeat"):
        return _no_longer(model, goals, name, given)
    if name == "ride" and not goals.ride:
        return goals
    checked = evaluate_goals(model, goals)
    index = rows_of(checked, model.reading)
    others = checked.candidates([each for each in checked.names if each != name])[index]
    found = best_value(checked, index, name, others)
    chosen = least([(checked, index)])
    if found is None or chosen is None:
        return goals
    strict = _limited(goals, name, found[0])
    if _setting(model, strict):
        return strict
    # A heartbeat stands in its way: what the least setting has.
    return _limited(goals, name, float(checked.values[name][index[chosen[0]], chosen[1]]))


def _limited(goals: Goals, name: str, value: float) -> Goals:
    """The goals with one of them limited to a figure, rounded to the safe side."""
    match name:
        case "ride":
            return replace(goals, ride=int(value // TICKS_PER_MS) * TICKS_PER_MS)
        case "dead":
            return replace(goals, dead=int(-(-value // TICKS_PER_MS)) * TICKS_PER_MS)
        case "errors":
            return replace(goals, errors=_rounded(goals.errors, value))
        case _:
            return replace(goals, onsets=_rounded(goals.onsets or 1.0, value))


def _no_longer(model: LinkModel, goals: Goals, name: str, given: Goals) -> Goals:
    """The goals with a deadline or a heartbeat's preset as short as all goals together allow, in its unit.

    With bursts, where each deadline takes distributions of its own, it stays as it was found.
    """
    unit = _UNITS[name]
    high = _limit(goals, name) // unit
    # The step before did not do.
    low = max((x for ticks in _longer(model, given, name) if (x := ticks // unit) < high), default=0)
    low = max(low, min(_limit(given, name) // unit, high - 1))
    while high - low > 1 and (name == "heartbeat" or model.noise.memoryless):
        middle = (low + high) // 2
        tried = _with_limit(goals, name, middle * unit)
        if _setting(model, tried) is None:
            low = middle
        else:
            high, goals = middle, tried
    return goals


def _longer(model: LinkModel, goals: Goals, name: str) -> list[int]:
    """Deadlines or presets (ticks) beyond that of a goal, up to one that is longer than two scans can be."""
    unit = _UNITS[name]
    longest = 2 * longest_scan(model.with_setting(MAX_RETRIES + 1, model.timeout_range[1] * TIMEOUT_UNIT))
    first = max(_limit(goals, name), unit)
    found = [round(first * factor / unit) * unit for factor in _FURTHER]
    while found[-1] < longest:
        found.append(2 * found[-1])
    return [ticks for ticks in dict.fromkeys(found) if ticks > _limit(goals, name)]


def _limit(goals: Goals, name: str) -> int:
    """The deadline or the preset of a goal, in ticks."""
    return ((goals.scan if name == "scan" else goals.heartbeat) or (0, 1.0))[0]


def _with_limit(goals: Goals, name: str, ticks: int) -> Goals:
    if name == "scan":
        return replace(goals, scan=(ticks, (goals.scan or (0, 1.0))[1]))
    return replace(goals, heartbeat=(ticks, (goals.heartbeat or (0, 1.0))[1]))


def _rounded(given: float, value: float) -> Rate:
    """A rate a year that is not less than a value, in the unit of the given one."""
    unit = Rate.of(given).unit
    return Rate(at_most(value / float(Rate(1.0, unit)), 1), unit)


def relaxed(model: LinkModel, goals: Goals, name: str) -> list[Callable[[Goals], Goals]]:
    """What makes one goal easier to meet, the least first; the last step leaves hardly a limit."""
    match name:
        case "errors":
            return [lambda now: replace(now, errors=_no_rate(now.errors))]
        case "onsets":
            return [lambda now: replace(now, onsets=_no_rate(now.onsets or 1.0))]
        case "dead":
            return [lambda now: replace(now, dead=UNIT_TICKS["y"])]
        case "ride":
            return [lambda now: replace(now, ride=1), lambda now: replace(now, ride=0)]
        case _:
            return [
                partial(lambda ticks, now: _with_limit(now, name, ticks), ticks)
                for ticks in _longer(model, goals, name)
            ]


def _no_rate(given: float) -> Rate:
    """More a year than there are scans, in the unit of a rate."""
    unit = Rate.of(given).unit
    return Rate(1e12 / float(Rate(1.0, unit)), unit)


def _setting(model: LinkModel, goals: Goals) -> str | None:
    """The least setting that meets all goals, in words, or None."""
    checked = evaluate_goals(model, goals)
    chosen = least([(checked, rows_of(checked, model.reading))])
    if chosen is None:
        return None
    return f"D8179 {chosen[0]}, D8180 {checked.grid.timeouts[chosen[1]] // TIMEOUT_UNIT}"


def _changes(model: LinkModel, goals: Goals, now: Changed) -> str:
    """What differs from a link and its goals, in words."""
    parts = []
    if len(now.model.stations) != len(model.stations):
        parts.append(
            f"{len(now.model.stations) + 1} stations on the link instead of {len(model.stations) + 1}"
        )
    if now.model.mode != model.mode:
        parts.append(f"refresh mode {now.model.mode} instead of {model.mode}")
    if now.less > 1:
        parts.append(f"{now.less:,} times less noise")
    new, old = now.goals.forms(), goals.forms()
    parts += [
        f"{new.get(name, 'ride>=0')} instead of {old[name]}" for name in old if new.get(name) != old[name]
    ]
    return " and ".join(parts)


def with_mode(model: LinkModel, mode: int) -> LinkModel:
    """The same link in another refresh mode."""
    ratio = frame_ticks(data_chars(mode)) / frame_ticks(data_chars(model.mode))
    return replace(
        model,
        mode=mode,
        data=round(model.data * ratio),
        stations=tuple(replace(s, reply=round(s.reply * ratio)) for s in model.stations),
    )

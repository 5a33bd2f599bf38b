"""The assumptions that would change a recommendation, or the figures of a setting, most."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

from bussim.exact.link import TIMEOUT_UNIT, LinkModel
from bussim.exact.sizing.choice import Choice, choice_of, recommend
from bussim.exact.sizing.evaluation import evaluate_goals, timeout_floor
from bussim.exact.sizing.goals import Goals
from bussim.exact.sizing.grid import evaluate
from bussim.exact.sizing.noise_levels import BAD, LEVELS, TYPICAL, scaled_noise, with_level
from bussim.exact.text import a_year, ms_at_least, ms_at_most
from bussim.plc.profiles import AbsentStation, Attempts, attempts_per_poll
from bussim.scenario.provenance import classes, in_words

#: So many assumptions are named.
_MOST = 3
#: A figure that changes by less than this part of it is not named.
_SLIGHT = 0.02
_NOTHING = "the figures hardly change"


@dataclass(frozen=True, slots=True)
class Assumption:
    """One assumption and what the recommended setting would be worth without it.

    ``otherwise`` has the setting's figures then, ``instead`` the setting that would be recommended then (None
    where no setting meets the goals).
    """

    name: str
    alternative: str
    before: Choice
    otherwise: Choice
    instead: Choice | None

    @property
    def weight(self) -> float:
        """By how much it changes the answer: differences of settings first, then of figures."""
        now, then = self.before, self.otherwise
        pairs = ((now.dead, then.dead), (now.errors, then.errors), (now.ride, then.ride))
        change = sum(abs(math.log((b + 1e-30) / (a + 1e-30))) for a, b in pairs)
        return change if self._stays else 1_000.0 + change

    @property
    def _stays(self) -> bool:
        return self.instead is not None and _setting(self.instead) == _setting(self.before)

    @property
    def differs(self) -> bool:
        """Whether another setting would be recommended, or a figure of this one be another."""
        return not self._stays or changes(self.before, self.otherwise) != _NOTHING

    def in_words(self) -> str:
        """What changes, in figures on the safe side."""
        before = self.before
        found = changes(before, self.otherwise)
        if self.instead is None:
            return f"{self.name}; {self.alternative}: {found}; no setting meets the goals"
        advice = f"D8179 = {self.instead.retries}, D8180 = {self.instead.d8180} would be recommended"
        if self._stays:
            advice = "the setting stays"
        return f"{self.name}; {self.alternative}: {found}; {advice}"

    def to_json(self) -> dict[str, object]:
        """As plain data, times in ms."""
        return {
            "assumption": self.name,
            "alternative": self.alternative,
            "text": self.in_words(),
            "otherwise": self.otherwise.to_json(),
            "recommended": None if self.instead is None else self.instead.to_json(),
        }


def changes(before: Choice, then: Choice) -> str:
    """The figures of a setting that differ between two assumptions, those of the second first."""
    parts = []
    for said, old, new, shown in (
        ("{} false station errors a year", before.errors, then.errors, a_year),
        ("a scan with a dead station of {}", before.dead, then.dead, ms_at_most),
        ("{} of interruption pass", before.ride, then.ride, ms_at_least),
        ("a scan of {}", before.mean, then.mean, ms_at_most),
    ):
        if abs(new - old) > _SLIGHT * old and shown(new) != shown(old):
            parts.append(f"{said.format(shown(new))} instead of {shown(old)}")
    return ", ".join(parts) or _NOTHING


def setting_assumptions(model: LinkModel) -> tuple[str, ...]:
    """What would change the figures of the setting that a link has most, in words; none without a law."""
    if not (model.valid and model.alive):
        return ()
    before = _as_set(model)
    noise = "the noise is as entered", "with ten times as much", scaled_noise(model, 10)
    if not model.noisy:
        noise = "no noise (none is entered)", "at the level bad", with_level(model, LEVELS[BAD])
    found = []
    for name, alternative, changed in (*_alternatives(model), noise):
        if changed.valid and (said := changes(before, then := _as_set(changed))) != _NOTHING:
            weight = Assumption(name, alternative, before, then, None).weight
            found.append((weight, f"{name}; {alternative}: {said}"))
    return tuple(text for _, text in sorted(found, reverse=True)[:_MOST])


def rests_on(model: LinkModel, keys: Iterable[str]) -> dict[str, Any]:
    """What the figures (by their keys) of the setting that a link has rest on, as plain data and as lines."""
    found, most = classes(model.inputs, keys), setting_assumptions(model)
    text = [f"  {line}" for line in in_words(found)]
    if most:
        text += ["the assumptions that change the figures most", *(f"  {line}" for line in most)]
    return {**found, "assumptions": list(most), "text": text}


def _as_set(model: LinkModel) -> Choice:
    """The setting that a link has, with the figures under its own noise."""
    attempts = attempts_per_poll(model.reading, model.retries)
    grid = evaluate(model, (attempts,), (model.timeout,))
    return choice_of(grid, model.reading, model.retries, model.timeout)


def assumptions(model: LinkModel, goals: Goals, recommended: Choice) -> tuple[Assumption, ...]:
    """The assumptions that would change a recommendation most, worked out with their alternatives."""
    found = []
    for name, alternative, changed in _alternatives(model):
        if timeout_floor(changed) > recommended.timeout:
            continue
        checked = evaluate_goals(changed, goals)
        then = choice_of(checked.grid, changed.reading, recommended.retries, recommended.timeout)
        found.append(Assumption(name, alternative, recommended, then, recommend(changed, goals)))
    if goals.ride and "ride" not in goals.given:
        free = recommend(model, replace(goals, ride=0))
        name = "the line must survive interruptions of 100 ms (assumed)"
        if free is not None and _setting(free) != _setting(recommended):
            found.append(Assumption(name, "with ride>=0", recommended, free, free))
    found += _noise(model, goals, recommended)
    return tuple(sorted(found, key=lambda each: -each.weight)[:_MOST])


def _alternatives(model: LinkModel) -> list[tuple[str, str, LinkModel]]:
    found = [
        (f"D8179 is read as {model.reading} (assumed)", f"read as {other}", replace(model, reading=other))
        for other in Attempts
        if other is not model.reading
    ]
    found += [
        (f"absent_station: {model.absent} (assumed)", f"with {absent}", replace(model, absent=absent))
        for absent in AbsentStation
        if absent is not model.absent
    ]
    if not any("replies at END" in note for note in model.notes):
        at_end = tuple(replace(station, extra=station.extra + station.scan) for station in model.stations)
        changed = replace(model, stations=at_end)
        found.append(("a slave replies at once (assumed)", "if it replied at its END, at worst", changed))
    return found


def _noise(model: LinkModel, goals: Goals, recommended: Choice) -> list[Assumption]:
    """What the level of noise that is assumed changes."""
    name, alternative, changed = _other_noise(model)
    checked = evaluate_goals(changed, goals, alone=True)
    then = choice_of(checked.grid, model.reading, recommended.retries, recommended.timeout)
    found = Assumption(name, alternative, recommended, then, recommend(changed, goals, alone=True))
    return [found] if found.differs else []


def _other_noise(model: LinkModel) -> tuple[str, str, LinkModel]:
    if model.noisy:
        name = "the level bad counts beside the noise as entered (assumed)"
        return name, "with the noise as entered alone", model
    changed = with_level(model, LEVELS[TYPICAL])
    return "the noise is of the level bad (assumed)", "at the level typical", changed


def refused_otherwise(model: LinkModel, goals: Goals) -> tuple[str, ...]:
    """Goals that no setting meets: what would meet them if an assumption did not hold, in words."""
    noise = _other_noise(model)
    alternatives = [(each, False) for each in _alternatives(model)] + [(noise, True)]
    said = [
        f"{name}; {alternative}: D8179 = {choice.retries}, D8180 = {choice.d8180} would be recommended"
        for (name, alternative, changed), alone in alternatives
        if timeout_floor(changed) <= changed.timeout_range[1] * TIMEOUT_UNIT
        and (choice := recommend(changed, goals, alone=alone))
    ]
    return tuple(said) or ("no setting would meet the goals if any of them were otherwise",)


def _setting(choice: Choice) -> tuple[int, int]:
    return choice.retries, choice.timeout

"""The assumptions that would change a recommendation, or the figures of a setting, most."""

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
from bussim.scenario.provenance import classes
from bussim.words.language import say
from bussim.words.origins import in_words

#: So many assumptions are named.
_MOST = 3
#: A figure that changes by less than this part of it is not named.
_SLIGHT = 0.02


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
        return not self._stays or bool(changes(self.before, self.otherwise))

    def in_words(self) -> str:
        """What changes, in figures on the safe side."""
        found = say("comma_list", texts=changes(self.before, self.otherwise) or [say("assume_nothing")])
        values = {"name": self.name, "alternative": self.alternative, "changes": found}
        if self.instead is None:
            return say("assume_none_meets", **values)
        if self._stays:
            return say("assume_stays", **values)
        return say("assume_instead", **values, retries=self.instead.retries, units=self.instead.d8180)

    def to_json(self) -> dict[str, object]:
        """As plain data, times in ms."""
        return {
            "assumption": self.name,
            "alternative": self.alternative,
            "text": self.in_words(),
            "otherwise": self.otherwise.to_json(),
            "recommended": None if self.instead is None else self.instead.to_json(),
        }


def changes(before: Choice, then: Choice) -> list[str]:
    """The figures of a setting that differ between two assumptions, those of the second first."""
    return [
        say(key, new=shown(new), old=shown(old))
        for key, old, new, shown in (
            ("assume_errors", before.errors, then.errors, a_year),
            ("assume_dead", before.dead, then.dead, ms_at_most),
            ("assume_interruption", before.ride, then.ride, ms_at_least),
            ("assume_mean", before.mean, then.mean, ms_at_most),
        )
        if abs(new - old) > _SLIGHT * old and shown(new) != shown(old)
    ]


def setting_assumptions(model: LinkModel) -> tuple[str, ...]:
    """What would change the figures of the setting that a link has most, in words; none without a law."""
    if not (model.valid and model.alive):
        return ()
    before = _as_set(model)
    noise = say("assume_as_entered"), say("assume_ten_times"), scaled_noise(model, 10)
    if not model.noisy:
        noise = say("assume_no_noise"), say("assume_at_bad"), with_level(model, LEVELS[BAD])
    found = []
    for name, alternative, changed in (*_alternatives(model), noise):
        if changed.valid and (said := changes(before, then := _as_set(changed))):
            weight = Assumption(name, alternative, before, then, None).weight
            texts = say("comma_list", texts=said)
            found.append((weight, say("assume_changes", name=name, alternative=alternative, changes=texts)))
    return tuple(text for _, text in sorted(found, reverse=True)[:_MOST])


def rests_on(model: LinkModel, keys: Iterable[str]) -> dict[str, Any]:
    """What the figures (by their keys) of the setting that a link has rest on, as plain data and as lines."""
    found, most = classes(model.inputs, keys), setting_assumptions(model)
    text = [say("rests_line", line=line) for line in in_words(found)]
    if most:
        text += [say("rests_most"), *(say("rests_line", line=line) for line in most)]
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
        name = say("assume_ride")
        if free is not None and _setting(free) != _setting(recommended):
            found.append(Assumption(name, say("assume_no_ride"), recommended, free, free))
    found += _noise(model, goals, recommended)
    return tuple(sorted(found, key=lambda each: -each.weight)[:_MOST])


def _alternatives(model: LinkModel) -> list[tuple[str, str, LinkModel]]:
    found = [
        (
            say("assume_reading", reading=_reading(model.reading)),
            say("assume_reading_other", reading=_reading(other)),
            replace(model, reading=other),
        )
        for other in Attempts
        if other is not model.reading
    ]
    found += [
        (
            say(f"assume_absent_{model.absent}"),
            say(f"assume_absent_{absent}_other"),
            replace(model, absent=absent),
        )
        for absent in AbsentStation
        if absent is not model.absent
    ]
    if not any("replies at END" in note for note in model.notes):
        at_end = tuple(replace(station, extra=station.extra + station.scan) for station in model.stations)
        changed = replace(model, stations=at_end)
        found.append((say("assume_at_once"), say("assume_at_end"), changed))
    return found


def _reading(reading: Attempts) -> str:
    return say(f"reading_{reading.name.lower()}")


def _noise(model: LinkModel, goals: Goals, recommended: Choice) -> list[Assumption]:
    """What the level of noise that is assumed changes."""
    name, alternative, changed = _other_noise(model)
    checked = evaluate_goals(changed, goals, alone=True)
    then = choice_of(checked.grid, model.reading, recommended.retries, recommended.timeout)
    found = Assumption(name, alternative, recommended, then, recommend(changed, goals, alone=True))
    return [found] if found.differs else []


def _other_noise(model: LinkModel) -> tuple[str, str, LinkModel]:
    if model.noisy:
        return say("assume_bad_beside"), say("assume_entered_alone"), model
    changed = with_level(model, LEVELS[TYPICAL])
    return say("assume_bad"), say("assume_typical"), changed


def refused_otherwise(model: LinkModel, goals: Goals) -> tuple[str, ...]:
    """Goals that no setting meets: what would meet them if an assumption did not hold, in words."""
    noise = _other_noise(model)
    alternatives = [(each, False) for each in _alternatives(model)] + [(noise, True)]
    said = [
        say("assume_then", name=name, alternative=alternative, retries=choice.retries, units=choice.d8180)
        for (name, alternative, changed), alone in alternatives
        if timeout_floor(changed) <= changed.timeout_range[1] * TIMEOUT_UNIT
        and (choice := recommend(changed, goals, alone=alone))
    ]
    return tuple(said) or (say("assume_no_help"),)


def _setting(choice: Choice) -> tuple[int, int]:
    return choice.retries, choice.timeout

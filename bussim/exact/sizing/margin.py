"""What more noise than was entered does to a setting, and which setting would still hold there."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from bussim.exact.link import LinkModel
from bussim.exact.sizing.choice import Choice, choice_of, recommend
from bussim.exact.sizing.evaluation import MOST_ERRORS, evaluate_goals
from bussim.exact.sizing.goals import Goals
from bussim.exact.sizing.grid import evaluate
from bussim.exact.sizing.noise_levels import BAD, LEVELS, scaled_noise, weaker_bursts, with_level
from bussim.exact.text import a_year, at_most, in_ms, ms_at_least, ms_at_most
from bussim.plc.profiles import MAX_RETRIES
from bussim.words.language import say

#: Multiples of the noise that are evaluated.
FACTORS = (1, 10, 100)
#: In at least this part of all scans: in nearly every one.
_NEARLY = 0.9


@dataclass(frozen=True, slots=True)
class Margin:
    """A setting at a multiple of the noise: the recommended one, else the one with most attempts.

    ``errors`` are its false station errors a year there, ``per_scan`` those in a link scan, of ``stations``
    that live; ``weaker`` says that weaker bursts cause more errors, and that the figures are theirs,
    ``unmet`` that no setting is recommended.
    ``choice`` is the least setting that meets all goals there, None where none does, ``more`` what that costs
    in ticks of a scan with a station dead.
    """

    noise: str
    factor: int
    setting: Choice
    errors: float
    per_scan: float
    stations: int
    weaker: bool
    unmet: bool
    holds: bool
    choice: Choice | None
    more: float

    def in_words(self, goal: float) -> str:
        """The errors to one digit, rounded up (see :func:`a_year`), and what would hold.

        Where errors make scans longer, a figure a year would fall with more noise: it is that of a scan then.
        """
        if self.per_scan >= _NEARLY * self.stations:
            said = say("margin_all")
        elif self.per_scan > MOST_ERRORS:
            said = say("margin_some", number=at_most(self.per_scan))
        else:
            said = say("margin_a_year", number=a_year(self.errors, goal))
        noise = say("margin_or_less", noise=self.noise) if self.weaker else self.noise
        values: dict[str, Any] = {"noise": noise, "said": said}
        if self.choice is None:
            if not self.unmet:
                return say("margin_none", **values)
            return say("margin_none_with", **values, retries=self.setting.retries, units=self.setting.d8180)
        if self.holds:
            return say("margin_holds", **values)
        values |= {"retries": self.choice.retries, "units": self.choice.d8180}
        if self.more > 0:
            return say("margin_more", **values, cost=ms_at_most(self.more))
        return say("margin_less", **values, cost=ms_at_least(-self.more))

    def to_json(self) -> dict[str, object]:
        """As plain data, times in ms."""
        choice = self.choice
        return {
            "noise": self.noise,
            "factor": self.factor,
            "of_setting": {"D8179": self.setting.retries, "D8180": self.setting.d8180},
            "station_errors_per_scan": self.per_scan,
            "weaker_bursts": self.weaker,
            "false_errors_per_year": self.errors,
            "holds": self.holds,
            "setting": None if choice is None else {"D8179": choice.retries, "D8180": choice.d8180},
            "more_ms": None if choice is None else in_ms(self.more),
        }


def margins(model: LinkModel, goals: Goals, recommended: Choice | None) -> tuple[Margin, ...]:
    """A setting at 1, 10 and 100 times the noise: of the entered one, else of the level bad."""
    known = evaluate_goals(model, goals)
    first = known.grid.timeouts[0]
    setting = recommended or choice_of(known.grid, model.reading, MAX_RETRIES, first)
    found = []
    for factor in FACTORS:
        noisy = scaled_noise(model, factor) if model.noisy else with_level(model, LEVELS[BAD] * factor)
        base = "entered" if model.noisy else "bad"
        views = [(line, view) for line in noisy.lines for view in (line, *weaker_bursts(line))]
        grids = [
            evaluate(view, (setting.attempts,), (first, setting.timeout), details=False) for _, view in views
        ]
        errors, per_scan = (
            np.array([getattr(grid, figure)[0, -1] for grid in grids])
            for figure in ("errors", "error_per_scan")
        )
        line, worst = views[int(errors.argmax())]
        choice, more = recommend(noisy, goals), 0.0
        if choice is not None:
            there = choice_of(known.grid, model.reading, choice.retries, choice.timeout)
            more = there.dead - setting.dead
        found.append(
            Margin(
                say(f"margin_{base}") if factor == 1 else say(f"margin_times_{base}", factor=factor),
                factor,
                setting,
                float(errors.max()),
                float(per_scan.max()),
                len(model.stations),
                worst is not line,
                recommended is None,
                choice is not None and (choice.retries, choice.timeout) == (setting.retries, setting.timeout),
                choice,
                more,
            )
        )
    return tuple(found)

"""What more noise than was entered does to a setting, and which setting would still hold there."""

from __future__ import annotations

from dataclasses import dataclass

from bussim.exact.link import LinkModel
from bussim.exact.sizing.choice import Choice, choice_of, recommend
from bussim.exact.sizing.evaluation import evaluate_goals
from bussim.exact.sizing.goals import Goals
from bussim.exact.sizing.grid import evaluate
from bussim.exact.sizing.noise_levels import BAD, LEVELS, with_level
from bussim.exact.sizing.unmet_goals import scaled_noise
from bussim.exact.text import a_year, in_ms, ms_at_most

#: Multiples of the noise that are evaluated.
FACTORS = (1, 10, 100)


@dataclass(frozen=True, slots=True)
class Margin:
    """A recommended setting at a multiple of the noise.

    ``errors`` are its false station errors a year there; ``choice`` is the least setting that meets all goals
    there, None where none does, ``more`` what that costs in ticks of a scan with a station dead.
    """

    noise: str
    factor: int
    errors: float
    holds: bool
    choice: Choice | None
    more: float

    def in_words(self, goal: float) -> str:
        """The errors to one digit, rounded up (see :func:`a_year`), and what would hold."""
        said = f"{self.noise}: {a_year(self.errors, goal)} false station errors a year; "
        if self.choice is None:
            return said + "no setting meets the goals there"
        if self.holds:
            return said + "the recommended setting holds"
        setting = f"D8179 = {self.choice.retries}, D8180 = {self.choice.d8180}"
        return said + f"{setting} would do: {ms_at_most(self.more)} more with a station dead"

    def to_json(self) -> dict[str, object]:
        """As plain data, times in ms."""
        choice = self.choice
        return {
            "noise": self.noise,
            "factor": self.factor,
            "false_errors_per_year": self.errors,
            "holds": self.holds,
            "setting": None if choice is None else {"D8179": choice.retries, "D8180": choice.d8180},
            "more_ms": None if choice is None else in_ms(self.more),
        }


def margins(model: LinkModel, goals: Goals, recommended: Choice) -> tuple[Margin, ...]:
    """A recommended setting at 1, 10 and 100 times the noise: of the entered one, else of the level bad."""
    known = evaluate_goals(model, goals)
    found = []
    for factor in FACTORS:
        noisy = scaled_noise(model, factor) if model.noisy else with_level(model, LEVELS[BAD] * factor)
        base = "noise as entered" if model.noisy else "level bad"
        own = evaluate(noisy, (recommended.attempts,), (known.grid.timeouts[0], recommended.timeout))
        choice = recommend(noisy, goals)
        setting = None if choice is None else (choice.retries, choice.timeout)
        more = 0.0
        if choice is not None:
            more = (
                choice_of(known.grid, model.reading, choice.retries, choice.timeout).dead - recommended.dead
            )
        found.append(
            Margin(
                base if factor == 1 else f"{factor} times the {base}",
                factor,
                float(own.errors[0, -1]),
                setting == (recommended.retries, recommended.timeout),
                choice,
                more,
            )
        )
    return tuple(found)

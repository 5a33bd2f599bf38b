"""What retries and timeout a link should have by what its readings tell, and by their upper limits."""

from dataclasses import dataclass
from typing import Any

from bussim.exact.sizing.choice import Choice, recommend
from bussim.exact.sizing.goals import Goals
from bussim.site.link import SteadyNoise
from bussim.site.noise.picture import Picture


@dataclass(frozen=True, slots=True)
class Size:
    """A setting for some noise, None where none meets the goals; ``why`` it is not worked out, or ""."""

    choice: Choice | None
    why: str = ""

    def in_words(self) -> str:
        """The setting, or why there is none."""
        if self.choice is None:
            return self.why or "no setting meets the goals of bussim size"
        return f"D8179 = {self.choice.retries}, D8180 = {self.choice.d8180}"

    def to_json(self) -> dict[str, Any]:
        """The setting as plain data."""
        chosen = None if self.choice is None else {"D8179": self.choice.retries, "D8180": self.choice.d8180}
        return {"setting": chosen, "why_not": self.why or None}


def sizes(picture: Picture) -> dict[str, Size]:
    """The settings by the likeliest values and by the upper limits."""
    if picture.bursts == "seen":
        unknown = Size(
            None, "the lengths of bursts are not known, on which retries depend; bussim sniff tells them"
        )
        return {"likeliest": unknown, "upper_limits": unknown}
    if not picture.measured.lenses:
        unknown = Size(None, "nothing that was read tells how much noise there is")
        return {"likeliest": unknown, "upper_limits": unknown}
    return {"likeliest": _size(picture, picture.noise), "upper_limits": _size(picture, picture.upper)}


def _size(picture: Picture, noise: SteadyNoise) -> Size:
    model = noise.applied(picture.link.model)
    if model.obstacles:
        return Size(None, "; ".join(model.obstacles))
    return Size(recommend(model, Goals()))

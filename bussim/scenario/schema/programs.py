"""The form of what a PLC does by itself: its program, what drives its inputs; and of latency entries."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Any, ClassVar

from pydantic import Field, model_validator

from bussim.forms.fields import FileName, Flag, Name, PlcDevice, Positive, Time, choice, fail, time, whole
from bussim.forms.form import Model, OneKind
from bussim.scenario.yaml.input_table import MAX_TIMES
from bussim.words.language import say
from bussim.words.tables import recognised
from bussim.words.values import show

#: How many devices a scenario may observe, and how many latencies it may measure.
MAX_OBSERVED, MAX_LATENCIES = 1000, 100
PROGRAM_ENDINGS = (".il", ".csv", ".txt", ".lst")
#: The same in small and in capital letters.
_ENDING = "|".join("".join(f"[{c}{c.upper()}]" for c in ending[1:]) for ending in PROGRAM_ENDINGS)
#: The shortest time that a stimulus may stay on or off, 10 µs: whatever is shorter costs time, and no
#: input of a PLC would let it through.
SHORTEST_LEVEL = 720
Level = Annotated[int, time(SHORTEST_LEVEL)]


class ProgramIn(OneKind):
    """A program: a file, or its text."""

    example = (
        "the name of a file such as press1.il or main.csv, or the program's lines as a block (program: |)"
    )

    kinds = ("file", "text")
    plain_form: ClassVar = {"type": "string", "pattern": rf"\n|\.({_ENDING})$"}

    file: FileName | None = None
    text: Annotated[str, Field()] | None = None

    @model_validator(mode="before")
    @classmethod
    def _text_or_file(cls, value: Any) -> Any:
        if not isinstance(value, str):
            return value
        if "\n" in value:
            return {"text": value}
        if value.casefold().endswith(PROGRAM_ENDINGS):
            return {"file": value}
        raise fail(say("form_program", found=show(value), expected=recognised(cls.example, "example_")))


class PulseIn(Model):
    """On for a while, once or again and again."""

    example = "{width: 50 ms, every: 2 s, at: 1 s, times: 3}"

    width: Level
    every: Positive | None = None
    at: Time = 0
    times: Annotated[int, whole(1, 10**9)] | None = None

    @model_validator(mode="after")
    def _pulses_are_apart(self) -> PulseIn:
        if self.every is not None and self.every <= self.width:
            raise fail(say("form_above_width"), "every")
        if self.times is not None and self.every is None:
            raise fail(say("form_needs_every"), "times")
        return self


class SquareIn(Model):
    """On and off for half a period each."""

    example = "a period such as 500 ms, or {period: 500 ms, at: 1 s}"
    shorthand = "period"

    period: Annotated[int, time(2 * SHORTEST_LEVEL)]
    at: Time = 0


class RandomIn(Model):
    """On and off for random times with these means.

    ``seed``: its course depends on that alone; else on the scenario's seed and the input's name.
    """

    example = "{on: 1 s, off: 2 s, seed: 3}"

    on: Level
    off: Level
    seed: Annotated[int, whole(0, 2**63 - 1)] | None = None


class InputIn(OneKind):
    """What drives one input: exactly one of its keys."""

    example = (
        "{square: 500 ms}, {pulse: {width: 50 ms, every: 2 s}}, {random: {on: 1 s, off: 2 s}}, "
        "{times: [1 s, 1.2 s]} or {csv: edges.csv}"
    )

    pulse: PulseIn | None = None
    square: SquareIn | None = None
    random: RandomIn | None = None
    times: Annotated[list[Time], Field(min_length=1, max_length=MAX_TIMES)] | None = None
    csv: FileName | None = None

    @model_validator(mode="after")
    def _rising(self) -> InputIn:
        times = self.times or []
        for earlier, later in pairwise(times):
            if later <= earlier:
                raise fail(say("form_rise"), "times")
        return self


InputIn.kinds = tuple(InputIn.model_fields)


class LatencyIn(Model):
    """One entry of ``latency:``."""

    example = "{from: press3.X0, to: press5.Y4, edge: rising}"

    name: Name | None = None
    from_: PlcDevice = Field(alias="from")
    to: PlcDevice
    edge: Annotated[str, choice("rising", "falling", "both")] | None = None
    inverted: Flag | None = None

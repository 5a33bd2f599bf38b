"""The form of a scenario file: profiles of PLCs.

The form has the fields of :class:`bussim.plc.profiles.Profile` that say how a family behaves: their
bounds stand there.
"""

from __future__ import annotations

from enum import StrEnum
from fractions import Fraction
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from pydantic import Field, create_model, field_validator, model_validator

from bussim.engines.modbus.gaps import GapRule
from bussim.engines.nn.frames import MODES
from bussim.forms.fields import Flag, Range, Time, Title, choice, fail, nanoseconds, number, time, whole
from bussim.forms.form import Model
from bussim.forms.rtu_gaps import RtuGapsIn
from bussim.plc.memory import DeviceRange, latched_problem
from bussim.plc.profiles import PROFILES, Number, Profile, Ticks, Turnaround
from bussim.plc.program.instruction_times import InstructionTimes
from bussim.units import TICKS_PER_SECOND
from bussim.wording import counted
from bussim.words.language import say
from bussim.words.values import show, suggest


class TurnaroundIn(Model):
    """A turnaround: uniform, or measured values with weights."""

    example = "{mean: 1.25 ms, jitter: 0.75 ms} or {values: [1 ms, 2 ms], weights: [3, 1]}"
    shorthand = "mean"

    mean: Annotated[int, time(0, 10 * TICKS_PER_SECOND)] | None = None
    jitter: Time | None = None
    values: (
        Annotated[
            list[Annotated[int, time(0, 10 * TICKS_PER_SECOND)]], Field(min_length=1, max_length=10_000)
        ]
        | None
    ) = None
    weights: Annotated[list[Annotated[float, number(1e-9, 1e9)]], Field(max_length=10_000)] | None = None

    @model_validator(mode="after")
    def _one_form(self) -> TurnaroundIn:
        if self.values is not None:
            if self.mean is not None or self.jitter is not None:
                raise fail(say("form_excludes_mean"), "values")
            if self.weights is not None and len(self.weights) != len(self.values):
                found = counted(len(self.weights), "entry")
                raise fail(say("form_weights", found=found, values=len(self.values)), "weights")
        elif self.weights is not None:
            raise fail(say("form_needs_values"), "weights")
        elif self.mean is None:
            raise fail(say("form_missing"), "mean")
        elif self.jitter is not None and self.jitter > self.mean:
            raise fail(say("form_not_above_mean"), "jitter")
        return self


_Nanoseconds = Annotated[int, nanoseconds(0, 1_000_000_000)]


class InstructionTimesIn(Model):
    """What a program's instructions take, class by class; what is left out stays as the profile has it."""

    example = "{basic: 80 ns, move: 1.52 us, others: {FROM: 200 us}}"

    basic: _Nanoseconds | None = None
    timer: _Nanoseconds | None = None
    comparison: _Nanoseconds | None = None
    idle: _Nanoseconds | None = None
    move: _Nanoseconds | None = None
    arithmetic: _Nanoseconds | None = None
    block: _Nanoseconds | None = None
    each: _Nanoseconds | None = None
    serial: _Nanoseconds | None = None
    wide: Annotated[float, number(1, 100)] | None = None
    others: dict[str, _Nanoseconds] | None = None

    @field_validator("others", mode="before")
    @classmethod
    def _instructions_exist(cls, value: Any) -> Any:
        from bussim.plc.program.text.catalog import SPECS  # what only a profile with such times pays

        for name in value if isinstance(value, dict) else ():
            if str(name).removesuffix(" off") not in SPECS:
                raise fail(
                    say("form_names_no_instruction", name=show(name), hint=suggest(str(name), list(SPECS)))
                )
        return value


#: The forms of fields that are no single values, by the type of the field.
_FORMS: dict[object, Any] = {
    tuple[DeviceRange, ...]: Annotated[list[Range], Field(max_length=100)],
    Turnaround: TurnaroundIn,
    GapRule: RtuGapsIn,
    InstructionTimes: InstructionTimesIn,
}


def _field(hint: Any) -> Any:
    """What a scenario may give for a field of a profile; None for one that it cannot change."""
    if get_origin(hint) is Annotated:
        of, mark = get_args(hint)
        return _marked(of, mark)
    if hint is bool:
        return Flag
    return Annotated[str, choice(*hint)] if isinstance(hint, type) and issubclass(hint, StrEnum) else None


def _marked(of: Any, mark: object) -> Any:
    match mark:
        case Ticks(low, high):
            return Annotated[int, time(low, high)]
        case Number(low, high) if get_origin(of) is tuple:
            many = Ellipsis in get_args(of)
            least, most = (1, high - low + 1) if many else (len(get_args(of)), len(get_args(of)))
            return Annotated[list[Annotated[int, whole(low, high)]], Field(min_length=least, max_length=most)]
        case Number(low, high):
            return Annotated[float, number(low, high)] if of is Fraction else Annotated[int, whole(low, high)]
        case _:
            return _FORMS[of]


class _BaseIn(Model):
    """What a profile's form has before the fields of a profile."""

    base: Annotated[str, choice(*PROFILES)]
    measured: dict[str, Title] | None = None  # fields by the recording that they were measured in


#: The keys of the form, made of the fields of a profile.
_Fields: Any = create_model(
    "_Fields",
    __base__=_BaseIn,
    **{
        name: (form | None, None)
        for name, hint in get_type_hints(Profile, include_extras=True).items()
        if (form := _field(hint)) is not None
    },  # type: ignore[call-overload] # keys that the type checker cannot know
)


class ProfileIn(_Fields):  # type: ignore[misc] # made above
    """A profile by name, or a built-in one with some fields changed."""

    example = "the name of a profile, or {base: pw10, attempts: retries}"
    shorthand = "base"

    @model_validator(mode="after")
    def _measured_are_given(self) -> ProfileIn:
        for name in sorted({*(self.measured or ())} - {*self.given("base", "measured")}):
            raise fail(say("form_names_no_field", name=show(name)), "measured")
        return self

    @model_validator(mode="after")
    def _has_what_it_keeps(self) -> ProfileIn:
        for kept in self.latched or ():
            if problem := latched_problem(kept, PROFILES[self.base].family):
                raise fail(problem, "latched")
        return self

    @model_validator(mode="after")
    def _timeouts_agree(self) -> ProfileIn:
        base = PROFILES[self.base]
        low, high = self.timeout_range or base.timeout_range
        if low > high:
            raise fail(say("form_first_above", low=low, high=high), "timeout_range")
        default = self.default_timeout or base.default_timeout
        if not low <= default <= high:
            if self.default_timeout is not None:
                raise fail(say("form_between", value=default, least=low, most=high), "default_timeout")
            raise fail(say("form_leaves_default", low=low, high=high, default=default), "timeout_range")
        return self

    @model_validator(mode="after")
    def _blocks_fit(self) -> ProfileIn:
        base = PROFILES[self.base]
        spacing = self.word_spacing or base.word_spacing
        words = max(MODES[mode].words for mode in self.modes or base.modes)
        if words > spacing:
            at = "word_spacing" if self.word_spacing is not None else "modes"
            raise fail(say("form_blocks_overlap", words=words, spacing=spacing), at)
        return self

"""What a PLC's ``profile`` means: a built-in one with the given fields changed."""

from __future__ import annotations

from dataclasses import replace
from enum import StrEnum
from fractions import Fraction
from typing import Any

from bussim.engines.modbus.gaps import GapRule
from bussim.forms.fields import exact
from bussim.forms.form import Model
from bussim.plc.profiles import PROFILES, Profile, Turnaround
from bussim.plc.program.times import InstructionTimes
from bussim.scenario.schema.profiles import InstructionTimesIn, ProfileIn, RtuGapsIn, TurnaroundIn
from bussim.units import round_half_up


def profile_of(given: ProfileIn) -> Profile:
    """The built-in profile with the given fields changed."""
    base = PROFILES[given.base]
    changes = {
        key: _value(value, getattr(base, key)) for key, value in given if key != "base" and value is not None
    }
    if given.modes is not None:
        changes["modes"] = tuple(sorted(set(given.modes)))
    return replace(base, **changes)


def _value(given: Any, base: object) -> Any:
    """A field's value as a profile has it, of the same type as the value that it replaces."""
    match base:
        case Turnaround():
            return _turnaround(given)
        case GapRule():
            return _gaps(given, base)
        case InstructionTimes():
            return _instructions(given, base)
        case Fraction():
            return exact(given)
        case StrEnum():
            return type(base)(given)
        case tuple():
            return tuple(given)
        case int():  # bool as well
            return given
        case _:
            raise AssertionError(f"no profile has a field with {base!r}")


def _given(model: Model, *keys: str) -> dict[str, object]:
    return {key: value for key in keys if (value := getattr(model, key)) is not None}


def _turnaround(given: TurnaroundIn) -> Turnaround:
    if given.values is None:
        return Turnaround(given.mean or 0, given.jitter or 0)
    values = tuple(given.values)
    weights = tuple(given.weights or [1.0] * len(values))
    measured = Turnaround(0, 0, values, weights)
    return replace(measured, mean=round_half_up(measured.average))


def _gaps(given: RtuGapsIn, base: GapRule) -> GapRule:
    fast = base.fast_character if given.fast_character is None else given.fast_character
    return GapRule(
        end=base.end if given.end is None else exact(given.end),
        inner=base.inner if given.inner is None else exact(given.inner),
        fast_character=fast if isinstance(fast, int) else None,
    )


def _instructions(given: InstructionTimesIn, base: InstructionTimes) -> InstructionTimes:
    classes = [key for key in type(given).model_fields if key != "others"]
    others = {**dict(base.others), **(given.others or {})}
    return replace(base, **_given(given, *classes), others=tuple(others.items()))  # type: ignore[arg-type] # as above

"""What a PLC's ``profile`` means: a built-in one with the given fields changed."""

from dataclasses import replace
from typing import Any

from bussim.forms.form import changed
from bussim.forms.rtu_gaps import RtuGapsIn
from bussim.plc.profiles import PROFILES, Profile, Turnaround
from bussim.scenario.schema.profiles import InstructionTimesIn, ProfileIn, TurnaroundIn
from bussim.units import round_half_up


def profile_of(given: ProfileIn) -> Profile:
    """The built-in profile with the given fields changed."""
    base, fields = PROFILES[given.base], given.given("base", "measured")
    changes = {key: _value(value, getattr(base, key)) for key, value in fields.items()}
    if given.modes is not None:
        changes["modes"] = sorted(set(given.modes))
    return changed(base, changes)


def _value(given: Any, base: Any) -> Any:
    """A field's value; what a mapping leaves out stays as ``base`` has it."""
    match given:
        case TurnaroundIn():
            return _turnaround(given)
        case RtuGapsIn():
            return given.rule()
        case InstructionTimesIn():
            others = {**dict(base.others), **(given.others or {})}
            return changed(base, {**given.given(), "others": others.items()})
        case _:
            return given


def _turnaround(given: TurnaroundIn) -> Turnaround:
    if given.values is None:
        return Turnaround(given.mean or 0, given.jitter or 0)
    values = tuple(given.values)
    weights = tuple(given.weights or [1.0] * len(values))
    measured = Turnaround(0, 0, values, weights)
    return replace(measured, mean=round_half_up(measured.average))

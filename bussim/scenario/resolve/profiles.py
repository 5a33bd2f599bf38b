"""What a PLC's ``profile`` means: a built-in one with the given fields changed."""

from __future__ import annotations

from dataclasses import replace

from bussim.engines.modbus.gaps import GapRule
from bussim.forms.fields import exact
from bussim.forms.form import Model
from bussim.plc.profiles import PROFILES, AbsentStation, Attempts, ErrorCount, Profile, Reply, Turnaround
from bussim.plc.program.times import InstructionTimes
from bussim.scenario.schema.profiles import InstructionTimesIn, ProfileIn, RtuGapsIn, TurnaroundIn
from bussim.units import round_half_up

#: Fields that are in a profile as they are in the file.
_PLAIN = (
    "master_gap",
    "scan_overhead",
    "link_scan_unit",
    "default_timeout",
    "word_spacing",
    "transaction_time",
    "broadcast_turnaround",
    "ascii_gap",
    "begun_holds",
    "slave_backlog",
    "com2_station",
    "free_awaits_first",
    "free_keeps_frame",
)


def profile_of(given: ProfileIn) -> Profile:
    """The built-in profile with the given fields changed."""
    base = PROFILES[given.base]
    changes = _given(given, *_PLAIN)
    choices = {
        "attempts": Attempts,
        "absent_station": AbsentStation,
        "error_count": ErrorCount,
        "reply": Reply,
    }
    for key, kind in choices.items():
        if (word := getattr(given, key)) is not None:
            changes[key] = kind(word)
    if given.turnaround is not None:
        changes["turnaround"] = _turnaround(given.turnaround)
    if given.scan_factor is not None:
        changes["scan_factor"] = exact(given.scan_factor)
    if given.timeout_range is not None:
        changes["timeout_range"] = tuple(given.timeout_range)
    if given.modes is not None:
        changes["modes"] = tuple(sorted(set(given.modes)))
    if given.rtu_gaps is not None:
        changes["rtu_gaps"] = _gaps(given.rtu_gaps, base.rtu_gaps)
    if given.instruction_times is not None:
        changes["instruction_times"] = _instructions(given.instruction_times, base.instruction_times)
    return replace(base, **changes)  # type: ignore[arg-type] # the schema gave each field its type


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

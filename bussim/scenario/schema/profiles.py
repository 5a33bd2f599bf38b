"""The form of a scenario file: profiles of PLCs.

Every field of :class:`bussim.plc.profiles.Profile` that says how a family behaves can be changed; what
the family is (its name, its special devices) cannot.
"""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field, field_validator, model_validator

from bussim.engines.modbus.adu import FIRST_STATION, LAST_STATION
from bussim.engines.modbus.gaps import STANDARD_GAPS
from bussim.engines.nn.frames import MODES
from bussim.forms.fields import Flag, Time, choice, fail, nanoseconds, number, time, time_or, whole
from bussim.forms.form import Model
from bussim.plc.profiles import PROFILES, AbsentStation, Attempts, ErrorCount, Reply
from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND
from bussim.wording import show, suggest


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
                raise fail("excludes mean and jitter", "values")
            if self.weights is not None and len(self.weights) != len(self.values):
                raise fail(f"has {len(self.weights)} entries, values has {len(self.values)}", "weights")
        elif self.weights is not None:
            raise fail("needs values", "weights")
        elif self.mean is None:
            raise fail("is missing", "mean")
        elif self.jitter is not None and self.jitter > self.mean:
            raise fail("must not be more than the mean", "jitter")
        return self


class RtuGapsIn(Model):
    """The silences of Modbus RTU, in characters; what is left out stays as the profile has it."""

    example = "{end: 4.5, inner: 1.5, fast_character: none}"

    end: Annotated[float, number(0.1, 1000)] | None = None
    inner: Annotated[float, number(0.1, 1000)] | None = None
    fast_character: Annotated[int | str, time_or("none", 1, TICKS_PER_SECOND)] | None = None

    @model_validator(mode="after")
    def _in_order(self) -> RtuGapsIn:
        end, inner = self.end or float(STANDARD_GAPS.end), self.inner or float(STANDARD_GAPS.inner)
        if inner > end:
            if self.inner is not None:
                raise fail(f"is {inner:g}, more than what ends a frame ({end:g})", "inner")
            raise fail(f"is {end:g}, less than what a frame may have inside ({inner:g})", "end")
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
                raise fail(f"names {show(name)}, no instruction; {suggest(str(name), list(SPECS))}")
        return value


class ProfileIn(Model):
    """A profile by name, or a built-in one with some fields changed."""

    example = "the name of a profile, or {base: pw10, attempts: retries}"
    shorthand = "base"

    base: Annotated[str, choice(*PROFILES)]
    master_gap: Annotated[int, time(0, TICKS_PER_SECOND)] | None = None
    turnaround: TurnaroundIn | None = None
    scan_overhead: Annotated[int, time(0, 10 * TICKS_PER_SECOND)] | None = None
    attempts: Annotated[str, choice(*Attempts)] | None = None
    absent_station: Annotated[str, choice(*AbsentStation)] | None = None
    error_count: Annotated[str, choice(*ErrorCount)] | None = None
    reply: Annotated[str, choice(*Reply)] | None = None
    link_scan_unit: Annotated[int, time(72, TICKS_PER_SECOND)] | None = None
    scan_factor: Annotated[float, number(1, 10)] | None = None
    default_timeout: Annotated[int, whole(1, 255)] | None = None
    timeout_range: (
        Annotated[list[Annotated[int, whole(1, 255)]], Field(min_length=2, max_length=2)] | None
    ) = None
    modes: Annotated[list[Annotated[int, whole(0, 4)]], Field(min_length=1, max_length=5)] | None = None
    word_spacing: Annotated[int, whole(4, 1000)] | None = None
    transaction_time: Annotated[int, time(0, TICKS_PER_SECOND)] | None = None
    broadcast_turnaround: Annotated[int, time(0, 60 * TICKS_PER_SECOND)] | None = None
    rtu_gaps: RtuGapsIn | None = None
    ascii_gap: Annotated[int, time(TICKS_PER_MS, 60 * TICKS_PER_SECOND)] | None = None
    begun_holds: Flag | None = None
    slave_backlog: Annotated[int, whole(0, 100)] | None = None
    com2_station: Annotated[int, whole(FIRST_STATION, LAST_STATION)] | None = None
    free_awaits_first: Flag | None = None
    free_keeps_frame: Flag | None = None
    instruction_times: InstructionTimesIn | None = None

    @model_validator(mode="after")
    def _timeouts_agree(self) -> ProfileIn:
        base = PROFILES[self.base]
        low, high = self.timeout_range or base.timeout_range
        if low > high:
            raise fail(f"is [{low}, {high}]; the first must not be more than the second", "timeout_range")
        default = self.default_timeout or base.default_timeout
        if not low <= default <= high:
            if self.default_timeout is not None:
                raise fail(f"is {default}, allowed {low}..{high}", "default_timeout")
            raise fail(f"is [{low}, {high}], which leaves out the default timeout {default}", "timeout_range")
        return self

    @model_validator(mode="after")
    def _blocks_fit(self) -> ProfileIn:
        base = PROFILES[self.base]
        spacing = self.word_spacing or base.word_spacing
        words = max(MODES[mode].words for mode in self.modes or base.modes)
        if words > spacing:
            at = "word_spacing" if self.word_spacing is not None else "modes"
            raise fail(f"lets the stations' blocks of {words} words overlap: they are {spacing} apart", at)
        return self

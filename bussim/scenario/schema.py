"""The form of a scenario file: buses and PLCs. What exceeds one value or one mapping is in ``rules``.

Fields are named as in the file; where that is a word of Python, the alias is the file's.
"""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field, ValidationInfo, field_validator, model_validator

from bussim.engines.modbus.adu import FIRST_STATION, LAST_STATION
from bussim.engines.modbus.gaps import STANDARD_GAPS
from bussim.engines.nn.frames import MODES
from bussim.plc.ports.cpavl import INTERVAL_UNIT, PROTOCOL_CODES, TIMEOUT_UNIT
from bussim.plc.profiles import MAX_RETRIES, MAX_SLAVES, PROFILES, AbsentStation, Attempts, ErrorCount, Reply
from bussim.scenario.fields import (
    Baud,
    DeviceName,
    Flag,
    Format,
    Name,
    PlcDevice,
    Positive,
    Time,
    character,
    choice,
    fail,
    link_port,
    nanoseconds,
    number,
    one_of,
    time,
    time_or,
    title,
    whole,
)
from bussim.scenario.form import Model, only_one
from bussim.scenario.program_schema import MAX_OBSERVED, InputIn, ProgramIn
from bussim.scenario.wording import show, suggest
from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND

#: How many of each a scenario may have.
MAX_BUSES, MAX_PLCS, MAX_DEVICES, MAX_NOISE, MAX_FAULTS = 16, 64, 256, 1000, 1000
#: How many polls a PLC or an HMI may have.
MAX_POLLS = 200
#: The most that one of CPAVL's words holds.
_WORD_MAX = 0xFFFF


class DocumentIn(Model):
    """The top of a file; its sections are lists that are read entry by entry."""

    example = "keys such as schema: 1, name: …, duration: 60 s"

    schema_: Annotated[int, one_of([1])] = Field(alias="schema")
    name: Annotated[str, title()]
    duration: Positive
    seed: Annotated[int, whole(0, 2**63 - 1)] = 1
    buses: list[Any]
    plcs: list[Any]
    devices: list[Any] = Field(default_factory=list)
    noise: list[Any] = Field(default_factory=list)
    faults: list[Any] = Field(default_factory=list)
    observe: list[PlcDevice] = Field(default_factory=list, max_length=MAX_OBSERVED)
    latency: list[Any] = Field(default_factory=list)


class BusIn(Model):
    """One RS485 line."""

    example = "{name: link, nn: true}"

    name: Name
    nn: Flag = False
    baud: Baud | None = None
    format: Format | None = None


class ScanIn(Model):
    """A scan time."""

    example = "a time, or {mean: 8 ms, jitter: 1 ms}"
    shorthand = "mean"

    mean: Annotated[int, time(TICKS_PER_MS // 10, 10 * TICKS_PER_SECOND)]
    jitter: Time = 0

    @model_validator(mode="after")
    def _jitter_below_mean(self) -> ScanIn:
        if self.jitter >= self.mean:
            raise fail("must be less than the mean", "jitter")
        return self


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
        from bussim.plc.program.catalog import SPECS  # what only a profile with such times pays

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


class NNIn(Model):
    """A PLC's seat on an N:N link: the friendly form of D8176 to D8180 and M8179."""

    example = "{bus: link, port: COM4, station: 1}"

    bus: Name
    port: Annotated[str, link_port()] | None = None
    station: Annotated[int, whole(0, MAX_SLAVES)]
    slaves: Annotated[int, whole(1, MAX_SLAVES)] | None = None
    mode: Annotated[int, whole(0, 4)] | None = None
    retries: Annotated[int, whole(0, MAX_RETRIES)] | None = None
    timeout: Time | None = None


class CpavlIn(Model):
    """Where a port's twenty words and bits lie."""

    example = "{words: D7900, bits: M2900}"

    words: DeviceName | None = None
    bits: DeviceName | None = None


class PortIn(Model):
    """What a port is wired to and what it does there: the friendly form of CPAVL's words."""

    example = "{bus: feeder, protocol: modbus-rtu-master}"

    bus: Name
    protocol: Annotated[str, choice(*PROTOCOL_CODES)] | None = None
    station: Annotated[int, whole(FIRST_STATION, LAST_STATION)] | None = None
    timeout: Annotated[int, time(TIMEOUT_UNIT, _WORD_MAX * TIMEOUT_UNIT)] | None = None
    interval: Annotated[int, time(0, _WORD_MAX * INTERVAL_UNIT)] | None = None
    start: Annotated[int, character()] | None = None
    end: Annotated[int, character()] | None = None
    eight_bit: Flag | None = None
    baud: Baud | None = None
    format: Format | None = None
    cpavl: CpavlIn | None = None


class RampIn(Model):
    """A linear ramp of a word."""

    example = "{from: 0, to: 1000, over: 10 s}"

    from_: Annotated[int, whole(-32768, 65535)] = Field(alias="from")
    to: Annotated[int, whole(-32768, 65535)]
    over: Positive


class SourceIn(Model):
    """What drives one device: exactly one of its keys."""

    example = "{toggle: 1 s}, {counter: 100 ms}, {constant: 5} or {ramp: {from: 0, to: 1000, over: 10 s}}"

    toggle: Positive | None = None
    counter: Positive | None = None
    constant: Annotated[int, whole(-32768, 65535)] | None = None
    ramp: RampIn | None = None

    @model_validator(mode="after")
    def _one_kind(self, info: ValidationInfo) -> SourceIn:
        only_one(self, ("toggle", "counter", "constant", "ramp"), info)
        return self


class PlcIn(Model):
    """One PLC."""

    example = "{name: press1, profile: pw10, scan: 8 ms, nn: {bus: link, station: 0}}"

    name: Name
    profile: ProfileIn = ProfileIn(base="pw10")
    scan: ScanIn = ScanIn(mean="10 ms")  # type: ignore[arg-type] # read as from a file
    phase: Annotated[int, time(0, 10 * TICKS_PER_SECOND)] | None = None
    nn: NNIn | None = None
    registers: dict[str, Annotated[int, whole(-32768, 65535)]] = Field(default_factory=dict)
    ports: dict[str, PortIn] = Field(default_factory=dict)
    polls: list[Any] = Field(default_factory=list)
    sources: dict[str, SourceIn] = Field(default_factory=dict)
    program: ProgramIn | None = None
    inputs: dict[str, InputIn] = Field(default_factory=dict)

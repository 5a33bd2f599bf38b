"""The forms of a readout, a calibration and a profile file. Times are ticks."""

import re
from typing import Annotated, Any

from pydantic import ConfigDict, Field

from bussim.exact.link import TIMEOUT_UNIT
from bussim.forms.fields import Duration, Positive, Title, choice, fail, number, one_of, time, whole
from bussim.forms.form import Model
from bussim.forms.kind import Kind
from bussim.plc.profiles import MAX_RETRIES, MAX_SLAVES
from bussim.scenario.schema.profiles import ProfileIn
from bussim.units import format_time

#: Counters stop here (assumed).
LIMIT = 32767
_WATCHED, _TIMEOUT = time(low=1, likely="s"), time(TIMEOUT_UNIT, 255 * TIMEOUT_UNIT)


def _started(value: object) -> object:
    found = re.fullmatch(r"(.+?) before the first reading", value) if isinstance(value, str) else None
    if found is None:
        raise fail("is no such text as: 300 s before the first reading")
    return _WATCHED.read(found[1])


def _timeout(value: object) -> object:
    ticks: Any = _TIMEOUT.read(value)
    if over := ticks % TIMEOUT_UNIT:
        near = f"{format_time(ticks - over)} and {format_time(ticks - over + TIMEOUT_UNIT)}"
        raise fail(f"is {format_time(ticks)}, which D8180 (x 10 ms) cannot be; nearest are {near}")
    return ticks


_Timeout = Annotated[int, Kind(_timeout)]
_Retries = Annotated[int, whole(0, MAX_RETRIES)]
_Slaves = Annotated[int, whole(1, MAX_SLAVES)]
_Milliseconds = Annotated[float, number(0, 1e6)]
_Lamp = Annotated[str, choice("flickers", "lit", "dark")] | None
_Symptom = Annotated[
    str, choice("when_drive_runs", "after_power_cycle_gone", "since_start", "every_few_days")
]
_Schema = Annotated[int, one_of((1,))]
_Kind = Annotated[str, choice("readout", "calibration")]
_Experiment = Annotated[
    str,
    choice(
        *("all", "one", "one_slow", "off_3_100", "off_10_50", "floor_40", "floor_30", "master_slow"),
        "listeners",
    ),
]


class CommonSettings(Model):
    """What all experiments have in common."""

    example = "{slaves: 3, mode: 2}"
    slaves: _Slaves
    mode: Annotated[int, whole(0, 4)]


class Settings(CommonSettings):
    """The master's D8177 to D8180."""

    example = "{slaves: 3, mode: 2, retries: 3, timeout: 50 ms}"
    retries: _Retries
    timeout: _Timeout


class Lamps(Model):
    """The lamps of a board; None where they were not looked at."""

    example = "{SD: flickers, RD: dark}"
    SD: _Lamp = None
    RD: _Lamp = None


class StationIn(Model):
    """What was noted at one cabinet; registers by name, each judged by itself later."""

    example = "{place: press, number: 0, state: run, after: {D8201: 66, D8203: 0}}"
    place: Title
    number: Annotated[int, whole(0, MAX_SLAVES)] | None = None
    state: Annotated[str, choice("run", "stop", "off", "unread")] = "unread"
    lamps: Lamps = Lamps.model_construct()
    plc_scan: Positive | None = None
    before: dict[str, Any] | None = None
    after: dict[str, Any] | None = None
    rising: Annotated[list[Title], Field(max_length=30)] = Field(default_factory=list)


class Ladder(Model):
    """How often D8201 rose to thresholds, and the longest scan, in the unit of D8201 as milliseconds."""

    example = "{thresholds_ms: [70, 101, 125], rises: [350, 41, 1], max_ms: 135}"
    thresholds_ms: Annotated[list[_Milliseconds], Field(min_length=1, max_length=3)]
    rises: Annotated[list[Annotated[int, whole(0, 10**9)]], Field(min_length=1, max_length=3)]
    max_ms: _Milliseconds | None = None


class ReadoutIn(Model):
    """One round from cabinet to cabinet."""

    example = "schema: 1, kind: readout"
    schema_: _Schema = Field(alias="schema")
    kind: _Kind
    profile: Any
    settings: Settings
    order: Annotated[list[Title], Field(min_length=2, max_length=MAX_SLAVES + 1)] | None = None
    watched: Duration
    started: Annotated[int, Kind(_started)] | None = None
    stations: Annotated[list[StationIn], Field(min_length=1, max_length=MAX_SLAVES + 1)]
    ladder: Ladder | None = None
    symptoms: Annotated[list[_Symptom], Field(max_length=4)] = Field(default_factory=list)


class Cut(Model):
    """A station whose supply was cut."""

    example = "{number: 2, times: 3, last_for: 60 s}"
    number: Annotated[int, whole(0, MAX_SLAVES)]
    times: Annotated[int, whole(1, 100)] = 1
    last_for: Duration | None = None


class SlowPlc(Model):
    """A station with a constant, long PLC scan."""

    example = "{number: 1, scan: 60 ms}"
    number: Annotated[int, whole(0, MAX_SLAVES)]
    scan: Positive


class ExperimentIn(Model):
    """One experiment; registers by name, each judged by itself later.

    ``at_slaves`` is what slaves count about the one that was cut, each read there.
    """

    model_config = ConfigDict(**{**Model.model_config, "extra": "allow"})
    example = "{name: all, retries: 3, timeout: 100 ms, slaves: 3, D8201: [89, 88], D8202: 106}"
    name: _Experiment
    retries: _Retries
    timeout: _Timeout
    slaves: _Slaves
    cut: Cut | None = None
    slow_plc: SlowPlc | None = None
    at_slaves: Annotated[list[Annotated[int, whole(0, LIMIT)]], Field(min_length=2, max_length=7)] | None = (
        None
    )


class CalibrationIn(Model):
    """Experiments at a machine at rest."""

    example = "schema: 1, kind: calibration"
    schema_: _Schema = Field(alias="schema")
    kind: _Kind
    profile: Any
    settings: CommonSettings
    plc_scan_ms: Annotated[list[_Milliseconds], Field(min_length=1, max_length=8)] | None = None
    experiments: Annotated[list[ExperimentIn], Field(min_length=1, max_length=20)]


class ProfileFileIn(Model):
    """A profile that a calibration wrote, and the fields that it left open."""

    example = "schema: 1, kind: profile, profile: {base: pw10}"
    schema_: _Schema = Field(alias="schema")
    kind: Annotated[str, choice("profile")]
    profile: ProfileIn
    open: Annotated[list[Title], Field(max_length=20)] = Field(default_factory=list)

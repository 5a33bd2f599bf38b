"""The form of a scenario file: buses and PLCs. What exceeds one value or one mapping is in ``rules``.

Fields are named as in the file; where that is a word of Python, the alias is the file's.
"""

from collections.abc import Callable
from typing import Annotated, Any, ClassVar

from pydantic import Field, field_validator

from bussim.engines.modbus.adu import FIRST_STATION, LAST_STATION
from bussim.forms.fields import (
    Baud,
    Character,
    DeviceName,
    Duration,
    Flag,
    Format,
    LinkPort,
    Name,
    PlcDevice,
    Positive,
    Sentence,
    Time,
    Title,
    any_whole,
    choice,
    one_of,
    time,
    whole,
)
from bussim.forms.form import Model, OneKind, ScanIn
from bussim.line.contention import Contention
from bussim.line.protocols import BusProtocol
from bussim.plc.ports.cpavl import INTERVAL_UNIT, PROTOCOL_CODES, TIMEOUT_UNIT
from bussim.plc.profiles import MAX_RETRIES, MAX_SLAVES
from bussim.plc.sources import Constant, Counter, Ramp, Source, Toggle
from bussim.scenario.schema.profiles import ProfileIn
from bussim.scenario.schema.programs import MAX_OBSERVED, InputIn, ProgramIn
from bussim.units import TICKS_PER_SECOND

#: How many of each a scenario may have.
MAX_BUSES, MAX_PLCS, MAX_DEVICES, MAX_NOISE, MAX_FAULTS = 16, 64, 256, 1000, 1000
#: How many warnings a scenario may carry.
MAX_WARNINGS = 100
#: How many polls a PLC or an HMI may have.
MAX_POLLS = 200
#: The most that one of CPAVL's words holds.
_WORD_MAX = 0xFFFF


class WarningIn(Model):
    """What a command that wrote the scenario wants repeated wherever it is used."""

    example = "{code: bursts, text: errors come in bursts}"

    code: Name
    text: Sentence


class DocumentIn(Model):
    """The top of a file; its sections are lists that are read entry by entry."""

    example = "keys such as schema: 1, name: …, duration: 60 s"

    schema_: Annotated[int, one_of([1])] = Field(alias="schema")
    name: Title
    duration: Duration
    seed: Annotated[int, whole(0, 2**63 - 1)] = 1
    buses: list[Any] = Field(default_factory=list)  # none: PLCs by themselves
    plcs: list[Any] = Field(default_factory=list)  # none: devices by themselves
    devices: list[Any] = Field(default_factory=list)
    noise: list[Any] = Field(default_factory=list)
    faults: list[Any] = Field(default_factory=list)
    observe: list[PlcDevice] = Field(default_factory=list, max_length=MAX_OBSERVED)
    latency: list[Any] = Field(default_factory=list)
    warnings: list[WarningIn] = Field(default_factory=list, max_length=MAX_WARNINGS)
    allow_unsimulated: Flag = False  # programs' instructions that are not simulated are skipped


class BusIn(Model):
    """One RS485 line."""

    example = "{name: link, nn: true}"

    name: Name
    nn: Flag = False
    baud: Baud | None = None
    format: Format | None = None
    contention: Annotated[str, choice(*Contention)] = Contention.UNDEFINED.value

    @property
    def protocol(self) -> BusProtocol:
        """What runs on it as a whole."""
        return BusProtocol.NN if self.nn else BusProtocol.SERIAL


class NNIn(Model):
    """How a PLC takes part in an N:N link: the friendly form of D8176 to D8180 and M8179."""

    example = "{bus: link, port: COM4, station: 1}"
    stand_ins: ClassVar = {"bus": "bus", "station": 1}

    bus: Name
    port: LinkPort | None = None
    station: Annotated[int, whole(0, MAX_SLAVES)]
    slaves: Annotated[int, whole(1, MAX_SLAVES)] | None = None
    mode: Annotated[int, any_whole] | None = None  # the profile bounds it
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
    stand_ins: ClassVar = {"bus": "bus"}

    bus: Name
    protocol: Annotated[str, choice(*PROTOCOL_CODES)] | None = None
    station: Annotated[int, whole(FIRST_STATION, LAST_STATION)] | None = None
    timeout: Annotated[int, time(TIMEOUT_UNIT, _WORD_MAX * TIMEOUT_UNIT)] | None = None
    interval: Annotated[int, time(0, _WORD_MAX * INTERVAL_UNIT)] | None = None
    start: Character | None = None
    end: Character | None = None
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


class SourceIn(OneKind):
    """What drives one device: exactly one of its keys."""

    example = "{toggle: 1 s}, {counter: 100 ms}, {constant: 5} or {ramp: {from: 0, to: 1000, over: 10 s}}"

    toggle: Positive | None = None
    counter: Positive | None = None
    constant: Annotated[int, whole(-32768, 65535)] | None = None
    ramp: RampIn | None = None

    @property
    def value(self) -> Source:
        """What drives the device, as a value of the scenario."""
        return _SOURCES[self.kind](getattr(self, self.kind))


SourceIn.kinds = tuple(SourceIn.model_fields)
#: What becomes of each kind.
_SOURCES: dict[str, Callable[[Any], Source]] = {
    "toggle": Toggle,
    "counter": Counter,
    "constant": Constant,
    "ramp": lambda given: Ramp(given.from_, given.to, given.over),
}


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
    comments: dict[str, Title] = Field(default_factory=dict)  # by device; ``file``: an export of them

    @field_validator("comments", mode="before")
    @classmethod
    def _comments_of_a_file(cls, value: Any) -> Any:
        return {"file": value} if isinstance(value, str) else value

"""What sits on a bus beside the PLCs, as frozen values. Times are ticks (1/72 MHz)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from bussim.devices.stepper.profile import STEPPER_PROFILE, StepperProfile
from bussim.engines.modbus.adu import Mode
from bussim.engines.modbus.server import Space
from bussim.line.characters import LineTiming
from bussim.plc.ports.spec import PollSpec
from bussim.scenario.model.plc import Scan

if TYPE_CHECKING:  # what only a scenario with devices pays
    from bussim.devices.scripted import Message
    from bussim.devices.stepper.axis import Switch
    from bussim.devices.user import Entry


@dataclass(frozen=True, slots=True)
class LxSettings:
    """A PLC as Modbus slave of which nothing else is simulated. It answers at END.

    ``registers`` are its devices at power-on by name.
    """

    scan: Scan
    registers: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class V80Settings:
    """``items`` are the values at power-on, by address space and address (from 0)."""

    items: dict[tuple[Space, int], int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class StepperSettings:
    """``registers`` are parameters by their names in the register table, as saved before power-on.

    ``steps`` are those of the program's steps, from the first on.
    """

    profile: StepperProfile = STEPPER_PROFILE
    switches: tuple[Switch, ...] = ()
    registers: dict[str, int] = field(default_factory=dict)
    steps: tuple[dict[str, int], ...] = ()


@dataclass(frozen=True, slots=True)
class MapSettings:
    """A register map that the scenario defines."""

    entries: tuple[Entry, ...]
    functions: frozenset[int]


@dataclass(frozen=True, slots=True)
class HmiSettings:
    """A Modbus master without a PLC's scan: an HMI or a PC. Times in ticks."""

    polls: tuple[PollSpec, ...]
    timeout: int
    interval: int
    turnaround: int  # after a broadcast


@dataclass(frozen=True, slots=True)
class FreeSettings:
    """A device that speaks a protocol of its own: a barcode reader, a scale, a display."""

    messages: tuple[Message, ...]


DeviceSettings = LxSettings | V80Settings | StepperSettings | MapSettings | HmiSettings | FreeSettings


@dataclass(frozen=True, slots=True)
class BusDevice:
    """One entry of ``devices:``: something on a bus that is no PLC of the scenario.

    ``station`` is None for what has none (``hmi``, ``free``). ``delay`` is the least time from a
    request's end to its reply's first edge, ``jitter`` what is added to it at most, uniform.
    ``timing`` are its own rate and format, normally the bus's.
    """

    name: str
    model: str  # "lx", "v80", "stepper", "map", "hmi" or "free"
    bus: str
    station: int | None
    mode: Mode
    timing: LineTiming
    delay: int
    jitter: int
    settings: DeviceSettings
    power_on: int = 0

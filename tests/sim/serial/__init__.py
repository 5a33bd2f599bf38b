"""Buses beside the link from values, without YAML."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from bussim.devices.contract import BusDevice
from bussim.devices.free.model import FreeSettings
from bussim.devices.free.scripted import Message
from bussim.devices.hmi import HmiSettings
from bussim.devices.lx.model import LxSettings
from bussim.devices.registry import form_of
from bussim.devices.stepper.model import StepperSettings
from bussim.devices.v80.model import V80Settings
from bussim.engines.modbus.adu import Mode
from bussim.line.characters import CharFormat, LineTiming
from bussim.line.protocols import BusProtocol
from bussim.plc.ports.cpavl import (
    END,
    FORMAT,
    INTERVAL,
    PROTOCOL,
    PROTOCOL_CODES,
    START,
    STATION,
    TIMEOUT,
    default_devices,
)
from bussim.plc.ports.spec import FreeSpec, PollSpec, PortSpec
from bussim.plc.profiles import PROFILES
from bussim.scenario import model
from tests.sim.build import MS, SECOND, Done, Recorder, run

__all__ = ["MS", "SECOND", "Done", "Recorder", "device", "hmi", "poll", "run", "scripted", "serial_bus"]

PLAIN = LineTiming(9600, CharFormat(8, "N", 1))


def device(name: str, kind: str = "v80", station: int = 1, **given: Any) -> BusDevice:
    """A slave; ``settings`` default to the model's own."""
    settings = {
        "v80": V80Settings(),
        "stepper": StepperSettings(),
        "lx": LxSettings(model.Scan(5 * MS)),
    }.get(kind)
    timing = given.pop("timing", PLAIN)
    values: dict[str, Any] = {
        "bus": "bus",
        "mode": Mode.RTU,
        "delay": form_of({"model": kind}).port.delay,
        "jitter": 0,
        "settings": settings,
    }
    return BusDevice(name=name, model=kind, station=station, timing=timing, **{**values, **given})


def poll(
    name: str = "p", station: int = 1, function: int = 3, address: int = 0, count: int = 1, **given: Any
) -> PollSpec:
    return PollSpec(name, "", station, function, address, count, **given)


def hmi(
    name: str,
    *polls: PollSpec,
    timeout: int = 100 * MS,
    interval: int = 5 * MS,
    silence: float | None = None,
    **given: Any,
) -> BusDevice:
    settings = HmiSettings(tuple(polls), timeout, interval, 100 * MS, silence)
    values: dict[str, Any] = {"bus": "bus", "mode": Mode.RTU, "timing": PLAIN, "delay": 0, "jitter": 0}
    return BusDevice(name=name, model="hmi", station=None, settings=settings, **{**values, **given})


def scripted(name: str, *messages: Message, **given: Any) -> BusDevice:
    values: dict[str, Any] = {"bus": "bus", "mode": Mode.RTU, "timing": PLAIN, "delay": 0, "jitter": 0}
    return BusDevice(
        name=name, model="free", station=None, settings=FreeSettings(messages), **{**values, **given}
    )


def serial_bus(
    devices: Sequence[BusDevice],
    plcs: Sequence[model.Plc] = (),
    *,
    seconds: float = 5,
    seed: int = 1,
    timing: LineTiming = PLAIN,
    noise: Sequence[model.Noise] = (),
    faults: Sequence[model.Fault] = (),
) -> model.Scenario:
    """One bus named ``bus``."""
    return model.Scenario(
        name="serial",
        duration=round(seconds * SECOND),
        seed=seed,
        buses=(model.Bus("bus", BusProtocol.SERIAL, timing),),
        plcs=tuple(plcs),
        noise=tuple(noise),
        faults=tuple(faults),
        devices=tuple(devices),
    )


MASTER, SLAVE, FREE = "modbus-rtu-master", "modbus-rtu-slave", "free"


def port(
    name: str, protocol: str, bus: str = "bus", *, station: int = 1, timeout: int = 10, **words: int
) -> tuple[PortSpec, dict[str, int]]:
    """A port and the registers that set it up; ``timeout`` is CPAVL +9 (× 10 ms)."""
    first, bits = default_devices(name)
    values = {PROTOCOL: PROTOCOL_CODES[protocol], STATION: station, TIMEOUT: timeout}
    offsets = {"form": FORMAT, "interval": INTERVAL, "start": START, "end": END}
    values |= {offsets[key]: value for key, value in words.items()}
    return PortSpec(name, bus, first, bits), {f"D{first.address + at}": value for at, value in values.items()}


def plc(
    name: str,
    *ports: tuple[PortSpec, dict[str, int]],
    polls: Sequence[PollSpec | FreeSpec] = (),
    scan: int = 8 * MS,
    jitter: int = 0,
    phase: int | None = None,
    registers: dict[str, int] | None = None,
    **given: Any,
) -> model.Plc:
    """A PLC with ports beside any link."""
    values = dict(registers or {})
    for _, words in ports:
        values |= words
    return model.Plc(
        name=name,
        profile=given.pop("profile", PROFILES["pw10"]),
        scan=model.Scan(scan, jitter),
        link=given.pop("link", None),
        registers=values,
        phase=phase,
        ports=tuple(spec for spec, _ in ports),
        polls=tuple(polls),
        **given,
    )

"""The scenario as plain data in the file's own form, with every default filled in."""

from __future__ import annotations

from typing import Any

from bussim.plc.board import D_TIMEOUT, TIMEOUT_UNIT
from bussim.scenario.disturbances import FAULT_KINDS, FaultIn, NoiseIn
from bussim.scenario.schema import BusIn, DocumentIn, Model, PlcIn
from bussim.scenario.seats import NN_KEYS, Member, line_of, raw_registers
from bussim.units import format_time


def canonical(
    document: DocumentIn,
    buses: list[BusIn],
    members: list[Member],
    noise: list[NoiseIn],
    faults: list[FaultIn],
) -> dict[str, object]:
    """Plain data that load as the same scenario: what the file says, and the defaults it relies on."""
    return {
        "schema": 1,
        "name": document.name,
        "duration": format_time(document.duration),
        "seed": document.seed,
        "buses": [_bus(bus) for bus in buses],
        "plcs": [_plc(member) for member in members],
        "noise": [_noise(entry) for entry in noise],
        "faults": [_fault(fault) for fault in faults],
    }


def _written(model: Model) -> dict[str, Any]:
    """A mapping as the file has it: times as text, keys by their names in the file."""
    return model.model_dump(by_alias=True, exclude_none=True)


def _bus(bus: BusIn) -> dict[str, object]:
    if bus.nn:
        return {"name": bus.name, "nn": True}
    line = line_of(bus)
    return {"name": bus.name, "nn": False, "baud": line.baud, "format": str(line.format)}


def _plc(member: Member) -> dict[str, object]:
    plc = member.plc
    written = _written(plc)
    profile = written["profile"]
    written["profile"] = profile["base"] if set(profile) == {"base"} else profile
    if "turnaround" in profile and "mean" in profile["turnaround"]:
        profile["turnaround"].setdefault("jitter", format_time(0))
    for key in ("registers", "ports", "sources"):
        if not written[key]:
            del written[key]
    if plc.nn is not None:
        written["nn"] = _nn(member, plc)
    return written


def _nn(member: Member, plc: PlcIn) -> dict[str, object]:
    """``nn`` with the defaults that it stands for, except where ``registers`` gives them."""
    if plc.nn is None:
        return {}
    written: dict[str, object] = {"bus": plc.nn.bus, "port": member.port}
    raw = raw_registers(plc)
    for key, address in NN_KEYS.items():
        name = f"D{address}"
        if getattr(plc.nn, key) is None and (name in raw or name not in member.registers):
            continue
        value = member.registers[name]
        written[key] = format_time(value * TIMEOUT_UNIT) if address == D_TIMEOUT else value
    return written


def _noise(noise: NoiseIn) -> dict[str, object]:
    written = _written(noise)
    if noise.station is not None and noise.reply_loss is None:
        written.setdefault("direction", "rx")
    return written


def _fault(fault: FaultIn) -> dict[str, object]:
    written = _written(fault)
    if fault.power_on is None:
        written = {"at": format_time(0), **written}
    for kind in FAULT_KINDS:
        inside = written.get(kind)
        if inside is not None and set(inside) == {"station"}:
            written[kind] = inside["station"]
    return written

"""The scenario as plain data in the file's own form, with every default filled in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from bussim.devices.profiles import DEVICE_PROFILES
from bussim.plc.board import D_TIMEOUT, TIMEOUT_UNIT
from bussim.scenario.device_rules import SPACES, reference
from bussim.scenario.device_schema import DeviceIn, HmiIn, MapIn, SlaveIn, StepperIn, V80In
from bussim.scenario.disturbances import FAULT_KINDS, FaultIn, NoiseIn
from bussim.scenario.maps import functions, stepper_profile
from bussim.scenario.places import Path
from bussim.scenario.poll_rules import count_of
from bussim.scenario.poll_schema import PollIn, TransactionIn
from bussim.scenario.port_seats import written_keys
from bussim.scenario.schema import BusIn, DocumentIn, Model, PlcIn
from bussim.scenario.seats import NN_KEYS, Member, line_of, raw_registers
from bussim.units import format_time


def canonical(
    document: DocumentIn,
    buses: list[BusIn],
    members: list[Member],
    devices: Sequence[tuple[DeviceIn, Sequence[TransactionIn]]],
    polls: Mapping[Path, Sequence[TransactionIn]],
    noise: list[NoiseIn],
    faults: list[FaultIn],
) -> dict[str, object]:
    """Plain data that load as the same scenario: what the file says, and the defaults it relies on.

    ``polls`` are those of each PLC by its path; a device stands beside its own.
    """
    written = {
        "schema": 1,
        "name": document.name,
        "duration": format_time(document.duration),
        "seed": document.seed,
        "buses": [_bus(bus) for bus in buses],
        "plcs": [_plc(member, polls[member.path]) for member in members],
        "devices": [_device(device, own) for device, own in devices],
        "noise": [_noise(entry) for entry in noise],
        "faults": [_fault(fault) for fault in faults],
    }
    if not devices:
        del written["devices"]
    return written


def _written(model: Model) -> dict[str, Any]:
    """A mapping as the file has it: times as text, keys by their names in the file."""
    return model.model_dump(by_alias=True, exclude_none=True)


def _in_order(model: Model, written: dict[str, Any]) -> dict[str, object]:
    """The keys in the order of the form, wherever their values came from."""
    order = [info.alias or name for name, info in type(model).model_fields.items()]
    return {key: written[key] for key in order if key in written}


def _bus(bus: BusIn) -> dict[str, object]:
    if bus.nn:
        return {"name": bus.name, "nn": True}
    line = line_of(bus)
    return {"name": bus.name, "nn": False, "baud": line.baud, "format": str(line.format)}


def _plc(member: Member, polls: Sequence[TransactionIn]) -> dict[str, object]:
    plc = member.plc
    written = _written(plc)
    written["polls"] = [_poll(poll) for poll in polls]
    profile = written["profile"]
    written["profile"] = profile["base"] if set(profile) == {"base"} else profile
    if "turnaround" in profile and "mean" in profile["turnaround"]:
        profile["turnaround"].setdefault("jitter", format_time(0))
    raw = raw_registers(plc)
    for seat in member.ports:
        port = written["ports"][seat.name]
        for key, value in written_keys(seat, member.registers, raw).items():
            port[key] = format_time(value) if key in ("timeout", "interval") else value
        port["cpavl"] = {"words": str(seat.words), "bits": str(seat.bits)}
        written["ports"][seat.name] = _in_order(seat.given, port)
    for key in ("registers", "ports", "polls", "sources"):
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


def _poll(poll: TransactionIn) -> dict[str, object]:
    written = _written(poll)
    if poll.function is not None:
        written.setdefault("count", count_of(poll))
        written.setdefault("retries", 0)
    elif isinstance(poll, PollIn):
        data = poll.data or poll.text
        if data is not None:
            written.setdefault("send_count", len(data))
    return _in_order(poll, written)


def _device(device: DeviceIn, polls: Sequence[TransactionIn]) -> dict[str, object]:
    written = {key: value for key, value in _written(device).items() if value not in ({}, [])}
    if isinstance(device, SlaveIn):
        delay = device.delay if device.delay is not None else DEVICE_PROFILES[device.model].delay
        written["delay"] = format_time(delay)
    if isinstance(device, StepperIn):
        profile = stepper_profile(device)
        written["profile"] = {
            "save_coil": profile.save_coil,
            "acceleration_unit": float(profile.acceleration_unit),
            "homing_zeroes": profile.homing_zeroes,
            "refused_command": profile.refused_command,
            "step_output": profile.step_output.value,
            "zero_is_endless": profile.zero_is_endless,
        }
    if isinstance(device, V80In):
        for section, (_, digit) in SPACES.items():
            if section in written:
                written[section] = {
                    f"{10_000 * digit + reference(section, key) + 1:05}": value
                    for key, value in written[section].items()
                }
    if isinstance(device, MapIn):
        written["functions"] = sorted(functions(device))
    if isinstance(device, HmiIn) and polls:
        written["polls"] = [_poll(poll) for poll in polls]
    return _in_order(device, written)


def _noise(noise: NoiseIn) -> dict[str, object]:
    written = _written(noise)
    if noise.station is not None and noise.reply_loss is None:
        written.setdefault("direction", "rx")
    return _in_order(noise, written)


def _fault(fault: FaultIn) -> dict[str, object]:
    written = _written(fault)
    if fault.power_on is None:
        written = {"at": format_time(0), **written}
    for kind in FAULT_KINDS:
        inside = written.get(kind)
        if inside is not None and set(inside) == {"station"}:
            written[kind] = inside["station"]
    return written

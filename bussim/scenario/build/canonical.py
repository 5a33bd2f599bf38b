"""The scenario as plain data in the file's own form, with every default filled in."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from bussim.forms.form import as_written, in_order
from bussim.plc.inputs import Times
from bussim.plc.link_registers import D_TIMEOUT, TIMEOUT_UNIT
from bussim.scenario.resolve.buses import Line
from bussim.scenario.resolve.members import NN_KEYS, Member, device_name
from bussim.scenario.resolve.port_configuration import written_keys
from bussim.scenario.resolve.scenario import Resolved
from bussim.scenario.schema.disturbances import FaultIn, NoiseIn
from bussim.scenario.schema.document import DocumentIn, PlcIn
from bussim.scenario.schema.draft import readable, values_of
from bussim.scenario.schema.programs import LatencyIn
from bussim.units import format_time

if TYPE_CHECKING:
    from bussim.devices.forms import DeviceIn
    from bussim.scenario.schema.polls import TransactionIn


def canonical(resolved: Resolved, document: DocumentIn) -> dict[str, object]:
    """Plain data that load as the same scenario: what the file says, and the defaults it relies on."""
    draft = resolved.draft
    polls = {path: values_of(entries) for path, entries in draft.polls.items()}
    written = {
        "schema": 1,
        "name": document.name,
        "duration": format_time(document.duration),
        "seed": document.seed,
        "buses": [_bus(line) for line in resolved.lines.values()],
        "plcs": [_plc(member, polls.get(member.path, [])) for member in resolved.members],
        "devices": [_device(device, polls.get(entry.path, [])) for entry, device in readable(draft.devices)],
        "noise": [_noise(entry) for entry in values_of(draft.noise)],
        "faults": [_fault(fault) for fault in values_of(draft.faults)],
        "observe": [str(point) for point in document.observe],
        "latency": [_latency(entry) for entry in values_of(draft.latency)],
        "warnings": [dict(warning) for warning in document.warnings],
    }
    if document.allow_unsimulated:
        written["allow_unsimulated"] = True
    for key in ("buses", "devices", "observe", "latency", "warnings"):
        if not written[key]:
            del written[key]
    return written


def _latency(latency: LatencyIn) -> dict[str, object]:
    defaults = {} if latency.from_.device.is_word else {"edge": "both", "inverted": False}
    return as_written(latency, **defaults)


def _bus(line: Line) -> dict[str, object]:
    own, timing = {"contention": line.bus.contention}, line.timing
    if line.is_link:
        return {"name": line.name, "nn": True, **own}
    return {"name": line.name, "nn": False, "baud": timing.baud, "format": str(timing.format), **own}


def _plc(member: Member, polls: Sequence[TransactionIn]) -> dict[str, object]:
    plc = member.plc
    written = as_written(plc)
    written["polls"] = _polls(polls)
    profile = written["profile"]
    written["profile"] = profile["base"] if set(profile) == {"base"} else profile
    if "turnaround" in profile and "mean" in profile["turnaround"]:
        profile["turnaround"].setdefault("jitter", format_time(0))
    raw = member.raw
    for config in member.ports:
        port = as_written(config.given, **written_keys(config, member.registers, raw))
        if config.name not in member.logic.first.ports:  # else its program says it
            port["cpavl"] = {"words": str(config.words), "bits": str(config.bits)}
        written["ports"][config.name] = port
    for key in ("registers", "sources", "inputs"):
        written[key] = {device_name(name) or name: value for name, value in written[key].items()}
    for key in ("registers", "ports", "polls", "sources", "inputs", "comments"):
        if not written[key]:
            del written[key]
    if member.logic.comments:
        written["comments"] = dict(member.logic.comments)
    if member.logic.program is not None:
        written["program"] = member.logic.program.text
    for name, given in plc.inputs.items():
        if given.csv is not None:
            proper = device_name(name) or name
            spec = member.logic.inputs[proper]
            if isinstance(spec, Times):
                written["inputs"][proper] = {"times": [format_time(tick) for tick in spec.ticks]}
    if plc.nn is not None:
        written["nn"] = _nn(member, plc)
    return written


def _polls(polls: Sequence[TransactionIn]) -> list[dict[str, object]]:
    if not polls:
        return []
    from bussim.scenario.build.polls import written_poll  # what only a scenario with polls pays

    return [written_poll(poll) for poll in polls]


def _device(device: DeviceIn, polls: Sequence[TransactionIn]) -> dict[str, object]:
    written = {key: value for key, value in as_written(device).items() if value not in ({}, [])}
    device.fill(written)
    if polls:
        written["polls"] = _polls(polls)
    return in_order(device, written)


def _nn(member: Member, plc: PlcIn) -> dict[str, object]:
    """``nn`` with the defaults that it stands for, except where ``registers`` gives them."""
    if plc.nn is None:
        return {}
    written: dict[str, object] = {"bus": plc.nn.bus, "port": plc.nn.port or member.port}
    for key, address in NN_KEYS.items():
        name = f"D{address}"
        given = getattr(plc.nn, key)
        if given is not None:
            written[key] = format_time(given) if address == D_TIMEOUT else given
            continue
        if name in member.raw or name in member.logic.first.link or name not in member.registers:
            continue
        value = member.registers[name]
        written[key] = format_time(value * TIMEOUT_UNIT) if address == D_TIMEOUT else value
    return written


def _noise(noise: NoiseIn) -> dict[str, object]:
    sided = noise.station is not None and noise.reply_loss is None
    return as_written(noise, **({"direction": "rx"} if sided else {}))


def _fault(fault: FaultIn) -> dict[str, object]:
    written = as_written(fault)
    if fault.power_on is None:
        written = {"at": format_time(0), **written}
    for kind in FaultIn.kinds:
        inside = written.get(kind)
        if inside is not None and set(inside) == {"station"}:
            written[kind] = inside["station"]
    return written

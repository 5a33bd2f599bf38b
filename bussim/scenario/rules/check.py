"""What one value cannot tell: whether the parts of a scenario fit each other.

Mistakes and oddities of names, buses and PLCs are here, the others in the modules that this one calls.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from bussim.forms.registers import check_registers, named_device
from bussim.line.characters import NN_LINE, LineTiming
from bussim.plc.link_registers import TAKE_PART, TIMEOUT_UNIT
from bussim.plc.memory import Device
from bussim.scenario.resolve.members import (
    NN_KEYS,
    PORT_DEVICE,
    Member,
    device_name,
    friendly_registers,
    member_of,
    own_registers,
    raw_registers,
)
from bussim.scenario.resolve.nodes import Directory, lines_of
from bussim.scenario.resolve.plc_logic import PlcLogic, read_logic
from bussim.scenario.resolve.port_configuration import FIRST_SPECIAL
from bussim.scenario.resolve.profiles import profile_of
from bussim.scenario.rules.buses import check_buses
from bussim.scenario.rules.disturbances import check_faults, check_noise
from bussim.scenario.rules.links import check_links
from bussim.scenario.rules.ports import check_link_bus, check_port_use, check_ports
from bussim.scenario.rules.programs import check_latencies, check_observed, check_programs
from bussim.scenario.schema.document import BusIn, PlcIn, SourceIn
from bussim.scenario.schema.draft import Draft, Entry
from bussim.scenario.yaml.files import Files
from bussim.scenario.yaml.source_map import Path, Report
from bussim.scenario.yaml.user_code import Code
from bussim.units import format_time
from bussim.wording import show


@dataclass(frozen=True, slots=True)
class Checked:
    """What the rules have made of a draft, for the builder."""

    members: list[Member]
    nodes: Directory
    code: Code


def check_rules(draft: Draft, report: Report, code: Code, files: Files) -> Checked:
    """Judge a draft. PLCs and devices that cannot be read are left out of what is returned."""
    owners: list[Entry[Any]] = [*draft.plcs, *draft.devices]  # both name nodes of buses
    sections: list[Iterable[Entry[Any]]] = [draft.buses, owners, draft.noise, draft.faults, draft.latency]
    for section in sections:
        _check_names(section, report)
    _check_owners(draft.buses, owners, report)
    for bus in draft.buses:
        _check_bus(bus, report)
    lines = lines_of(draft)
    power_on: dict[str, int] = {}
    for fault in draft.faults:
        power_on.update((fault.value.power_on or {}) if fault.value is not None else {})
    members = [
        _check_plc(entry, entry.value, draft.buses, lines, power_on, files, report)
        for entry in draft.plcs
        if entry.value is not None
    ]
    nodes = Directory(draft, members, lines)
    if draft.devices:
        from bussim.scenario.rules.devices import check_device  # what only a scenario with devices pays

        for entry in draft.devices:
            if entry.value is not None:
                check_device(entry, entry.value, draft.buses, code, report)
    check_links(draft, members, report)
    check_buses(draft, nodes, report)
    polled: set[str] = set()
    if draft.polls:
        from bussim.scenario.rules.polls import check_polls  # and one with polls

        polled = check_polls(draft, members, nodes, code, report)
    check_port_use(nodes, polled, report)
    check_programs(members, report)
    check_observed(draft, report)
    check_latencies(draft, members, report)
    duration = draft.document.duration if draft.document is not None else None
    check_noise(draft, nodes, duration, report)
    check_faults(draft, nodes, duration, report)
    return Checked(members, nodes, code)


def _check_owners(buses: Iterable[Entry[Any]], owners: Iterable[Entry[Any]], report: Report) -> None:
    """Events name a bus or whoever sits on one, and do not tell which it is."""
    names = {bus.name for bus in buses}
    for entry in owners:
        if entry.name is not None and entry.name in names:
            report.warn(
                (*entry.path, "name"),
                f"{entry.name} is the name of a bus as well: events in the trace and in pictures do not tell "
                "which of the two they are of",
            )


def _check_names(section: Iterable[Entry[Any]], report: Report) -> None:
    seen: dict[str, Entry[Any]] = {}
    for entry in section:
        name = entry.name
        if name is None:
            continue
        first = seen.setdefault(name.casefold(), entry)
        if first is entry:
            continue
        path = (*entry.path, "name")
        where = report.where((*first.path, "name"))
        if first.name == name:
            report.error(path, f"is {show(name)}, which is used already ({where})")
        else:
            report.error(
                path, f"is {show(name)}, which differs only in case from {show(first.name)} ({where})"
            )


def _check_bus(entry: Entry[BusIn], report: Report) -> None:
    bus = entry.value
    if bus is None or not bus.nn:
        return
    fixed = "an N:N link is always 38400 7E1 (leave it out)"
    if bus.baud not in (None, NN_LINE.baud):
        report.error((*entry.path, "baud"), f"is {bus.baud}, but {fixed}")
    if bus.format not in (None, NN_LINE.format):
        report.error((*entry.path, "format"), f"is {bus.format}, but {fixed}")


def _check_plc(
    entry: Entry[PlcIn],
    plc: PlcIn,
    buses: Sequence[Entry[BusIn]],
    lines: Mapping[str, LineTiming],
    power_on: Mapping[str, int],
    files: Files,
    report: Report,
) -> Member:
    check_registers((*entry.path, "registers"), plc.registers, report, link=True)
    _check_source_devices(entry, plc, report)
    logic = PlcLogic()
    if plc.program is not None or plc.inputs:
        at = power_on.get(plc.name, 0)
        logic = read_logic(entry.path, plc, profile_of(plc.profile), own_registers(plc), at, files, report)
    member = member_of(entry.path, plc, lines, logic)
    check_ports(entry, member, buses, report)
    if plc.nn is not None:
        _check_nn(entry, member, report)
        check_link_bus((*entry.path, "nn", "bus"), plc.nn.bus, buses, report)
    elif member.takes_part and member.bus is None and not entry.lost("nn", "ports", "registers"):
        given = next(name for name in TAKE_PART if name in member.registers)
        key = "registers" if given in raw_registers(plc) else "program"
        selected = member.registers.get(PORT_DEVICE, 0)
        example = next((bus.name for bus in buses if bus.value is not None and bus.value.nn), "link")
        and_bus = "" if buses else f" and buses: [{{name: {example}, nn: true}}]"
        report.mistake(
            (*entry.path, key),
            f"{plc.name} sets {given} and so takes part in N:N on {member.port} (M8179 is {selected}), "
            f"but ports does not tell the bus; write ports: {{{member.port}: {{bus: {example}}}}}{and_bus}",
        )
    return member


def _check_source_devices(entry: Entry[PlcIn], plc: PlcIn, report: Report) -> None:
    path = (*entry.path, "sources")
    seen: dict[Device, str] = {}
    for name, source in plc.sources.items():
        device = named_device((*path, name), name, report)
        if device is None:
            continue
        if device in seen:
            report.error((*path, name), f"is the same device as {seen[device]}", key=True)
        seen[device] = name
        if device.letter not in "MD":
            report.error((*path, name), "cannot be driven: a station shares M and D devices only", key=True)
        elif device.address >= FIRST_SPECIAL:
            report.error((*path, name), "is a special device; set it in registers", key=True)
        else:
            _check_source((*path, name), device, source, report)


def _check_source(path: Path, device: Device, source: SourceIn, report: Report) -> None:
    if device.is_word:
        return
    if source.constant is not None and source.constant not in (0, 1):
        report.error((*path, "constant"), f"is {source.constant}, allowed 0, 1 ({device} is a bit)")
    if source.ramp is not None:
        report.error((*path, "ramp"), f"needs a word; {device} is a bit", key=True)


def _check_nn(entry: Entry[PlcIn], member: Member, report: Report) -> None:
    nn, profile = member.plc.nn, member.profile
    if nn is None:
        return
    path = (*entry.path, "nn")
    if nn.mode is not None and nn.mode not in profile.modes and not entry.lost("profile"):
        allowed = ", ".join(map(str, profile.modes))
        report.error((*path, "mode"), f"is {nn.mode}, allowed {allowed} (profile {profile.name})")
    if nn.timeout is not None:
        low, high = (limit * TIMEOUT_UNIT for limit in profile.timeout_range)
        below = nn.timeout - nn.timeout % TIMEOUT_UNIT
        if not low <= nn.timeout <= high and not entry.lost("profile"):
            report.error(
                (*path, "timeout"),
                f"is {format_time(nn.timeout)}, allowed {_ms(low)}..{_ms(high)} (profile {profile.name})",
            )
        elif nn.timeout != below:
            near = f"{_ms(below)} or {_ms(below + TIMEOUT_UNIT)}"
            report.error(
                (*path, "timeout"),
                f"is {format_time(nn.timeout)}, allowed are multiples of 10 ms, here {near}",
            )
    _check_contradictions(entry, member, report)


def _ms(ticks: int) -> str:
    return f"{ticks // (TIMEOUT_UNIT // 10)} ms"


def _check_contradictions(entry: Entry[PlcIn], member: Member, report: Report) -> None:
    nn = member.plc.nn
    if nn is None:
        return
    friendly = friendly_registers(nn)
    keys = {f"D{address}": key for key, address in NN_KEYS.items()} | {PORT_DEVICE: "port"}
    for name, value in member.plc.registers.items():
        device = device_name(name)
        if device in friendly and value & 0xFFFF != friendly[device]:
            report.error(
                (*entry.path, "registers", name),
                f"is {value}, but nn.{keys[device]} makes it {friendly[device]}",
            )

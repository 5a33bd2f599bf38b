"""What one value cannot tell: whether the parts of a scenario fit each other.

Mistakes and oddities of buses and PLCs are here, those of links in ``link_rules``, those of noise
and faults in ``disturbance_rules``.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from bussim.line.characters import NN_LINE
from bussim.plc.board import TAKE_PART, TIMEOUT_UNIT
from bussim.plc.memory import Device, parse_device
from bussim.scenario.disturbance_rules import check_faults, check_noise
from bussim.scenario.link_rules import check_bus_name, check_links
from bussim.scenario.places import Path, Report
from bussim.scenario.schema import BusIn, PlcIn, SourceIn
from bussim.scenario.seats import NN_KEYS, PORT_DEVICE, Member, device_name, friendly_registers, member_of
from bussim.scenario.validate import Draft, Entry, T
from bussim.scenario.wording import show, suggest
from bussim.units import format_time

#: The ports of the first board, the only ones that M8179 can select.
LINK_PORTS = ("COM3", "COM4")
_ALL_PORTS = ("COM1", "COM2", "COM3", "COM4", "COM5", "COM6")
#: M8000 and D8000 on are special devices.
FIRST_SPECIAL = 8000


def check_rules(draft: Draft, report: Report) -> list[Member]:
    """Judge a draft; returns the PLCs as links see them, in order, without those that cannot be read."""
    _check_names(draft.buses, report)
    _check_names(draft.plcs, report)
    _check_names(draft.noise, report)
    _check_names(draft.faults, report)
    for bus in draft.buses:
        _check_bus(bus, report)
    members = [
        _check_plc(entry, entry.value, draft.buses, report) for entry in draft.plcs if entry.value is not None
    ]
    check_links(draft, members, report)
    duration = draft.document.duration if draft.document is not None else None
    check_noise(draft, members, duration, report)
    check_faults(draft, members, duration, report)
    return members


def _check_names(section: Iterable[Entry[T]], report: Report) -> None:
    seen: dict[str, Entry[T]] = {}
    for entry in section:
        name = entry.name
        if name is None:
            continue
        first = seen.setdefault(name.casefold(), entry)
        if first is entry:
            continue
        path = (*entry.path, "name")
        where = report.places.where((*first.path, "name"))
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


def _check_plc(entry: Entry[PlcIn], plc: PlcIn, buses: Sequence[Entry[BusIn]], report: Report) -> Member:
    _check_registers(entry, plc, report)
    _check_source_devices(entry, plc, report)
    member = member_of(entry.path, plc)
    _check_ports(entry, member, buses, report)
    if plc.nn is not None:
        _check_nn(entry, member, report)
        _check_link_bus((*entry.path, "nn", "bus"), plc.nn.bus, buses, report)
    elif member.takes_part and member.bus is None and not entry.lost("nn", "ports", "registers"):
        given = next(name for name in TAKE_PART if name in member.registers)
        selected = member.registers.get(PORT_DEVICE, 0)
        example = next((bus.name for bus in buses if bus.value is not None and bus.value.nn), "link")
        report.mistake(
            (*entry.path, "registers"),
            f"{plc.name} sets {given} and so takes part in N:N on {member.port} (M8179 is {selected}), "
            f"but ports does not tell the bus; write ports: {{{member.port}: {{bus: {example}}}}}",
        )
    return member


def _check_link_bus(path: Path, name: str, buses: Sequence[Entry[BusIn]], report: Report) -> None:
    bus = check_bus_name(path, name, buses, report)
    lost = any(entry.name == name and entry.lost("nn") for entry in buses)
    if bus is not None and not bus.nn and not lost:
        report.error(path, f"is {name}, which is not an N:N link; give that bus nn: true")


#: What the link writes: mirrors of its settings, times, counts and codes, and flags.
_STATUS = (("D", 8173, 8175), ("D", 8201, 8218), ("M", 8183, 8191))


def _check_registers(entry: Entry[PlcIn], plc: PlcIn, report: Report) -> None:
    path = (*entry.path, "registers")
    seen: dict[Device, str] = {}
    for name, value in plc.registers.items():
        device = _device((*path, name), name, report)
        if device is None:
            continue
        if device in seen:
            report.error((*path, name), f"is the same device as {seen[device]}", key=True)
        seen[device] = name
        if not device.is_word and value not in (0, 1):
            report.error((*path, name), f"is {value}, allowed 0, 1")
        if any(
            device.letter == letter and first <= device.address <= last for letter, first, last in _STATUS
        ):
            report.warn((*path, name), "is written by the link itself: the value given here is lost")


def _device(path: Path, name: str, report: Report) -> Device | None:
    try:
        return parse_device(name)
    except ValueError as error:
        report.mistake(path, f"a device of {report.places.short_name(path[:-1])} {error}", key=True)
        return None


def _check_source_devices(entry: Entry[PlcIn], plc: PlcIn, report: Report) -> None:
    path = (*entry.path, "sources")
    seen: dict[Device, str] = {}
    for name, source in plc.sources.items():
        device = _device((*path, name), name, report)
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


def _check_ports(entry: Entry[PlcIn], member: Member, buses: Sequence[Entry[BusIn]], report: Report) -> None:
    plc, path = member.plc, (*entry.path, "ports")
    for name, port in plc.ports.items():
        if name not in _ALL_PORTS:
            report.error((*path, name), f"is not a port; {suggest(name, LINK_PORTS)}", key=True)
        elif name not in LINK_PORTS:
            report.error((*path, name), "has no use in this version: N:N runs on COM3 or COM4", key=True)
        elif not member.takes_part:
            check_bus_name((*path, name, "bus"), port.bus, buses, report)
            if not entry.lost("nn", "registers"):
                report.warn(
                    (*path, name),
                    f"{plc.name} takes no part in N:N (no nn, and none of M8179, D8176 to D8180 set): "
                    f"its port {name} does nothing",
                )
        elif name != member.port:
            check_bus_name((*path, name, "bus"), port.bus, buses, report)
            report.warn((*path, name), f"port {name} of {plc.name} does nothing: M8179 selects {member.port}")
        elif plc.nn is None:
            _check_link_bus((*path, name, "bus"), port.bus, buses, report)
        elif port.bus != plc.nn.bus:
            report.error((*path, name, "bus"), f"is {port.bus}, but nn.bus is {plc.nn.bus}")


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

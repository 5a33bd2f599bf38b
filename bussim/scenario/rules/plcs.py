"""What is wrong or odd about a PLC's own keys: registers, sources, inputs, and its place on a link."""

from bussim.forms.registers import check_registers, named_devices
from bussim.plc.link_registers import TAKE_PART, TIMEOUT_UNIT, mode_numbers
from bussim.plc.memory import FIRST_SPECIAL, Device
from bussim.plc.system_devices import CLOCK, clock_of
from bussim.scenario.resolve.members import KEYS_OF_DEVICES, PORT_DEVICE, Member, device_name
from bussim.scenario.resolve.scenario import Resolved
from bussim.scenario.schema.document import PlcIn, SourceIn
from bussim.scenario.schema.draft import Entry
from bussim.scenario.yaml.source_map import Path, Report
from bussim.units import format_time
from bussim.words.language import say

#: A level that is so many times shorter than a scan is seen by hardly any.
_FAR_SHORTER = 10


def check_plcs(resolved: Resolved, report: Report) -> None:
    """Check every PLC by itself."""
    entries = {entry.path: entry for entry in resolved.draft.plcs}
    for member in resolved.members:
        entry = entries[member.path]
        path, family = (*member.path, "registers"), member.profile.family
        check_registers(path, member.plc.registers, report, link=True, family=family)
        _check_clock(member, report)
        _check_ports(member, report)
        _check_source_devices(member, report)
        _check_short_levels(member, report)
        if member.plc.nn is not None:
            _check_nn(entry, member, report)
        elif member.takes_part and member.bus is None and not entry.lost("nn", "ports", "registers"):
            _report_unknown_bus(member, resolved, report)


def _check_clock(member: Member, report: Report) -> None:
    path, year = (*member.path, "registers"), member.raw.get("D8018", 0)
    if year not in range(100):
        text = say("rule_year", year=year)
        report.mistake(path, say("rule_of_plc", member=member.name, what=text))
    else:
        try:
            clock_of([member.raw.get(f"D{address}", 0) & 0xFFFF for address in CLOCK[:-1]])
        except ValueError as error:
            report.mistake(path, say("rule_no_clock", member=member.name, error=error.args[0]))
    if "D8019" in member.raw:
        text = say("rule_weekday")
        report.warn(path, say("rule_of_plc", member=member.name, what=text))


def _check_ports(member: Member, report: Report) -> None:
    """Ports that a family's boards do not have."""
    used = [member.port] * member.takes_part + [config.name for config in member.ports]
    allowed = member.profile.board_ports
    for port in sorted({*used} - {*allowed}):
        has = say("rule_profile_ports", profile=member.profile.name, allowed=list(allowed))
        report.warn(member.path, say("rule_port_lacking", member=member.name, has=has, port=port))


def _report_unknown_bus(member: Member, resolved: Resolved, report: Report) -> None:
    """A PLC whose registers let it take part in N:N, while no key names the bus."""
    given = next(name for name in TAKE_PART if name in member.registers)
    selected = member.registers.get(PORT_DEVICE, 0)
    example = next((line.name for line in resolved.lines.values() if line.is_link), "link")
    and_bus = "" if resolved.draft.buses else say("rule_and_buses", example=example)
    report.mistake(
        (*member.path, "registers" if given in member.raw else "program"),
        say(
            "rule_bus_unnamed",
            member=member.name,
            given=given,
            port=member.port,
            selected=selected,
            example=example,
            and_bus=and_bus,
        ),
    )


def _check_source_devices(member: Member, report: Report) -> None:
    path = (*member.path, "sources")
    for name, device in named_devices(path, member.plc.sources, report, family=member.profile.family):
        if device.letter not in "MD":
            report.error((*path, name), say("rule_m_d_only"), key=True)
        elif device.address >= FIRST_SPECIAL:
            report.error((*path, name), say("rule_special"), key=True)
        else:
            _check_source((*path, name), device, member.plc.sources[name], report)


def _check_source(path: Path, device: Device, source: SourceIn, report: Report) -> None:
    if device.is_word:
        return
    if source.constant is not None and source.constant not in (0, 1):
        report.error((*path, "constant"), say("rule_bit_value", constant=source.constant, device=device))
    if source.ramp is not None:
        report.error((*path, "ramp"), say("rule_needs_word", device=device), key=True)


def _check_nn(entry: Entry[PlcIn], member: Member, report: Report) -> None:
    nn, profile = member.plc.nn, member.profile
    if nn is None:
        return
    path = (*entry.path, "nn")
    if nn.mode is not None and nn.mode not in profile.modes and not entry.lost("profile"):
        allowed = say("rule_of_profile", allowed=mode_numbers(profile.modes), profile=profile.name)
        report.error((*path, "mode"), say("rule_allowed", mode=nn.mode, allowed=allowed))
    if nn.timeout is not None:
        low, high = (limit * TIMEOUT_UNIT for limit in profile.timeout_range)
        below, asked = nn.timeout - nn.timeout % TIMEOUT_UNIT, format_time(nn.timeout)
        if not low <= nn.timeout <= high and not entry.lost("profile"):
            report.error(
                (*path, "timeout"),
                say("rule_timeout_range", timeout=asked, low=_ms(low), high=_ms(high), profile=profile.name),
            )
        elif nn.timeout != below:
            near = say("rule_or", below=_ms(below), above=_ms(below + TIMEOUT_UNIT))
            report.error((*path, "timeout"), say("rule_multiples_10", timeout=asked, near=near))
    _check_contradictions(entry, member, report)


def _ms(ticks: int) -> str:
    return f"{ticks // (TIMEOUT_UNIT // 10)} ms"


def _check_contradictions(entry: Entry[PlcIn], member: Member, report: Report) -> None:
    for name, value in member.plc.registers.items():
        device = device_name(name)
        if ("nn", KEYS_OF_DEVICES.get(device or "")) in entry.cut:
            continue
        if device in member.friendly and value & 0xFFFF != member.friendly[device]:
            made = {"setting": KEYS_OF_DEVICES[device], "made": member.friendly[device]}
            report.error((*member.path, "registers", name), say("rule_contradicts_nn", value=value, **made))


def _check_short_levels(member: Member, report: Report) -> None:
    """Inputs of which the PLC sees next to nothing, since it looks once a scan."""
    for name, given in member.plc.inputs.items():
        if given.pulse is not None:
            level, what = given.pulse.width, "rule_on_for"
        elif given.square is not None:
            level, what = given.square.period // 2, "rule_on_off_for"
        elif given.random is not None:
            level, what = min(given.random.on, given.random.off), "rule_on_or_off_for"
        else:
            continue
        if level * _FAR_SHORTER < member.plc.scan.mean:
            values = {"level": format_time(level), "scan": format_time(member.plc.scan.mean)}
            text = say("rule_short_level", name=name, member=member.name, what=say(what), **values)
            report.warn((*member.path, "inputs", name), text, key=True)

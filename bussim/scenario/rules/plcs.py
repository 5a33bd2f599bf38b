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
        text = f"D8018 is {year}, allowed 0..99, the year without its century"
        report.mistake(path, f"{member.name}: {text}")
    else:
        try:
            clock_of([member.raw.get(f"D{address}", 0) & 0xFFFF for address in CLOCK[:-1]])
        except ValueError as error:
            report.mistake(path, f"{member.name}: D8013 to D8018 are no time: {error}")
    if "D8019" in member.raw:
        text = "D8019, the day of the week, follows from D8013 to D8018; leave it out"
        report.warn(path, f"{member.name}: {text}")


def _check_ports(member: Member, report: Report) -> None:
    """Ports that a family's boards do not have."""
    used = [member.port] * member.takes_part + [config.name for config in member.ports]
    allowed = member.profile.board_ports
    for port in sorted({*used} - {*allowed}):
        has = f"a PLC of profile {member.profile.name} has {' and '.join(allowed)}"
        report.warn(member.path, f"{member.name}: {has}, not {port}, which is simulated as if it were there")


def _report_unknown_bus(member: Member, resolved: Resolved, report: Report) -> None:
    """A PLC whose registers let it take part in N:N, while no key names the bus."""
    given = next(name for name in TAKE_PART if name in member.registers)
    selected = member.registers.get(PORT_DEVICE, 0)
    example = next((line.name for line in resolved.lines.values() if line.is_link), "link")
    and_bus = "" if resolved.draft.buses else f" and buses: [{{name: {example}, nn: true}}]"
    report.mistake(
        (*member.path, "registers" if given in member.raw else "program"),
        f"{member.name} sets {given} and so takes part in N:N on {member.port} (M8179 is {selected}), "
        f"but ports does not name the bus; write ports: {{{member.port}: {{bus: {example}}}}}{and_bus}",
    )


def _check_source_devices(member: Member, report: Report) -> None:
    path = (*member.path, "sources")
    for name, device in named_devices(path, member.plc.sources, report, family=member.profile.family):
        if device.letter not in "MD":
            report.error((*path, name), "cannot be driven: a station shares M and D devices only", key=True)
        elif device.address >= FIRST_SPECIAL:
            report.error((*path, name), "is a special device; set it in registers", key=True)
        else:
            _check_source((*path, name), device, member.plc.sources[name], report)


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
        allowed = f"{mode_numbers(profile.modes)} (profile {profile.name})"
        report.error((*path, "mode"), f"is {nn.mode}, allowed {allowed}")
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
    for name, value in member.plc.registers.items():
        device = device_name(name)
        if ("nn", KEYS_OF_DEVICES.get(device or "")) in entry.cut:
            continue
        if device in member.friendly and value & 0xFFFF != member.friendly[device]:
            report.error(
                (*member.path, "registers", name),
                f"is {value}, but nn.{KEYS_OF_DEVICES[device]} makes it {member.friendly[device]}",
            )


def _check_short_levels(member: Member, report: Report) -> None:
    """Inputs of which the PLC sees next to nothing, since it looks once a scan."""
    for name, given in member.plc.inputs.items():
        if given.pulse is not None:
            level, what = given.pulse.width, "stays on for"
        elif given.square is not None:
            level, what = given.square.period // 2, "stays on and off for"
        elif given.random is not None:
            level, what = min(given.random.on, given.random.off), "stays on or off for a mean of"
        else:
            continue
        if level * _FAR_SHORTER < member.plc.scan.mean:
            report.warn(
                (*member.path, "inputs", name),
                f"{name} of {member.name} {what} {format_time(level)}, but is read once a scan, every "
                f"{format_time(member.plc.scan.mean)}: almost none of its changes are seen",
                key=True,
            )

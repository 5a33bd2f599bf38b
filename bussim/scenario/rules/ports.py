"""What is wrong or odd about the ports of one PLC, the link's and the others."""

from collections.abc import Mapping
from typing import Any

from bussim.engines.modbus.adu import Mode
from bussim.errors import Problem
from bussim.plc.errors import serial_error
from bussim.plc.memory import BIT_RANGES, FIRST_SPECIAL, Device
from bussim.plc.ports.cpavl import (
    BITS,
    INTERVAL_UNIT,
    PORT_PROTOCOLS,
    PROTOCOL_CODES,
    RS_WORDS,
    TIMEOUT_UNIT,
    WORDS,
    BadSettings,
    format_word,
    refusal,
)
from bussim.scenario.resolve.buses import Line
from bussim.scenario.resolve.members import Member, device_name
from bussim.scenario.resolve.port_configuration import (
    CPAVL_PORTS,
    FREE,
    HMI,
    MODES,
    SLAVES,
    PortConfiguration,
    is_set_up,
    keys_of,
    own_line,
)
from bussim.scenario.resolve.scenario import Resolved
from bussim.scenario.rules.buses import understood
from bussim.scenario.rules.programs import link_writes, lost_settings
from bussim.scenario.schema.document import PlcIn, PortIn
from bussim.scenario.schema.draft import Entry
from bussim.scenario.yaml.source_map import Path, Report
from bussim.units import format_time
from bussim.words.language import say
from bussim.words.values import suggest

ALL_PORTS = ("COM1", *CPAVL_PORTS)


def protocols_of(port: str) -> list[str]:
    """What a port can be set to, in the order of the codes."""
    return [name for name in PROTOCOL_CODES if name in PORT_PROTOCOLS[port]]


def check_ports(resolved: Resolved, report: Report) -> None:
    """Check every entry of the PLCs' ``ports``, and the bus of their link."""
    entries = {entry.path: entry for entry in resolved.draft.plcs}
    for member in resolved.members:
        _check_member(entries[member.path], member, resolved.lines, report)
        if member.plc.nn is not None:
            _check_link_bus((*member.path, "nn", "bus"), resolved.lines.get(member.plc.nn.bus), report)


def _check_member(entry: Entry[PlcIn], member: Member, lines: Mapping[str, Line], report: Report) -> None:
    configs = {config.name: config for config in member.ports}
    for name, port in member.plc.ports.items():
        path = (*member.path, "ports", name)
        if name not in ALL_PORTS:
            report.error(path, say("rule_no_port", hint=suggest(name, CPAVL_PORTS)), key=True)
            continue
        if name == "COM1":
            text = say("rule_com1")
            report.error(path, say("rule_allowed_are", text=text, ports=", ".join(CPAVL_PORTS)), key=True)
            continue
        line = lines.get(port.bus)
        if member.takes_part and name == member.port:
            _check_link_port(path, member, port, line, report)
        elif line is not None and line.is_link:
            _check_beside_link(path, member, port, line, report)
        if name in configs:
            _check_config(entry, configs[name], member, line, report)
        elif not is_set_up(name, port):
            _check_bare(entry, path, member, port, line, report)
    _check_positions(member, report)


def _check_link_bus(path: Path, line: Line | None, report: Report) -> None:
    """The bus of an N:N port must be one for N:N."""
    if line is not None and not line.is_link and not line.entry.lost("nn"):
        report.error(path, say("rule_not_link", line=line.name))


def _given(port: PortIn) -> list[str]:
    return [key for key in PortIn.model_fields if key != "bus" and getattr(port, key) is not None]


def _check_link_port(path: Path, member: Member, port: PortIn, line: Line | None, report: Report) -> None:
    """The port that M8179 selects is the link's: it has a bus, and nothing else."""
    if member.plc.nn is not None and port.bus != member.plc.nn.bus:
        report.error((*path, "bus"), say("rule_nn_bus", bus=port.bus, other=member.plc.nn.bus))
    elif member.plc.nn is None:
        _check_link_bus((*path, "bus"), line, report)
    for key in _given(port):
        where = say("rule_runs_on", member=member.name, port=member.port, selected=int(member.port == "COM4"))
        value = (
            say("rule_is_but_end", protocol=port.protocol)
            if key == "protocol"
            else say("rule_no_meaning_end")
        )
        report.error((*path, key), say("rule_one_thing", value=value, where=where))


def _check_beside_link(path: Path, member: Member, port: PortIn, bus: Line, report: Report) -> None:
    """A port on an N:N bus that is not the one which takes part."""
    name = str(path[-1])
    if port.protocol is not None:
        report.error((*path, "protocol"), say("rule_beside_link", protocol=port.protocol, bus=bus.name))
    elif name in ("COM5", "COM6"):
        report.error((*path, "bus"), say("rule_cannot_select", bus=bus.name, name=name))
    elif name == "COM2" or port.cpavl is not None:
        why = say("rule_com2_lacks") if name == "COM2" else say("rule_cpavl_not")
        report.error((*path, "bus"), say("rule_link_elsewhere", bus=bus.name, why=why))
    elif member.takes_part:
        report.warn(path, say("rule_not_selected", name=name, member=member.name, selected=member.port))


def _check_bare(
    entry: Entry[PlcIn], path: Path, member: Member, port: PortIn, line: Line | None, report: Report
) -> None:
    name = str(path[-1])
    if member.takes_part and name == member.port:
        return
    for key in _given(port):
        report.error(
            (*path, key), say("rule_needs_protocol", name=name, protocols=", ".join(protocols_of(name)))
        )
    if _given(port) or entry.lost("nn", "registers", "ports"):
        return
    if not member.takes_part and lost_settings(member):
        return  # which was said
    if not member.takes_part:
        program = member.logic.program
        when = say("rule_first_scan") if program is not None and link_writes(program) else ""
        report.warn(path, say("rule_port_idle", member=member.name, when=when, name=name))
    elif line is None or not line.is_link:
        report.warn(path, say("rule_port_no_protocol", name=name, member=member.name))


def _check_config(
    entry: Entry[PlcIn], config: PortConfiguration, member: Member, line: Line | None, report: Report
) -> None:
    path, given = config.path, config.given
    sure = not entry.lost("registers", "ports")
    before = len(report.errors)
    if config.words == RS_WORDS and (keys := _given(given)):
        text = say("rule_rs_drives", plc=config.plc, config=config.name)
        report.error((*path, keys[0]), say("rule_only_bus", what=text), key=True)
        return
    if given.protocol is not None and given.protocol not in protocols_of(config.name):
        allowed = ", ".join(protocols_of(config.name))
        report.error((*path, "protocol"), say("rule_only_com2", protocol=given.protocol, allowed=allowed))
        return
    _check_keys(config, given.protocol or (config.protocol if sure else None), report)
    _check_units(config, report)
    _check_contradictions(entry, config, report)
    if given.protocol in SLAVES and config.register("station") not in member.registers and sure:
        report.error((*path, "station"), say("form_missing"))
    if line is not None and not line.is_link and sure and not line.entry.lost("baud", "format"):
        _check_line(config, member, line, report)
    if sure and len(report.errors) == before:
        _check_settings(config, member, report)


def _at_cpavl(config: PortConfiguration, member: Member, text: str, report: Report, *, fatal: bool) -> bool:
    """Report a sentence at the CPAVL of the program that sets a port up; False if none does."""
    program, origin = member.logic.program, member.logic.origin
    if program is None or origin is None or config.name not in member.logic.first.ports:
        return False
    calls = [at for at in program.instructions if at.spec.name == "CPAVL"]
    at = next((at for at in calls if f"COM{at.operands[2].address}" == config.name), None)
    if at is not None:
        problem = Problem("", at.line, at.column, text)
        report.add(origin.problem(report, problem, warning=not fatal), fatal=fatal)
    return at is not None


def _check_settings(config: PortConfiguration, member: Member, report: Report) -> None:
    """What becomes of words that the PLC refuses, or that set up nothing that is simulated."""
    settings = config.settings
    if isinstance(settings, BadSettings):
        code = serial_error(member.profile.error_codes, config.name, settings.error)
        text = refusal(config.node, settings.text, code)
        if not _at_cpavl(config, member, text, report, fatal=False):
            report.warn(config.path, text)
    elif settings.protocol is None:
        word = config.register("protocol")
        codes = ", ".join(
            say("rule_code", code=code, name=name) for name, code in PROTOCOL_CODES.items() if code
        )
        report.warn(
            config.path, say("rule_word_zero", word=word, plc=config.plc, config=config.name, codes=codes)
        )
    elif settings.protocol == HMI:
        report.warn(config.path, say("rule_hmi_silent", config=config.node))


def _check_keys(config: PortConfiguration, protocol: str | None, report: Report) -> None:
    if protocol is None:
        return
    allowed = keys_of(protocol)
    for key in _given(config.given):
        if key in ("protocol", "cpavl") or key in allowed:
            continue
        report.error(
            (*config.path, key),
            say("rule_protocol_has", protocol=protocol, allowed=", ".join(allowed)),
            key=True,
        )


def _check_units(config: PortConfiguration, report: Report) -> None:
    """Times that the words cannot hold."""
    for key, unit in (("timeout", TIMEOUT_UNIT), ("interval", INTERVAL_UNIT)):
        value = getattr(config.given, key)
        if value is None:
            continue
        below = value - value % unit
        if value != below:
            near = say("rule_or", below=format_time(below), above=format_time(below + unit))
            if key == "timeout" and not below:
                near = format_time(unit)
            report.error(
                (*config.path, key),
                say("rule_multiples", value=format_time(value), unit=format_time(unit), near=near),
            )
    if config.given.interval == 0 and config.is_master:
        report.warn((*config.path, "interval"), say("rule_interval_0", config=config.node))


def _check_contradictions(entry: Entry[PlcIn], config: PortConfiguration, report: Report) -> None:
    """The same word in ``registers`` and in a friendly key, with different values."""
    if entry.value is None:
        return
    wanted = {register: (key, value) for key, (register, value) in config.explicit.items()}
    for name, value in entry.value.registers.items():
        key, friendly = wanted.get(device_name(name) or "", ("", value & 0xFFFF))
        if value & 0xFFFF != friendly:
            report.error(
                (*entry.path, "registers", name),
                say("rule_contradicts_port", value=value, port=config.name, setting=key, friendly=friendly),
            )


def _check_line(config: PortConfiguration, member: Member, bus: Line, report: Report) -> None:
    line, given = config.line, config.given
    own = own_line(given, line)
    if MODES.get(given.protocol or "") is Mode.RTU and own.format.data_bits != 8:
        word = config.register("format")
        needs = say("rule_rtu_bits")
        if given.format is not None:
            report.error((*config.path, "format"), say("rule_fixed", found=own.format, why=needs))
            return
        if member.registers.get(word) == format_word(own, eight_bit=False):
            report.error(
                (*config.path, "protocol"),
                say(
                    "rule_protocol_format",
                    protocol=given.protocol,
                    bus=bus.name,
                    own=own.format,
                    why=needs,
                ),
            )
            return
    timing = config.valid.timing if config.valid is not None and config.protocol is not None else line
    understood(config.path, config.node, timing, bus, report)


def _check_positions(member: Member, report: Report) -> None:
    """CPAVL's words and bits must lie in the memory, and apart."""
    for kind, size in (("words", WORDS), ("bits", BITS)):
        taken: list[tuple[Device, PortConfiguration]] = []
        for config in (each for each in member.ports if each.words != RS_WORDS):
            first: Device = getattr(config, kind)
            wanted = "D" if kind == "words" else "M"
            last = FIRST_SPECIAL - 1 if kind == "words" else BIT_RANGES["M"][0][1]
            wrong: list[dict[str, Any]] = []
            if first.letter != wanted or first.address + size - 1 > last:
                wrong.append({"letter": wanted, "last": Device(wanted, last - size + 1)})
            else:
                near = (pair for pair in taken if abs(pair[0].address - first.address) < size)
                wrong += [{"owner": owner.name, "other": other} for other, owner in near]
                taken.append((first, config))
            for values in wrong:
                shown = say("rule_first_of", first=first, size=size, kind=say(f"word_{kind}"))
                text = say(
                    "rule_overlap" if "owner" in values else "rule_first_allowed", shown=shown, **values
                )
                operand = say("rule_operand_for", config=config.node, what=text)
                if not _at_cpavl(config, member, operand, report, fatal=True):
                    report.error((*config.path, "cpavl", kind), text)


def _polled(resolved: Resolved) -> set[str]:
    """The nodes of PLCs' ports with polls; all of a PLC's where a poll cannot be read."""
    found: set[str] = set()
    if not resolved.draft.polls:
        return found
    from bussim.scenario.schema.polls import PollIn  # what only a scenario with polls pays

    for member in resolved.members:
        for entry in resolved.draft.polls.get(member.path, []):
            ports = [config.name for config in member.ports]
            if isinstance(entry.value, PollIn):
                ports = [entry.value.port]
            found |= {f"{member.name}.{port}" for port in ports}
    return found


def check_port_use(resolved: Resolved, report: Report) -> None:
    """Warn of masters and free ports that nothing drives."""
    nodes, polled = resolved.nodes, _polled(resolved)
    for node in nodes.nodes:
        config = node.config
        if config is None or node.name in polled or not nodes.sure(node.owner):
            continue
        if node.member is not None and node.member.drives_ports:
            continue
        if config.is_master:
            report.warn(config.path, say("rule_no_polls", node=node.name))
        elif config.protocol == FREE:
            report.warn(config.path, say("rule_undriven", node=node.name))

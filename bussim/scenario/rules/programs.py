"""What is odd about programs beside the rest of a scenario."""

from __future__ import annotations

import operator
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, assert_never

from bussim.errors import Problem
from bussim.plc.link_registers import TAKE_PART
from bussim.plc.memory import BlockRange, Device, parse_device
from bussim.plc.profiles import RS2_FIRMWARE
from bussim.scenario.resolve.members import KEYS_OF_DEVICES, Member, device_name
from bussim.scenario.resolve.scenario import Resolved
from bussim.scenario.rules.links import blocks_of, link_of
from bussim.scenario.yaml.source_map import Report
from bussim.wording import counted

if TYPE_CHECKING:
    from bussim.plc.program.program import Program
    from bussim.plc.program.text.catalog import Instruction
    from bussim.plc.program.text.ladder import Condition
    from bussim.plc.program.text.operand_checks import Extent

#: What a program's texts together may have: a run's scenario.yaml holds them all, and must be read again.
MAX_PROGRAMS = 256 * 1024
#: Writes into other stations' blocks that are reported of one PLC.
MAX_FOREIGN = 20


def check_programs(resolved: Resolved, report: Report) -> None:
    """Check every program against registers, ports and the link."""
    members, total = resolved.members, 0
    for member in members:
        program = member.logic.program
        if program is None:
            continue
        # A line costs its indentation as well.
        total += len(program.text.encode()) + 8 * program.text.count("\n")
        _check_settings(member, report)
        _check_specials(member, report)
        _check_ports(member, report)
        _check_rs2(member, report)
        _check_writes(member, members, report)
        _check_guards(member, members, report)
    if total > MAX_PROGRAMS:
        report.mistake(
            ("plcs",),
            f"the programs of all PLCs have {total >> 10} KiB together, allowed {MAX_PROGRAMS >> 10} KiB",
        )


def _warn_at(member: Member, at: Instruction, message: str, report: Report, *, in_runs: bool = True) -> None:
    origin = member.logic.origin
    if origin is not None:
        problem = Problem("", at.line, at.column, f"{member.name}: {message}")
        placed = origin.problem(report, problem, warning=True)
        report.add(placed, fatal=False)
        if not in_runs:
            report.plain[placed] = ""


def _check_settings(member: Member, report: Report) -> None:
    """What the scenario says of the link and the program says otherwise."""
    name, friendly, raw, program = member.name, member.friendly, member.raw, member.logic.program
    if program is not None and not program.sets_link(at_step_0=member.profile.link_at_step_0):
        from bussim.plc.program.text.operand_checks import extents

        settings = {parse_device(device) for device in TAKE_PART}
        for at in program.instructions:
            written = {Device(each.letter, each.first) for each in extents(at) if each.writes} & settings
            if written:
                out = "" if member.takes_part else f", and {name} takes no part in the link"
                message = (
                    f"{at.name} writes {written.pop()}, but not under M8038 as the contact of the program's "
                    f"first step: profile {member.profile.name} does not take that over (assumed){out}"
                )
                _warn_at(member, at, message, report)
                break
    for device, value in member.logic.first.link.items():
        if device in friendly and friendly[device] != value:
            key = KEYS_OF_DEVICES[device]
            report.warn(
                (*member.path, "nn", key),
                f"the program of {name} sets {device} to {value}: nn.{key}, which stands for "
                f"{friendly[device]}, is lost",
            )
        elif device not in friendly and device in raw and raw[device] & 0xFFFF != value:
            report.warn(
                (*member.path, "registers"),
                f"the program of {name} sets {device} to {value}: the {raw[device]} of registers is lost",
            )


def _check_specials(member: Member, report: Report) -> None:
    """Special bits that the scenario sets, that would change how the program runs, and that do not."""
    program = member.logic.program
    if program is None:
        return
    idle = {f"M{address}": message for address, message in program.not_simulated().items()}
    for name, value in member.plc.registers.items():
        message = idle.get(device_name(name) or "")
        if value and message is not None:
            report.warn((*member.path, "registers", name), f"{member.name}: {message}", key=True)


def _check_ports(member: Member, report: Report) -> None:
    """Ports that a CPAVL sets up and the scenario does not connect; keys that it overrules."""
    program = member.logic.program
    if program is None:
        return
    firmware, needed, reported = member.profile.firmware, RS2_FIRMWARE, set[str]()
    for at in program.instructions:
        if at.spec.group != "serial":
            continue
        if any(map(operator.lt, firmware, needed)) and not reported:
            message = (
                f"{at.name} exists from D8001 = {needed[0]} and D8101 = {needed[1]} on, here they are "
                f"{firmware[0]} and {firmware[1]} (firmware of profile {member.profile.name})"
            )
            _warn_at(member, at, message, report)
        port = f"COM{at.operands[-1].constant}"
        if at.operands[-1].constant is not None and port not in (*member.plc.ports, *reported):
            does = f"sets {port} up" if at.spec.name == "CPAVL" else f"drives {port}"
            message = (
                f"{at.name} {does}, but ports does not name its bus: it does nothing; "
                f"write ports: {{{port}: {{bus: …}}}}"
            )
            _warn_at(member, at, message, report)
        reported.add(port)
    for config in member.ports:
        found = member.logic.first.ports.get(config.name)
        if found is None:
            continue
        for key, (register, value) in config.explicit.items():
            if found.registers.get(register, 0) != value:
                report.warn(
                    (*config.path, key),
                    f"the program of {member.name} sets {register} to {found.registers.get(register, 0)}: "
                    f"ports.{config.name}.{key}, which makes it {value}, is lost",
                )


def _check_rs2(member: Member, report: Report) -> None:
    """RS2 instructions that the text alone shows to be driven on one port at once."""
    program = member.logic.program
    if program is None or not program.uses_ports:
        return
    earlier: dict[int, list[tuple[Instruction, str]]] = {}
    for conditions, outputs in _conditioned(program):
        said = " and ".join(map(_said, conditions))
        for at in outputs:
            port = at.operands[-1].constant if at.spec.name == "RS2" else None
            if port is None:
                continue
            drives = earlier.setdefault(port, [])
            first = next((one for one, when in drives if said == when or _ALWAYS in (said, when)), None)
            if first is not None:
                message = (
                    f"RS2 drives COM{port} while RS2 at line {first.line} does: one at a time may, and the first "
                    "keeps the port (assumed)"
                )
                _warn_at(member, at, message, report, in_runs=False)  # a run counts it
            drives.append((at, said))


#: A condition that is always on, as _said writes it.
_ALWAYS = "on M8000"


def _said(condition: Condition) -> str:
    """A condition as a text; two of the same text are on together."""
    from bussim.plc.program.text.ladder import Both, Contact, Either, Not, Saved

    match condition:
        case Contact(at):
            return f"{at.spec.test} {' '.join(operand.text for operand in at.operands)}"
        case Saved(rung):
            return _said(rung.condition)
        case Not(part):
            return f"not ({_said(part)})"
        case Both(first, second):
            return f"({_said(first)}) and ({_said(second)})"
        case Either(first, second):
            return f"({_said(first)}) or ({_said(second)})"
        case _:
            assert_never(condition)


def _check_writes(member: Member, members: list[Member], report: Report) -> None:
    """What the program writes of other stations' shared blocks, line by line."""
    program = member.logic.program
    if program is None:
        return
    from bussim.plc.program.text.operand_checks import extents  # what only a scenario with programs pays

    blocks, turns = blocks_of(member, members), program.turns_bmov
    blocks.pop(member.station, None)
    found = [
        (at, shared, station)
        for at in program.instructions
        for extent in extents(at, backwards=turns)
        if extent.writes
        for station, block in blocks.items()
        if (shared := _shared(extent, block)) is not None
    ]
    link = link_of(member, members)
    for at, (letter, first, last), station in found[:MAX_FOREIGN]:
        who = _station(station, link)
        span = f"{Device(letter, first)}" + (f" to {Device(letter, last)}" if last > first else "")
        message = (
            f"{at.name} writes {span}, in the shared block of {who}: the link overwrites it with every "
            "frame from there, and no other station sees it"
        )
        _warn_at(member, at, message, report)
    if len(found) > MAX_FOREIGN:
        more = len(found) - MAX_FOREIGN
        text = f"{counted(more, 'more write')} into blocks of other stations"
        _warn_at(member, found[MAX_FOREIGN][0], text, report)


def _check_guards(member: Member, members: list[Member], report: Report) -> None:
    """Rungs that act on another station's shared bits without its error flag: only check says so."""
    program, blocks = member.logic.program, blocks_of(member, members)
    if program is None or not blocks:
        return
    from bussim.plc.program.text.operand_checks import extents
    from bussim.scenario.signals.network import contacts_of

    link, flags = link_of(member, members), member.profile.devices.first_flag
    found: dict[int, dict[Instruction, Device]] = {}
    for condition, outputs in _conditioned(program):
        contacts = contacts_of(*condition)
        guards = {at.operands[0].address - flags for at in contacts if at.operands[0].kind == "M"}
        for at in (*contacts, *outputs):
            reads = [extent for extent in extents(at) if not extent.writes and not extent.word]
            for station, block in blocks.items():
                taken = next((part for extent in reads if (part := _shared(extent, block))), None)
                if taken is not None and station not in (member.station, *guards):
                    found.setdefault(station, {}).setdefault(at, Device(*taken[:2]))
    for station, first_reads in found.items():
        (at, bit), *more = first_reads.items()
        lines = ", ".join(f"at line {each.line}" for each, _ in more[:4])
        message = (
            f"{at.name} takes {bit} of {_station(station, link)} without its error flag M{flags + station}: "
            f"while that station is away the bit stays what it was{'; also ' if lines else ''}{lines}"
        )
        _warn_at(member, at, message, report, in_runs=False)


def _station(number: int, link: Mapping[int, Member]) -> str:
    return f"station {number}" + (f" ({link[number].name})" if number in link else "")


def _conditioned(program: Program) -> Iterator[tuple[list[Condition], list[Instruction]]]:
    """Each rung's conditions, those of the MC around it included, with its outputs; so each jump."""
    from bussim.plc.program.text.ladder import Rung

    masters: dict[int, list[Condition]] = {}
    for block in program.blocks:
        for item in (*block.rungs, block.exit):
            if item is None or item.condition is None:
                continue
            around = masters.get(item.level, []) if item.level is not None else []
            outputs = item.outputs if isinstance(item, Rung) else [item.instruction]
            if outputs and outputs[0].name == "MC":
                masters[outputs[0].operands[0].address] = [item.condition, *around]
            yield [item.condition, *around], outputs


def _shared(extent: Extent, block: BlockRange) -> tuple[str, int, int] | None:
    """The part of an extent in a shared block: its letter, first and last address."""
    if extent.letter != ("D" if extent.word else "M"):
        return None
    begin, count = (block.word, block.words) if extent.word else (block.bit, block.bits)
    first, last = max(extent.first, begin), min(extent.last, begin + count - 1)
    return (extent.letter, first, last) if first <= last else None

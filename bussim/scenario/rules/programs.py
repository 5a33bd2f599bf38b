"""What is odd about programs beside the rest of a scenario."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from typing import TYPE_CHECKING

from bussim.errors import Problem
from bussim.plc.link_registers import D_MODE, TAKE_PART
from bussim.plc.memory import FIRST_SPECIAL, BlockRange, Device, parse_device
from bussim.plc.profiles import PROFILES
from bussim.scenario.resolve.members import KEYS_OF_DEVICES, Member
from bussim.scenario.resolve.scenario import Resolved
from bussim.scenario.rules.links import blocks_of, link_of
from bussim.scenario.yaml.source_map import Report
from bussim.words.language import say
from bussim.words.tables import changed

if TYPE_CHECKING:
    from bussim.plc.program.program import Program
    from bussim.plc.program.text.catalog import Instruction
    from bussim.plc.program.text.ladder import Condition
    from bussim.plc.program.text.operand_checks import Extent

#: What a program's texts together may have: a run's scenario.yaml holds them all, and must be read again.
MAX_PROGRAMS = 256 * 1024
_DEVICE = re.compile(r"(?<!\()\b[XYMSTCDR][0-9]+\b", re.ASCII)
#: Writes into other stations' blocks that are reported of one PLC.
MAX_FOREIGN = 20


def check_programs(resolved: Resolved, report: Report) -> None:
    """Check every program against registers, ports and the link."""
    members, total = resolved.members, 0
    beyond = {member.name: _words_beyond(member, members) for member in members}
    for member in members:
        program = member.logic.program
        _check_specials(member, report)
        if program is None:
            continue
        # A line costs its indentation as well.
        total += len(program.text.encode()) + 8 * program.text.count("\n")
        _check_settings(member, report)
        _check_ports(member, report)
        _check_writes(member, members, report)
        _check_rungs(program, member, members, report)
        _check_unshared(program, member, members, beyond, report)
    if total > MAX_PROGRAMS:
        report.mistake(("plcs",), say("rule_programs_total", total=total >> 10, most=MAX_PROGRAMS >> 10))


def _warn_at(member: Member, at: Instruction, message: str, report: Report, *, in_runs: bool = True) -> None:
    origin = member.logic.origin
    if origin is not None:
        named = changed(message, lambda text: _DEVICE.sub(lambda found: _named(found[0], member), text))
        problem = Problem("", at.line, at.column, say("rule_of_plc", member=member.name, what=named))
        placed = origin.problem(report, problem, warning=True)
        report.add(placed, fatal=False)
        if not in_runs:
            report.plain[placed] = ""


def _named(device: str, member: Member) -> str:
    """A device in a message, with its comment."""
    comment = member.logic.comments.get(device)
    return f"{device} ({comment})" if comment else device


def link_writes(program: Program) -> list[tuple[Instruction, str]]:
    """What a program writes of M8179 and D8176 to D8180, line by line."""
    from bussim.plc.program.text.operand_checks import extents  # what only a scenario with programs pays

    return [
        (at, device)
        for at in program.instructions
        for each in extents(at)
        for device in TAKE_PART
        if each.writes and each.holds(device[0], int(device[1:]), word=device[0] == "D")
    ]


def lost_settings(member: Member) -> list[tuple[Instruction, str]]:
    """What the program writes of them outside of the rung whose settings its family takes over."""
    program = member.logic.program
    if program is None or not member.profile.link_at_step_0:
        return []
    taken_over = len(program.link_settings.instructions)
    return [(at, device) for at, device in link_writes(program) if at.number >= taken_over]


def _check_settings(member: Member, report: Report) -> None:
    """What the scenario says of the link and the program says otherwise."""
    name, friendly, raw = member.name, member.friendly, member.raw
    late = lost_settings(member)
    for at, device in late[:1]:
        also = [say("rule_also", other=other, line=_line(each)) for each, other in late[1:]]
        left = "" if member.takes_part else say("rule_left_out", name=name)
        message = say(
            "rule_not_at_step_0", at=at.name, device=device, profile=member.profile.name, left=left, also=also
        )
        _warn_at(member, at, message, report)
    for device, value in member.logic.first.link.items():
        if device in friendly and friendly[device] != value:
            key, made = KEYS_OF_DEVICES[device], friendly[device]
            report.warn(
                (*member.path, "nn", key),
                say("rule_program_nn", name=name, device=device, value=value, setting=key, made=made),
            )
        elif device not in friendly and device in raw and raw[device] & 0xFFFF != value:
            report.warn(
                (*member.path, "registers"),
                say("rule_program_raw", name=name, device=device, value=value, given=raw[device]),
            )


def _check_specials(member: Member, report: Report) -> None:
    """Special devices that the scenario sets and that do nothing."""
    raw = {name: parse_device(name) for name in member.raw if name not in TAKE_PART}
    specials = {name: device for name, device in raw.items() if device.address >= FIRST_SPECIAL}
    if not specials:
        return
    from bussim.plc.program.text.operand_checks import Extent
    from bussim.plc.program.text.specials import not_simulated

    program = member.logic.program
    with_rs = program is not None and program.uses_rs
    for name, (letter, address) in specials.items():
        extent = Extent(letter, address, address, word=letter == "D", writes=True)
        found = not_simulated(extent, with_rs=with_rs, family=member.profile.family)
        for message in found if member.raw[name] else ():
            report.warn(
                (*member.path, "registers", name),
                say("rule_of_plc", member=member.name, what=message),
                key=True,
            )


def _port(at: Instruction, member: Member) -> str | None:
    """The port that RS, RS2 or CPAVL names; None where a register does, and of other instructions."""
    if at.name == "RS":
        return member.profile.rs_port
    number = at.operands[-1].constant if at.spec.group == "serial" else None
    return None if number is None else f"COM{number}"


def _check_ports(member: Member, report: Report) -> None:
    """Ports that a CPAVL sets up and the scenario does not connect; keys that it overrules."""
    program = member.logic.program
    if program is None:
        return
    reported: set[str] = set()
    first, (d8001, d8101) = PROFILES["pw10"].firmware, member.profile.firmware
    lacks = member.profile.name != "pw10" or d8001 < first[0] or d8101 < first[1]
    for at in program.instructions:
        port = _port(at, member)
        if lacks and at.name in ("RS2", "CPAVL") and at.name not in reported:
            reported.add(at.name)
            have = say("rule_firmware", at=at.name, first=first[0], second=first[1])
            lacking = say("rule_lacks", profile=member.profile.name, d8001=d8001, d8101=d8101)
            _warn_at(member, at, say("rule_as_if", have=have, lacking=lacking), report)
        does = "rule_sets_up" if at.spec.name == "CPAVL" else "rule_drives"
        if at.name == "RS" and member.takes_part and port == member.port and port not in reported:
            _warn_at(member, at, say("rule_rs_on_link", does=say(does, port=port)), report)
            reported.add(f"{port}")
        if port not in (None, *member.plc.ports, *reported):
            message = say("rule_port_unnamed", at=at.name, does=say(does, port=port), port=port)
            _warn_at(member, at, message, report)
            reported.add(f"{port}")
    for config in member.ports:
        found = member.logic.first.ports.get(config.name)
        if found is None:
            continue
        for key, (register, value) in config.explicit.items():
            if found.registers.get(register, 0) != value:
                sets = {"register": register, "found": found.registers.get(register, 0), "made": value}
                text = say("rule_program_port", member=member.name, port=config.name, setting=key, **sets)
                report.warn((*config.path, key), text)


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
        start, end = Device(letter, first), Device(letter, last)
        span = say("rule_to", first=start, until=end) if last > first else f"{start}"
        message = say("rule_foreign_block", at=at.name, span=span, who=who)
        _warn_at(member, at, message, report)
    if len(found) > MAX_FOREIGN:
        more = len(found) - MAX_FOREIGN
        text = say("rule_more_writes", more=more)
        _warn_at(member, found[MAX_FOREIGN][0], text, report)


def _check_rungs(program: Program, member: Member, members: list[Member], report: Report) -> None:
    """What only check says: what is taken of a station that is away, two RS2 on one port."""
    from bussim.plc.program.text.ladder import contacts_of
    from bussim.scenario.signals.network import rungs_of

    inverted = any(at.name == "INV" for at in program.instructions)
    drives: dict[object, Instruction] = {}
    rungs = list(rungs_of(program))
    for conditions, outputs in rungs if not inverted else ():
        # Without INV, rungs with the same contacts are on together.
        contacts = [at for condition in conditions for at in contacts_of(condition)]
        said = tuple((at.name, *(operand.text for operand in at.operands)) for at in contacts)
        for at in outputs:
            port = at.operands[-1].text if at.name == "RS2" else _port(at, member) if at.name == "RS" else ""
            if port and (first := drives.setdefault((port, said), at)) is not at:
                other = say("rule_at_line", first=first.name, line=_line(first))
                message = say("rule_port_driven", at=at.name, port=port, other=other)
                _warn_at(member, at, message, report, in_runs=False)
    link, relays = link_of(member, members), _relays(program, rungs)
    for station, block in blocks_of(member, members).items():
        flag = Device("M", member.profile.devices.first_flag + station)
        found = _taken_while_away(rungs, flag, block, relays) if station != member.station else []
        for at, device in found[:1]:
            also = [say("rule_also_line", line=_line(each)) for each, _ in found[1:5]]
            kept = say("word_word" if device.is_word else "word_bit")
            who = _station(station, link)
            taken = {"at": at.name, "device": device, "who": who, "flag": flag, "kept": kept}
            message = say("rule_taken_away", **taken, also=also)
            _warn_at(member, at, message, report, in_runs=False)


def _relays(program: Program, rungs: list[tuple[list[Condition], list[Instruction]]]) -> dict[int, Device]:
    """The M that one OUT alone writes, in every scan, by its number; none with CALL, STL or an index."""
    from bussim.plc.program.text.catalog import Flow
    from bussim.plc.program.text.operand_checks import extents

    for at in program.instructions:
        if at.spec.flow in (Flow.CALL, Flow.STL) or any(each.index for each in at.operands):
            return {}
    touched = (extent for _, outputs in rungs for at in outputs for extent in extents(at))
    bits = (each for each in touched if each.writes and each.letter == "M")
    writes = Counter(address for each in bits for address in range(each.first, each.last + 1))
    plain = (
        at for conditions, outputs in rungs if len(conditions) == 1 for at in outputs if at.name == "OUT"
    )
    coils = {at.number: at.operands[0].device for at in plain if at.operands[0].kind == "M"}
    return {number: device for number, device in coils.items() if writes[device.address] == 1}


def _taken_while_away(
    rungs: list[tuple[list[Condition], list[Instruction]]],
    flag: Device,
    block: BlockRange,
    relays: Mapping[int, Device],
) -> list[tuple[Instruction, Device]]:
    """What is read of a station's block by rungs that act while its error flag is on."""
    from bussim.plc.program.text.operand_checks import extents
    from bussim.scenario.signals.network import Remaining, remaining

    levels = {flag: True}

    def level(at: Instruction) -> bool | None:
        known = levels.get(at.operands[0].device) if at.spec.test in ("on", "off") else None
        return None if known is None else known is (at.spec.test == "on")

    taken: dict[Instruction, Device] = {}
    earlier: dict[int, Remaining] = {}
    for conditions, outputs in rungs:
        found = [remaining(condition, level, earlier) for condition in conditions]
        if isinstance(found[0], bool):
            levels.update((relays[at.number], found[0]) for at in outputs if at.number in relays)
        if any(each is False for each in found):
            continue
        readers = [at for each in found if isinstance(each, list) for at in each]
        for at in (*readers, *outputs):
            for extent in extents(at):
                part = None if extent.writes else _shared(extent, block)
                if part is not None:
                    taken.setdefault(at, Device(*part[:2]))
    return list(taken.items())


def _words_beyond(member: Member, members: list[Member]) -> dict[tuple[int, int], dict[bool, Instruction]]:
    """Words that only a larger refresh mode shares, by station and number: where each use is first."""
    program, shared = member.logic.program, blocks_of(member, members)
    found: dict[tuple[int, int], dict[bool, Instruction]] = {}
    if program is None or not shared or member.ports:
        return found
    from bussim.plc.program.text.operand_checks import extents

    largest = blocks_of(member, members, max(member.profile.modes))
    for at in program.instructions:
        for extent in extents(at):
            for station, block in largest.items():
                part = _shared(extent, block) if extent.word else None
                numbers = range(part[1] - block.word, part[2] - block.word + 1) if part else range(0)
                for number in numbers[max(0, shared[station].words - numbers.start) :]:
                    found.setdefault((station, number), {}).setdefault(extent.writes, at)
    return found


def _check_unshared(
    program: Program,
    member: Member,
    members: list[Member],
    beyond: Mapping[str, Mapping[tuple[int, int], Mapping[bool, Instruction]]],
    report: Report,
) -> None:
    """What only check says: bits and words that only a larger refresh mode of the family shares.

    What the program both writes and reads is its own; another port's may be what it does not. Words there
    are commonly its own: those are named that one station writes only and another takes only.
    """
    from bussim.plc.program.text.operand_checks import extents

    shared = {} if member.ports else blocks_of(member, members)
    larger = [blocks_of(member, members, mode) for mode in sorted(member.profile.modes)]
    touched = (
        [(at, each) for at in program.instructions for each in extents(at) if not each.word] if shared else []
    )
    found: dict[Instruction, tuple[bool, Device]] = {}
    for at, extent in touched:
        parts = [part for blocks in larger for each in blocks.values() if (part := _shared(extent, each))]
        if not parts or any(_shared(extent, block) for block in shared.values()):
            continue
        device = Device(*parts[0][:2])
        if not any(
            other.writes is not extent.writes and other.holds(*parts[0][:2], word=extent.word)
            for _, other in touched
        ):
            found.setdefault(at, (extent.writes, device))
    link = link_of(member, members)
    for (station, number), uses in beyond[member.name].items():
        for other in link.values():
            theirs = beyond[other.name].get((station, number), {})
            sender = member if True in uses else other
            if len(uses) == len(theirs) == 1 and uses.keys() != theirs.keys() and sender.station == station:
                word = Device("D", member.profile.word_spacing * station + number)
                found.setdefault(next(iter(uses.values())), (True in uses, word))
    for at, (writes, device) in [*found.items()][:1]:
        also = [say("rule_also", other=other, line=_line(each)) for each, (_, other) in [*found.items()][1:5]]
        mode = link[0].settings[D_MODE]
        does = say("rule_does_write" if writes else "rule_does_take")
        text = say("rule_unshared", at=at.name, does=does, device=device, mode=mode, also=also)
        _warn_at(member, at, text, report, in_runs=False)


def _station(number: int, link: Mapping[int, Member]) -> str:
    return f"station {number}" + (f" ({link[number].name})" if number in link else "")


def _line(at: Instruction) -> str:
    """Where an instruction stands, as :meth:`~bussim.scenario.resolve.plc_logic.Origin.problem` reads it."""
    return f"at line {at.line}"


def _shared(extent: Extent, block: BlockRange) -> tuple[str, int, int] | None:
    """The part of an extent in a shared block: its letter, first and last address."""
    if extent.letter != ("D" if extent.word else "M"):
        return None
    begin, count = (block.word, block.words) if extent.word else (block.bit, block.bits)
    first, last = max(extent.first, begin), min(extent.last, begin + count - 1)
    return (extent.letter, first, last) if first <= last else None

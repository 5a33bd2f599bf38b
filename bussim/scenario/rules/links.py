"""What is wrong or odd about an N:N link as a whole. An odd link is simulated, with a warning."""

from collections.abc import Sequence

from bussim.engines.nn.frames import MODES, data_chars
from bussim.line.characters import NN_LINE
from bussim.plc.link_registers import (
    D_MODE,
    D_SLAVES,
    D_STATION,
    D_TIMEOUT,
    TIMEOUT_UNIT,
    mode_refusal,
    refusal,
    worst_turnaround,
)
from bussim.plc.memory import BlockRange, block_range, parse_device
from bussim.plc.profiles import MAX_SLAVES
from bussim.scenario.resolve.members import NN_KEYS, Member
from bussim.scenario.resolve.scenario import Resolved
from bussim.scenario.yaml.source_map import Report
from bussim.units import format_time
from bussim.words.language import say

MAX_STATIONS = MAX_SLAVES + 1


def check_links(resolved: Resolved, report: Report) -> None:
    """Check every N:N link of a scenario."""
    members, plcs = resolved.members, resolved.draft.plcs
    whole = len(members) == len(plcs) and not any(
        plc.lost("nn", "registers", "ports", "profile") for plc in plcs
    )
    for line in resolved.lines.values():
        if line.entry.lost("nn") or not line.is_link:
            continue
        on_link = [member for member in members if member.takes_part and member.bus == line.name]
        for member in on_link[MAX_STATIONS:]:
            report.mistake(
                member.path,
                say("rule_one_too_many", member=member.name, line=line.name, max_stations=MAX_STATIONS),
            )
        if not on_link and whole:
            alone = any(member.plc.program is not None or member.plc.inputs for member in members)
            besides = say("rule_programs_run") if alone else ""
            report.warn(line.entry.path, say("rule_link_empty", line=line.name, besides=besides))
        elif len(on_link) <= MAX_STATIONS and whole:
            _check_link(line.name, on_link, report)
            _check_sources(on_link, report)
    for member in members:
        if not member.takes_part and not member.ports and member.plc.sources:
            report.warn((*member.path, "sources"), say("rule_sources_unsent", member=member.name))


def _check_link(bus: str, members: list[Member], report: Report) -> None:
    numbers: dict[int, Member] = {}
    for member in members:
        _check_settings(member, report)
        first = numbers.setdefault(member.station, member)
        if first is not member:
            path = member.setting_path(D_STATION)
            if member.station == 0:
                report.warn(path, say("rule_two_masters", bus=bus, first=first.name, member=member.name))
            else:
                report.warn(
                    path,
                    say(
                        "rule_both_stations", plcs=[first.name, member.name], bus=bus, station=member.station
                    ),
                )
    master = numbers.get(0)
    if master is None:
        report.warn(members[0].path, say("rule_no_master", bus=bus))
    elif not master.refused:
        _check_polling(bus, master, members, report)
        for member in members:
            if member.station and not member.refused:
                _check_slave(master, member, report)


def _check_settings(member: Member, report: Report) -> None:
    settings, name = member.settings, member.name
    if member.refused:
        first = next(address for address in NN_KEYS.values() if member.refused[0].startswith(f"D{address} "))
        report.warn(member.setting_path(first), refusal(member.profile, name, member.refused, member.port))
        return
    if member.station:
        ignored = [
            f"nn.{key}"
            if member.plc.nn is not None and getattr(member.plc.nn, key) is not None
            else f"D{address}"
            for key, address in NN_KEYS.items()
            if key != "station" and f"D{address}" in member.registers
        ]
        if ignored:
            report.warn(member.path, say("rule_slave_ignores", name=name, ignored=", ".join(ignored)))
        return
    mode, documented = settings[D_MODE], member.profile.documented_modes
    if mode not in documented:
        report.warn(
            member.setting_path(D_MODE),
            say("rule_undocumented", name=name, mode=mode, documented=", ".join(map(str, documented))),
        )


def _check_polling(bus: str, master: Member, members: list[Member], report: Report) -> None:
    slaves = master.settings[D_SLAVES]
    present = {member.station for member in members}
    for member in members:
        if member.station > slaves and not member.refused:
            report.warn(
                member.setting_path(D_STATION),
                say(
                    "rule_never_polled",
                    member=member.name,
                    station=member.station,
                    master=master.name,
                    slaves=slaves,
                    bus=bus,
                ),
            )
    absent = [number for number in range(1, slaves + 1) if number not in present]
    if absent:
        report.warn(
            master.setting_path(D_SLAVES),
            say(
                "rule_absent", master=master.name, slaves=slaves, bus=bus, absent=", ".join(map(str, absent))
            ),
        )


def _check_slave(master: Member, slave: Member, report: Report) -> None:
    mode, limit = master.settings[D_MODE], master.settings[D_TIMEOUT] * TIMEOUT_UNIT
    if mode not in slave.profile.modes:
        report.warn(slave.path, mode_refusal(slave.name, slave.profile, mode))
        return
    apart = slave.profile.word_spacing, master.profile.word_spacing
    if apart[0] != apart[1]:
        report.warn(
            slave.path,
            say("rule_spacing", slave=slave.name, apart=apart[0], master=master.name, other=apart[1]),
        )
    longest = worst_turnaround(slave.profile, slave.longest_scan) + NN_LINE.characters(data_chars(mode))
    if slave.station <= master.settings[D_SLAVES] and longest > limit:
        report.warn(
            master.setting_path(D_TIMEOUT),
            say(
                "rule_timeout_late",
                master=master.name,
                limit=format_time(limit),
                slave=slave.name,
                longest=longest / 72000,
            ),
        )


def link_of(member: Member, members: Sequence[Member]) -> dict[int, Member]:
    """The PLCs on the N:N link of one of them, by station; none for a PLC that is on no link."""
    on_link = [other for other in members if other.takes_part and other.bus == member.bus is not None]
    return {other.station: other for other in reversed(on_link)} if member.takes_part else {}


def blocks_of(member: Member, members: Sequence[Member], mode: int | None = None) -> dict[int, BlockRange]:
    """Where a PLC keeps the blocks of its link's stations, by station; none without a working master.

    In the master's refresh mode, or in ``mode``.
    """
    master = link_of(member, members).get(0)
    if master is None or master.refused or member.refused:
        return {}
    block = MODES[master.settings[D_MODE] if mode is None else mode]
    spacing = member.profile.word_spacing
    stations = sorted({*range(master.settings[D_SLAVES] + 1), member.station})
    return {station: block_range(station, block.bits, block.words, spacing) for station in stations}


def _check_sources(members: list[Member], report: Report) -> None:
    for member in members:
        blocks = blocks_of(member, members)
        block = blocks.pop(member.station, None)
        if block is None:
            continue
        for name in member.plc.sources:
            try:
                device = parse_device(name)
            except ValueError:
                continue
            if member.ports and not any(other.holds(device) for other in blocks.values()):
                continue  # another port may send it
            if not block.holds(device):
                text = say("rule_not_own_block", member=member.name, name=name, own=_extent(block))
                report.warn((*member.path, "sources", name), text, key=True)


def _extent(block: BlockRange) -> str:
    bits = say("rule_block_bits", first=block.bit, last=block.bit + block.bits - 1) if block.bits else ""
    return say("rule_block_words", bits=bits, first=block.word, last=block.word + block.words - 1)

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
from bussim.wording import counted

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
                f"{member.name} is one too many: {line.name}, an N:N link, takes {MAX_STATIONS} stations",
            )
        if not on_link and whole:
            alone = any(member.plc.program is not None or member.plc.inputs for member in members)
            besides = "; programs run all the same" if alone else ""
            report.warn(line.entry.path, f"no PLC is on {line.name}: nothing is sent there{besides}")
        elif len(on_link) <= MAX_STATIONS and whole:
            _check_link(line.name, on_link, report)
            _check_sources(on_link, report)
    for member in members:
        if not member.takes_part and not member.ports and member.plc.sources:
            report.warn(
                (*member.path, "sources"),
                f"{member.name} takes no part in N:N: what its sources drive is sent to no station",
            )


def _check_link(bus: str, members: list[Member], report: Report) -> None:
    numbers: dict[int, Member] = {}
    for member in members:
        _check_settings(member, report)
        first = numbers.setdefault(member.station, member)
        if first is not member:
            path = member.setting_path(D_STATION)
            if member.station == 0:
                report.warn(path, f"{bus} has two masters, {first.name} and {member.name} (station 0)")
            else:
                report.warn(
                    path, f"{first.name} and {member.name} on {bus} are both station {member.station}"
                )
    master = numbers.get(0)
    if master is None:
        report.warn(
            members[0].path, f"{bus} has no master (station 0): no station is polled, nothing is sent"
        )
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
            report.warn(
                member.path, f"{name} is a slave: it ignores {', '.join(ignored)} and learns the master's"
            )
        return
    mode, documented = settings[D_MODE], member.profile.documented_modes
    if mode not in documented:
        report.warn(
            member.setting_path(D_MODE),
            f"{name} uses refresh mode {mode}, which the manual describes but its table of settings "
            f"(D8178: {', '.join(map(str, documented))}) leaves out",
        )


def _check_polling(bus: str, master: Member, members: list[Member], report: Report) -> None:
    slaves = master.settings[D_SLAVES]
    present = {member.station for member in members}
    for member in members:
        if member.station > slaves and not member.refused:
            report.warn(
                member.setting_path(D_STATION),
                f"{member.name} is station {member.station}, but {master.name} polls only {slaves} on {bus} "
                "(D8177): it is never polled",
            )
    absent = [number for number in range(1, slaves + 1) if number not in present]
    if absent:
        report.warn(
            master.setting_path(D_SLAVES),
            f"{master.name} polls {counted(slaves, 'slave')} (D8177), but {bus} has no station "
            f"{', '.join(map(str, absent))}: every link scan waits for what is not there",
        )


def _check_slave(master: Member, slave: Member, report: Report) -> None:
    mode, limit = master.settings[D_MODE], master.settings[D_TIMEOUT] * TIMEOUT_UNIT
    if mode not in slave.profile.modes:
        report.warn(slave.path, mode_refusal(slave.name, slave.profile, mode))
        return
    if slave.profile.word_spacing != master.profile.word_spacing:
        report.warn(
            slave.path,
            f"{slave.name} keeps the stations' words {slave.profile.word_spacing} apart, {master.name} "
            f"{master.profile.word_spacing}: the same data have other addresses there",
        )
    longest = worst_turnaround(slave.profile, slave.longest_scan) + NN_LINE.characters(data_chars(mode))
    if slave.station <= master.settings[D_SLAVES] and longest > limit:
        report.warn(
            master.setting_path(D_TIMEOUT),
            f"the timeout of {master.name} is {format_time(limit)}, but a reply of {slave.name} may take "
            f"{longest / 72_000:.1f} ms: it can come too late",
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
        bits = f"M{block.bit} to M{block.bit + block.bits - 1} and " if block.bits else ""
        own = f"{bits}D{block.word} to D{block.word + block.words - 1}"
        for name in member.plc.sources:
            try:
                device = parse_device(name)
            except ValueError:
                continue
            if member.ports and not any(other.holds(device) for other in blocks.values()):
                continue  # another port may send it
            if not block.holds(device):
                report.warn(
                    (*member.path, "sources", name),
                    f"{member.name} drives {name}, which is not in its own block ({own}): it is not sent, "
                    "and in another station's block it is overwritten",
                    key=True,
                )

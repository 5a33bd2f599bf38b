"""Entries of ``latency`` whose devices nothing connects, or whose age nothing tells: warnings."""

from __future__ import annotations

from collections.abc import Sequence

from bussim.plc.link_registers import D_MODE, D_SLAVES
from bussim.scenario.resolve.members import Member
from bussim.scenario.schema.programs import LatencyIn
from bussim.scenario.signals.data_age import age_reasons
from bussim.scenario.signals.program_signals import Key
from bussim.scenario.signals.reachability import Lead, Net, Question, Station
from bussim.scenario.yaml.source_map import Path, Report


def check_way(
    path: Path, given: LatencyIn, source: Member, target: Member, members: Sequence[Member], report: Report
) -> None:
    """A device that nothing drives; two that nothing connects; a word whose age nothing tells."""
    start, end = given.from_, given.to
    if start.device.letter == "X" and str(start.device) not in source.logic.inputs:
        report.warn(
            (*path, "from"), f"nothing drives {start}: it has no entry in the inputs of the PLC {source.name}"
        )
    if any(member.unread for member in members):
        return  # its program may be what connects them
    net = _net(members, source.bus if source.takes_part else None)
    source_map = [net.named(member.name) for member in (source, target)]
    question = Question(net, source_map[0], Key.of(start.device), source_map[1], Key.of(end.device))
    finding = question.answer()
    if finding.lead is Lead.NONE:
        hint = f"; {finding.meant}" if finding.meant else ""
        if finding.end:  # else the link's own warnings tell
            report.warn((*path, finding.end), f"nothing leads from {start} to {end}: {finding.why}{hint}")
    elif start.device.is_word:
        for reason in age_reasons(question, finding):
            report.warn((*path, "to"), f"no age is measured of {start} in {end}: {reason}")


def _net(members: Sequence[Member], bus: str | None) -> Net:
    stations = tuple(_station(member, bus) for member in members)
    masters = [
        member
        for member in members
        if member.takes_part and member.bus == bus and not member.station and not member.refused
    ]
    if bus is None or not masters:
        return Net(stations, bus or "")
    settings = masters[0].settings
    return Net(stations, bus, settings[D_MODE], settings[D_SLAVES])


def _station(member: Member, bus: str | None) -> Station:
    buses = {config.bus for config in member.ports}
    on_link = member.takes_part and member.bus == bus and bus is not None
    if member.takes_part and member.bus is not None and not on_link:
        buses.add(member.bus)
    return Station(
        member.name,
        member.station if on_link and not member.refused else None,
        member.profile.word_spacing,
        member.profile.modes,
        member.logic.program,
        frozenset(buses),
    )

"""The way that each entry of ``latency`` takes: over which link, between which seats, with what frames."""

from __future__ import annotations

from dataclasses import dataclass

from bussim.engines.nn.frames import data_chars
from bussim.line.characters import NN_LINE
from bussim.plc.link_registers import D_MODE, D_SLAVES, D_STATION, bad_parameters, setting_values
from bussim.plc.memory import parse_device
from bussim.scenario.model import Latency, Plc, Scenario
from bussim.scenario.signals.data_age import age_reasons
from bussim.scenario.signals.program_signals import Key
from bussim.scenario.signals.reachability import Finding, Lead, Net, Question, Station


@dataclass(frozen=True, slots=True)
class Way:
    """Of one entry. ``bus`` is None where source and target are of one PLC.

    ``seats`` are the positions of source and target among the PLCs on the link, ``frame`` the ticks of
    a data frame (0 without a working master). ``direct``: nothing but the link comes between the block
    that is sent and the target. ``finding`` tells how the one leads to the other, and ``unmeasured`` why
    the age of a word cannot be told.
    """

    entry: Latency
    source: Plc
    target: Plc
    bus: str | None
    seats: tuple[int, int]
    frame: int
    direct: bool
    finding: Finding
    unmeasured: tuple[str, ...] = ()

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why nothing leads from the source to the target, or no age can be told of a word."""
        if self.word or self.finding.lead is not Lead.NONE:
            return self.unmeasured
        source, target = f"{self.source.name}.{self.entry.source}", f"{self.target.name}.{self.entry.target}"
        return (f"nothing leads from {source} to {target}: {self.finding.why}",)

    @property
    def word(self) -> bool:
        """Whether the age of a word is measured."""
        return parse_device(self.entry.source, observed=True).is_word


def ways(scenario: Scenario) -> tuple[Way, ...]:
    """The ways of all entries, in their order."""
    return tuple(_way(scenario, entry) for entry in scenario.latency)


def working_master(scenario: Scenario, bus: str) -> Plc | None:
    """The PLC whose parameters hold on a link: the first one along the cable that is a master."""
    for plc in scenario.plcs:
        if plc.link is not None and plc.link.bus == bus:
            values = setting_values(plc.profile, plc.registers)
            if values[D_STATION] == 0 and not bad_parameters(plc.profile, values):
                return plc
    return None


def net_of(scenario: Scenario, bus: str | None) -> Net:
    """All PLCs as the programs' texts are asked about them, with one of the links."""
    master = None if bus is None else working_master(scenario, bus)
    stations = tuple(_station(plc, bus) for plc in scenario.plcs)
    if bus is None or master is None:
        return Net(stations, bus or "")
    values = setting_values(master.profile, master.registers)
    return Net(stations, bus, values[D_MODE], values[D_SLAVES])


def _station(plc: Plc, bus: str | None) -> Station:
    values = setting_values(plc.profile, plc.registers)
    buses = {port.bus for port in plc.ports}
    number = None
    if plc.link is not None and plc.link.bus == bus:
        number = None if bad_parameters(plc.profile, values) else values[D_STATION]
    elif plc.link is not None:
        buses.add(plc.link.bus)
    profile = plc.profile
    return Station(plc.name, number, profile.word_spacing, profile.modes, plc.program, frozenset(buses))


def _way(scenario: Scenario, entry: Latency) -> Way:
    plcs = {plc.name: plc for plc in scenario.plcs}
    source, target = plcs[entry.source_plc], plcs[entry.target_plc]
    bus = None if source.link is None else source.link.bus
    net = net_of(scenario, bus)
    start, end = (parse_device(name, observed=True) for name in (entry.source, entry.target))
    question = Question(net, net.named(source.name), Key.of(start), net.named(target.name), Key.of(end))
    finding = question.answer()
    if source is target or bus is None:
        return Way(entry, source, target, None, (0, 0), 0, direct=True, finding=finding)
    names = [plc.name for plc in scenario.plcs if plc.link is not None and plc.link.bus == bus]
    seats = (names.index(source.name), names.index(target.name))
    place = net.block(question.source, question.target)
    return Way(
        entry,
        source,
        target,
        bus,
        seats,
        0 if net.mode is None else NN_LINE.characters(data_chars(net.mode)),
        direct=place is not None and place.holds(end),
        finding=finding,
        unmeasured=age_reasons(question, finding) if start.is_word else (),
    )

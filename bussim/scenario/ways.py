"""The way that each entry of ``latency`` takes: over which link, between which seats, with what frames."""

from __future__ import annotations

from dataclasses import dataclass

from bussim.engines.nn.frames import MODES, data_chars
from bussim.line.characters import NN_LINE
from bussim.plc.board import D_MODE, D_STATION, bad_parameters, setting_values
from bussim.plc.memory import block_place, parse_device
from bussim.scenario.model import Latency, Plc, Scenario


@dataclass(frozen=True, slots=True)
class Way:
    """Of one entry. ``bus`` is None where source and target are of one PLC.

    ``seats`` are the positions of source and target among the PLCs on the link, ``frame`` the ticks of
    a data frame (0 without a working master). ``direct``: nothing but the link comes between the block
    that is sent and the target.
    """

    entry: Latency
    source: Plc
    target: Plc
    bus: str | None
    seats: tuple[int, int]
    frame: int
    direct: bool

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
        if plc.seat is not None and plc.seat.bus == bus:
            values = setting_values(plc.profile, plc.registers)
            if values[D_STATION] == 0 and not bad_parameters(plc.profile, values):
                return plc
    return None


def _way(scenario: Scenario, entry: Latency) -> Way:
    plcs = {plc.name: plc for plc in scenario.plcs}
    source, target = plcs[entry.source_plc], plcs[entry.target_plc]
    if source is target or source.seat is None:
        return Way(entry, source, target, None, (0, 0), 0, direct=True)
    bus = source.seat.bus
    names = [plc.name for plc in scenario.plcs if plc.seat is not None and plc.seat.bus == bus]
    seats = (names.index(source.name), names.index(target.name))
    master = working_master(scenario, bus)
    if master is None:
        return Way(entry, source, target, bus, seats, 0, direct=False)
    mode = setting_values(master.profile, master.registers)[D_MODE]
    station = setting_values(source.profile, source.registers)[D_STATION]
    block = MODES[mode]
    place = block_place(station, block.bits, block.words, target.profile.word_spacing)
    frame = NN_LINE.characters(data_chars(mode))
    return Way(
        entry,
        source,
        target,
        bus,
        seats,
        frame,
        direct=place.holds(parse_device(entry.target, observed=True)),
    )

"""What is wrong or odd about noise and faults: whom they name, and when."""

from __future__ import annotations

from collections.abc import Sequence

from bussim.line.characters import NN_LINE
from bussim.scenario.disturbances import CableCutIn, FaultIn, NoiseIn, StationIn
from bussim.scenario.link_rules import check_bus_name
from bussim.scenario.places import Path, Report
from bussim.scenario.seats import Member
from bussim.scenario.validate import Draft, Entry
from bussim.scenario.wording import show, suggest
from bussim.units import format_time

#: Faults that a PLC has without a link.
_OF_THE_PLC = frozenset({"power_off", "stop"})
#: Faults of a slave's reply.
_OF_REPLIES = frozenset({"drop_reply", "slow"})


class _Names:
    """Who is who, as far as the rest of the scenario could be read."""

    def __init__(self, draft: Draft, members: Sequence[Member], report: Report) -> None:
        self._draft = draft
        self._members = {member.name: member for member in members}
        self._report = report
        self.known = [entry.name for entry in draft.plcs if entry.name is not None]

    def plc(self, path: Path, name: str) -> Member | None:
        """The PLC of that name; an unknown name is reported."""
        if name not in self.known and self.known:
            self._report.error(path, f"is {show(name)}, which is no PLC; {suggest(name, self.known)}")
        return self._members.get(name)

    def certain(self, name: str) -> bool:
        """Whether a PLC's seat could be read, so that something may be said against it."""
        return not any(
            entry.lost("nn", "registers", "ports") for entry in self._draft.plcs if entry.name == name
        )

    def seated(self, path: Path, name: str, what: str) -> Member | None:
        """A PLC that must take part in N:N for ``what`` to act on it."""
        member = self.plc(path, name)
        if member is None or member.takes_part:
            return member
        if self.certain(name):
            self._report.error(
                path, f"is {name}, which takes no part in N:N: there is nothing for {what} to act on"
            )
        return None

    def on_bus(self, path: Path, name: str, bus: str) -> Member | None:
        """A PLC that must be on a bus."""
        member = self.plc(path, name)
        if member is None or (member.takes_part and member.bus == bus):
            return member
        if self.certain(name):
            there = [m.name for m in self._members.values() if m.takes_part and m.bus == bus]
            self._report.error(path, f"is {name}, which is not on {bus}; {suggest(name, there)}")
        return None

    def last_on(self, bus: str) -> str | None:
        there = [m.name for m in self._members.values() if m.takes_part and m.bus == bus]
        return there[-1] if there else None


def check_noise(draft: Draft, members: Sequence[Member], duration: int | None, report: Report) -> None:
    """Judge every entry of ``noise``."""
    names = _Names(draft, members, report)
    for entry in draft.noise:
        noise = entry.value
        if noise is None:
            continue
        _check_start(entry, noise.at, duration, report)
        bus = check_bus_name((*entry.path, "bus"), noise.bus, draft.buses, report)
        if noise.station is None or bus is None:
            continue
        member = names.on_bus((*entry.path, "station"), noise.station, noise.bus)
        if noise.reply_loss is not None and member is not None and member.station == 0:
            report.warn(
                (*entry.path, "station"), f"{member.name} is a master: it sends no replies that could be lost"
            )


def _check_start(
    entry: Entry[NoiseIn] | Entry[FaultIn], at: int, duration: int | None, report: Report
) -> None:
    if duration is not None and at >= duration:
        name = report.places.full_name(entry.path)
        report.warn(
            (*entry.path, "at"),
            f"{name} begins at {format_time(at)}, after the end of the run ({format_time(duration)})",
        )


def check_faults(draft: Draft, members: Sequence[Member], duration: int | None, report: Report) -> None:
    """Judge every entry of ``faults``."""
    names = _Names(draft, members, report)
    switched_on: dict[str, Path] = {}
    for entry in draft.faults:
        fault = entry.value
        if fault is None:
            continue
        kind = fault.kind
        if kind == "power_on":
            _check_power_on(entry, fault, names, switched_on, duration, report)
            continue
        _check_start(entry, fault.at or 0, duration, report)
        path = (*entry.path, kind)
        if not kind:
            continue
        if fault.cable_cut is not None:
            _check_cut(path, fault.cable_cut, draft, names, report)
        elif fault.board_error is not None:
            names.plc((*path, "plc"), fault.board_error.plc)
        else:
            _check_station(entry, kind, fault, names, report)


def _check_power_on(
    entry: Entry[FaultIn],
    fault: FaultIn,
    names: _Names,
    switched_on: dict[str, Path],
    duration: int | None,
    report: Report,
) -> None:
    for name, tick in (fault.power_on or {}).items():
        path = (*entry.path, "power_on", name)
        if name not in names.known and names.known:
            report.error(path, f"is no PLC; {suggest(name, names.known)}", key=True)
        elif name in switched_on:
            where = report.places.where(switched_on[name])
            report.error(path, f"is given twice, first {where}", key=True)
        else:
            switched_on[name] = path
        if duration is not None and tick >= duration:
            report.warn(path, f"{name} is switched on at {format_time(tick)}, after the end of the run")


def _check_cut(path: Path, cut: CableCutIn, draft: Draft, names: _Names, report: Report) -> None:
    if check_bus_name((*path, "bus"), cut.bus, draft.buses, report) is None:
        return
    member = names.on_bus((*path, "after"), cut.after, cut.bus)
    if member is not None and names.last_on(cut.bus) == member.name:
        report.warn(
            (*path, "after"),
            f"{member.name} is the last station on {cut.bus}: a cut behind it changes nothing",
        )


def _check_station(entry: Entry[FaultIn], kind: str, fault: FaultIn, names: _Names, report: Report) -> None:
    given: StationIn = getattr(fault, kind)
    path = (*entry.path, kind)
    in_full = isinstance(entry.raw, dict) and isinstance(entry.raw.get(kind), dict)
    place = (*path, "station") if in_full else path
    if kind in _OF_THE_PLC:
        names.plc(place, given.station)
        return
    member = names.seated(place, given.station, kind)
    if member is None:
        return
    if kind in _OF_REPLIES and member.station == 0:
        report.warn(place, f"{member.name} is a master: it sends no replies, and {kind} does nothing")
    wrong = fault.wrong_format
    if wrong is not None and wrong.format in (None, NN_LINE.format) and wrong.baud in (None, NN_LINE.baud):
        report.warn(path, f"wrong_format of {member.name} is 38400 7E1, which is right: it does nothing")

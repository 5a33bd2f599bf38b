"""A readout of a simulated run, as a technician could have noted it."""

from collections.abc import Mapping
from typing import Any

from bussim.engines.nn.codes import MEANINGS
from bussim.errors import UsageError
from bussim.plc.link_registers import D_MIRROR_MODE, D_MIRROR_STATION
from bussim.scenario.fault_kinds import CableCut, PowerOff, Stop
from bussim.scenario.model import Scenario
from bussim.site.readout import CODE, COUNT, FLAG
from bussim.trace.records import LinkTotals, PlcTotals, RunTotals
from bussim.units import TICKS_PER_MS, format_time


def readout_data(scenario: Scenario, totals: RunTotals, *, as_seen: bool = False) -> dict[str, Any]:
    """The readout at the end of a run as plain data.

    ``as_seen`` leaves out what a technician rarely notes: station numbers and PLC scans. What is
    off cannot be read. Raises UsageError unless it has one link with a master.
    """
    links = [link for link in totals.links if link.master is not None]
    if len(links) != 1:
        raise UsageError(f"a readout is of one link; {scenario.name} has {len(links)} with a master")
    link = links[0]
    plcs = {plc.name: plc for plc in totals.plcs}
    master = next(plc for plc in scenario.source["plcs"] if plc["name"] == link.master)  # type: ignore[attr-defined] # plain data
    return {
        "schema": 1,
        "kind": "readout",
        "profile": master["profile"],
        "settings": {
            "slaves": link.slaves,
            "mode": link.mode,
            "retries": link.retries,
            "timeout": format_time(link.timeout or 0),
        },
        "order": list(link.plc_names),
        "watched": format_time(totals.duration - _since(scenario, link, totals.duration)),
        "stations": [
            _station(plcs[name], link.slaves or 0, lamps, as_seen=as_seen)
            for name, lamps in _lamps(scenario, link, plcs, totals.duration).items()
        ],
    }


def _lamps(
    scenario: Scenario, link: LinkTotals, plcs: Mapping[str, PlcTotals], end: int
) -> dict[str, dict[str, str]]:
    """The lamps of each board at the end: SD of who takes part, RD where such a signal arrives."""
    names = link.plc_names
    broken = {
        names.index(fault.kind.after)
        for fault in scenario.faults
        if isinstance(fault.kind, CableCut)
        and fault.kind.bus == link.bus
        and fault.window.at < end
        and (fault.window.until is None or fault.window.until >= end)
    }
    sends = [plcs[name].state == "run" and plcs[name].registers["M8191"] for name in names]
    parts = [sum(at < index for at in broken) for index in range(len(names))]
    found = {}
    for index, name in enumerate(names):
        others = (other for other in range(len(names)) if other != index and parts[other] == parts[index])
        lit = {"SD": sends[index], "RD": plcs[name].state != "off" and any(sends[other] for other in others)}
        found[name] = {lamp: "flickers" if on else "dark" for lamp, on in lit.items()}
    return found


def _since(scenario: Scenario, link: LinkTotals, end: int) -> int:
    """When the master was last switched on or put into RUN."""
    plc = next(plc for plc in scenario.plcs if plc.name == link.master)
    times = [plc.power_on]
    times += [
        fault.window.until or 0
        for fault in scenario.faults
        if isinstance(fault.kind, PowerOff | Stop) and fault.kind.node == link.master
    ]
    return max(time for time in times if time < end)


def _station(plc: PlcTotals, slaves: int, lamps: dict[str, str], *, as_seen: bool) -> dict[str, Any]:
    noted: dict[str, Any] = {"place": plc.name, "state": plc.state, "lamps": lamps}
    if plc.state == "off":
        return noted
    if not as_seen:
        noted["number"] = plc.registers[f"D{D_MIRROR_STATION}"]
        if plc.scan_max is not None:
            noted["plc_scan"] = format_time(round(plc.scan_max / TICKS_PER_MS * 10) * TICKS_PER_MS // 10)
    names = [f"D{at}" for at in range(D_MIRROR_STATION + as_seen, D_MIRROR_MODE + 1)] + ["D8201", "D8202"]
    names += [
        f"{letter}{first + at}"
        for letter, first in (("D", COUNT), ("D", CODE), ("M", FLAG))
        for at in range(slaves + 1)
    ]
    noted["after"] = {
        plc.own_names.get(name, name): _shown(name, plc.registers[name]) for name in (*names, "M8191")
    }
    return noted


def _shown(name: str, value: int) -> int | str:
    """A flag as on or off; a code as the digits that the manuals have for it."""
    if name[0] == "M":
        return "on" if value else "off"
    return int(f"{value:X}") if CODE <= int(name[1:]) <= CODE + 7 and value in MEANINGS else value

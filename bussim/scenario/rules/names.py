"""Names: those of entries differ, and those of buses and PLCs exist."""

from collections.abc import Iterable, Iterator
from typing import Any

from bussim.forms.fields import PlcPoint
from bussim.scenario.resolve.port_configuration import CPAVL_PORTS
from bussim.scenario.resolve.scenario import Resolved
from bussim.scenario.schema.draft import Draft, Entry, readable
from bussim.scenario.yaml.source_map import Path, Report
from bussim.words.language import say
from bussim.words.values import show, suggest


def check_names(resolved: Resolved, report: Report) -> None:
    """Check the names of entries, and every mention of a bus or of a PLC's device."""
    draft = resolved.draft
    owners: list[Entry[Any]] = [*draft.plcs, *draft.devices]  # both name nodes of buses
    sections: list[Iterable[Entry[Any]]] = [draft.buses, owners, draft.noise, draft.faults, draft.latency]
    for section in (*sections, *draft.polls.values()):
        _check_different(section, report)
    buses = [entry.name for entry in draft.buses if entry.name is not None]
    for entry in owners:
        if entry.name is not None and entry.name in buses:
            report.warn((*entry.path, "name"), say("rule_name_of_bus", entry=entry.name))
    for path, name in _buses_named(draft) if buses else ():  # else that is the mistake, reported already
        if name not in buses:
            report.error(path, say("rule_no_bus", name=show(name), hint=suggest(name, buses)))
    plcs = [entry.name for entry in draft.plcs if entry.name is not None]
    for path, point in _points_named(draft) if plcs else ():
        if point.plc not in plcs:
            unknown = say("rule_no_such_plc", plc=point.plc, hint=suggest(point.plc, plcs))
            report.error(path, say("rule_is_but", point=show(str(point)), why=unknown))


def _check_different(section: Iterable[Entry[Any]], report: Report) -> None:
    seen: dict[str, Entry[Any]] = {}
    for entry in section:
        name = entry.name
        if name is None:
            continue
        first = seen.setdefault(name.casefold(), entry)
        if first is entry:
            continue
        path = (*entry.path, "name")
        where = report.source_map.where((*first.path, "name"))
        if first.name == name:
            report.error(path, say("rule_name_used", name=show(name), where=where))
        else:
            report.error(path, say("rule_name_case", name=show(name), first=show(first.name), where=where))


def _buses_named(draft: Draft) -> Iterator[tuple[Path, str]]:
    """Every mention of a bus, and where it stands."""
    for entry, plc in readable(draft.plcs):
        for port, given in plc.ports.items():
            if port in CPAVL_PORTS and ("ports", port, "bus") not in entry.cut:
                yield (*entry.path, "ports", port, "bus"), given.bus
        if plc.nn is not None and ("nn", "bus") not in entry.cut:
            yield (*entry.path, "nn", "bus"), plc.nn.bus
    wired: list[Entry[Any]] = [*draft.devices, *draft.noise]
    for wire, value in readable(wired):
        yield (*wire.path, "bus"), value.bus
    for cut, fault in readable(draft.faults):
        if fault.cable_cut is not None:
            yield (*cut.path, "cable_cut", "bus"), fault.cable_cut.bus


def _points_named(draft: Draft) -> Iterator[tuple[Path, PlcPoint]]:
    """Every mention of a PLC's device, and where it stands."""
    for index, point in enumerate(draft.observe):
        yield ("observe", index), point
    for entry, latency in readable(draft.latency):
        yield (*entry.path, "from"), latency.from_
        yield (*entry.path, "to"), latency.to

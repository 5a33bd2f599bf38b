"""What is wrong with a link's rate and format, and what is odd about another bus as a whole."""

from bussim.engines.modbus.adu import Mode
from bussim.line.characters import NN_LINE, LineTiming
from bussim.scenario.resolve.buses import Line
from bussim.scenario.resolve.nodes import Node, NodeRole
from bussim.scenario.resolve.scenario import Resolved
from bussim.scenario.yaml.source_map import Path, Report
from bussim.words.language import say


def check_buses(resolved: Resolved, report: Report) -> None:
    """Check rate and format of links, and what sits on the other buses."""
    nodes = resolved.nodes
    for line in resolved.lines.values():
        if line.is_link:
            _check_fixed(line, report)
    for line in resolved.lines.values() if nodes.whole else ():
        if line.is_link or line.entry.lost("nn"):
            continue
        entry, bus = line.entry, line.bus
        there = nodes.on(bus.name)
        masters = [node for node in there if node.role is NodeRole.MASTER]
        slaves = [node for node in there if node.role is NodeRole.SLAVE]
        if not there:
            report.warn(entry.path, say("rule_bus_empty", bus=bus.name))
        elif slaves and not masters:
            no_master, names = say("rule_no_master_there"), ", ".join(_names(slaves))
            report.warn(entry.path, say("rule_bus_no_master", bus=bus.name, why=no_master, slaves=names))
        for second in masters[1:]:
            report.warn(
                second.path,
                say("rule_bus_masters", bus=bus.name, masters=masters[0].name, second=second.name),
            )
        _check_stations(bus.name, slaves, report)


def _check_fixed(line: Line, report: Report) -> None:
    bus, path = line.bus, line.entry.path
    for key in ("baud", "format"):
        if getattr(bus, key) not in (None, getattr(NN_LINE, key)):
            text = say("rule_fixed", found=getattr(bus, key), why=say("rule_link_format"))
            report.error((*path, key), text)


def _names(nodes: list[Node]) -> list[str]:
    names = [node.name for node in nodes]
    return names if len(names) <= 3 else [*names[:3], "…"]


def _check_stations(bus: str, slaves: list[Node], report: Report) -> None:
    first: dict[tuple[Mode | None, int | None], Node] = {}
    for node in slaves:
        other = first.setdefault((node.mode, node.station), node)
        if other is not node:
            report.warn(
                (*node.path, "station"),
                say("rule_same_station", other=other.name, node=node.name, bus=bus, station=node.station),
            )


def understood(path: Path, name: str, timing: LineTiming, line: Line, report: Report) -> bool:
    """Whether a node has the rate and format of its bus; a warning says so if not."""
    bus = line.timing
    same = (timing.baud, timing.format) == (bus.baud, bus.format)
    if not same:
        own, there = (f"{each.baud} {each.format}" for each in (timing, bus))
        report.warn(path, say("rule_not_understood", name=name, own=own, line=line.name, there=there))
    return same

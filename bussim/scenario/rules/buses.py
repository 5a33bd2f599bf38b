"""What is wrong with a link's rate and format, and what is odd about another bus as a whole."""

from bussim.engines.modbus.adu import Mode
from bussim.line.characters import NN_LINE, LineTiming
from bussim.scenario.resolve.buses import Line
from bussim.scenario.resolve.nodes import Node, NodeRole
from bussim.scenario.resolve.scenario import Resolved
from bussim.scenario.yaml.source_map import Path, Report

#: Of a bus that has slaves alone.
NO_MASTER = "has no Modbus master"


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
            report.warn(entry.path, f"nothing is on {bus.name}: no port of a PLC and no device")
        elif slaves and not masters:
            report.warn(entry.path, f"{bus.name} {NO_MASTER}: no station asks {', '.join(_names(slaves))}")
        for second in masters[1:]:
            report.warn(
                second.path,
                f"{bus.name} has more than one master, {masters[0].name} and {second.name}: their requests "
                "can collide",
            )
        _check_stations(bus.name, slaves, report)


def _check_fixed(line: Line, report: Report) -> None:
    bus, path = line.bus, line.entry.path
    fixed = "an N:N link is always 38400 7E1 (leave it out)"
    if bus.baud not in (None, NN_LINE.baud):
        report.error((*path, "baud"), f"is {bus.baud}, but {fixed}")
    if bus.format not in (None, NN_LINE.format):
        report.error((*path, "format"), f"is {bus.format}, but {fixed}")


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
                f"{other.name} and {node.name} on {bus} are both station {node.station}: they reply at once",
            )


def understood(path: Path, name: str, timing: LineTiming, line: Line, report: Report) -> bool:
    """Whether a node has the rate and format of its bus; a warning says so if not."""
    bus = line.timing
    same = (timing.baud, timing.format) == (bus.baud, bus.format)
    if not same:
        report.warn(
            path,
            f"{name} runs at {timing.baud} {timing.format}, {line.name} at {bus.baud} {bus.format}: "
            "no station there understands it",
        )
    return same

"""What is odd about a bus beside the link as a whole. It is simulated all the same."""

from __future__ import annotations

from bussim.engines.modbus.adu import Mode
from bussim.scenario.resolve.nodes import Directory, Node, Role
from bussim.scenario.schema.draft import Draft
from bussim.scenario.yaml.source_map import Path, Report


def check_buses(draft: Draft, nodes: Directory, report: Report) -> None:
    """Who is on each bus, and whether they can get along."""
    if not nodes.whole:
        return
    for entry in draft.buses:
        bus = entry.value
        if bus is None or bus.nn or entry.lost("nn"):
            continue
        there = nodes.on(bus.name)
        masters = [node for node in there if node.role is Role.MASTER]
        slaves = [node for node in there if node.role is Role.SLAVE]
        if not there:
            report.warn(entry.path, f"nothing is on {bus.name}: no port of a PLC and no device")
        elif slaves and not masters:
            report.warn(
                entry.path, f"{bus.name} has no Modbus master: nobody asks {', '.join(_names(slaves))}"
            )
        for second in masters[1:]:
            report.warn(
                second.path,
                f"{bus.name} has more than one master, {masters[0].name} and {second.name}: their requests "
                "can collide",
            )
        _check_stations(bus.name, slaves, report)


def _names(nodes: list[Node]) -> list[str]:
    names = [node.name for node in nodes]
    return names if len(names) <= 3 else [*names[:3], "…"]


def _check_stations(bus: str, slaves: list[Node], report: Report) -> None:
    first: dict[tuple[Mode | None, int | None], Node] = {}
    for node in slaves:
        other = first.setdefault((node.mode, node.station), node)
        if other is not node:
            report.warn(
                station_path(node),
                f"{other.name} and {node.name} on {bus} are both station {node.station}: they answer at once",
            )


def station_path(node: Node) -> Path:
    """Where the scenario gives a node's station."""
    return (*node.path, "station")

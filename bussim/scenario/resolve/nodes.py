"""What sits on the buses of a scenario, in the order of the cable, and which node a name means."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Any

from bussim.engines.modbus.adu import Mode
from bussim.line.characters import NN_LINE, LineTiming
from bussim.scenario.resolve.buses import PLAIN_LINE, Line
from bussim.scenario.resolve.members import Member
from bussim.scenario.resolve.port_configuration import FREE, PortConfiguration
from bussim.scenario.schema.draft import Draft, Entry, readable
from bussim.scenario.yaml.source_map import Path
from bussim.words.language import say
from bussim.words.values import show, suggest

if TYPE_CHECKING:
    from bussim.devices.forms import DeviceIn


class NodeRole(Enum):
    """What a node does on its bus."""

    LINK_MASTER = "N:N master"
    LINK_SLAVE = "N:N slave"
    MASTER = "Modbus master"
    SLAVE = "Modbus slave"
    FREE = "free protocol"
    SILENT = "silent"  # a port that does nothing, or whose protocol is not simulated


#: The role of a device by the kind of its model.
_ROLES = {"slave": NodeRole.SLAVE, "master": NodeRole.MASTER, "free protocol": NodeRole.FREE}


@dataclass(frozen=True, slots=True)
class Node:
    """One node of a bus. ``path`` is where the scenario describes it, ``owner`` the PLC or device."""

    name: str
    owner: str
    bus: str
    role: NodeRole
    timing: LineTiming
    mode: Mode | None
    station: int | None
    path: Path
    member: Member | None = None
    config: PortConfiguration | None = None
    device: DeviceIn | None = None

    @property
    def replies(self) -> bool:
        """Whether it sends replies."""
        return self.role in (NodeRole.LINK_SLAVE, NodeRole.SLAVE)


def link_node(member: Member) -> Node | None:
    """A PLC's node on its N:N link."""
    if not member.takes_part or member.bus is None:
        return None
    role = NodeRole.LINK_SLAVE if member.station else NodeRole.LINK_MASTER
    return Node(
        member.name, member.name, member.bus, role, NN_LINE, None, member.station, member.path, member
    )


def port_node(member: Member, config: PortConfiguration) -> Node:
    """A PLC's node on another bus."""
    role = NodeRole.MASTER if config.is_master else NodeRole.SLAVE if config.is_slave else NodeRole.SILENT
    if config.protocol == FREE:
        role = NodeRole.FREE
    timing, station = config.line, None
    if config.valid is not None:
        timing = config.valid.timing
        station = config.valid.station if config.is_slave else None
    return Node(
        config.node, member.name, config.bus, role, timing, config.mode, station, config.path, member, config
    )


def device_node(path: Path, device: DeviceIn, line: LineTiming) -> Node:
    """A device's node."""
    mode, station = device.address()
    role, timing = _ROLES[device.role], device.timing(line)
    return Node(device.name, device.name, device.bus, role, timing, mode, station, path, device=device)


class Missing(Exception):  # noqa: N818 - the caller words it
    """No node is meant by a name; the text follows the name's key."""


class Directory:
    """All nodes: PLC ports in the order of ``plcs``, of one PLC by port, then devices in their order.

    ``whole``: whether everything could be read, so that something may be said of what is absent.
    """

    def __init__(self, draft: Draft, members: Sequence[Member], lines: Mapping[str, Line]) -> None:
        self.nodes: list[Node] = []
        #: The link's port of those PLCs that take part in N:N: their node has the PLC's bare name.
        self._links: dict[str, str] = {}
        owners: list[Entry[Any]] = [*draft.plcs, *draft.devices]
        for member in members:
            own = [(config.name, port_node(member, config)) for config in member.ports]
            link = link_node(member)
            if link is not None:
                own.append((member.port, link))
                self._links[member.name] = member.port
            self.nodes += [node for _, node in sorted(own, key=lambda pair: pair[0])]
        for entry, device in readable(draft.devices):
            if device.known:
                timing = lines[device.bus].timing if device.bus in lines else PLAIN_LINE
                self.nodes.append(device_node(entry.path, device, timing))
        self.plcs = [entry.name for entry in draft.plcs if entry.name is not None]
        self.devices = [entry.name for entry in draft.devices if entry.name is not None]
        #: PLCs and devices that could not be read, so that nothing may be said against them.
        self._unsure = {
            entry.name
            for entry in owners
            if entry.lost("nn", "registers", "ports", "profile", "model", "bus", "station", "mode")
        }
        self._unsure |= {member.name for member in members if member.unread}
        self.whole = not self._unsure

    def on(self, bus: str) -> list[Node]:
        """The nodes of a bus."""
        return [node for node in self.nodes if node.bus == bus]

    def sure(self, owner: str) -> bool:
        """Whether a PLC or device could be read, so that something may be said against it."""
        return owner not in self._unsure

    def unknown(self, name: str, instead: Sequence[str] = ()) -> str:
        """What a message says of a name that no PLC and no device has; "" if one has, or there are none.

        It offers the names ``instead``, else those of all PLCs and devices.
        """
        known = [*self.plcs, *self.devices]
        if name in known or not known:
            return ""
        kinds = say("rule_no_plc_or_device" if self.devices else "rule_no_plc")
        return say("rule_is_no", kinds=kinds, hint=suggest(name, instead or known))

    def find(self, name: str, bus: str | None = None) -> Node | None:
        """The node that a name means, on a bus if that is given.

        A PLC's bare name is its only port on that bus; without a bus its link port, else its only
        port. None if that cannot be decided because of other mistakes. Raises :class:`Missing`.
        """
        owner, _, port = name.partition(".")
        unknown = self.unknown(owner, [node.name for node in self.nodes])
        if unknown:
            raise Missing(say("rule_which_unknown", owner=show(owner), unknown=unknown))
        own = [node for node in self.nodes if node.owner == owner]
        if port:
            return self._port(name, owner, port, own, bus)
        there = [node for node in own if bus is None or node.bus == bus]
        link = next((node for node in there if node.name == owner), None)
        if link is not None:
            return link
        if len(there) == 1:
            return there[0]
        if not self.sure(owner):
            return None
        if there:
            ports, on = [node.name for node in there], say("rule_there") if bus is not None else ""
            raise Missing(say("rule_several_ports", name=name, there=on, ports=ports))
        if bus is None:
            raise Missing(say("rule_on_no_bus", name=name))
        raise Missing(
            say("rule_not_on_bus", name=name, bus=bus, hint=suggest(name, [n.name for n in self.on(bus)]))
        )

    def _port(self, name: str, owner: str, port: str, own: list[Node], bus: str | None) -> Node | None:
        wanted = owner if self._links.get(owner) == port else name
        found = next((node for node in own if node.name == wanted), None)
        if found is None and not self.sure(owner):
            return None
        if found is None:
            names = [node.name if "." in node.name else f"{owner}.{self._links.get(owner)}" for node in own]
            raise Missing(say("rule_on_no_bus_hint", name=name, hint=suggest(name, names)))
        if bus is not None and found.bus != bus:
            there = [node.name for node in self.on(bus)]
            raise Missing(say("rule_not_on_bus", name=name, bus=bus, hint=suggest(name, there)))
        return found

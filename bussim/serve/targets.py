"""The nodes of a scenario that can be served, the ports to serve them on, and the lines that they form."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import assert_never

from bussim.devices.contract import BusDevice, FreeProtocolSettings, MasterSettings, SlaveSettings
from bussim.errors import UsageError
from bussim.line.characters import LineTiming
from bussim.line.protocols import BusProtocol
from bussim.plc.link_registers import D_STATION
from bussim.plc.ports.cpavl import BadSettings, PortSettings, configured
from bussim.scenario import model
from bussim.words.values import suggest

#: The URL of a node for which none is given: a new pseudo-terminal.
DEFAULT_URL = "pty"
_WORDS = {
    "modbus-rtu-slave": "Modbus RTU slave",
    "modbus-ascii-slave": "Modbus ASCII slave",
    "modbus-rtu-master": "Modbus RTU master",
    "modbus-ascii-master": "Modbus ASCII master",
    "free": "free protocol",
}


#: Whether some nodes of a bus can be external while it goes on without them.
DIVISIBLE = {BusProtocol.NN: False, BusProtocol.SERIAL: True}


@dataclass(frozen=True, slots=True)
class ServeTarget:
    """A node of a scenario. ``what`` it does on its bus in words; ``why_not`` it cannot be served, or "".

    ``station`` is its number where ``what`` does not name it.
    """

    node: str
    bus: str
    protocol: BusProtocol
    what: str
    timing: LineTiming
    station: int | None = None
    why_not: str = ""

    def described(self, timing: LineTiming) -> str:
        """What it does, its number, and rate and format of its wire."""
        number = "" if self.station is None else f", station {self.station}"
        return f"{self.what}{number}, {timing.baud} {timing.format}"


@dataclass(frozen=True, slots=True)
class Target:
    """An external line: its name, the URL of its wire, and its nodes in cable order."""

    name: str
    bus: str
    protocol: BusProtocol
    url: str
    timing: LineTiming
    nodes: tuple[ServeTarget, ...]


def serve_targets(scenario: model.Scenario) -> tuple[ServeTarget, ...]:
    """All nodes of a scenario, bus by bus in cable order."""
    found: list[ServeTarget] = []
    for bus in scenario.buses:
        for plc in scenario.plcs:
            if plc.link is not None and plc.link.bus == bus.name:
                station = plc.registers.get(f"D{D_STATION}", 0)
                what = f"N:N slave {station}" if station else "N:N master"
                found.append(ServeTarget(plc.name, bus.name, bus.protocol, what, bus.timing))
            found += [_port(plc, spec.name, bus) for spec in plc.ports if spec.bus == bus.name]
        found += [_device(device, bus) for device in scenario.devices if device.bus == bus.name]
    return tuple(found)


def _port(plc: model.Plc, port: str, bus: model.Bus) -> ServeTarget:
    spec = next(spec for spec in plc.ports if spec.name == port)
    node = f"{plc.name}.{port}"
    settings = configured(port, spec.words, plc.registers, plc.profile.com2_station)
    if isinstance(settings, BadSettings):
        return ServeTarget(node, bus.name, bus.protocol, "silent", bus.timing, None, settings.text)
    what = _WORDS.get(settings.protocol or "")
    if what is None:
        why = f"{port} has no protocol"
        if settings.protocol is not None:
            why = f"the protocol of {port} ({settings.protocol}) is not simulated"
        return ServeTarget(node, bus.name, bus.protocol, "silent", bus.timing, None, why)
    return ServeTarget(node, bus.name, bus.protocol, what, settings.timing, _station(settings))


def _station(settings: PortSettings) -> int | None:
    return settings.station if (settings.protocol or "").endswith("slave") else None


def _device(device: BusDevice, bus: model.Bus) -> ServeTarget:
    match device.settings:
        case FreeProtocolSettings():
            what = "free protocol"
        case MasterSettings():
            what = f"Modbus {device.mode.value.upper()} master"
        case SlaveSettings():
            what = f"Modbus {device.mode.value.upper()} slave"
        case _ as never:
            assert_never(never)
    return ServeTarget(device.name, bus.name, bus.protocol, what, device.timing, device.station)


def targets(scenario: model.Scenario, nodes: Iterable[str], ports: Iterable[str]) -> tuple[Target, ...]:
    """The lines that serve these nodes. ``ports`` are texts ``NODE=URL``; a node without one gets a pty.

    Nodes of one bus with the same URL share a wire, as they share the bus; ``pty`` is a pseudo-terminal
    of each bus's own. Raises UsageError, also where nothing is to be served: it says what can be.
    """
    known = {servable.node: servable for servable in serve_targets(scenario)}
    urls: dict[str, str] = {}
    for text in ports:
        node, equals, url = text.partition("=")
        if not equals or not node.strip() or not url.strip():
            raise UsageError(f"--port {text}: write NODE=URL, such as press1.COM3=COM7")
        found = _node(scenario, known, node.strip())
        if found.node in urls:
            raise UsageError(f"--port {text}: {found.node} has a port already, {urls[found.node]}")
        urls[found.node] = url.strip()
    for name in nodes:
        urls.setdefault(_node(scenario, known, name).node, DEFAULT_URL)
    if not urls:
        raise UsageError(f"nothing is to be served: name a NODE, or --port NODE=URL\n{listing(scenario)}")
    return _lines([servable for servable in known.values() if servable.node in urls], urls, known.values())


def _node(scenario: model.Scenario, known: dict[str, ServeTarget], name: str) -> ServeTarget:
    found = known.get(name)
    if found is None:  # a link's port by its own name: press1.COM4
        owner, _, port = name.partition(".")
        plc = next((plc for plc in scenario.plcs if plc.name == owner), None)
        found = known.get(plc.port_node(port)) if plc is not None and port else None
    if found is None:
        own = [node for node in known if node.partition(".")[0] == name]
        hint = f"it has {', '.join(own)}" if own else suggest(name, list(known))
        raise UsageError(f"{name} is no node of a bus of {scenario.name}; {hint}\n{listing(scenario)}")
    if found.why_not:
        raise UsageError(f"{found.node} cannot be served: {found.why_not}")
    return found


def _lines(
    served: Sequence[ServeTarget], urls: dict[str, str], all_nodes: Iterable[ServeTarget]
) -> tuple[Target, ...]:
    groups: dict[tuple[str, str], list[ServeTarget]] = {}
    for servable in served:
        groups.setdefault((servable.bus, urls[servable.node]), []).append(servable)
    whole = {bus: sum(one.bus == bus for one in all_nodes) for bus in {one.bus for one in served}}
    taken: dict[str, str] = {}
    found: list[Target] = []
    for (bus, url), nodes in groups.items():
        if url != DEFAULT_URL and url in taken:
            raise UsageError(f"{url} cannot be the wire of {taken[url]} and of {bus} at once")
        taken[url] = bus
        same = [one for one in found if one.bus == bus]
        first = nodes[0]
        alone = not DIVISIBLE[first.protocol] and sum(one == bus for one, _ in groups) == 1
        number = f" {len(same) + 1}" if same else ""
        name = bus if alone or whole[bus] == len(nodes) else f"{bus} outside{number}"
        found.append(Target(name, bus, first.protocol, url, first.timing, tuple(nodes)))
    return tuple(found)


def listing(scenario: model.Scenario) -> str:
    """What can be served, a line each."""
    rows = [one for one in serve_targets(scenario) if not one.why_not]
    if not rows:
        return f"{scenario.name} has nothing on its buses that can be served"
    wide = max(len(one.node) for one in rows)
    lines = [f"  {one.node:{wide}}  {one.described(one.timing)}, on {one.bus}" for one in rows]
    return "\n".join([f"what {scenario.name} can serve:", *lines])

"""Builds a scenario's simulation and runs it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import assert_never

from bussim.devices.lx.map import LxMap
from bussim.engines.nn.frames import data_chars
from bussim.line.characters import LineTiming
from bussim.line.contention import disputed_level
from bussim.line.protocols import BusProtocol
from bussim.line.random_streams import Streams
from bussim.plc.inputs import InputSpec, Random, RandomInput, Stimulus
from bussim.plc.link_registers import D_MODE, D_STATION, bad_parameters, setting_values
from bussim.plc.memory import parse_device
from bussim.plc.plc import Plc
from bussim.scenario import model
from bussim.sim import totals
from bussim.sim.end_recorder import EndRecorder
from bussim.sim.faults import FaultPlan
from bussim.sim.independent import parts
from bussim.sim.kernel import Kernel, Timer
from bussim.sim.nn.bus import LinkBus
from bussim.sim.nn.link_port import LinkPort
from bussim.sim.nn.reporter import LinkReporter
from bussim.sim.noise import place_noise
from bussim.sim.notes import Notes
from bussim.sim.plc_probe import PlcProbe
from bussim.sim.power_units import PlcUnit, Unit
from bussim.sim.serial.bus import SerialBus
from bussim.sim.serial.device import DeviceNode
from bussim.sim.serial.node import SerialNode
from bussim.sim.serial.plc_port import EndClock, PlcPort
from bussim.sim.serial.reporter import SerialReporter
from bussim.sim.wire.line import Line
from bussim.sim.wire.node import Node
from bussim.trace.records import LinkTotals, RunTotals
from bussim.trace.sink import Sink

Progress = Callable[[int, int], None]


class Lines:
    """The lines of a simulation: none leads out of it. For a subclass, whose lines do.

    ``lateness`` is by how many ticks characters may be late on a line that leads out.
    """

    lateness = 0

    def line_of(self, node: str) -> str | None:
        """The name of the external line that a node is on in place of its bus; None: it stays on its bus."""
        return None

    def serial_bus(
        self, name: str, timing: LineTiming, kernel: Kernel, sink: Sink, reporter: Notes
    ) -> SerialBus:
        """A serial bus, or an external line of one."""
        return SerialBus(name, timing, sink, reporter)

    def link_bus(
        self,
        name: str,
        timing: LineTiming,
        kernel: Kernel,
        sink: Sink,
        reporter: LinkReporter,
        external_nodes: dict[int, str],
    ) -> LinkBus:
        """A line of a link; ``external_nodes`` are the PLCs by station that are not simulated."""
        return LinkBus(name, timing, kernel, sink, reporter)


class Simulation:
    """A scenario in simulated time. Times are ticks from the start.

    ``links`` are the N:N lines by name, ``serial_buses`` the others; ``nodes`` are the nodes of all of them.
    By ``lines`` some nodes of a bus may be on lines of their own that lead out of the simulation. A link
    is external as a whole or not at all: its stations that are on no such line are not simulated.
    """

    #: Whether PLCs may leave ENDs out that change nothing (a test compares runs with and without).
    may_rest = True

    def __init__(self, scenario: model.Scenario, sink: Sink, lines: Lines | None = None) -> None:
        self._scenario = scenario
        self._sink = sink
        self._outside = lines or Lines()
        self.kernel = Kernel()
        streams = Streams(scenario.seed)
        self._streams = streams
        absent = self._absent()
        self.plcs = {
            spec.name: _plc(spec, streams, linked=spec.link is not None and spec.name not in absent)
            for spec in scenario.plcs
        }
        self.links: dict[str, LinkBus] = {}
        self.serial_buses: dict[str, SerialBus] = {}
        # By serial bus: the PLCs on it, and its timers.
        self._bus_timers: list[tuple[list[str], list[Timer]]] = []
        self.nodes: dict[str, Node] = {}
        self.serial_reporter = SerialReporter(sink)
        # The lines of a bus of the scenario: one, unless some of its nodes are on external lines.
        self._lines: dict[str, list[Line]] = {bus.name: [] for bus in scenario.buses}
        self._primaries: dict[str, str | None] = {}
        # By bus: the first PLC with each station number.
        self._names: dict[str, dict[int, str]] = {}
        for spec in scenario.buses:
            match spec.protocol:
                case BusProtocol.NN:
                    self._build_link(spec)
                case BusProtocol.SERIAL:
                    self._build_serial_bus(spec)
                case _:
                    assert_never(spec.protocol)
            for line in self._lines[spec.name]:
                line.disputed = disputed_level(spec.contention, scenario.seed, line.name)
        for noise in scenario.noise:
            self._place_noise(noise)
        self.units = self._build_units()
        buses: dict[str, Line] = {**self.links, **self.serial_buses}
        self.faults = FaultPlan(scenario, self.kernel, self.units, buses, self.nodes, streams, sink)

    def _absent(self) -> set[str]:
        """PLCs that take no part in their link: it is external, and they are not on an external line."""
        line_of = self._outside.line_of
        plc_names = {spec.name: spec.link.bus for spec in self._scenario.plcs if spec.link is not None}
        away = {bus for name, bus in plc_names.items() if line_of(name) is not None}
        return {name for name, bus in plc_names.items() if bus in away and line_of(name) is None}

    def _parts(self, names: Sequence[str]) -> dict[str | None, list[str]]:
        """Nodes of a bus by the external line that they are on, None the bus itself."""
        parts: dict[str | None, list[str]] = {}
        for name in names:
            parts.setdefault(self._outside.line_of(name), []).append(name)
        return parts or {None: []}

    def _build_link(self, spec: model.Bus) -> None:
        linked = [plc for plc in self._scenario.plcs if plc.link and plc.link.bus == spec.name]
        parts = self._parts([plc.name for plc in linked])
        if len(parts) > 1:
            parts.pop(None, None)  # a link is external as a whole
        for name, members in parts.items():
            self._build_link_line(spec, name, linked, [plc for plc in linked if plc.name in members])

    def _build_link_line(
        self, spec: model.Bus, outer: str | None, all_linked: list[model.Plc], linked: list[model.Plc]
    ) -> None:
        """Build a link's line with some of its PLCs; ``outer`` is its name if it is external."""
        line = outer or spec.name
        by_station: dict[int, str] = {}
        for plc in all_linked:
            by_station.setdefault(plc.registers.get(f"D{D_STATION}", 0), plc.name)
        stations = {plc.name: plc.registers.get(f"D{D_STATION}", 0) for plc in linked}
        self._names[line] = by_station
        primary = next((plc.name for plc in linked if stations[plc.name] == 0 and _accepted(plc)), None)
        self._primaries[line] = primary
        longest = max((plc.profile.turnaround.longest for plc in all_linked), default=0)
        longest += self._outside.lateness if outer else 0
        reporter = LinkReporter(line, self._sink, by_station, primary, longest)
        external_nodes = {number: name for number, name in by_station.items() if name not in stations}
        bus = self._outside.link_bus(line, spec.timing, self.kernel, self._sink, reporter, external_nodes)
        ports = [
            LinkPort(self.plcs[plc.name], bus, position, self.kernel, self._streams)
            for position, plc in enumerate(linked)
        ]
        bus.connect(ports)
        bus.block_history.horizon = max((port.plc.longest_scan() for port in ports), default=0)
        if primary is not None:
            master = next(plc for plc in linked if plc.name == primary)
            mode = setting_values(master.profile, master.registers)[D_MODE]
            bus.block_time = spec.timing.characters(data_chars(mode))
        self.links[line] = bus
        self._lines[spec.name].append(bus)
        for port in ports:
            self.nodes[port.name] = port
            port.plc.received = _visible(bus, port.position)
            if port.plc.every_end:
                bus.block_history.on_news.append(port.plc.received_news)

    def _build_serial_bus(self, spec: model.Bus) -> None:
        ports = {
            f"{plc.name}.{port.name}": (plc.name, port.name)
            for plc in self._scenario.plcs
            for port in plc.ports
            if port.bus == spec.name
        }
        devices = {device.name: device for device in self._scenario.devices if device.bus == spec.name}
        kernel, reporter = self.kernel, self.serial_reporter
        for outer, members in self._parts([*ports, *devices]).items():
            line = outer or spec.name
            bus = self._outside.serial_bus(line, spec.timing, kernel, self._sink, reporter)
            nodes: list[SerialNode] = []
            kernel.made, kernel.behind = [], len(self.serial_buses) + 1
            for name in members:
                if name in ports:
                    plc, port = ports[name]
                    nodes.append(PlcPort(self.plcs[plc], port, bus, len(nodes), kernel, reporter))
                else:
                    nodes.append(DeviceNode(devices[name], bus, len(nodes), kernel, reporter, self._streams))
            bus.connect(nodes)
            self._bus_timers.append(([ports[name][0] for name in members if name in ports], kernel.made))
            kernel.made, kernel.behind = None, 0
            self.serial_buses[line] = bus
            self._lines[spec.name].append(bus)
            self.nodes.update((node.name, node) for node in nodes)

    def _build_units(self) -> dict[str, Unit]:
        units: dict[str, Unit] = {}
        timed = {plc for entry in self._scenario.latency for plc in (entry.source_plc, entry.target_plc)}
        others = [plc for name, plc in self.plcs.items() if name not in timed] if self._sink.traced else []
        self._ends = EndRecorder(others, self.kernel, self._sink)
        for bus in self.links.values() if others else ():
            bus.recording = {self._ends.timer}
        programs = {spec.name: spec.program for spec in self._scenario.plcs}
        self._probes: list[PlcProbe] = []
        clocks: dict[str, tuple[Plc, Timer | None]] = {}
        for name, plc in self.plcs.items():
            link = self.nodes.get(name)
            ports = [node for node in self.nodes.values() if isinstance(node, PlcPort) and node.plc is plc]
            clock = EndClock(plc, self.kernel, ports, len(units)) if plc.has_ends else None
            if self.may_rest:
                plc.may_rest()
            clocks[name] = plc, clock.timer if clock is not None else None
            self._probes.append(PlcProbe(plc, programs[name], self._sink, ends=name in timed))
            units[name] = PlcUnit(
                plc, link if isinstance(link, LinkPort) else None, ports, clock, self._ends.record
            )
        # In order come the records of a trace, and the ENDs that are recorded as they happen.
        if self.may_rest and type(self._outside) is Lines and not self._sink.traced and not timed:
            for bus in self.links.values():
                bus.parts = parts(clocks, self._bus_timers)
        for device in self._scenario.devices:
            node = self.nodes[device.name]
            if isinstance(node, DeviceNode):
                units[device.name] = node
        return units

    def _place_noise(self, noise: model.Noise) -> None:
        target = noise.target
        node = self.nodes.get(target.station) if target.station is not None else None
        lines = [node.line] if node is not None else [] if target.station else self._lines[target.bus]
        for number, line in enumerate(lines):
            name = noise.name if not number else f"{noise.name} {line.name}"
            place_noise(noise, name, line, node, self._streams)

    @property
    def now(self) -> int:
        """The current tick."""
        return self.kernel.now

    def run(self, until: int, watch: Callable[[int], None] | None = None) -> None:
        """Simulate everything before the tick ``until``; ``watch`` is called with the tick now and then."""
        self.kernel.run(until, watch)

    def totals(self) -> RunTotals:
        """Counts so far; brings every PLC's memory up to its latest END."""
        now = self.now
        self._ends.flush(now - 1)
        for bus in (*self.links.values(), *self.serial_buses.values()):
            bus.close(now)
            for port in bus.ports:
                port.drain(now)
        for plc in self.plcs.values():
            plc.sync(now)
            plc.cycle.count_up_to(now)
        devices = tuple(
            totals.device_totals(node, now) for node in self.nodes.values() if isinstance(node, DeviceNode)
        )
        warnings = [w for bus in self.links.values() for w in bus.reporter.warnings]
        warnings += self.serial_reporter.warnings
        warnings += [text for probe in self._probes for text in probe.warnings(now)]
        return RunTotals(
            duration=now,
            links=tuple(self._link_totals(bus) for bus in self.links.values()),
            plcs=tuple(totals.plc_totals(plc) for plc in self.plcs.values()),
            warnings=tuple(dict.fromkeys((*self._scenario.warnings, *warnings))),
            buses=tuple(totals.bus_totals(bus) for bus in self.serial_buses.values()),
            ports=tuple(
                totals.port_totals(node) for node in self.nodes.values() if isinstance(node, PlcPort)
            ),
            devices=devices,
        )

    def _link_totals(self, bus: LinkBus) -> LinkTotals:
        primary = self._primaries[bus.name]
        spec = next((plc for plc in self._scenario.plcs if plc.name == primary), None)
        engine = self.plcs[primary].master if primary is not None else None
        return totals.link_totals(bus, spec, engine, self._names[bus.name])


def _accepted(spec: model.Plc) -> bool:
    """Whether a PLC's parameters will be accepted at RUN."""
    return not bad_parameters(spec.profile, setting_values(spec.profile, spec.registers))


def _visible(bus: LinkBus, position: int) -> Callable[[int, int], Iterable[tuple[int, bytes]]]:
    block_history = bus.block_history
    return lambda since, end: (
        block_history.visible(position, end, since) if block_history.latest > since else ()
    )


def _plc(spec: model.Plc, streams: Streams, *, linked: bool) -> Plc:
    return Plc(
        spec.name,
        spec.profile,
        scan_mean=spec.scan.mean,
        scan_jitter=spec.scan.jitter,
        phase=spec.phase,
        registers=spec.registers,
        sources=spec.sources,
        linked=linked,
        streams=streams,
        ports=spec.ports,
        polls=spec.polls,
        maps=LxMap,
        program=spec.program,
        inputs={
            parse_device(name): _stimulus(spec.name, name, given, streams)
            for name, given in spec.inputs.items()
        },
        observed=[parse_device(name, observed=True) for name in spec.observed],
    )


def _stimulus(plc: str, device: str, given: InputSpec, streams: Streams) -> Stimulus:
    if isinstance(given, RandomInput):
        if given.seed is not None:
            return Random(given.on, given.off, Streams(given.seed).uniforms("input"))
        return Random(given.on, given.off, streams.uniforms("input", plc, device))
    return given


def simulate(scenario: model.Scenario, sink: Sink, *, progress: Progress | None = None) -> RunTotals:
    """Run a scenario to its end; ``sink`` takes its records.

    ``progress``, where given, is called with (ticks simulated, ticks in all) now and then.
    """
    simulation = Simulation(scenario, sink)
    duration = scenario.duration
    simulation.run(duration, None if progress is None else lambda now: progress(now, duration))
    return simulation.totals()

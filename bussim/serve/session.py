"""A scenario of which some nodes are served on real ports, from its start to its results."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import asdict, replace
from typing import Any

from bussim.line.characters import LineTiming
from bussim.line.protocols import BusProtocol
from bussim.live.clock import LATE, Clock, Lateness
from bussim.live.echo import RETURNS
from bussim.live.options import PortOptions
from bussim.live.wire import Wire
from bussim.results.collector import Collector, Rows
from bussim.results.meters.link import LinkRecord, Pairs
from bussim.results.run_record import RunRecord
from bussim.scenario import model
from bussim.scenario.build.trace_header import trace_header
from bussim.serve.bridge import Bridge
from bussim.serve.external_lines import ExternalLinkBus, ExternalSerialBus
from bussim.serve.late_responses import LateResponses
from bussim.serve.loop import RealTime
from bussim.serve.targets import DIVISIBLE, Target
from bussim.sim.kernel import Kernel
from bussim.sim.nn.bus import LinkBus
from bussim.sim.nn.reporter import LinkReporter
from bussim.sim.notes import Notes
from bussim.sim.runner import Lines, Simulation
from bussim.sim.serial.bus import SerialBus
from bussim.trace.records import (
    Outcome,
    PollRecord,
    Record,
    RunTotals,
    TraceBus,
    TraceHeader,
    TransactionRecord,
)
from bussim.trace.sink import Sink
from bussim.units import format_ms, milliseconds, seconds
from bussim.wording import counted
from bussim.words.language import say

#: The duration of a run without an end (100 years).
FOREVER = 100 * 365 * 86_400 * 72_000_000
#: Said of a wire whose bytes take no time.
_NO_PACE = (
    "has no pace: what others send takes no time there, so that {} times are shorter than on a line, and a "
    "bus load may be above 100 %; --paced on both sides spaces bytes at the line's rate"
)


class _Bridges(Lines):
    """The lines of a simulation of which some have bridges."""

    def __init__(self, targets: Sequence[Target], wires: Sequence[Wire]) -> None:
        self._line_of = {node.node: target.name for target in targets for node in target.nodes}
        self._wires = {target.name: wire for target, wire in zip(targets, wires, strict=True)}
        self.lateness = max((wire.options.tolerance for wire in wires), default=0)
        self.bridges: list[Bridge] = []

    def line_of(self, node: str) -> str | None:
        """See the base class."""
        return self._line_of.get(node)

    def _bridge(self, name: str, kernel: Kernel) -> Bridge:
        bridge = Bridge(self._wires[name], kernel)
        self.bridges.append(bridge)
        return bridge

    def serial_bus(
        self, name: str, timing: LineTiming, kernel: Kernel, sink: Sink, reporter: Notes
    ) -> SerialBus:
        """See the base class; an external line has the rate and format of its wire."""
        if name not in self._wires:
            return super().serial_bus(name, timing, kernel, sink, reporter)
        bridge = self._bridge(name, kernel)
        return ExternalSerialBus(name, bridge.wire.timing, sink, reporter).attach(bridge, kernel)

    def link_bus(
        self,
        name: str,
        timing: LineTiming,
        kernel: Kernel,
        sink: Sink,
        reporter: LinkReporter,
        external_nodes: dict[int, str],
    ) -> LinkBus:
        """See the base class."""
        if name not in self._wires:
            return super().link_bus(name, timing, kernel, sink, reporter, external_nodes)
        bus = ExternalLinkBus(name, timing, kernel, sink, reporter)
        bus.leave_out(external_nodes)
        return bus.attach(self._bridge(name, kernel), kernel)


class _SimulatedOnly(Collector):
    """Leaves out when external stations received a block, which is unknown.

    Requests over a port that failed while this computer was late are recorded, but not counted. ``here``
    are the names of the simulated nodes, ``served`` those of the lines on ports.
    """

    here: frozenset[str] = frozenset()
    late: LateResponses
    served: frozenset[str] = frozenset()
    lateness: Lateness = Lateness()
    #: Requests that are not counted.
    uncounted = 0

    def take(self, record: Record) -> None:
        """See the base class."""
        if isinstance(record, TransactionRecord):
            self.late.note(record)
        if isinstance(record, TransactionRecord | PollRecord) and record.bus in self.served:
            begun = record.sent if isinstance(record, TransactionRecord) else record.start
            failed = record.error is not None and not getattr(record, "exception", 0)
            if failed and begun is not None and self.lateness.spoils(begun, record.end):
                self.uncounted += isinstance(record, TransactionRecord)
                self._keep(record)
                return
        super().take(record)

    def links(self, totals: RunTotals) -> dict[str, LinkRecord]:
        """See the base class."""
        return {
            name: replace(
                link,
                refresh=Pairs((pair, gaps) for pair, gaps in link.refresh.items() if pair[1] in self.here),
            )
            for name, link in super().links(totals).items()
        }

    def exchanged(self, bus: str, node: str, peer: str, start: int, outcome: Outcome) -> None:
        """See the base class; what no simulated node is asked is not known to be missing."""
        if outcome is not Outcome.MISSING:
            super().exchanged(bus, node, peer, start, outcome)


def _ignore(text: str) -> None:
    """Drop a report."""


class Session:
    """A scenario in real time.

    ::

        session = Session(scenario, targets(scenario, ["press1.COM3"], []))
        with session:
            print(session.devices)
            session.run(lambda: False, until=60 * TICKS_PER_SECOND)
        record = session.record()

    Entering it opens the ports (UsageError where one cannot be opened). ``rows`` takes single records,
    ``traced`` also frames; ``report`` is called with sentences for the user. ``duration`` is how long it
    lasts at most (ticks): what a scenario does after that does not happen.
    """

    def __init__(
        self,
        scenario: model.Scenario,
        targets: Sequence[Target],
        *,
        options: PortOptions | None = None,
        rows: Rows | None = None,
        traced: bool = False,
        duration: int = FOREVER,
        report: Callable[[str], None] = _ignore,
    ) -> None:
        no_master = say("rule_no_master_there")
        outside = tuple(f"{target.bus} {no_master}" for target in targets)  # it has masters outside
        warnings = tuple(text for text in scenario.warnings if not text.startswith(outside))
        self.scenario = replace(scenario, duration=duration, warnings=warnings)
        self.targets = tuple(targets)
        self.report = report
        self.clock = Clock()
        options = options or PortOptions()
        self.wires = tuple(
            Wire(target.url, _nominal(target.timing), options, clock=self.clock, report=report)
            for target in targets
        )
        header = session_header(self.scenario, targets)
        bus_of = {
            node: bus.name for bus in header.buses if bus.protocol is BusProtocol.NN for node in bus.nodes
        }
        external = _Bridges(targets, self.wires)
        linked = [(plc, plc.link.bus) for plc in scenario.plcs if plc.link is not None]
        led_out = {bus for plc, bus in linked if external.line_of(plc.name) is not None}
        numbers = {plc.name: plc.registers.get("D8176", 0) for plc, bus in linked if bus not in led_out}
        self.collector = _SimulatedOnly(traced=traced, rows=rows, bus_of=bus_of, numbers=numbers)
        self.collector.served = frozenset(target.name for target in targets)
        self.collector.late = LateResponses(self.collector.served)
        self.simulation = Simulation(self.scenario, self.collector, external)
        self.collector.here = frozenset(self.simulation.nodes)
        self.bridges = tuple(external.bridges)
        self.loop = RealTime(
            self.simulation.kernel, self.clock, self.bridges, also=self._carry_out, report=report
        )
        self.collector.lateness = self.loop.lateness
        self._requests: deque[Callable[[], None]] = deque()  # of other threads
        self._stack = ExitStack()
        self._totals: RunTotals | None = None

    def __enter__(self) -> Session:
        with ExitStack() as stack:
            for wire in self.wires:
                stack.callback(wire.close)
                wire.open()
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    @property
    def devices(self) -> dict[str, str]:
        """What the other side opens, by the names of lines: a device, or the port's URL."""
        return {target.name: wire.name for target, wire in zip(self.targets, self.wires, strict=True)}

    def described(self) -> tuple[str, ...]:
        """What is served where, a line each node: ``drive: Modbus RTU slave … on /dev/pts/3``."""
        return tuple(
            f"{node.node}: {node.described(target.timing)}, on {wire.name}"
            for target, wire in zip(self.targets, self.wires, strict=True)
            for node in target.nodes
        )

    def hints(self) -> tuple[str, ...]:
        """What is to be known of the wires that an N:N link is served on."""
        return tuple(
            f"{wire.name} {_NO_PACE.format('scan')}"
            for target, wire in zip(self.targets, self.wires, strict=True)
            if target.protocol is BusProtocol.NN and wire.instant and not wire.options.paced
        )

    @property
    def now(self) -> int:
        """The present tick of the simulation."""
        return self.simulation.now

    def run(self, stopped: Callable[[], bool], until: int | None = None) -> None:
        """Run until ``stopped`` says so, or up to a tick (default: the duration)."""
        self.loop.run(self.scenario.duration if until is None else until, stopped)

    def inject(self, fault: model.Fault) -> threading.Event:
        """Let a fault begin as soon as possible, for as long as its window lasts. Any thread may call.

        The event that is returned is set when it has begun.
        """
        begun = threading.Event()

        def begin() -> None:
            self.simulation.faults.inject(fault)
            begun.set()

        self._requests.append(begin)
        return begun

    def _carry_out(self) -> None:
        while self._requests:
            self._requests.popleft()()

    # -- results -----------------------------------------------------------------------------------

    def totals(self) -> RunTotals:
        """Counts at the end, and warnings."""
        if self._totals is None:
            for bridge in self.bridges:
                if bridge.frames is not None:
                    bridge.frames.close()
            totals = self.simulation.totals()
            served = {target.bus for target in self.targets}
            here = {node.partition(".")[0] for node in self.simulation.nodes}
            away = {
                plc.name for plc in self.scenario.plcs if plc.link is not None and plc.link.bus in served
            } - here
            plcs = tuple(replace(plc, registers={}) if plc.name in away else plc for plc in totals.plcs)
            self._totals = replace(totals, plcs=plcs, warnings=(*totals.warnings, *self._warnings()))
        return self._totals

    def _warnings(self) -> list[str]:
        warnings = self.collector.late.warnings()
        echoing = {bridge.wire for bridge in self.bridges if bridge.echo.found}
        for target, wire in zip(self.targets, self.wires, strict=True):
            warnings.append(f"{target.name} leads to {target.url}: its times are the operating system's")
            if wire.instant and not wire.options.paced:
                of = "scan" if target.protocol is BusProtocol.NN else "response"
                warnings.append(f"{target.url} {_NO_PACE.format(of)}")
            if wire in echoing:
                warnings.append(f"{target.url} {RETURNS}")
            counts = wire.counts
            if counts.losses:
                away = f"{counted(counts.losses, 'time')} for {counts.away_s:.1f} s"
                warnings.append(f"{target.url} was lost {away}")
            if counts.dropped:
                lost = counted(counts.dropped, "byte")
                warnings.append(f"{target.url} did not take {lost}: no program reads there")
        late = self.loop.lateness
        if late.worst > LATE:
            warnings.append(
                f"this computer was up to {format_ms(late.worst)} late, at {seconds(late.worst_at):.3f} s"
            )
        if uncounted := self.collector.uncounted:
            failed = counted(uncounted, "failed request")
            warnings.append(f"this computer was late meanwhile: {failed} left out of what is counted")
        return warnings

    def record(self) -> RunRecord:
        """The results, as of a run."""
        totals, collector, scenario = self.totals(), self.collector, self.scenario
        record = collector.run(totals, scenario=scenario.name, seed=scenario.seed)
        record.summary["served"] = self._served()
        return record

    def _served(self) -> dict[str, Any]:
        late = self.loop.lateness
        return {
            "lines": {
                target.name: {
                    "bus": target.bus,
                    "url": target.url,
                    "nodes": [node.node for node in target.nodes],
                    **asdict(wire.counts),
                }
                for target, wire in zip(self.targets, self.wires, strict=True)
            },
            "late_ms": {
                "mean": round(milliseconds(late.mean), 6),
                "max": round(milliseconds(late.worst), 6),
                "max_at_s": round(seconds(late.worst_at), 6),
            },
        }


def session_header(scenario: model.Scenario, targets: Sequence[Target]) -> TraceHeader:
    """The first line of a session's trace: its lines, and that their times are not exact."""
    header = trace_header(scenario)
    buses: list[TraceBus] = []
    for bus in header.buses:
        own = [target for target in targets if target.bus == bus.name]
        away = {node.node for target in own for node in target.nodes}
        left = tuple(node for node in bus.nodes if node not in away)
        for target in own:
            nodes = tuple(node.node for node in target.nodes) if DIVISIBLE[bus.protocol] else bus.nodes
            stations = _only(bus.stations, nodes)
            timing = target.timing
            fmt = str(timing.format)
            buses.append(
                bus._replace(name=target.name, baud=timing.baud, format=fmt, nodes=nodes, stations=stations)
            )
        if (left and DIVISIBLE[bus.protocol]) or not own:  # after what is served, which is searched first
            buses.append(bus._replace(nodes=left, stations=_only(bus.stations, left)))
    return header._replace(buses=tuple(buses), duration=None, exact=False)


def _only(stations: dict[str, int], nodes: Sequence[str]) -> dict[str, int]:
    return {node: number for node, number in stations.items() if node in nodes}


def _nominal(timing: LineTiming) -> LineTiming:
    """Rate and format of a wire: its clock is its own."""
    return LineTiming(timing.baud, timing.format)

"""Scenarios from values, a sink that keeps everything, and the times that the specification gives."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from bussim.line.characters import NN_LINE
from bussim.line.contention import Contention
from bussim.line.protocols import BusProtocol
from bussim.plc.profiles import PROFILES, Profile, Turnaround
from bussim.scenario import fault_kinds, model
from bussim.sim.nn.bus import LinkBus
from bussim.sim.runner import Simulation
from bussim.trace.records import (
    AttemptRecord,
    CycleRecord,
    DeviceValueRecord,
    FrameRecord,
    FreeRecord,
    InputRecord,
    LinkTotals,
    NoteRecord,
    Outcome,
    PollRecord,
    Record,
    RunTotals,
    ScanRecord,
    TransactionRecord,
)
from tests.sinks import OneByOne

MS = 72_000
SECOND = 72_000_000
#: One character: 10 bits at 38400 bps.
CHAR = 18_750
#: 0.4175 ms, 0.1 ms and 3.52 ms of the profile, in ticks.
GAP = 30_060
TURNAROUND, JITTER = 30_060, 7_200
OVERHEAD = 253_440
#: Bytes of a block by mode: points / 8 + words * 2.
BLOCK_BYTES = (0 + 8, 4 + 8, 8 + 16, 8 + 32, 8 + 64)
POLL = 5 * CHAR
PARAMETERS = 14 * CHAR


def data(mode: int) -> int:
    """Ticks of a data frame: six characters around two for each byte."""
    return (6 + 2 * BLOCK_BYTES[mode]) * CHAR


def slot(mode: int, turnaround: int = TURNAROUND) -> int:
    """Ticks of a slave that replies at once."""
    return GAP + POLL + turnaround + data(mode)


def plain_scan(stations: int, mode: int, turnaround: int = TURNAROUND) -> int:
    """Ticks of a link scan without errors and without jitter."""
    return GAP + data(mode) + (stations - 1) * slot(mode, turnaround) + OVERHEAD


def timeout(units: int) -> int:
    """Ticks of D8180."""
    return units * 10 * MS


def steady(base: str = "pw10", **changes: Any) -> Profile:
    """A built-in profile without jitter of the turnaround, and with other changes."""
    return replace(PROFILES[base], **{"turnaround": Turnaround(TURNAROUND, 0), **changes})


PLAIN = steady()


@dataclass
class Recorder(OneByOne):
    """A sink that keeps everything."""

    traced: bool = True
    scans: list[ScanRecord] = field(default_factory=list)
    attempts: list[AttemptRecord] = field(default_factory=list)
    frames: list[FrameRecord] = field(default_factory=list)
    failures: list[tuple[str, int, int, int]] = field(default_factory=list)
    notes: list[NoteRecord] = field(default_factory=list)
    refreshes: list[tuple[str, int, int, tuple[int, ...] | None]] = field(default_factory=list)
    switches: list[tuple[str, int, int, int | None]] = field(default_factory=list)
    irregularities: list[tuple[str, str, int, str]] = field(default_factory=list)
    exchanges: list[tuple[str, str, str, int, Outcome]] = field(default_factory=list)
    transactions: list[TransactionRecord] = field(default_factory=list)
    turns: list[PollRecord] = field(default_factory=list)
    cycles: list[CycleRecord] = field(default_factory=list)
    said: list[FreeRecord] = field(default_factory=list)
    values: list[DeviceValueRecord] = field(default_factory=list)
    inputs: list[InputRecord] = field(default_factory=list)
    all_ends: dict[str, list[int]] = field(default_factory=dict)

    def take(self, record: Record) -> None:
        match record:
            case ScanRecord():
                self.scans.append(record)
            case AttemptRecord():
                self.attempts.append(record)
            case FrameRecord():
                self.frames.append(record)
            case NoteRecord():
                self.notes.append(record)
            case TransactionRecord():
                self.transactions.append(record)
            case PollRecord():
                self.turns.append(record)
            case CycleRecord():
                self.cycles.append(record)
            case FreeRecord():
                self.said.append(record)
            case DeviceValueRecord():
                self.values.append(record)
            case InputRecord():
                self.inputs.append(record)

    def failed(self, bus: str, tick: int, station: int, code: int, *, garbled: bool = False) -> None:
        self.failures.append((bus, tick, station, code))

    def ends(self, plc: str, ticks: Sequence[int]) -> None:
        self.all_ends.setdefault(plc, []).extend(ticks)

    def refreshed(self, bus: str, source: int, tick: int, heard: Sequence[int] | None) -> None:
        self.refreshes.append((bus, source, tick, None if heard is None else tuple(sorted(heard))))

    def switched(self, bus: str, position: int, tick: int, fresh: int | None) -> None:
        self.switches.append((bus, position, tick, fresh))

    def irregular(self, bus: str, node: str, tick: int, what: str) -> None:
        self.irregularities.append((bus, node, tick, what))

    def exchanged(self, bus: str, node: str, peer: str, start: int, outcome: Outcome) -> None:
        self.exchanges.append((bus, node, peer, start, outcome))


@dataclass
class Done:
    """A simulation that has run to its end."""

    simulation: Simulation
    record: Recorder
    totals: RunTotals

    @property
    def link(self) -> LinkTotals:
        return self.totals.links[0]

    @property
    def durations(self) -> list[int]:
        return [scan.duration for scan in self.record.scans]

    @property
    def codes(self) -> Counter[tuple[int, int]]:
        """Failed attempts by (station, code)."""
        return Counter((station, code) for _, _, station, code in self.record.failures)

    def registers(self, plc: str) -> dict[str, int]:
        return next(found.registers for found in self.totals.plcs if found.name == plc)

    def about(self, plc: str, station: int) -> tuple[int, int, int]:
        """What a PLC says of a station: error count, last code, flag now on."""
        found = self.registers(plc)
        return found[f"D{8203 + station}"], found[f"D{8211 + station}"], found[f"M{8183 + station}"]

    def of(self, plc: str, kind: str = "data") -> list[FrameRecord]:
        """The frames of one kind that a PLC sent."""
        return [frame for frame in self.record.frames if frame.sender == plc and frame.kind == kind]

    def notes(self, kind: str, where: str | None = None) -> list[NoteRecord]:
        return [n for n in self.record.notes if n.kind == kind and where in (None, n.where)]


def plc(
    station: int,
    *,
    profile: Profile = PLAIN,
    name: str | None = None,
    registers: Mapping[str, int] | None = None,
    **changes: Any,
) -> model.Plc:
    """A PLC on the bus ``link``, called p0, p1… by its station."""
    values: dict[str, Any] = {
        "scan": model.Scan(8 * MS),
        "link": model.LinkAttachment("link", "COM4"),
        **changes,
    }
    return model.Plc(
        name or f"p{station}",
        profile,
        registers={"D8176": station, "M8179": 1, **(registers or {})},
        **values,
    )


def link(
    stations: int = 3,
    mode: int = 2,
    *,
    seconds: float = 2.0,
    retries: int = 3,
    units: int = 5,
    profile: Profile = PLAIN,
    seed: int = 1,
    others: Mapping[int, Mapping[str, Any]] | None = None,
    more: Sequence[model.Plc] = (),
    noise: Sequence[model.Noise] = (),
    faults: Sequence[model.Fault | fault_kinds.FaultKind] = (),
    contention: Contention = Contention.UNDEFINED,
) -> model.Scenario:
    """A master p0 and slaves p1, p2… ; ``others`` are arguments of :func:`plc` by station.

    ``units`` is D8180. A fault without a window lasts from the start to the end.
    """
    plcs = []
    for station in range(stations):
        values = dict((others or {}).get(station, {}))
        registers = dict(values.pop("registers", {}))
        if station == 0:
            master = {"D8177": stations - 1, "D8178": mode, "D8179": retries, "D8180": units}
            registers = {**master, **registers}
        plcs.append(plc(station, registers=registers, **{"profile": profile, **values}))
    return model.Scenario(
        name="test",
        duration=round(seconds * SECOND),
        seed=seed,
        buses=(model.Bus("link", BusProtocol.NN, NN_LINE, contention),),
        plcs=(*plcs, *more),
        noise=tuple(noise),
        faults=tuple(
            item if isinstance(item, model.Fault) else model.Fault(f"fault{number}", item)
            for number, item in enumerate(faults)
        ),
    )


def fault(kind: fault_kinds.FaultKind, at: float = 0.0, lasting: float | None = None) -> model.Fault:
    """A fault with its window in seconds."""
    window = model.Window(round(at * SECOND), None if lasting is None else round(lasting * SECOND))
    return model.Fault(f"{type(kind).__name__} at {at}", kind, window)


def started(scenario: model.Scenario, *, traced: bool = True) -> tuple[Simulation, Recorder]:
    """A simulation that has not begun, and its sink."""
    recorder = Recorder(traced)
    return Simulation(scenario, recorder), recorder


def run(scenario: model.Scenario, *, traced: bool = True) -> Done:
    """Run a scenario to its end."""
    simulation, recorder = started(scenario, traced=traced)
    simulation.run(scenario.duration)
    return Done(simulation, recorder, simulation.totals())


def registers_now(simulation: Simulation, plc: str) -> dict[str, int]:
    """The special devices of a PLC at the present tick."""
    found = simulation.plcs[plc]
    found.sync(simulation.now)
    return found.link_registers.registers()


def bus_of(done: Done | Simulation) -> LinkBus:
    """The bus of a simulation of :func:`link`."""
    simulation = done.simulation if isinstance(done, Done) else done
    return simulation.links["link"]


def takers(done: Done, source: int) -> dict[int, set[int]]:
    """Who took the blocks of a position, by the tick."""
    found: dict[int, set[int]] = {}
    for _, position, tick, heard in done.record.refreshes:
        if position == source:
            all_others = set(range(len(done.link.plc_names))) - {position}
            found.setdefault(tick, set()).update(all_others if heard is None else heard)
    return found

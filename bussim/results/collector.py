"""Takes a run's records and keeps what the results need, in memory that does not grow with the run."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Protocol, assert_never

from bussim.results.meters.failures import FailureMeter, Irregular, Irregulars, LinkMember
from bussim.results.meters.latency import LatencyMeter, LatencySpec
from bussim.results.meters.link import LinkMeter, LinkRecord
from bussim.results.meters.ports import PortMeter, PortRecord
from bussim.results.meters.refresh import RefreshMeter
from bussim.results.meters.timeline import Spans
from bussim.results.run_record import RunRecord
from bussim.results.summary.latency import LatencyBounds
from bussim.results.summary.run import summarise
from bussim.results.verdict.verdict import Evidence
from bussim.trace import records
from bussim.trace.blocks import RecordBlock
from bussim.trace.records import (
    IN_RUN,
    IN_STOP,
    LEFT_RUN,
    WITHOUT_SUPPLY,
    EndsRecord,
    NoteRecord,
    Record,
    RunTotals,
    ScanRecord,
)

if TYPE_CHECKING:
    import numpy as np

#: Notes that are kept besides the faults.
MOST_NOTES = 1000
#: ENDs that are recorded one by one come into a trace in blocks of so many.
_ENDS_IN_A_BLOCK = 256
#: What a PLC or device may be if it is not at work.
_STATES = (WITHOUT_SUPPLY, IN_STOP)
_ALWAYS_KEPT = frozenset({"fault", "fault_over"})


class Rows(Protocol):
    """Where single records go: files, or memory."""

    def take(self, record: Record) -> None:
        """A record; attempts, frames and ENDs only of a traced run."""

    def take_many(self, block: RecordBlock, breaks: Iterable[int]) -> None:
        """Records that come many at once; see :meth:`bussim.trace.sink.Sink.take_many`."""


class Collector:
    """A :class:`bussim.trace.sink.Sink` that keeps statistics, and hands single records on to ``rows``.

    ``bus_of`` names the N:N link of each PLC, in cable order, so that what a PLC reports is counted on its
    link; ``numbers`` are their station numbers, without which failed exchanges are judged by codes alone.
    ``latency`` is what is measured between devices. After the run, :meth:`run` gives what was kept.
    ``notes`` are all faults and the first :data:`MOST_NOTES` other notes; ``left_out`` counts the rest by
    kind.
    """

    def __init__(
        self,
        *,
        traced: bool = False,
        rows: Rows | None = None,
        bus_of: Mapping[str, str] | None = None,
        numbers: Mapping[str, int] | None = None,
        latency: Sequence[LatencySpec] = (),
    ) -> None:
        self.traced = traced
        self.in_order = rows is not None
        self.notes: list[NoteRecord] = []
        self.left_out: Counter[str] = Counter()
        self._others = 0
        self._refused: dict[str, int] = {}  # D8063 by PLC or port
        self._rows = rows
        self._bus_of = bus_of or {}
        self._numbers = numbers or {}
        self._links: dict[str, LinkMeter] = {}
        self._refresh = RefreshMeter()
        self._irregular: defaultdict[str, Irregulars] = defaultdict(dict)  # by bus
        self._away: dict[str, Spans] = {}  # by PLC or device: times without supply or in STOP
        self._ports = PortMeter()
        self._latency = LatencyMeter(latency)
        self._single_ends: dict[str, list[int]] = {}  # ENDs that came one by one, for the trace

    def take(self, record: Record) -> None:
        """Count a record, and hand it on to the rows."""
        match record:
            case ScanRecord():
                self._link(record.bus).scan(record)
            case records.FrameRecord() | records.AttemptRecord() | EndsRecord():
                pass
            case (
                records.TransactionRecord()
                | records.PollRecord()
                | records.CycleRecord()
                | records.FreeRecord()
            ):
                self._ports.take(record)
            case records.DeviceValueRecord():
                self._latency.value(record)
            case records.InputRecord():
                self._latency.input(record)
            case NoteRecord():
                self._note(record)
            case _:
                assert_never(record)
        self._keep(record)

    def take_many(self, block: RecordBlock, breaks: Iterable[int] = ()) -> None:
        """Count records that come many at once, and hand them on to the rows."""
        for each in block:
            if isinstance(each.pattern, ScanRecord):
                self._link(each.pattern.bus).scans(each.varying["start"], each.varying["duration"])
        if self._rows is not None:
            self._rows.take_many(block, breaks)

    def _keep(self, record: Record) -> None:
        if self._rows is not None:
            self._rows.take(record)

    def _link(self, bus: str) -> LinkMeter:
        if bus not in self._links:
            members = [
                LinkMember(name, position, self._numbers[name])
                for position, name in enumerate(plc for plc, link in self._bus_of.items() if link == bus)
                if name in self._numbers
            ]
            failures = FailureMeter(bus, members, self._refresh, self._irregular[bus])
            self._links[bus] = LinkMeter(bus, self._refresh, failures)
        return self._links[bus]

    def _note(self, record: NoteRecord) -> None:
        """Keep a note, and what follows from it for the plots and for the time after start-up."""
        kind, where, tick = record.kind, record.where, record.tick
        if kind == "healthy":
            self._link(where).healthy(tick)
        elif kind in ("station_error", "recovered"):
            station, code = record.detail.get("station"), record.detail.get("code", 0)
            if isinstance(station, int) and isinstance(code, int):
                link = self._link(self._bus_of.get(where, where))
                link.flag(where, station, tick, code if kind == "station_error" else None)
        elif kind == "watchdog":
            heard = record.detail.get("heard")
            self._link(self._bus_of.get(where, where)).watchdog(
                where, heard if isinstance(heard, int) else tick
            )
        elif kind == "parameters":
            self._link(self._bus_of.get(where, where)).found_master(where, tick)
        elif kind in (IN_RUN, LEFT_RUN):
            away = self._away.setdefault(where, Spans())
            away.all_off(tick)
            if kind == LEFT_RUN:
                away.on(_STATES.index(record.text), tick)
            if where in self._bus_of:
                self._link(self._bus_of[where]).state(where, tick, running=kind == IN_RUN)
        elif kind == "refused":
            number = record.detail.get("D8063")
            self._refused[where] = number if isinstance(number, int) else 0
            if where in self._bus_of:
                self._link(self._bus_of[where]).failures.refused(where)
        if kind in _ALWAYS_KEPT:
            self.notes.append(record)
        elif self._others < MOST_NOTES:
            self._others += 1
            self.notes.append(record)
        else:
            self.left_out[kind] += 1

    def failed(self, bus: str, tick: int, station: int, code: int, *, garbled: bool = False) -> None:
        """Count a failed attempt in the scan under way."""
        self._link(bus).attempt_failed(station, code, tick, garbled=garbled)

    def ends(self, plc: str, ticks: Sequence[int]) -> None:
        """Hand ENDs on, in a trace in blocks."""
        if plc in self._latency.plcs:
            self._latency.ends(plc, ticks)
            if self.traced:
                gathered = self._single_ends.setdefault(plc, [])
                gathered += ticks
                if len(gathered) >= _ENDS_IN_A_BLOCK:
                    self._hand_on_ends(plc)
        elif self.traced:
            self._keep(EndsRecord(plc, tuple(ticks)))

    def _hand_on_ends(self, plc: str) -> None:
        self._keep(EndsRecord(plc, tuple(self._single_ends.pop(plc))))

    def refreshed(self, bus: str, source: int, tick: int, heard: Sequence[int] | None) -> None:
        """Count a refresh."""
        self._refresh.refreshed(bus, source, tick, heard)
        self._latency.refreshed(bus, source, tick, heard)

    def refreshed_often(self, bus: str, source: int, ticks: np.ndarray, heard: Sequence[int] | None) -> None:
        """Count refreshes of one source."""
        self._refresh.refreshed_often(bus, source, ticks, heard)
        for tick in ticks.tolist() if self._latency.plcs else ():
            self._latency.refreshed(bus, source, tick, heard)

    def switched(self, bus: str, position: int, tick: int, fresh: int | None) -> None:
        """See :meth:`bussim.trace.sink.Sink.switched`."""
        self._refresh.switched(bus, position, tick, fresh)

    def irregular(self, bus: str, node: str, tick: int, what: str) -> None:
        """Count what a node's driver did."""
        found = self._irregular[bus]
        found[node, what] = Irregular.noted(found.get((node, what)), tick)

    def exchanged(self, bus: str, node: str, peer: str, start: int, outcome: records.Outcome) -> None:
        """Count what became of a message or request."""
        self._ports.exchanged(bus, node, peer, start, outcome)

    def ordinary_turns(
        self, turns: Sequence[records.OrdinaryTurns], cycles: Sequence[records.CycleRecord]
    ) -> None:
        """Count turns and cycles without errors."""
        self._ports.ordinary_turns(turns, cycles)

    def links(self, totals: RunTotals) -> dict[str, LinkRecord]:
        """What was kept of every link, in the order of the totals."""
        return {link.bus: self._link(link.bus).record(link, totals.duration) for link in totals.links}

    def ports(self, totals: RunTotals) -> dict[str, PortRecord]:
        """What was kept of every Modbus master and node of the free protocol."""
        return self._ports.nodes(totals)

    def run(
        self,
        totals: RunTotals,
        *,
        scenario: str,
        seed: int,
        bounds: Mapping[str, LatencyBounds] | None = None,
    ) -> RunRecord:
        """The whole run; ``scenario`` is the scenario's name.

        ``bounds`` are what a latency may be at worst, by entry.
        """
        for plc in list(self._single_ends):
            self._hand_on_ends(plc)
        links, ports, latency = self.links(totals), self.ports(totals), self._latency.records()
        summary = summarise(
            totals,
            links,
            ports,
            scenario=scenario,
            seed=seed,
            latency=latency,
            bounds=bounds or {},
            evidence=Evidence(
                links,
                self._refused,
                self._irregular,
                {
                    name: {_STATES[state]: times for state, times in spans.all().items()}
                    for name, spans in self._away.items()
                },
                ports,
            ),
        )
        return RunRecord(summary, totals.duration, links, tuple(self.notes), self.left_out, ports, latency)

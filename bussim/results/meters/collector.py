"""Takes a run's records and keeps what the results need, in memory that the run's length leaves alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

from bussim.results.meters.latency import LatencyMeter, LatencySpec
from bussim.results.meters.ports import PortMeter, PortRecord
from bussim.results.meters.refresh import RefreshMeter
from bussim.results.meters.run_record import LinkRecord, RunRecord, ScanTimes
from bussim.results.meters.timeline import Spans, Timeline
from bussim.results.summary import summarise
from bussim.results.text.latency import LatencyBounds
from bussim.trace.file import Record
from bussim.trace.records import (
    AttemptRecord,
    CycleRecord,
    DeviceValueRecord,
    EndsRecord,
    FrameRecord,
    FreeRecord,
    InputRecord,
    LinkTotals,
    NoteRecord,
    PollRecord,
    RunTotals,
    ScanRecord,
    TransactionRecord,
)

#: Notes that are kept besides the faults.
MOST_NOTES = 1000
#: ENDs that are told one by one come into a trace in blocks of so many.
_ENDS_IN_A_BLOCK = 256
_ALWAYS_KEPT = frozenset({"fault", "fault_over"})


class Rows(Protocol):
    """Where single records go: files, or memory."""

    def take(self, record: Record) -> None:
        """A record; attempts, frames and ENDs only of a traced run."""


class _Link:
    """What is being counted of one bus."""

    __slots__ = (
        "after_startup",
        "failed",
        "failed_per_scan",
        "flagged",
        "healthy_at",
        "in_error",
        "timeline",
        "times",
    )

    def __init__(self) -> None:
        self.times = ScanTimes()
        self.after_startup = ScanTimes()
        self.healthy_at: int | None = None
        self.timeline = Timeline()
        self.in_error: dict[str, Spans] = {}  # by who reported it: the PLC, or the bus itself
        self.flagged = False  # whether one of them may be on
        self.failed: dict[int, int] = {}  # code → failed attempts in the scan under way
        self.failed_per_scan: dict[int, dict[int, int]] = {}

    def scan(self, record: ScanRecord) -> None:
        self.times.add(record)
        if self.healthy_at is not None and record.start >= self.healthy_at:
            self.after_startup.add(record)
        self.timeline.add(record.start, record.duration)
        if self.failed:
            for code, number in self.failed.items():
                scans = self.failed_per_scan.setdefault(code, {})
                scans[number] = scans.get(number, 0) + 1
            self.failed.clear()
        if self.flagged and not record.stations_in_error:
            # A master that stops drops its flags without saying so for each.
            self.flagged = False
            for spans in self.in_error.values():
                spans.all_off(record.start + record.duration)

    def flag(self, reporter: str, kind: str, station: int, tick: int) -> None:
        spans = self.in_error.setdefault(reporter, Spans())
        if kind == "station_error":
            self.flagged = True
            spans.on(station, tick)
        else:
            spans.off(station, tick)


class Collector:
    """A :class:`bussim.trace.records.Sink` that keeps statistics, and hands single records on to ``rows``.

    ``bus_of`` names the N:N link of each PLC, so that what a PLC reports is booked on its link.
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
        latency: Sequence[LatencySpec] = (),
    ) -> None:
        self.traced = traced
        self.notes: list[NoteRecord] = []
        self.left_out: dict[str, int] = {}
        self._others = 0
        self._rows = rows
        self._bus_of = bus_of or {}
        self._links: dict[str, _Link] = {}
        self._meter = RefreshMeter()
        self._ports = PortMeter()
        self._latency = LatencyMeter(latency) if latency else None
        self._single_ends: dict[str, list[int]] = {}  # ENDs that were told one by one, for the trace

    def scan(self, record: ScanRecord) -> None:
        """Count a link scan."""
        self._link(record.bus).scan(record)
        if self._rows is not None:
            self._rows.take(record)

    def attempt(self, record: AttemptRecord) -> None:
        """Hand an attempt on."""
        if self._rows is not None:
            self._rows.take(record)

    def frame(self, record: FrameRecord) -> None:
        """Hand a frame on."""
        if self._rows is not None:
            self._rows.take(record)

    def failed(self, bus: str, tick: int, station: int, code: int) -> None:  # noqa: ARG002 (Sink's signature)
        """Count a failed attempt in the scan under way."""
        failed = self._link(bus).failed
        failed[code] = failed.get(code, 0) + 1

    def note(self, record: NoteRecord) -> None:
        """Keep a note, and what follows from it for the plots and for the time after start-up."""
        kind = record.kind
        if kind == "healthy":
            link = self._link(record.where)
            if link.healthy_at is None:
                link.healthy_at = record.tick
        elif kind in ("station_error", "recovered"):
            station = record.detail.get("station")
            if isinstance(station, int):
                link = self._link(self._bus_of.get(record.where, record.where))
                link.flag(record.where, kind, station, record.tick)
        if kind in _ALWAYS_KEPT:
            self.notes.append(record)
        elif self._others < MOST_NOTES:
            self._others += 1
            self.notes.append(record)
        else:
            self.left_out[kind] = self.left_out.get(kind, 0) + 1
        if self._rows is not None:
            self._rows.take(record)

    def transaction(self, record: TransactionRecord) -> None:
        """Count a transaction."""
        self._ports.transaction(record)
        if self._rows is not None:
            self._rows.take(record)

    def poll_turn(self, record: PollRecord) -> None:
        """Count a turn of a poll."""
        self._ports.turn(record)
        if self._rows is not None:
            self._rows.take(record)

    def cycle(self, record: CycleRecord) -> None:
        """Count a cycle of a poll list."""
        self._ports.cycle(record)
        if self._rows is not None:
            self._rows.take(record)

    def free(self, record: FreeRecord) -> None:
        """Count bytes of the free protocol."""
        self._ports.free(record)
        if self._rows is not None:
            self._rows.take(record)

    def value(self, record: DeviceValueRecord) -> None:
        """Hand a device's new value on."""
        if self._latency is not None:
            self._latency.value(record)
        if self._rows is not None:
            self._rows.take(record)

    def input(self, record: InputRecord) -> None:
        """Hand an input's change on."""
        if self._latency is not None:
            self._latency.input(record)
        if self._rows is not None:
            self._rows.take(record)

    def ends(self, plc: str, ticks: Sequence[int]) -> None:
        """Hand ENDs on, in a trace in blocks."""
        if self._latency is not None and plc in self._latency.plcs:
            self._latency.ends(plc, ticks)
            if self.traced:
                gathered = self._single_ends.setdefault(plc, [])
                gathered += ticks
                if len(gathered) >= _ENDS_IN_A_BLOCK:
                    self._tell_ends(plc)
        elif self._rows is not None and self.traced:
            self._rows.take(EndsRecord(plc, tuple(ticks)))

    def _tell_ends(self, plc: str) -> None:
        ticks = self._single_ends.pop(plc)
        if self._rows is not None and ticks:
            self._rows.take(EndsRecord(plc, tuple(ticks)))

    def refreshed(self, bus: str, source: int, tick: int, heard: Sequence[int] | None) -> None:
        """Count a refresh."""
        self._meter.refreshed(bus, source, tick, heard)
        if self._latency is not None:
            self._latency.refreshed(bus, source, tick, heard)

    def links(self, totals: RunTotals) -> dict[str, LinkRecord]:
        """What was kept of every link, in the order of the totals."""
        return {link.bus: self._record(link) for link in totals.links}

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
            self._tell_ends(plc)
        links, ports = self.links(totals), self.ports(totals)
        latency = self._latency.records() if self._latency is not None else {}
        summary = summarise(
            totals, links, ports, scenario=scenario, seed=seed, latency=latency, bounds=bounds or {}
        )
        notes = tuple(self.notes)
        return RunRecord(summary, totals.duration, links, notes, self.left_out, ports, latency)

    def _link(self, bus: str) -> _Link:
        try:
            return self._links[bus]
        except KeyError:
            return self._links.setdefault(bus, _Link())

    def _record(self, totals: LinkTotals) -> LinkRecord:
        link, bus, plc_names = self._link(totals.bus), totals.bus, totals.plc_names
        # Slaves report what they overhear; the link's flags are those of its master.
        in_error = link.in_error.get(totals.master or bus) or Spans()
        return LinkRecord(
            plc_names=plc_names,
            scan_times=link.times,
            after_startup=link.after_startup,
            refresh={
                (name, other): self._meter.pair(bus, source, receiver)
                for source, name in enumerate(plc_names)
                for receiver, other in enumerate(plc_names)
                if source != receiver
            },
            timeline=link.timeline.cells,
            in_error=in_error.all(),
            failed_per_scan=link.failed_per_scan,
        )

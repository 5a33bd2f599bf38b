"""What is counted of one N:N link while a run goes on, and its form in ``histograms.json``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from bussim.results.meters.histogram import Histogram
from bussim.results.meters.plain_data import FLAT, UNKEPT, from_plain, named, to_plain
from bussim.results.meters.refresh import Refresh, RefreshMeter
from bussim.results.meters.timeline import Cell, Span, Spans, Timeline
from bussim.trace.records import LinkTotals, ScanRecord


@dataclass(slots=True)
class ScanTimes:
    """Link scan times of one bus: their histogram, the last one, and when and why the longest was."""

    last: int | None = None
    longest_at: int | None = None
    longest_cause: str = ""
    histogram: Histogram = field(default_factory=Histogram, metadata=FLAT)

    def add(self, scan: ScanRecord) -> None:
        """Take in a scan; of several longest ones the first is kept."""
        longest = self.histogram.maximum
        if longest is None or scan.duration > longest:
            self.longest_at, self.longest_cause = scan.start, scan.cause
        self.histogram.add(scan.duration)
        self.last = scan.duration


class Pairs(dict[tuple[str, str], Refresh]):
    """The refreshes of a link by (source, receiver) names; plain data has a list of them."""

    def to_json(self) -> list[dict[str, Any]]:
        """Plain data, times in ticks."""
        return [
            {"source": source, "receiver": receiver, **to_plain(pair)}
            for (source, receiver), pair in self.items()
        ]

    @classmethod
    def from_json(cls, data: Sequence[Mapping[str, Any]]) -> Pairs:
        """The value of :meth:`to_json`."""
        return cls(((pair["source"], pair["receiver"]), from_plain(Refresh, pair)) for pair in data)


class MasterLost(NamedTuple):
    """A time without the master's frames, in ticks; ``end`` is None where it lasts beyond the run's end.

    It begins where the first link scan that was not completed began, or when the first M8183 came on.
    ``stations`` are the slaves whose watchdog on the master expired, by name; ``scans_missed`` are the link
    scans of median length that fit into the part of it without any.
    """

    start: int
    end: int | None
    stations: tuple[str, ...]
    scans_missed: int


@dataclass(frozen=True, slots=True)
class LinkRecord:
    """One N:N link's statistics.

    ``after_startup`` are the scans that began at or after the link was healthy for the first time.
    ``refresh`` is by (source, receiver) names. ``in_error`` has when each station's error flag
    was on at the master. ``failed_per_scan`` has, by error code (two hexadecimal digits), how many scans had
    how many failed attempts with that code (only scans that had one).

    The summary alone keeps ``onsets`` (how often each station's errors began, at the master),
    ``master_lost``, and what its verdict rests on: the slaves that took the master's parameters after a
    station error (``restarted``), and those to which frames of the master came damaged
    (``master_damaged``), by name.
    """

    plc_names: tuple[str, ...] = field(metadata=named("seats"))
    scan_times: ScanTimes
    after_startup: ScanTimes
    refresh: Pairs = field(default_factory=Pairs)
    timeline: list[Cell] = field(default_factory=list)
    in_error: dict[int, list[Span]] = field(default_factory=dict)
    failed_per_scan: dict[str, dict[int, int]] = field(default_factory=dict)
    onsets: dict[int, int] = field(default_factory=dict, compare=False, metadata=UNKEPT)
    master_lost: list[MasterLost] = field(default_factory=list, compare=False, metadata=UNKEPT)
    restarted: frozenset[str] = field(default_factory=frozenset, compare=False, metadata=UNKEPT)
    master_damaged: frozenset[str] = field(default_factory=frozenset, compare=False, metadata=UNKEPT)


@dataclass(slots=True)
class LinkMeter:
    """Counts one link's scans, failed attempts and stations in error while a run goes on."""

    scan_times: ScanTimes = field(default_factory=ScanTimes)
    after_startup: ScanTimes = field(default_factory=ScanTimes)
    healthy_at: int | None = None
    timeline: Timeline = field(default_factory=Timeline)
    in_error: dict[str, Spans] = field(default_factory=dict)  # by reporter: the PLC, or the bus itself
    flagged: bool = False  # whether one of them may be on
    failed: Counter[int] = field(default_factory=Counter)  # code → failed attempts in the scan under way
    failed_per_scan: dict[int, Counter[int]] = field(default_factory=dict)
    onsets: dict[str, Counter[int]] = field(default_factory=dict)  # by reporter and station
    scans_end: int | None = None
    failed_at: int = 0  # when the latest attempt failed: the master was at work until then
    gaps: Spans = field(default_factory=Spans)  # times between link scans
    lost: dict[str, Spans] = field(default_factory=dict)  # by slave: its watchdog on the master had expired
    restarted: set[str] = field(default_factory=set)
    master_damaged: set[str] = field(default_factory=set)

    def scan(self, record: ScanRecord) -> None:
        """Count a link scan that has ended."""
        self.scan_times.add(record)
        if self.healthy_at is not None and record.start >= self.healthy_at:
            self.after_startup.add(record)
        self.timeline.add(record.start, record.duration)
        if self.scans_end is not None and record.start > self.scans_end:
            self.gaps.on(0, self.scans_end)
            self.gaps.off(0, record.start)
        self.scans_end = record.start + record.duration
        for code, number in self.failed.items():
            self.failed_per_scan.setdefault(code, Counter())[number] += 1
        self.failed.clear()
        if self.flagged and not record.stations_in_error:
            # A master that stops drops its flags without reporting each.
            self.flagged = False
            for spans in self.in_error.values():
                spans.all_off(record.start + record.duration)

    def attempt_failed(self, code: int, tick: int) -> None:
        """Count a failed attempt in the scan under way."""
        self.failed[code] += 1
        self.failed_at = tick

    def healthy(self, tick: int) -> None:
        """Every slave replies; only the first time counts."""
        if self.healthy_at is None:
            self.healthy_at = tick

    def flag(self, reporter: str, station: int, tick: int, *, on: bool) -> None:
        """A station's error flag changed where ``reporter`` sees it."""
        spans = self.in_error.setdefault(reporter, Spans())
        if on:
            self.flagged = True
            self.onsets.setdefault(reporter, Counter())[station] += 1
            spans.on(station, tick)
        else:
            spans.off(station, tick)
            if not station and reporter in self.lost:
                self.lost[reporter].off(0, tick)

    def watchdog(self, slave: str, tick: int) -> None:
        """A slave's watchdog on the master's frames expired."""
        self.lost.setdefault(slave, Spans()).on(0, tick)

    def parameters(self, slave: str, tick: int) -> None:
        """A slave took the master's parameters; after a station error it has restarted."""
        if slave in self.lost:
            self.lost[slave].off(0, tick)
        if self.onsets:
            self.restarted.add(slave)

    def record(self, totals: LinkTotals, refresh: RefreshMeter, duration: int) -> LinkRecord:
        """What was counted in a run of ``duration`` ticks; ``refresh`` has the refresh gaps of all buses."""
        names = totals.plc_names
        # Slaves report what they overhear; the link's flags are those of its master.
        reporter = totals.master or totals.bus
        in_error = self.in_error.get(reporter) or Spans()
        return LinkRecord(
            plc_names=names,
            scan_times=self.scan_times,
            after_startup=self.after_startup,
            refresh=Pairs(
                ((name, other), refresh.pair(totals.bus, source, receiver))
                for source, name in enumerate(names)
                for receiver, other in enumerate(names)
                if source != receiver
            ),
            timeline=self.timeline.cells,
            in_error=in_error.all(),
            failed_per_scan={
                f"{code:02X}": dict(each) for code, each in sorted(self.failed_per_scan.items())
            },
            onsets=dict(self.onsets.get(reporter, {})),
            master_lost=self._master_lost(duration, totals.timeout or 0),
            restarted=frozenset(self.restarted),
            master_damaged=frozenset(self.master_damaged),
        )

    def _master_lost(self, duration: int, timeout: int) -> list[MasterLost]:
        """Times between link scans and expired watchdogs; what overlaps is one."""
        gaps = [span for spans in self.gaps.all().values() for span in spans]
        lost = [(span, name) for name, spans in self.lost.items() for span in spans.all().get(0, [])]
        times = self.scan_times.histogram
        usual = times.quantile(500) or times.mean
        if self.scans_end is not None and any(span.end is None for span, _ in lost):
            # A master at work ends a scan or fails in an attempt before a scan and a timeout have passed.
            since = max(self.scans_end, self.failed_at)
            if duration - since > (usual or 0) + timeout:
                gaps.append(Span(since, None))
        found: list[MasterLost] = []
        without = 0
        for span, name in sorted([*((gap, "") for gap in gaps), *lost], key=lambda each: each[0].start):
            last = found.pop() if found and (found[-1].end is None or span.start <= found[-1].end) else None
            if last is None:
                last, without = MasterLost(span.start, span.start, (), 0), 0
            if not name:
                without += (duration if span.end is None else span.end) - span.start
            end = None if None in (last.end, span.end) else max(last.end or 0, span.end or 0)
            stations = (*last.stations, name) if name and name not in last.stations else last.stations
            found.append(MasterLost(last.start, end, stations, int(without // usual) if usual else 0))
        order = {name: index for index, name in enumerate(self.lost)}
        return [each._replace(stations=tuple(sorted(each.stations, key=order.__getitem__))) for each in found]

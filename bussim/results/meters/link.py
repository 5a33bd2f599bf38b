"""What is counted of one N:N link while a run goes on, and its form in ``histograms.json``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from bussim.results.meters.histogram import Histogram
from bussim.results.meters.plain_data import FLAT, from_plain, named, to_plain
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


@dataclass(frozen=True, slots=True)
class LinkRecord:
    """One N:N link's statistics.

    ``after_startup`` are the scans that began at or after the link was healthy for the first time.
    ``refresh`` is by (source, receiver) names. ``in_error`` has when each station's error flag
    was on at the master. ``failed_per_scan`` has, by error code (two hexadecimal digits), how many scans had
    how many failed attempts with that code (only scans that had one).
    """

    plc_names: tuple[str, ...] = field(metadata=named("seats"))
    scan_times: ScanTimes
    after_startup: ScanTimes
    refresh: Pairs = field(default_factory=Pairs)
    timeline: list[Cell] = field(default_factory=list)
    in_error: dict[int, list[Span]] = field(default_factory=dict)
    failed_per_scan: dict[str, dict[int, int]] = field(default_factory=dict)


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

    def scan(self, record: ScanRecord) -> None:
        """Count a link scan that has ended."""
        self.scan_times.add(record)
        if self.healthy_at is not None and record.start >= self.healthy_at:
            self.after_startup.add(record)
        self.timeline.add(record.start, record.duration)
        for code, number in self.failed.items():
            self.failed_per_scan.setdefault(code, Counter())[number] += 1
        self.failed.clear()
        if self.flagged and not record.stations_in_error:
            # A master that stops drops its flags without reporting each.
            self.flagged = False
            for spans in self.in_error.values():
                spans.all_off(record.start + record.duration)

    def attempt_failed(self, code: int) -> None:
        """Count a failed attempt in the scan under way."""
        self.failed[code] += 1

    def healthy(self, tick: int) -> None:
        """Every slave answers; only the first time counts."""
        if self.healthy_at is None:
            self.healthy_at = tick

    def flag(self, reporter: str, station: int, tick: int, *, on: bool) -> None:
        """A station's error flag changed where ``reporter`` sees it."""
        spans = self.in_error.setdefault(reporter, Spans())
        if on:
            self.flagged = True
            spans.on(station, tick)
        else:
            spans.off(station, tick)

    def record(self, totals: LinkTotals, refresh: RefreshMeter) -> LinkRecord:
        """What was counted; ``refresh`` has the refresh gaps of all buses."""
        names = totals.plc_names
        # Slaves report what they overhear; the link's flags are those of its master.
        in_error = self.in_error.get(totals.master or totals.bus) or Spans()
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
        )

"""What is counted of one N:N link while a run goes on, and its form in ``histograms.json``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

from bussim.results.meters.failures import FailureMeter, Failures, Times
from bussim.results.meters.histogram import Histogram
from bussim.results.meters.plain_data import FLAT, UNKEPT, from_plain, named, to_plain
from bussim.results.meters.refresh import Refresh, RefreshMeter
from bussim.results.meters.timeline import Cell, Span, Spans, Timeline
from bussim.trace.records import LinkTotals, ScanRecord

if TYPE_CHECKING:
    import numpy as np

#: The code of a slave to which a frame of the master came damaged (FX communication manual, chapter 4).
MASTER_DAMAGED = 0x14
#: Link scans that are counted at once.
_COUNTED_AT_ONCE = 2048


@dataclass(slots=True)
class ScanTimes:
    """Link scan times of one bus: their histogram, the last one, and when and why the longest was."""

    last: int | None = None
    longest_at: int | None = None
    longest_cause: str = ""
    histogram: Histogram = field(default_factory=Histogram, metadata=FLAT)

    def add(self, starts: np.ndarray, durations: np.ndarray, causes: Mapping[int, str]) -> None:
        """Take in scans, with causes by start; of several longest ones the first is kept."""
        if len(durations):
            slowest = int(durations.argmax())
            longest = self.histogram.maximum
            if longest is None or durations[slowest] > longest:
                self.longest_at = int(starts[slowest])
                self.longest_cause = causes.get(self.longest_at, "")
            self.histogram.add_array(durations)
            self.last = int(durations[-1])


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

    It lasts from the last valid frame of the master that reached the slaves whose watchdog on it expired
    (``stations``, by name), to the next one; without such slaves from the beginning of the link scan that was
    not completed, or of the run, to that of the next. ``scans_missed`` are the link scans of median length
    that fit into what of it was between link scans, 0 where the master went on with them.
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
    ``master_lost``, and what its verdict rests on: ``failures``, and when each slave's flag of the master
    was on for a damaged frame (``master_damaged``, by name).
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
    failures: Failures = field(default_factory=Failures, compare=False, metadata=UNKEPT)
    master_damaged: dict[str, Times] = field(default_factory=dict, compare=False, metadata=UNKEPT)


@dataclass(slots=True)
class LinkMeter:
    """Counts one link's scans, failed attempts and stations in error while a run goes on."""

    bus: str
    refresh: RefreshMeter
    failures: FailureMeter
    scan_times: ScanTimes = field(default_factory=ScanTimes)
    after_startup: ScanTimes = field(default_factory=ScanTimes)
    healthy_at: int | None = None
    timeline: Timeline = field(default_factory=Timeline)
    in_error: dict[str, Spans] = field(default_factory=dict)  # by reporter: the PLC, or the bus itself
    flagged: bool = False  # whether one of them may be on
    failed: Counter[int] = field(default_factory=Counter)  # code → failed attempts in the scan under way
    failed_per_scan: dict[int, Counter[int]] = field(default_factory=dict)
    onsets: dict[str, Counter[int]] = field(default_factory=dict)  # by reporter and station
    # Scans that are not counted yet (starts and durations), their causes by start, and how many they are.
    _waiting: list[list[Any]] = field(default_factory=list)
    _causes: dict[int, str] = field(default_factory=dict)
    _number: int = 0
    scans_end: int = 0
    failed_at: int = 0  # when the latest attempt failed: the master was at work until then
    gaps: Spans = field(default_factory=Spans)  # times between link scans
    lost: dict[str, Spans] = field(default_factory=dict)  # by slave: its watchdog on the master had expired
    damaged_since: dict[str, int] = field(default_factory=dict)  # by slave: its flag of the master, code 14
    damaged: dict[str, Times] = field(default_factory=dict)

    def scan(self, record: ScanRecord) -> None:
        """Count a link scan that has ended."""
        if record.start > self.scans_end and (self.scans_end or self._master_was_away()):
            self.gaps.on(0, self.scans_end)
            self.gaps.off(0, record.start)
        self._waiting.append([[record.start], [record.duration]])
        if record.cause:
            self._causes[record.start] = record.cause
        self.scans_end = record.start + record.duration
        self._take(1)
        for code, number in self.failed.items():
            self.failed_per_scan.setdefault(code, Counter())[number] += 1
        self.failed.clear()
        flagged = record.stations_in_error > 0
        self.failures.scan(self.scans_end, flagged=flagged)
        if self.flagged and not flagged:
            # A master that stops drops its flags without reporting each.
            self._flags_off(self.scans_end)

    def scans(self, starts: np.ndarray, durations: np.ndarray) -> None:
        """Count link scans in a row without errors, after one that came as a record."""
        self._waiting.append([starts, durations])
        self.scans_end = int(starts[-1] + durations[-1])
        self.failures.ordinary_scans(len(starts), self.scans_end)
        self._take(len(starts))

    def _take(self, number: int) -> None:
        self._number += number
        if self._number >= _COUNTED_AT_ONCE:
            self.count()

    def count(self) -> None:
        """Count the scans that wait for it: many at once are cheaper than one by one."""
        import numpy as np

        if not self._waiting:
            return
        starts, durations = np.concatenate([np.asarray(each) for each in self._waiting], axis=1)
        self.scan_times.add(starts, durations, self._causes)
        if self.healthy_at is not None:
            after = int(starts.searchsorted(self.healthy_at))
            self.after_startup.add(starts[after:], durations[after:], self._causes)
        self.timeline.add(starts, durations)
        self._waiting.clear()
        self._causes.clear()
        self._number = 0

    def _flags_off(self, tick: int) -> None:
        self.flagged = False
        for spans in self.in_error.values():
            spans.all_off(tick)

    def _master_was_away(self) -> bool:
        master = self.failures.master
        return master is not None and self.failures.was_away(master.name)

    def attempt_failed(self, station: int, code: int, tick: int, *, garbled: bool) -> None:
        """Count a failed attempt in the scan under way."""
        self.failed[code] += 1
        self.failed_at = tick
        self.failures.failed(station, code, tick, garbled=garbled)

    def healthy(self, tick: int) -> None:
        """Every slave replies; only the first time counts."""
        if self.healthy_at is None:
            self.healthy_at = tick

    def state(self, plc: str, tick: int, *, running: bool) -> None:
        """A PLC went to RUN, or left it: its flags go off then, a master's that of all its slaves."""
        self.failures.state(plc, tick, running=running)
        if not running:
            self.found_master(plc, tick)
            if self.failures.is_master(plc):
                self._flags_off(tick)

    def flag(self, reporter: str, station: int, tick: int, code: int | None) -> None:
        """A station's error flag changed where ``reporter`` sees it: on with a code, off with None."""
        spans = self.in_error.setdefault(reporter, Spans())
        master = self.failures.master
        if code is not None:
            self.flagged = True
            self.onsets.setdefault(reporter, Counter())[station] += 1
            spans.on(station, tick)
        else:
            spans.off(station, tick)
        if station and (master is None or reporter == master.name):
            self.failures.flag(station, tick, on=code is not None)
        elif not station and code is None:
            self.found_master(reporter, tick)
        elif not station and code == MASTER_DAMAGED:
            self.damaged_since.setdefault(reporter, tick)
            self.failures.master_damaged(reporter, None)

    def watchdog(self, slave: str, heard: int) -> None:
        """A slave's watchdog on the master expired, whose last valid frame there had ended at ``heard``."""
        self.lost.setdefault(slave, Spans()).on(0, heard)

    def found_master(self, slave: str, tick: int) -> None:
        """A slave received a valid frame of the master, or is no longer in RUN."""
        if slave in self.lost:
            self.lost[slave].off(0, tick)
        if slave in self.damaged_since:
            self.damaged.setdefault(slave, Times()).add(self.damaged_since.pop(slave), tick)
            self.failures.master_damaged(slave, tick)

    def record(self, totals: LinkTotals, duration: int) -> LinkRecord:
        """What was counted in a run of ``duration`` ticks."""
        self.count()
        names = totals.plc_names
        # Slaves report what they overhear; the link's flags are those of its master.
        reporter = totals.master or totals.bus
        in_error = self.in_error.get(reporter) or Spans()
        master_lost = self._master_lost(duration, totals.timeout or 0)
        for slave in list(self.damaged_since):
            self.found_master(slave, duration)
        return LinkRecord(
            plc_names=names,
            scan_times=self.scan_times,
            after_startup=self.after_startup,
            refresh=Pairs(
                ((name, other), self.refresh.pair(totals.bus, source, receiver))
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
            master_lost=master_lost,
            failures=self.failures.finish(duration),
            master_damaged=self.damaged,
        )

    def _master_lost(self, duration: int, timeout: int) -> list[MasterLost]:
        """Times between link scans and expired watchdogs; what begins and ends in one link scan is one."""
        gaps = [span for spans in self.gaps.all().values() for span in spans]
        lost = [(span, name) for name, spans in self.lost.items() for span in spans.all().get(0, [])]
        times, master = self.scan_times.histogram, self.failures.master
        usual = times.quantile(500) or times.mean or 0
        if master is not None and self.failures.away(master.name):
            gaps.append(Span(self.scans_end, None))
        elif self.scans_end and any(span.end is None for span, _ in lost):
            # A master at work ends a scan or fails in an attempt before a scan and a timeout have passed.
            since = max(self.scans_end, self.failed_at)
            if duration - since > usual + timeout:
                gaps.append(Span(since, None))

        def end_of(end: int | None) -> int:
            return duration if end is None else end

        def without_scans(each: MasterLost, within: Span) -> int:
            start, end = each.start, end_of(each.end)
            if within in gaps:
                return end - start
            return sum(max(0, min(end, end_of(gap.end)) - max(start, gap.start)) for gap in gaps)

        # Each with the times in which what belongs to it begins.
        found = [(MasterLost(*gap, (), 0), gap) for gap in gaps]
        for span, name in lost:
            for index, (each, within) in enumerate(found):
                begins = within.start - usual <= span.start <= end_of(within.end)
                if begins and abs(end_of(each.end) - end_of(span.end)) <= usual and name not in each.stations:
                    start = min(each.start, span.start) if each.stations else span.start
                    end = None if None in (each.end, span.end) else max(end_of(each.end), end_of(span.end))
                    found[index] = (
                        each._replace(start=start, end=end, stations=(*each.stations, name)),
                        within,
                    )
                    break
            else:
                found.append((MasterLost(*span, (name,), 0), Span(span.start, span.start + int(usual))))
        order = {name: index for index, name in enumerate(self.lost)}
        return sorted(
            (
                each._replace(
                    stations=tuple(sorted(each.stations, key=order.__getitem__)),
                    scans_missed=int(without_scans(each, within) // usual if usual else 0),
                )
                for each, within in found
            ),
            key=lambda each: each.start,
        )

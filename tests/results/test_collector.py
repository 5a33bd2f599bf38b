from __future__ import annotations

import tracemalloc
from dataclasses import replace

import pytest

from bussim.results.collector import MOST_NOTES, Collector
from bussim.trace.records import LinkTotals, NoteRecord, RunTotals, ScanRecord
from bussim.units import TICKS_PER_SECOND
from tests.results.fakes import NODES, Fake, record_of

LINK = LinkTotals(
    bus="link",
    plc_names=NODES,
    station_names=dict(enumerate(NODES)),
    master=NODES[0],
    slaves=2,
    mode=2,
    retries=3,
    attempts=4,
    timeout=3_600_000,
    polls=4,
    failed_attempts={},
    station_errors={},
    busy=0,
    frames=0,
    collisions=0,
    undetected=0,
    healthy_at=None,
)
TOTALS = RunTotals(TICKS_PER_SECOND, (LINK,), ())


def scan(start: int, duration: int, cause: str = "", *, in_error: int = 0, bus: str = "link") -> ScanRecord:
    return ScanRecord(bus, 0, start, duration, 2, 0, in_error, cause)


def test_of_equal_longest_scans_the_first_is_named() -> None:
    collector = Collector()
    for start, duration, cause in ((0, 500, "a"), (500, 900, "b"), (1400, 900, "c"), (2300, 100, "d")):
        collector.take(scan(start, duration, cause))
    times = collector.links(TOTALS)["link"].scan_times
    assert (times.last, times.longest_at, times.longest_cause) == (100, 500, "b")
    assert (times.histogram.minimum, times.histogram.maximum) == (100, 900)


def test_after_startup_counts_scans_that_began_when_the_link_was_healthy() -> None:
    collector = Collector()
    collector.take(scan(0, 1000, "late station"))
    collector.take(NoteRecord(1500, "healthy", "link", "", {}))
    collector.take(scan(1000, 800))  # began before
    collector.take(NoteRecord(2600, "healthy", "link", "", {}))  # only the first time counts
    collector.take(scan(1800, 700, "noise"))
    collector.take(scan(2500, 600))
    after = collector.links(TOTALS)["link"].after_startup
    assert after.histogram.count == 2
    assert (after.histogram.maximum, after.longest_at, after.longest_cause) == (700, 1800, "noise")


def test_a_scan_that_begins_at_the_very_tick_is_after_startup() -> None:
    collector = Collector()
    collector.take(NoteRecord(1800, "healthy", "link", "", {}))
    collector.take(scan(1800, 700))
    assert collector.links(TOTALS)["link"].after_startup.histogram.count == 1


def test_a_link_that_never_was_healthy_has_nothing_after_startup() -> None:
    collector = Collector()
    collector.take(scan(0, 1000))
    assert collector.links(TOTALS)["link"].after_startup.histogram.count == 0


def test_failed_attempts_are_counted_by_scan_and_code() -> None:
    collector = Collector()
    for number, codes in enumerate(([1, 1, 4], [], [1, 1], [4])):
        for code in codes:
            collector.failed("link", 0, 1, code)
        collector.take(scan(1000 * number, 1000))
    assert collector.links(TOTALS)["link"].failed_per_scan == {"01": {2: 2}, "04": {1: 2}}


def test_buses_are_kept_apart() -> None:
    other = replace(LINK, bus="other")
    collector = Collector()
    collector.take(scan(0, 100))
    collector.take(scan(0, 300, bus="other"))
    links = collector.links(RunTotals(TICKS_PER_SECOND, (LINK, other), ()))
    assert links["link"].scan_times.histogram.maximum == 100
    assert links["other"].scan_times.histogram.maximum == 300


def test_flags_are_those_that_the_master_reports() -> None:
    collector = Collector(bus_of=dict.fromkeys(NODES, "link"))
    collector.take(NoteRecord(100, "station_error", "press1", "", {"station": 1}))
    collector.take(NoteRecord(120, "station_error", "press3", "", {"station": 2}))
    collector.take(NoteRecord(400, "recovered", "press1", "", {"station": 1}))
    collector.take(NoteRecord(500, "station_error", "press1", "", {"station": 2}))
    assert collector.links(TOTALS)["link"].in_error == {1: [(100, 400)], 2: [(500, None)]}


def test_flags_that_went_with_the_master_end_with_the_next_scan_without_one() -> None:
    collector = Collector(bus_of=dict.fromkeys(NODES, "link"))
    collector.take(NoteRecord(100, "station_error", "press1", "", {"station": 1}))
    collector.take(scan(0, 100, in_error=1))
    collector.take(scan(1000, 100))
    collector.take(scan(1100, 100))
    assert collector.links(TOTALS)["link"].in_error == {1: [(100, 1100)]}


def test_faults_are_always_kept_and_other_notes_up_to_a_bound() -> None:
    collector = Collector()
    for tick in range(MOST_NOTES + 500):
        collector.take(NoteRecord(tick, "watchdog", "press2", "", {}))
    for tick in range(50):
        collector.take(NoteRecord(10_000 + tick, "fault", "f", "", {}))
        collector.take(NoteRecord(10_000 + tick, "fault_over", "f", "", {}))
    kinds = [note.kind for note in collector.notes]
    assert kinds.count("watchdog") == MOST_NOTES
    assert kinds.count("fault") == kinds.count("fault_over") == 50
    assert collector.left_out == {"watchdog": 500}


def test_refresh_gaps_of_all_pairs() -> None:
    collector = Collector()
    fake = Fake(duration=20 * TICKS_PER_SECOND, loss=0.0)
    record = record_of(fake.feed(collector), collector)
    pairs = record.links["link"].refresh
    assert set(pairs) == {(a, b) for a in NODES for b in NODES if a != b}
    # press2 is off from 10 s to 15 s: it neither refreshes nor is refreshed.
    for source, receiver in pairs:
        longest = pairs[source, receiver].gaps.maximum
        assert longest is not None
        away = "press2" in (source, receiver)
        assert (longest > 4.9 * TICKS_PER_SECOND) == away


@pytest.mark.slow
def test_memory_does_not_grow_with_the_run() -> None:
    def peak(duration: int) -> int:
        collector = Collector()
        fake = Fake(duration=duration, loss=0.05)
        tracemalloc.start()
        try:
            record_of(fake.feed(collector), collector)
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    short, long = peak(4 * 60 * TICKS_PER_SECOND), peak(30 * 60 * TICKS_PER_SECOND)
    # Seven times the scans; all that may still grow is the number of occupied bins
    # and cells, which have an end.
    assert long < 1.5 * short

"""Why a link scan took so long: its parts, to the tick."""

from __future__ import annotations

from itertools import pairwise

import bussim
from bussim.report.scene import scene_of
from bussim.report.trace_window import Part, TraceWindow, in_words, parts_of_scan, read_window, worst_window
from bussim.trace.records import ScanRecord
from bussim.units import TICKS_PER_MS
from tests.report.samples import eight_folder, longest, opened

CHARACTER = 10 / 38.4
GAP = 0.4175
POLL = 5 * CHARACTER


def test_the_parts_of_every_link_scan_add_up_to_its_duration() -> None:
    trace, record = opened(eight_folder())
    whole = read_window(trace, record, "link", 0, record.duration)
    assert len(whole.scans) > 60
    assert any(scan.failed for scan in whole.scans)
    for scan in whole.scans:
        parts = parts_of_scan(whole, scan)
        assert sum(part.ticks for part in parts) == scan.duration
        assert parts[0].start == scan.start
        assert all(one.end == other.start for one, other in pairwise(parts))
        assert sum(part.lost and part.attempt > 0 for part in parts) == scan.failed
        assert sum(part.attempt > 0 for part in parts) == scan.attempts


def test_a_silent_attempt_costs_gap_poll_and_timeout() -> None:
    window = longest(eight_folder())
    silent = [
        part
        for scan in window.scans
        for part in parts_of_scan(window, scan)
        if part.what.endswith("no reply, code 01")
    ]
    assert silent
    for part in silent:
        assert abs(part.ticks / TICKS_PER_MS - (GAP + POLL + 100)) < 1e-3


def test_the_sentence_names_station_attempt_code_and_time() -> None:
    scene = scene_of(longest(eight_folder()))
    (sentence,) = scene.why
    assert "took 2" in sentence
    assert "no reply, code 01" in sentence
    assert "101.720 ms" in sentence
    assert "polls with a reply" in sentence


def test_attempts_that_failed_alike_are_told_once(tmp_path) -> None:  # type: ignore[no-untyped-def]
    run = bussim.run("press_line", out=tmp_path / "run", trace=True)
    trace, record = opened(tmp_path / "run")
    window = worst_window(trace, record, "link")
    assert window is not None
    window = read_window(trace, record, "link", *window)
    (sentence,) = scene_of(window).why
    assert "6 × 51.720 ms (attempts 1 to 6 at station 1 (press2): no reply, code 01)" in sentence
    assert f"{run.summary['links']['link']['scan_time_ms']['max']:.3f} ms" in sentence
    assert "4.063 ms (parameter frame)" in sentence


def test_parts_that_differ_are_told_apart() -> None:
    parts = [
        Part(0, 72_000, "data frame of a"),
        Part(72_000, 144_000, "at station 1: reply", 1),
        Part(144_000, 216_000, "at station 2: damaged, code 04", 1, lost=True),
        Part(216_000, 360_000, "at station 2: damaged, code 04", 2, lost=True),
        Part(360_000, 432_000, "at station 2: reply", 3),
        Part(432_000, 504_000, "overhead of the scan"),
    ]
    assert in_words(parts) == [
        "2.000 ms (data frame of a, 1 poll with a reply)",
        "1.000 ms (attempt 1 at station 2: damaged, code 04)",
        "2.000 ms (attempt 2 at station 2: damaged, code 04)",
        "2.000 ms (overhead of the scan, 1 poll with a reply)",
    ]


def test_without_the_records_a_scan_is_one_part() -> None:
    window = longest(eight_folder())
    scan = ScanRecord("link", 5, window.end + 1000, 5000, 2, 0, 0, "")
    assert [(part.ticks, part.what) for part in parts_of_scan(window, scan)] == [
        (5000, "overhead of the scan")
    ]


def test_a_scan_with_a_late_reply_names_the_station() -> None:
    scan = ScanRecord("link", 5, 0, 5000, 1, 0, 0, "station 1 (b) replied 15 ms after its poll")
    (sentence,) = scene_of(TraceWindow("link", 0, 9000, ("a", "b"), scans=[scan])).why
    assert sentence.endswith("overhead of the scan); station 1 (b) replied 15 ms after its poll.")
    assert "a plain one has not" not in sentence

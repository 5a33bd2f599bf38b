"""Why a link scan took so long: its parts, to the tick."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import bussim
from bussim.report.scene import scene_of
from bussim.report.trace_window import Part, TraceWindow, in_words, parts_of_scan, read_window, worst_window
from bussim.scenario import builtin
from bussim.trace.records import ScanRecord
from bussim.units import TICKS_PER_MS
from tests.report.samples import eight_folder, longest, opened
from tests.selection import quick_names

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


def test_attempts_that_failed_alike_are_named_once(tmp_path) -> None:  # type: ignore[no-untyped-def]
    run = bussim.run("press_line", out=tmp_path / "run", trace=True)
    trace, record = opened(tmp_path / "run")
    window = worst_window(trace, record, "link")
    assert window is not None
    window = read_window(trace, record, "link", *window)
    (sentence,) = scene_of(window).why
    silent = "(attempts 1 to 6 at station 1 (press2): no reply, code 01, 51.720 ms each)"
    assert f"310.318 ms {silent}" in sentence
    assert f"{run.summary['links']['link']['scan_time_ms']['max']:.3f} ms" in sentence
    assert "ms (parameter frame); 314.38" in sentence
    assert sentence.endswith(" ms of it went to failed attempts and the parameter frame.")


def test_parts_that_differ_are_distinguished() -> None:
    parts = [
        Part(0, 72_000, "data frame of a"),
        Part(72_000, 144_000, "at station 1: reply", 1, ordinary=True),
        Part(144_000, 216_000, "at station 2: damaged, code 04", 1, lost=True),
        Part(216_000, 360_000, "at station 2: damaged, code 04", 2, lost=True),
        Part(360_000, 432_000, "at station 2: reply", 3, ordinary=True),
        Part(432_000, 504_000, "overhead of the scan"),
    ]
    assert in_words(parts) == (
        "7.000 ms: 2.000 ms (data frame of a, 1 poll with a reply) "
        "+ 1.000 ms (attempt 1 at station 2: damaged, code 04) "
        "+ 2.000 ms (attempt 2 at station 2: damaged, code 04) "
        "+ 2.000 ms (overhead of the scan, 1 poll with a reply)"
        "; 3.000 ms of it went to failed attempts"
    )


def microseconds(text: str) -> int:
    return round(1000 * float(text))


def check_sum(sentence: str) -> None:
    """Assert that what a sentence lists adds up to the time that stands before it, to the last digit."""
    took = re.search(r"([0-9.]+) ms: (.*)", sentence)
    assert took
    listed, _, lost = took[2].partition("; ")
    times = re.findall(r"(?:^| \+ )([0-9.]+) ms \(", listed)
    assert sum(map(microseconds, times)) == microseconds(took[1])
    failed = re.findall(r"([0-9.]+) ms \((?=attempts? \d+[^+]*code|parameter)", listed)
    if "of it went to" in lost:
        assert sum(map(microseconds, failed)) == microseconds(lost.split(" ms")[0])


#: What a part of a random link scan was, and whether it was lost.
KINDS = st.sampled_from(
    [
        ("data frame of a", 0, False),
        ("at station 1: reply", 1, False),
        ("at station 2: damaged, code 04", 1, True),
        ("at station 2: no reply, code 01", 2, True),
    ]
)
TICKS = st.integers(1, 10**8)


@given(st.lists(st.tuples(KINDS, TICKS), min_size=1, max_size=20), st.integers(0, 10**10), st.none() | TICKS)
def test_the_times_of_any_scan_add_up_to_the_microsecond(
    found: list[tuple[tuple[str, int, bool], int]], start: int, parameters: int | None
) -> None:
    parts = []
    for (what, attempt, lost), ticks in found:
        parts.append(Part(start, start + ticks, what, attempt, lost=lost))
        start += ticks
    if parameters is not None:
        parts.append(Part(start, start + parameters, "parameter frame", lost=True))
    check_sum(in_words(parts))


@pytest.mark.parametrize("name", quick_names(["undetected_corruption"], builtin.names()))
@pytest.mark.usefixtures("pictures_undrawn")
def test_every_explanation_of_a_built_in_scenario_adds_up(name: str, tmp_path: Path) -> None:
    bussim.run(bussim.load(name, ["duration=15 s"]), out=tmp_path / "run", trace=True)
    trace, record = opened(tmp_path / "run")
    for bus, link in record.links.items():
        window = read_window(trace, record, bus, 0, record.duration)
        for scan in window.scans:
            parts = parts_of_scan(window, scan)
            assert sum(part.ticks for part in parts) == scan.duration
            check_sum(in_words(parts))
        assert len(window.scans) == link.scan_times.histogram.count
        for sentence in scene_of(window).why:
            check_sum(sentence)


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

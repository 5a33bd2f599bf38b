from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest

from bussim.results.collector import Collector
from bussim.trace.records import NoteRecord, PlcTotals, RunTotals, ScanRecord
from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND
from bussim.version import __version__
from tests.results.fakes import NODES, REGISTERS, Fake
from tests.results.test_collector import LINK

STATISTICS = {"min", "mean", "p50", "p95", "p99", "p999", "max", "max_at_s", "max_cause"}


@pytest.fixture(scope="module")
def summary() -> dict[str, Any]:
    return Fake().run().summary


def test_the_keys_are_those_of_the_contract(summary: dict[str, Any]) -> None:
    assert list(summary) == [
        "schema",
        "bussim",
        "scenario",
        "seed",
        "duration_s",
        "links",
        "buses",
        "plcs",
        "ports",
        "devices",
        "warnings",
        "verdict",
    ]
    assert list(summary["links"]["link"]) == [
        "stations",
        "mode",
        "retries",
        "attempts",
        "timeout_ms",
        "scans",
        "bus_load",
        "scan_time_ms",
        "polls",
        "failed_attempts",
        "station_errors",
        "station_error_onsets",
        "master_lost",
        "refresh_gap_ms",
        "undetected_frames",
        "collisions",
        "healthy_at_s",
    ]
    times = summary["links"]["link"]["scan_time_ms"]
    assert set(times) == {"current", "after_startup"} | STATISTICS
    assert set(times["after_startup"]) == STATISTICS
    gaps = summary["links"]["link"]["refresh_gap_ms"]
    assert set(gaps) == {f"{a}->{b}" for a in NODES for b in NODES if a != b}
    assert all(set(pair) == {"p50", "p99", "p999", "max", "open", "count"} for pair in gaps.values())
    assert set(summary["plcs"]["press1"]) == {"registers", "scan_ms"}
    assert set(summary["plcs"]["press1"]["scan_ms"]) == {"mean", "max"}


def test_the_types_are_those_of_the_contract(summary: dict[str, Any]) -> None:
    link = summary["links"]["link"]
    assert (summary["schema"], summary["bussim"], summary["seed"]) == (1, __version__, 7)
    assert (summary["duration_s"], type(summary["duration_s"])) == (60.0, float)
    assert (link["timeout_ms"], type(link["timeout_ms"])) == (50, int)
    assert type(link["bus_load"]) is float
    assert (link["stations"], link["mode"], link["retries"], link["attempts"]) == (3, 2, 5, 6)
    assert summary["plcs"]["press2"] == {"registers": REGISTERS, "scan_ms": {"mean": 8.8, "max": 9.9}}
    assert (summary["ports"], summary["devices"], summary["warnings"]) == ({}, {}, ["a warning"])
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary


def test_only_what_failed_is_in_failed_attempts_but_every_station_in_station_errors(
    summary: dict[str, Any],
) -> None:
    link = summary["links"]["link"]
    assert list(link["failed_attempts"]) == ["1"]
    assert list(link["failed_attempts"]["1"]) == ["01"]  # code 04 never occurred
    assert list(link["station_errors"]) == ["1", "2"]
    assert link["station_errors"]["2"] == 0


def test_codes_are_two_hexadecimal_digits() -> None:
    link = replace(LINK, failed_attempts={2: {0x04: 1, 0x01: 3, 0x21: 2}, 1: {0x03: 0}})
    totals = RunTotals(TICKS_PER_SECOND, (link,), ())
    summary = Collector().run(totals, scenario="s", seed=1).summary
    assert summary["links"]["link"]["failed_attempts"] == {"2": {"01": 3, "04": 1, "21": 2}}


def numbers(*durations_ms: float) -> dict[str, Any]:
    collector, start = Collector(), 0
    for number, duration in enumerate(durations_ms):
        ticks = round(duration * TICKS_PER_MS)
        collector.take(ScanRecord("link", number, start, ticks, 2, 0, 0, "noise" if ticks > 4e6 else ""))
        start += ticks
    totals = RunTotals(60 * TICKS_PER_SECOND, (LINK,), ())
    result: dict[str, Any] = collector.run(totals, scenario="s", seed=1).summary
    times: dict[str, Any] = result["links"]["link"]["scan_time_ms"]
    return times


def test_statistics_of_known_scans() -> None:
    times = numbers(*[50.0] * 989, 349.3, *[50.2] * 10)
    assert times["current"] == 50.2
    assert times["min"] == 50.0
    assert times["mean"] == round((50.0 * 989 + 349.3 + 50.2 * 10) / 1000, 6)
    assert (times["p50"], times["p95"], times["p99"]) == (50.0, 50.0, 50.2)
    assert times["p999"] is None  # one sample lies beyond it: not the maximum in disguise
    assert (times["max"], times["max_at_s"], times["max_cause"]) == (349.3, 49.45, "noise")


def test_a_plain_longest_scan_has_an_empty_cause() -> None:
    times = numbers(50.0, 50.1)
    assert (times["max"], times["max_at_s"], times["max_cause"]) == (50.1, 0.05, "")


def test_a_link_without_a_working_master() -> None:
    link = replace(LINK, slaves=None, mode=None, retries=None, attempts=None, timeout=None)
    totals = RunTotals(TICKS_PER_SECOND, (link,), (PlcTotals("press1", {}, 0, None, None),))
    summary = Collector().run(totals, scenario="s", seed=1).summary
    result = summary["links"]["link"]
    assert result["scans"] == 0
    assert [result[key] for key in ("mode", "retries", "attempts", "timeout_ms")] == [None] * 4
    assert result["station_errors"] == result["failed_attempts"] == {}
    times = result["scan_time_ms"]
    assert all(times[key] is None for key in STATISTICS | {"current"})
    assert all(times["after_startup"][key] is None for key in STATISTICS)
    assert result["healthy_at_s"] is None
    assert summary["plcs"]["press1"]["scan_ms"] == {"mean": None, "max": None}


def test_the_gap_open_at_the_end_stands_apart() -> None:
    collector = Collector()
    for tick in (0, 50 * TICKS_PER_MS, 110 * TICKS_PER_MS):
        collector.refreshed("link", 0, tick, [1])
    totals = RunTotals(TICKS_PER_SECOND, (LINK,), ())
    gaps = collector.run(totals, scenario="s", seed=1).summary["links"]["link"]["refresh_gap_ms"]
    assert gaps["press1->press2"] == {
        "p50": None,
        "p99": None,
        "p999": None,
        "max": 60.0,
        "open": 890.0,
        "count": 2,
    }
    never = {"p50": None, "p99": None, "p999": None, "max": None, "open": 1000.0, "count": 0}
    assert gaps["press1->press3"] == never
    assert gaps["press3->press1"] == never


def test_healthy_and_notes_do_not_disturb_the_order_of_links() -> None:
    other = replace(LINK, bus="a second one", healthy_at=TICKS_PER_SECOND // 2)
    totals = RunTotals(TICKS_PER_SECOND, (LINK, other), ())
    collector = Collector()
    collector.take(NoteRecord(1, "healthy", "a second one", "", {}))
    summary = collector.run(totals, scenario="s", seed=1).summary
    assert list(summary["links"]) == ["link", "a second one"]
    assert summary["links"]["a second one"]["healthy_at_s"] == 0.5

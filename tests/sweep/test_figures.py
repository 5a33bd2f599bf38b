from __future__ import annotations

import pytest

from bussim import api
from bussim.sweep.figures import (
    LINK_FIGURES,
    figures_of,
    in_order,
    is_event_count,
    kinds_in,
    rare_count_of,
)
from bussim.sweep.jobs import masters_of


def test_the_figures_of_a_run_are_those_of_its_summary() -> None:
    scenario = api.load("press_line", ["duration=8s", "noise=[{bus: link, ber: 5e-4}]"])
    summary = api.run(scenario, rows=False).summary
    link = summary["links"]["link"]
    found = figures_of(summary, masters_of(scenario))
    assert found["link.scans"] == link["scans"] > 50
    assert found["link.scan_time_mean_ms"] == link["scan_time_ms"]["mean"]
    assert found["link.scan_time_p999_ms"] is link["scan_time_ms"]["p999"] is None
    assert found["link.scan_time_max_after_startup_ms"] == link["scan_time_ms"]["after_startup"]["max"]
    by_code: dict[str, int] = {}
    for codes in link["failed_attempts"].values():
        for code, count in codes.items():
            by_code[code] = by_code.get(code, 0) + count
    assert len(by_code) > 1
    assert {f"link.failed_attempts_{code}": count for code, count in by_code.items()}.items() <= found.items()
    assert found["link.failed_attempts"] == sum(by_code.values())
    assert found["link.station_errors_1"] == link["station_errors"]["1"]
    assert found["link.station_errors"] == sum(link["station_errors"].values())
    master = masters_of(scenario)["link"]
    assert found["link.D8202"] == summary["plcs"][master]["registers"]["D8202"] > 0
    gaps = link["refresh_gap_ms"].values()
    assert found["link.refresh_gap_max_ms"] == max(max(gap["max"], gap["open"]) for gap in gaps)


def test_a_station_that_is_never_heard_again_has_the_longest_gap() -> None:
    scenario = api.load("two_stations", ["duration=5s", "faults=[{at: 2 s, power_off: feeder}]"])
    found = figures_of(api.run(scenario, rows=False).summary, {})
    gap = found["link.refresh_gap_max_ms"]
    assert gap is not None
    assert gap == pytest.approx(3000, abs=100)
    assert found["link.D8202"] is None  # without a known master


def test_ports_and_devices_give_their_numbers() -> None:
    summary = {
        "links": {},
        "buses": {
            "feeder": {"baud": 9600, "bus_load": 0.3, "frames": 7, "collisions": 1, "undetected_frames": 0}
        },
        "plcs": {},
        "ports": {"press1.COM3": {"ok": 299, "response_ms": {"p50": 58.1, "max": None}, "on": True}},
        "devices": {"feeder1": {"requests": 300, "exceptions": {}, "model": "stepper"}},
    }
    assert figures_of(summary, {}) == {
        "feeder.bus_load": 0.3,
        "feeder.frames": 7,
        "feeder.collisions": 1,
        "feeder.undetected_frames": 0,
        "press1.COM3.ok": 299,
        "press1.COM3.response_ms.p50": 58.1,
        "press1.COM3.response_ms.max": None,
        "feeder1.requests": 300,
    }


def test_columns_have_one_order() -> None:
    names = [
        "b.scans", "b.failed_attempts", "b.failed_attempts_01", "b.failed_attempts_0A", "b.station_errors_1",
        "b.station_errors_10", "b.bus_load", "a.scans", "a.station_errors_2", "a.COM3.ok", "z.scans",
    ]  # fmt: skip
    numbers = ["b.station_errors_1", "b.station_errors_2", "b.station_errors_10"]
    assert in_order(reversed(names), ["b", "a"]) == names
    assert in_order(reversed(numbers), ["b"]) == numbers
    assert in_order([f"x.{name}" for name in sorted(LINK_FIGURES)], ["x"]) == [f"x.{n}" for n in LINK_FIGURES]


def test_what_counts_events() -> None:
    for name in ("link.failed_attempts", "l.failed_attempts_0A", "l.station_errors_3", "l.collisions"):
        assert is_event_count(name)
        assert is_event_count(f"press1.COM3.{name}")
    for name in (
        "timeouts",
        "exceptions.02",
        "errors.09",
        "other_errors.frame length",
        "polls.p.failed_turns",
    ):
        assert is_event_count(f"press1.COM3.{name}")
    for name in ("link.scans", "link.bus_load", "link.scan_time_max_ms", "collisions.scans", "p.COM3.ok"):
        assert not is_event_count(name)


def test_latencies_give_their_times_and_shares() -> None:
    summary = api.run(api.load("interlock", ["duration=20s"]), rows=False).summary
    found = figures_of(summary, {})
    entry = summary["latency"]["door-to-run"]
    for key, value in entry["ms"].items():
        assert found[f"latency.door-to-run.ms.{key}"] == value
    assert found["latency.door-to-run.bound_ms.1 lost reply"] == entry["bound_ms"]["1 lost reply"] > 100
    assert found["latency.door-to-run.parts_ms.turn.mean"] == entry["parts_ms"]["turn"]["mean"] > 0
    assert "latency.door-to-run.max_at_s" not in found
    names = ["latency.door-to-press1", "latency.door-to-feeder", "latency.door-to-run"]
    assert kinds_in(found, ["link"]) == {"link": "link", **dict.fromkeys(names, "latency")}


def test_shares_are_of_the_changes_whose_outcome_is_known() -> None:
    bit = {"edge": "both", "changes": 50, "delivered": 30, "lost": 8, "unseen": 2, "open": 10}
    word = {"edge": None, "changes": 9, "delivered": 700, "lost": 0, "unseen": 0, "open": 0}
    nothing = {**bit, "changes": 10, "delivered": 0, "lost": 0, "unseen": 0}
    times = {"ms": {"max": 60.5}, "parts_ms": {}}
    latency = {"a.b": bit | times, "age": word | times, "none": nothing | times}
    found = figures_of({"links": {}, "buses": {}, "ports": {}, "devices": {}, "latency": latency}, {})
    assert (found["latency.a.b.lost_share"], found["latency.a.b.unseen_share"]) == (0.2, 0.05)
    assert found["latency.none.lost_share"] is found["latency.none.unseen_share"] is None
    assert {name: found[name] for name in found if name.startswith("latency.age.")} == {
        "latency.age.changes": 9,
        "latency.age.delivered": 700,
        "latency.age.ms.max": 60.5,
    }
    kinds = {"latency.a.b": "latency", "latency.age": "data age", "latency.none": "latency"}
    assert kinds_in(found, []) == kinds
    for name in ("lost", "lost_share", "unseen", "unseen_share"):
        assert is_event_count(f"latency.a.b.{name}")
    for name in ("latency.a.delivered", "latency.lost", "latency.a.lost.ms.max", "p.COM3.lost"):
        assert not is_event_count(name)


def test_whose_rare_counts_are() -> None:
    assert rare_count_of("link.failed_attempts_04") == "link"
    assert rare_count_of("press1.COM3.exceptions.02") == "press1.COM3"
    assert rare_count_of("press1.COM3.other_errors.no response. At all") == "press1.COM3"
    assert rare_count_of("drive.rejected.framing error") == "drive"
    for name in ("link.failed_attempts", "press1.COM3.timeouts", "press1.COM3.ok"):
        assert rare_count_of(name) is None


def test_a_run_with_ports_gives_their_metrics_by_name() -> None:
    summary = api.run(api.load("stepper_positioning", ["duration=4s"]), rows=False).summary
    found = figures_of(summary, {})
    port = summary["ports"]["press.COM3"]
    assert found["press.COM3.response_ms.max"] == port["response_ms"]["max"] > 35
    assert found["press.COM3.response_ms.p99"] is port["response_ms"]["p99"] is None
    age = port["polls"]["position"]["age_ms"]
    assert found["press.COM3.polls.position.age_ms.before_refresh.max"] == age["before_refresh"]["max"] > 0
    assert found["press.COM3.cycle_ms.count"] == port["cycle_ms"]["count"]
    assert found["axis.bus_load"] == summary["buses"]["axis"]["bus_load"]
    assert found["drive.requests"] == summary["devices"]["drive"]["requests"]
    assert kinds_in(found, ["axis"]) == {"press.COM3": "Modbus master"}

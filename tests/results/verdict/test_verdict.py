"""Verdicts name what was wrong, wherever they are read, and nothing where nothing was."""

from __future__ import annotations

import html
import io
import random
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from rich.console import Console

import bussim
from bussim.report.page import report_page
from bussim.report.runs import Source
from bussim.results.result import Result
from bussim.results.text.run import show_result
from bussim.results.verdict.verdict import faults
from bussim.sim.faults import FaultPlan
from tests.selection import quick

from .cases import ONE_THING_WRONG, SYMPTOMS, Case, Data, healthy, link, modbus


def run(scenario: Data, folder: Path) -> Result:
    path = folder / "scenario.yaml"
    path.write_text(yaml.safe_dump(scenario, sort_keys=False), encoding="utf-8")
    return bussim.run(path, rows=False)


def console(result: Result) -> str:
    output = io.StringIO()
    show_result(Console(file=output, width=80), result.record, {})
    return output.getvalue()


def page(result: Result) -> str:
    return html.unescape(report_page([Source("run", "run", result.record, "schema: 1\n")]))


def items(result: Result) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = result.summary["verdict"]
    return found


#: What takes longest to simulate: in the slow pass.
LONG = {"jabber", "jabbering_master", "noise_at_the_masters_receiver", "same_number", "two_masters"}
ONE = [
    pytest.param(make, marks=pytest.mark.slow) if make.__name__ in LONG else make for make in ONE_THING_WRONG
]


@pytest.mark.parametrize("make", ONE, ids=lambda make: str(make.__name__))
def test_the_one_thing_that_is_wrong_is_named(make: Callable[[random.Random], Case], tmp_path: Path) -> None:
    case = make(random.Random(ONE_THING_WRONG.index(make)))
    result = run(case.scenario, tmp_path)
    wrong = faults(items(result))
    named = [
        item for item in wrong if item["key"] == case.key and case.values.items() <= item["values"].items()
    ]
    assert len(named) == 1, [item["text"] for item in wrong]
    assert {item["key"] for item in wrong} - SYMPTOMS - case.others - {case.key} == set()
    text = named[0]["text"]
    assert f"  {text}\n" in console(result)
    assert f"<li>{text}</li>" in page(result)


@pytest.mark.parametrize("seed", range(20))
def test_where_nothing_is_wrong_nothing_is_named(seed: int, tmp_path: Path) -> None:
    result = run(healthy(seed), tmp_path)
    assert faults(items(result)) == []
    well = ("no_station_in_error", "own_data", "messages_whole")
    assert any(item["key"] in well for item in items(result))


@pytest.mark.parametrize("make", quick(2, ONE_THING_WRONG[::4]), ids=lambda make: str(make.__name__))
def test_a_verdict_rests_on_no_fault_of_the_scenario(
    make: Callable[[random.Random], Case], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where faults act without a word in the records, it is the same."""
    case = make(random.Random(0))
    told = run(case.scenario, tmp_path)
    monkeypatch.setattr(FaultPlan, "_note", lambda *_: None)
    untold = run(case.scenario, tmp_path)
    assert not [note for note in untold.record.notes if note.kind.startswith("fault")]
    assert items(untold) == items(told)
    assert faults(items(told))


def test_a_little_noise_is_not_called_healthy_where_a_station_shows_it(tmp_path: Path) -> None:
    line = healthy(1)
    line["noise"] = [{"bus": "link", "ber": 1e-5}]
    result = run(line, tmp_path)
    assert [item["key"] for item in faults(items(result))] == ["master_damaged"]
    assert not [item for item in items(result) if item["key"] == "no_station_in_error"]


def test_a_receiver_that_fails_in_two_ways_by_turns_is_noisy(tmp_path: Path) -> None:
    """Of its failures some come with a data frame of the master, some without: one sentence, of them all."""
    line = link(random.Random(4), duration="10 s")
    line["plcs"] = line["plcs"][:3]
    line["plcs"][0]["nn"] |= {"slaves": 2, "mode": 0, "retries": 0, "timeout": "50 ms"}
    line["noise"] = [{"bus": "link", "station": "plc1", "direction": "rx", "ber": 4e-3}]
    result = run(line, tmp_path)
    said = {item["key"]: item for item in faults(items(result))}
    assert said["cause_noisy"]["values"]["station"] == "station 1 (plc1)"
    onsets = result.summary["links"]["link"]["station_error_onsets"]
    assert said["cause_noisy"]["values"]["when"]["times"] == onsets["1"] > 4
    assert {key for key in said if key.startswith("cause")} == {"cause_noisy"}
    assert "received frames of the master now whole, now damaged" in said["cause_noisy"]["text"]


@pytest.mark.slow
def test_each_outage_has_its_own_cause(tmp_path: Path) -> None:
    """A jabbering station does not hide that another one had no supply, nor that its replies were lost."""
    line = link(random.Random(3))
    line["faults"] = [
        {"at": "3 s", "for": "2 s", "jabber": "plc2"},
        {"at": "8 s", "for": "2 s", "drop_reply": "plc1"},
        {"at": "13 s", "for": "2 s", "power_off": "plc1"},
    ]
    said = {item["key"]: item["values"] for item in faults(items(run(line, tmp_path)))}
    assert said["no_frame"]["node"] == "plc2"
    assert said["not_running"]["plc"] == "plc1"
    when = said["cause_no_reply"]["when"]
    assert when["times"] == 1
    assert 8 <= when["from_s"] <= 9
    assert when["from_s"] + when["for_s"] == pytest.approx(10, abs=0.5)


@pytest.mark.parametrize(
    ("fault", "cause"),
    [
        ({"drop_reply": "plc2"}, "cause_no_reply"),
        ({"cable_cut": {"bus": "link", "after": "plc1"}}, "cause_cut"),  # within a frame
    ],
    ids=["lost replies", "cable"],
)
def test_a_late_station_does_not_hide_what_another_one_has(fault: Data, cause: str, tmp_path: Path) -> None:
    line = link(random.Random(3))
    line["plcs"] = line["plcs"][:3]
    line["plcs"][0]["nn"] |= {"slaves": 2, "mode": 2, "retries": 3, "timeout": "50 ms"}
    line["faults"] = [
        {"at": "5 s", "for": "5 s", "slow": {"station": "plc1", "extra": "60 ms"}},
        {"at": "6 s", "for": "2 s", **fault},
    ]
    said = {item["key"]: item["values"] for item in faults(items(run(line, tmp_path)))}
    assert said["late_replies"]["node"] == "plc1"
    assert said[cause]["station"] == "station 2 (plc2)"
    assert 6 <= said[cause]["when"]["from_s"] <= 7


def test_a_jabber_within_a_cut_takes_no_cause_away_and_each_time_counts(tmp_path: Path) -> None:
    line = link(random.Random(5))
    line["plcs"] = line["plcs"][:4]
    line["plcs"][0]["nn"] |= {"slaves": 3, "mode": 2, "retries": 3, "timeout": "50 ms"}
    line["faults"] = [
        {"at": "5 s", "for": "4 s", "cable_cut": {"bus": "link", "after": "plc1"}},
        {"at": "6 s", "for": "1 s", "jabber": "plc3"},
        {"at": "17 s", "for": "300 ms", "jabber": "plc3"},
    ]
    found = faults(items(run(line, tmp_path)))
    cut = [item["values"]["station"] for item in found if item["key"] in ("cause_cut", "cause_format")]
    assert cut == ["station 2 (plc2)", "station 3 (plc3)"]
    (jabber,) = [item["values"] for item in found if item["key"] == "no_frame"]
    when = jabber["when"]
    assert (when["times"], when["from_s"]) == (2, pytest.approx(6, abs=0.05))
    assert when["for_s"] == pytest.approx(1, abs=0.05)
    assert when["total_s"] == pytest.approx(1.3, abs=0.1)
    assert (when["first_s"], when["last_s"]) == (pytest.approx(6, abs=0.05), pytest.approx(17.3, abs=0.05))


def test_equal_outages_are_one_sentence_and_stations_stay_apart(tmp_path: Path) -> None:
    line = link(random.Random(3))
    line["faults"] = [
        {"at": f"{at} s", "for": "1 s", "cable_cut": {"bus": "link", "after": "plc0"}} for at in (3, 6, 9)
    ]
    line["faults"].append({"at": "13 s", "for": "5 s", "cable_cut": {"bus": "link", "after": "plc1"}})
    lost = [
        item["values"] for item in faults(items(run(line, tmp_path))) if item["key"] == "master_not_received"
    ]
    names = [plc["name"] for plc in line["plcs"]]
    assert [(each["stations"], each["when"]["times"]) for each in lost] == [(names[1:], 3), (names[2:], 1)]
    assert lost[0]["when"]["total_s"] == pytest.approx(3, abs=0.5)
    assert lost[1]["when"]["for_s"] == pytest.approx(5, abs=0.2)


def test_polls_that_got_a_response_are_not_among_those_without_one(tmp_path: Path) -> None:
    bus = modbus(random.Random(1))
    bus["plcs"][0]["polls"][1]["station"] = 2  # there is none
    (item,) = [item for item in faults(items(run(bus, tmp_path))) if item["key"] == "no_response"]
    assert item["values"]["polls"] == ["vfd_speed"]


def test_a_slow_reply_counts_from_the_poll_that_it_replies_to(tmp_path: Path) -> None:
    line = link(random.Random(1))
    line["plcs"][0]["nn"] |= {"retries": 3, "timeout": "50 ms"}
    line["faults"] = [{"at": "5 s", "for": "3 s", "slow": {"station": "plc1", "extra": "60 ms"}}]
    cause = run(line, tmp_path).summary["links"]["link"]["scan_time_ms"]["max_cause"]
    waited = float(re.search(r"station 1 \(plc1\) replied ([\d.]+) ms after its poll", cause)[1])  # type: ignore[index]
    assert 60 <= waited <= 61


# -- a master that stops -----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def dead_master(tmp_path_factory: pytest.TempPathFactory) -> Result:
    plcs = [
        {"name": "main", "scan": "10 ms", "nn": {"bus": "link", "port": "COM4", "station": 0, "slaves": 4}}
    ]
    plcs[0]["nn"] |= {"mode": 2, "retries": 3, "timeout": "50 ms"}  # type: ignore[operator]
    plcs += [
        {"name": f"slave_{n}", "scan": f"{3 + 3 * n} ms", "nn": {"bus": "link", "port": "COM4", "station": n}}
        for n in range(1, 5)
    ]
    scenario = {
        "schema": 1,
        "name": "dead master",
        "duration": "60 s",
        "buses": [{"name": "link", "nn": True}],
        "plcs": plcs,
        "faults": [{"at": "20 s", "for": "10 s", "power_off": "main"}],
    }
    return run(scenario, tmp_path_factory.mktemp("dead"))


def test_a_master_that_stops_is_lost_by_all_slaves(dead_master: Result) -> None:
    link = dead_master.summary["links"]["link"]
    (lost,) = link["master_lost"]
    assert lost["stations"] == ["slave_1", "slave_2", "slave_3", "slave_4"]
    scan = link["scan_time_ms"]["p50"] / 1000
    # It begins with the last frame that slaves received of the master, and ends with the first one after.
    assert 20 - scan <= lost["from_s"] <= 20
    assert 30 <= lost["from_s"] + lost["for_s"] <= 30 + 2 * scan
    assert lost["scans_missed"] == int(lost["for_s"] / scan)
    for name in lost["stations"]:
        registers = dead_master.summary["plcs"][name]["registers"]
        assert (registers["D8203"], registers["D8211"], registers["M8183"]) == (1, 0x11, 0)


def test_a_lost_master_is_in_the_station_tables_and_pictures(dead_master: Result, tmp_path: Path) -> None:
    text = console(dead_master)
    assert "master lost" in text
    shown = page(dead_master)
    assert "lost the master (s)" in shown
    assert "master lost by slave_1, slave_2, slave_3, slave_4" in shown
    picture = dead_master.plot_scan_times_over_run(tmp_path / "run.svg")
    labels = [label.get_text() for axes in picture.axes for label in axes.get_yticklabels()]
    assert any(label.startswith("master lost by slave_1") for label in labels)


@pytest.mark.parametrize(("at", "lasts"), [(7.0, 1.0), (5.2, 12.0)], ids=["meanwhile", "beyond"])
def test_a_slave_that_dies_after_the_master_was_not_passed_by(
    at: float, lasts: float, tmp_path: Path
) -> None:
    """Its time without the master ends with its own supply; the master made no link scan in it."""
    line = link(random.Random(3))
    line["faults"] = [
        {"at": "5 s", "for": "10 s", "power_off": "plc0"},
        {"at": f"{at} s", "for": f"{lasts} s", "power_off": "plc1"},
    ]
    result = run(line, tmp_path)
    own = [each for each in result.summary["links"]["link"]["master_lost"] if each["stations"] == ["plc1"]]
    scan = result.summary["links"]["link"]["scan_time_ms"]["p50"] / 1000
    assert [each["from_s"] + each["for_s"] for each in own] == [pytest.approx(at)]
    # The link scan in which its last frame of the master came may have ended before that died.
    assert own[0]["scans_missed"] == pytest.approx((at - 5) / scan, abs=1.1)
    said = [item["key"] for item in faults(items(result)) if "scans_missed" in item["values"]]
    assert set(said) == {"master_lost"}


def test_a_master_that_is_back_before_any_watchdog_has_paused(tmp_path: Path) -> None:
    case = ONE_THING_WRONG[0](random.Random(0))
    case.scenario["faults"] = [{"at": "5 s", "for": "30 ms", "stop": "plc0"}]
    result = run(case.scenario, tmp_path)
    (lost,) = result.summary["links"]["link"]["master_lost"]
    assert lost["stations"] == []
    assert [item["key"] for item in faults(items(result))][:2] == ["not_running", "master_paused"]


def test_a_master_at_work_is_not_without_supply_because_the_run_ends_within_its_scan(tmp_path: Path) -> None:
    # A scan with a dead station lasts several usual ones; the run ends at ten points of such a scan.
    line = {
        "schema": 1,
        "name": "cut to the end",
        "duration": "8 s",
        "buses": [{"name": "link", "nn": True}],
        "plcs": [
            {"name": "m", "nn": {"bus": "link", "port": "COM4", "station": 0, "slaves": 2, "retries": 3}},
            {"name": "a", "nn": {"bus": "link", "port": "COM4", "station": 1}},
            {"name": "b", "nn": {"bus": "link", "port": "COM4", "station": 2}},
        ],
        "faults": [{"at": "3004 ms", "cable_cut": {"bus": "link", "after": "a"}}],
    }
    for step in range(10):
        (tmp_path / str(step)).mkdir()
        result = run(line | {"duration": f"{8000 + 23 * step} ms"}, tmp_path / str(step))
        (lost,) = result.summary["links"]["link"]["master_lost"]
        assert (lost["stations"], lost["scans_missed"]) == (["b"], 0)
        found = [item["key"] for item in faults(items(result))]
        assert found == ["master_not_received", "station_still_in_error", "cause_cut"]


# -- responses to other requests -----------------------------------------------------------------------


def test_responses_to_other_requests_are_none_of_its_own() -> None:
    result = bussim.run("timeout_too_short", rows=False)
    port = result.summary["ports"]["press.COM3"]
    assert (port["transactions"], port["ok"], port["mismatched_responses"]) == (1356, 678, 678)
    assert (port["answered_with_own_data"], port["late_responses"]) == (0, 678)
    assert "press.COM3: requests answered with their own data: none of 1,356." in console(result)
    assert "with success" not in page(result)


@pytest.mark.parametrize("name", quick(1, ["hmi_on_com2", "nn_with_modbus"]))
def test_answered_late_and_mistaken_are_never_more_than_the_requests(name: str) -> None:
    summary = bussim.run(name, rows=False).summary
    for node in (*summary["ports"].values(), *summary["devices"].values()):
        if "transactions" in node:
            mistaken = node["mismatched_responses"]
            assert node["answered_with_own_data"] == node["ok"] - mistaken
            assert node["late_responses"] <= node["timeouts"]


# -- station errors and onsets ------------------------------------------------------------------------


def test_scans_in_error_and_onsets_are_two_figures(tmp_path: Path) -> None:
    nn = {"bus": "link", "port": "COM4", "station": 0, "slaves": 1, "retries": 0, "timeout": "50 ms"}
    scenario = {
        "schema": 1,
        "name": "one outage",
        "duration": "60 s",
        "buses": [{"name": "link", "nn": True}],
        "plcs": [
            {"name": "main", "nn": nn},
            {"name": "a", "nn": {"bus": "link", "port": "COM4", "station": 1}},
        ],
        "faults": [{"at": "10 s", "for": "10 s", "power_off": "a"}],
    }
    result = run(scenario, tmp_path)
    link = result.summary["links"]["link"]
    assert (link["station_errors"], link["station_error_onsets"]) == ({"1": 153}, {"1": 1})
    (said,) = [item for item in items(result) if item["key"] == "station_error"]
    assert (said["values"]["errors"], said["values"]["onsets"]) == (153, 1)
    assert "station errors   onsets" in console(result)
    shown = page(result)
    assert "station errors (link scans)" in shown
    assert 'data-path="/links/link/station_error_onsets/1" data-run="1">1' in " ".join(shown.split())


def test_failed_attempts_are_those_of_errors_or_repeated_with_success() -> None:
    """Attempts that failed in errors and those made good are together all of them."""
    result = bussim.run("press_line", rows=False)
    said = {item["key"]: item["values"]["codes"] for item in items(result) if "codes" in item["values"]}
    failed = result.summary["links"]["link"]["failed_attempts"]
    assert failed == {"1": {"01": 90, "04": 2}, "2": {"04": 1}}
    assert said == {"station_error": {"01": 90}, "repeated": {"04": 3}}


@pytest.mark.slow
def test_onsets_are_as_many_as_flags_that_went_on() -> None:
    for name in ("press_line", "bursts", "cable_cut"):
        record = bussim.run(name, rows=False).record
        for bus, entry in record.links.items():
            onsets = record.summary["links"][bus]["station_error_onsets"]
            assert {int(k): n for k, n in onsets.items() if n} == {
                k: len(v) for k, v in entry.in_error.items() if v
            }

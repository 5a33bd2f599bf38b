"""``bussim size`` on lines whose right settings are known from a solver of their own."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest
from click.testing import CliRunner

from bussim.cli import main
from bussim.commands.size.command import command as size
from bussim.exact.from_scenario import from_scenario
from bussim.exact.link import LinkModel
from bussim.scenario.model import Scenario
from tests.selection import quick

#: Five stations of a packing line with different PLC scans, mode 2. ``{noise}`` is its noise.
PACKING = """\
schema: 1
name: packing
duration: 60 s
buses: [{{name: link, nn: true}}]
plcs:
  - name: packer
    profile: pw10
    scan: {{mean: 10 ms, jitter: 2 ms}}
    nn: {{bus: link, port: COM4, station: 0, slaves: 4, mode: 2, retries: 3, timeout: 50 ms}}
  - {{name: infeed, scan: 6 ms, nn: {{bus: link, port: COM4, station: 1}}}}
  - {{name: foil, scan: 12 ms, nn: {{bus: link, port: COM4, station: 2}}}}
  - {{name: printer, scan: 5 ms, nn: {{bus: link, port: COM4, station: 3}}}}
  - {{name: stacker, scan: 20 ms, nn: {{bus: link, port: COM4, station: 4}}}}
{noise}
"""

#: Two stations whose profile reads D8179 as the attempts themselves.
READING = """\
schema: 1
name: attempts as written
duration: 10 s
buses: [{name: link, nn: true}]
plcs:
  - name: a
    profile: {base: pw10, attempts: retries}
    scan: 8 ms
    nn: {bus: link, port: COM4, station: 0, slaves: 1, mode: 1, retries: 3, timeout: 50 ms}
  - {name: b, profile: {base: pw10, attempts: retries}, scan: 8 ms, nn: {bus: link, port: COM4, station: 1}}
noise: [{bus: link, ber: 1.0e-5}]
"""


@pytest.fixture(scope="module")
def packing(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("size") / "packing.yaml"
    path.write_text(PACKING.format(noise=""), encoding="utf-8")
    return str(path)


@cache
def sized(*args: str) -> dict[str, object]:
    result = CliRunner().invoke(size, [*args, "--json"])
    found: dict[str, object] = json.loads(result.stdout)["links"]["link"]
    return found


@cache
def printed(*args: str) -> str:
    return CliRunner().invoke(size, args).stdout


def goals(*texts: str) -> list[str]:
    return [part for text in texts for part in ("--goal", text)]


def test_a_heartbeat_too_short_is_refused_with_figures_and_a_change_that_works(packing: str) -> None:
    found = sized(packing, *goals("heartbeat=100ms@1/y"))
    assert found["recommended"] is None
    (unmet,) = found["unmet"]  # type: ignore[misc]
    assert unmet["goals"] == ["heartbeat"]
    assert "each setting misses it 380,000,000 times a year or more" in unmet["text"]
    assert not any("outage" in text or "ride" in text for text in unmet["helps"])
    change = next(text for text in unmet["helps"] if "instead of 100 ms missed once a year" in text)
    preset = re.match(r"a heartbeat of (\S+) ms missed at most once a year instead", change)
    assert preset is not None
    assert sized(packing, *goals(f"heartbeat={preset[1]}ms@1/y"))["recommended"] is not None


def test_the_users_goals_are_used_and_shown_as_given(packing: str) -> None:
    said = printed(packing, *goals("ride>=20ms", "errors<=1/d"))
    assert "goal: an interruption of the line of 20 ms without a station error" in said
    assert "goal: false station errors: at most 1 a day" in said
    assert "100 ms without" not in said
    best = sized(packing, *goals("ride>=20ms", "errors<=1/d"))["recommended"]
    assert best["attempts"] == 3  # type: ignore[index]
    assert 20 <= best["ride_through_ms"] < 100  # type: ignore[index]


def test_all_conflicts_are_named_with_figures_on_the_safe_side(packing: str) -> None:
    found = sized(packing, *goals("ride>=300ms", "dead<=330ms"))
    errors, ride = found["unmet"]  # type: ignore[misc]
    assert errors["goals"] == ["errors", "dead"]
    assert "the best is 331 ms (attempts 5, D8180 5)" in errors["text"]  # more than 330 ms
    assert ride["goals"] == ["dead", "ride"]
    assert "the best is 486 ms (attempts 8, D8180 5)" in ride["text"]
    assert errors["helps"] == ride["helps"]
    assert errors["helps"] == [
        "a scan of at most 486 ms with one station dead instead of 330 ms (then D8179 7, D8180 5)"
    ]


@pytest.mark.slow
def test_a_longer_timeout_is_not_better_for_its_slower_scans(tmp_path: Path) -> None:
    path = tmp_path / "noisy.yaml"
    path.write_text(PACKING.format(noise="noise: [{bus: link, ber: 2.0e-5}]"), encoding="utf-8")
    found = sized(str(path), *goals("errors<=0.1/y", "dead<=200ms"))
    assert {tuple(unmet["goals"]) for unmet in found["unmet"]} == {("errors", "dead"), ("dead", "ride")}  # type: ignore[attr-defined]
    for unmet in found["unmet"]:  # type: ignore[attr-defined]
        assert "D8180 6" not in unmet["text"]
    front = found["pareto"]
    assert {row["D8180"] for row in front} == {5}  # type: ignore[attr-defined]
    assert max(row["one_dead_ms"] for row in front) < 1_000  # type: ignore[attr-defined]


@pytest.mark.parametrize("retries", quick(1, [0, 3]))
def test_the_reading_of_d8179_is_the_profiles(retries: int, tmp_path: Path) -> None:
    path = tmp_path / "reading.yaml"
    path.write_text(READING, encoding="utf-8")
    found = sized(str(path), "--set", f"plcs.a.nn.retries={retries}", "--set", "plcs.a.nn.timeout=200 ms")
    assert found["mov"][1].startswith("MOV K4 D8179")  # type: ignore[index]
    assert found["recommended"]["attempts"] == 4  # type: ignore[index]


@pytest.mark.parametrize(
    "noise", quick(1, ["[{bus: link, ber: 1.0e-9}]", "[]", "[{bus: link, ber: 1.0e-12}]"])
)
def test_typing_in_a_little_noise_changes_nothing(noise: str) -> None:
    best = sized("press_line", "--set", f"noise={noise}")["recommended"]
    assert best["D8179"] == 4  # type: ignore[index]
    assert best["ride_through_ms"] >= 100  # type: ignore[index]


def test_each_sizing_says_what_more_noise_does_and_what_it_rests_on() -> None:
    found = sized("electrical_noise")
    assert [margin["factor"] for margin in found["margins"]] == [1, 10, 100]  # type: ignore[attr-defined]
    once, ten, hundred = found["margins"]  # type: ignore[misc]
    assert once["holds"]
    assert ten["setting"] == {"D8179": 9, "D8180": 5}
    assert ten["more_ms"] == pytest.approx(5 * 51.72, abs=0.1)
    assert hundred["setting"] is None
    assert 2 <= len(found["assumptions"]) <= 3  # type: ignore[arg-type]
    assert set(found["rests_on"]["inputs"].values()) <= {"published", "derived", "assumed", "entered"}  # type: ignore[index]
    said = printed("electrical_noise")
    assert "10 times the noise as entered: 30,000 false station errors a year" in said
    assert "D8179 = 9, D8180 = 5 would do: 259 ms more with a station dead" in said
    assert said.rstrip().splitlines()[-4].strip() == "the assumptions that change the answer most:"
    assert "a station's supply or STOP is not covered" in said


@pytest.mark.slow
def test_the_check_by_simulation_sees_errors_at_raised_noise(packing: str) -> None:
    found = sized(packing, "--verify")
    chosen, raised, fewer, none = found["verify"]  # type: ignore[misc]
    assert all(each["agrees"] for each in (chosen, raised, fewer, none))
    assert [each["D8179"] for each in (chosen, raised, fewer, none)] == [4, 4, 3, 0]
    assert [each["times_the_noise"] > 1 for each in (chosen, raised, fewer, none)] == [
        False,
        True,
        False,
        False,
    ]
    assert [each["about_errors"] for each in (chosen, raised, fewer, none)] == [False, True, False, True]
    assert "so that this says nothing about errors" in printed(packing, "--verify")


@pytest.mark.slow
def test_a_law_that_counts_one_attempt_too_many_disagrees(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from bussim.commands.size import verify

    def wrong(scenario: Scenario) -> dict[str, LinkModel]:
        return {
            bus: replace(link, attempts=link.attempts + 1) for bus, link in from_scenario(scenario).items()
        }

    monkeypatch.setattr(verify, "from_scenario", wrong)
    assert main(["size", "two_stations", "--verify"]) == 1
    captured = capsys.readouterr()
    assert "DISAGREES" in captured.out
    assert "simulation and law disagree on link: see above" in captured.err
    assert main(["size", "two_stations", "--verify", "--json"]) == 1


@pytest.mark.slow
def test_a_dead_station_is_no_false_error_of_the_check() -> None:
    found = sized("dead_from_start", "--verify")
    assert all(each["agrees"] for each in found["verify"])  # type: ignore[attr-defined]
    assert found["verify"][0]["station_errors"] == 0  # type: ignore[index]


@pytest.mark.slow
def test_a_refusal_says_which_assumption_would_change_it() -> None:
    found = sized("electrical_noise", *goals("dead<=200ms"))
    assert found["otherwise"] == [
        "absent_station: full (assumed); with probe: D8179 = 4, D8180 = 5 would be recommended"
    ]
    probing = sized(
        "electrical_noise",
        *goals("dead<=200ms"),
        "--set",
        "plcs.crane.profile={base: pw10, absent_station: probe}",
    )
    assert (probing["recommended"]["D8179"], probing["recommended"]["D8180"]) == (4, 5)  # type: ignore[index]
    said = printed("electrical_noise", *goals("dead<=20ms")).rstrip().splitlines()[-1].strip()
    assert said == "no setting would meet the goals if any of them were otherwise"
    # Refused just below the level bad, whose failed attempts take the whole timeout, and just above it.
    below, above = (
        sized("press_line", *goals("scan<=140ms@1e-6"), "--set", f"noise.0.ber={ber}")
        for ber in ("9e-6", "1.1e-5")
    )
    assert below["recommended"] is above["recommended"] is None
    assert below["otherwise"][0].startswith("the level bad counts beside the noise as entered")  # type: ignore[index]


def test_a_goal_given_twice_is_a_mistake(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["size", "two_stations", *goals("ride>=20ms", "ride>=30ms")]) == 2
    assert "a second goal ride; give each once" in capsys.readouterr().err


def test_all_wrong_goals_are_named_at_once(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["size", "two_stations", *goals("ride>=20", "dead<=100ms", "rid>=3ms", "dead=4ms")]) == 2
    said = capsys.readouterr().err
    for each in ("'ride>=20'", "did you mean ride>=100ms?", "write dead<=…"):
        assert each in said
    assert said.count("--goal") == 3


#: Station 2 refuses the master's mode, 3 is off, 5 does not exist; another PLC has a station number too high.
NOT_REPLYING = """\
schema: 1
name: not replying
duration: 10 s
buses: [{name: link, nn: true}]
plcs:
  - {name: m, scan: 8 ms, nn: {bus: link, port: COM4, station: 0, slaves: 5, mode: 2, timeout: 50 ms}}
  - {name: a, scan: 8 ms, nn: {bus: link, port: COM4, station: 1}}
  - {name: b, profile: {base: pw10, modes: [0]}, scan: 8 ms, nn: {bus: link, port: COM4, station: 2}}
  - {name: c, scan: 8 ms, nn: {bus: link, port: COM4, station: 3}}
  - {name: d, scan: 8 ms, registers: {D8176: 9, M8179: 1}, ports: {COM4: {bus: link}}}
  - {name: e, scan: 8 ms, nn: {bus: link, port: COM4, station: 4}}
faults: [{at: 0 s, power_off: {station: c}}]
"""


@pytest.mark.parametrize("command", ["size", "exact"])
def test_stations_that_do_not_reply_are_said_first(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "line.yaml"
    path.write_text(NOT_REPLYING, encoding="utf-8")
    assert main([command, str(path)]) == 0
    lines = [line.strip() for line in capsys.readouterr().out.splitlines()]
    assert lines[1:6] == [
        "d refuses its N:N settings (D8176 is 9, allowed 0..7): M8063 on, D8063 = 7448, and it sends nothing",
        "station 2 (b): b (pw10) does not have the master's refresh mode 2: it stays out of the link",
        "station 3 (c) never replies: a fault keeps it silent all the time",
        "station 5 does not exist on the link: D8177 = 5 has it polled in vain",
        "figures of the line as it is are with that; a dead station spoken of is one more",
    ]
    if command == "exact":
        assert any(line.startswith("one more station dead") for line in lines)


def test_a_link_whose_master_refuses_says_why(capsys: pytest.CaptureFixture[str]) -> None:
    for command, code in (("size", 1), ("exact", 0)):
        assert main([command, "bad_parameter"]) == code
        assert "master refuses its N:N settings (D8177 is 0, allowed 1..7)" in capsys.readouterr().out


def test_no_table_of_refreshes_has_a_header_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "line.yaml"
    path.write_text(NOT_REPLYING.replace("station: c", "station: [a, e, c]"), encoding="utf-8")
    every = (
        NOT_REPLYING.split("faults:")[0]
        + "faults:\n"
        + "".join(f"  - {{at: 0 s, power_off: {{station: {name}}}}}\n" for name in "ace")
    )
    path.write_text(every, encoding="utf-8")
    assert main(["exact", str(path)]) == 0
    said = capsys.readouterr().out
    assert "link scan time" in said
    assert "refresh gap" not in said
    assert "where a dead station is spoken of" not in said  # no more can die


@pytest.mark.slow
def test_answers_have_a_figure_for_each_goal() -> None:
    wanted = ("onsets<=1/y", "scan<=300ms@1e-6", "heartbeat=1500ms@1/y", "ride>=0")
    found = sized("press_line", *goals(*wanted))
    figures = found["goal_figures"]
    assert set(figures) == {"onsets", "scan", "heartbeat"}  # type: ignore[call-overload]
    best = found["recommended"]
    assert 0 < best["false_error_onsets_per_year"] <= min(1, best["false_errors_per_year"])  # type: ignore[index]
    said = printed("press_line", *goals(*wanted))
    assert "goal: no interruption of the line must pass without a station error" in said
    for name, figure in figures.items():  # type: ignore[attr-defined]
        words = {"onsets": "false station errors begin", "scan": "scans over the deadline"}
        assert f"{words.get(name, 'a heartbeat is missed falsely')}: {figure}" in said


def test_a_refusal_shows_more_noise_too() -> None:
    said = printed("electrical_noise", *goals("dead<=200ms"))
    rows = [line.strip() for line in said.splitlines() if "with D8179 = 10" in line]
    assert [row.split(":")[0] for row in rows] == [
        "noise as entered",
        "10 times the noise as entered",
        "100 times the noise as entered",
    ]
    assert all(row.endswith("no setting meets the goals there") for row in rows)


@pytest.mark.slow
def test_where_nearly_every_scan_has_an_error_no_figure_a_year_is_given() -> None:
    """More noise makes scans longer, so that errors a year would fall."""
    said = printed("electrical_noise", "--set", "noise.0.ber=3e-4", *goals("ride>=0"))
    rows = [line.strip() for line in said.splitlines() if "times the noise as entered:" in line]
    assert "stations in error in each scan on average" in rows[0]
    assert "every station in error in nearly every scan" in rows[1]


@pytest.mark.slow
def test_a_heartbeat_that_is_advised_is_the_least_that_all_goals_allow(packing: str) -> None:
    found = sized(packing, *goals("heartbeat=100ms@1/y"))
    helps = "\n".join(found["unmet"][0]["helps"])  # type: ignore[index]
    (preset,) = map(
        int, re.findall(r"^a heartbeat of (\d+) ms missed at most once a year", helps, re.MULTILINE)
    )
    assert preset % 10 == 0
    assert sized(packing, *goals(f"heartbeat={preset - 10}ms@1/y"))["recommended"] is None


def test_a_time_of_many_ms_is_shown_in_seconds() -> None:
    said = printed("--stations", "2", *goals("heartbeat=100000ms@1/y", "scan<=12345ms@0.1"))
    assert "a heartbeat of 100 s missed" in said
    assert "a scan over 12.345 s with" in said


def test_a_plc_scan_far_from_what_is_usual_is_asked_about() -> None:
    said = CliRunner().invoke(size, ["--stations", "2", "--scan", "6s"]).output
    assert "warning: --scan is 6s, but a PLC's scan is usually 100 us to 200 ms; did you mean 6 ms?" in said


def test_errors_and_how_often_they_begin_are_two_figures_of_two_names(tmp_path: Path) -> None:
    path = tmp_path / "two.yaml"
    path.write_text(
        "schema: 1\nname: two meanings\nduration: 60 s\nbuses: [{name: link, nn: true}]\nplcs:\n"
        "  - {name: main, nn: {bus: link, port: COM4, station: 0, slaves: 1, retries: 0, timeout: 50 ms}}\n"
        "  - {name: a, nn: {bus: link, port: COM4, station: 1}}\n"
        "noise: [{bus: link, reply_loss: 0.1}]\n"
        "faults: [{at: 10 s, for: 10 s, power_off: a}]\n",
        encoding="utf-8",
    )
    wanted = goals("errors<=20/y", "onsets<=10/y")
    found = sized(str(path), *wanted)
    assert found["goals"][:2] == [  # type: ignore[index]
        "false station errors: at most 20 a year",
        "false station errors that begin: at most 10 a year",
    ]
    for choice in found["pareto"]:  # type: ignore[attr-defined]
        # In error after all attempts, 0.1 each; it began if the scan before had a reply.
        errors, onsets = (choice[f"false_error{part}_per_year"] for part in ("s", "_onsets"))
        assert onsets / errors == pytest.approx(1 - 0.1 ** choice["attempts"], rel=1e-6)
    said = printed(str(path), *wanted)
    assert "false station errors: " in said
    assert "false station errors begin: " in said

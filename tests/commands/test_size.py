"""``bussim size`` on lines whose right settings are known from a solver of their own."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner

from bussim.cli import main
from bussim.commands.size.command import command as size
from bussim.exact.from_scenario import from_scenario
from bussim.exact.link import LinkModel
from bussim.scenario.model import Scenario

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


@pytest.fixture
def packing(tmp_path: Path) -> str:
    path = tmp_path / "packing.yaml"
    path.write_text(PACKING.format(noise=""), encoding="utf-8")
    return str(path)


def sized(*args: str) -> dict[str, object]:
    result = CliRunner().invoke(size, [*args, "--json"])
    found: dict[str, object] = json.loads(result.stdout)["links"]["link"]
    return found


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
    change = next(text for text in unmet["helps"] if text.startswith("heartbeat="))
    assert sized(packing, *goals(change.split()[0]))["recommended"] is not None


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
    assert errors["helps"] == ["dead<=486ms instead of dead<=330ms (then D8179 7, D8180 5)"]


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


@pytest.mark.parametrize("retries", [0, 3])
def test_the_reading_of_d8179_is_the_profiles(retries: int, tmp_path: Path) -> None:
    path = tmp_path / "reading.yaml"
    path.write_text(READING, encoding="utf-8")
    found = sized(str(path), "--set", f"plcs.a.nn.retries={retries}", "--set", "plcs.a.nn.timeout=200 ms")
    assert found["mov"][0].startswith("MOV K4 D8179")  # type: ignore[index]
    assert found["recommended"]["attempts"] == 4  # type: ignore[index]


@pytest.mark.parametrize("noise", ["[]", "[{bus: link, ber: 1.0e-12}]", "[{bus: link, ber: 1.0e-9}]"])
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
    assert set(found["classes"]["inputs"].values()) <= {"published", "derived", "assumed", "entered"}  # type: ignore[index]
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

"""``bussim exact`` and ``bussim size`` as a user meets them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

import bussim
from bussim.cli import main
from bussim.commands.exact.command import command as exact
from bussim.commands.size.command import command as size
from bussim.commands.size.uniform_link import uniform_link
from bussim.commands.size.verify import Verification, compare, with_setting
from bussim.errors import RunError, UsageError


def invoke(command: object, *args: str) -> Result:
    return CliRunner().invoke(command, list(args))  # type: ignore[arg-type]  # click's own commands


def link(command: object, *args: str) -> dict[str, object]:
    result = invoke(command, *args, "--json")
    if result.exception is not None and not isinstance(result.exception, RunError):
        raise result.exception
    found = json.loads(result.stdout)
    assert found["schema"] == 1
    return dict(found["links"]["link"])


def test_json_has_the_promised_keys() -> None:
    found = link(exact, "electrical_noise", "--q", "1e-3,1e-6", "--deadline", "100ms")
    assert found["valid"] is True
    assert found["reasons"] == []
    assert set(found["quantiles_ms"]) == {"1e-3", "1e-6"}  # type: ignore[call-overload]
    assert set(found["p_scan_over_ms"]) == {"100"}  # type: ignore[call-overload]
    for key in ("mean_ms", "sd_ms", "false_errors_per_year", "one_dead_ms", "two_dead_ms", "detect_ms"):
        assert found[key] is not None
    assert set(found["station_error_per_scan"]) == {"1", "2", "3"}  # type: ignore[call-overload]


def test_no_noise_is_the_formula_of_a_link_scan() -> None:
    # gap + 54 characters, then gap + poll + turnaround + 54 characters, and the overhead (mode 2).
    character = 10 / 38.4
    expected = 0.4175 + 54 * character + 2 * 0.4175 + 5 * character + 54 * character + 3.52
    assert link(exact, "two_stations")["mean_ms"] == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize("name", ["slow_slave_short_timeout", "same_number_twice", "drive_impulses"])
def test_where_the_closed_form_does_not_hold_it_says_so(name: str) -> None:
    found = link(exact, name)
    assert found["valid"] is False
    assert found["reasons"]
    assert found["mean_ms"] is None
    assert "no exact law" in invoke(exact, name).stdout


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (("--q", "often"), "--q has 'often'"),
        (("--q", "2"), "allowed 1e-15"),
        (("--deadline", "100"), "without a unit"),
        (("--mission", "0 s"), "above 0"),
        (("--out", "x"), "--plot"),
    ],
)
def test_bad_options(args: tuple[str, ...], said: str) -> None:
    result = invoke(exact, "two_stations", *args)
    assert isinstance(result.exception, UsageError)
    assert said in str(result.exception)


def test_poll_lists_stand_beside_the_links() -> None:
    result = invoke(exact, "nn_with_modbus", "--json")
    found = json.loads(result.stdout)
    assert list(found["links"]) == ["link"]
    assert list(found["polls"]) == ["press1.COM3", "press2.COM5"]
    press = found["polls"]["press1.COM3"]
    # (8 + 3.5 + 7 or 9 + 3.5 characters, 35 ms) in whole scans of 7 to 9 ms, 1.1 times that under N:N.
    assert press["polls"]["position"]["response_ms"] == {"min": 44.375, "max": 44.375}
    assert press["cycle_ms"]["min"] < press["cycle_ms"]["mean"] < press["cycle_ms"]["max"]
    assert press["cycle_ms"]["max"] < press["worst_case_ms"]
    assert press["dead"]["feeder1"]["lost_ms"] == 2 * 200 * 2
    said = invoke(exact, "nn_with_modbus").stdout
    assert "1 retry = 2 attempts × 200 ms on 2 polls (position, running): 800 ms when feeder1 is dead" in said
    assert "at worst" in said
    assert "44.375" in said


def test_poll_lists_without_a_link() -> None:
    found = json.loads(invoke(exact, "two_masters", "--json").stdout)
    assert found["links"] == {}
    assert [found["polls"][node]["valid"] for node in ("filler.COM3", "packer.COM3")] == [False, False]
    assert "no figures: packer.COM3 also asks" in invoke(exact, "two_masters").stdout
    alone = invoke(exact, "two_masters", "--set", "plcs.packer.polls=[]").stdout
    assert "poll cycle" in alone
    plotted = invoke(exact, "two_masters", "--plot")
    assert "no N:N link, whose law --plot draws" in str(plotted.exception)


@pytest.mark.slow
def test_pictures(tmp_path: Path) -> None:
    result = invoke(exact, "electrical_noise", "--set", "duration=5 s", "--plot", "--out", str(tmp_path))
    assert result.exception is None
    assert {path.name for path in tmp_path.iterdir()} == {"law_link.png", "law_link.svg"}


def test_size_recommends_and_prints_the_lines_to_paste(tmp_path: Path) -> None:
    result = invoke(size, "electrical_noise", "--out", str(tmp_path))
    assert result.exception is None
    assert "MOV K4 D8179" in result.stdout
    assert "attempts" in result.stdout
    assert {path.name for path in tmp_path.iterdir()} == {"size.json", "size_link.png", "size_link.svg"}


def test_without_noise_the_noise_levels_are_shown_and_retries_remain() -> None:
    found = link(size, "two_stations")
    assert found["assumed_noise"] == "ladder"
    assert found["recommended"]["attempts"] >= 3  # type: ignore[index]
    assert "no noise is given" in invoke(size, "two_stations").stdout


def test_a_goal_that_cannot_be_met_is_refused_with_numbers(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["size", "electrical_noise", "--goal", "dead<=200ms"]) == 1
    said = capsys.readouterr().out
    assert "not to be met" in said
    assert "would help" in said


def test_a_wrong_goal_names_the_forms() -> None:
    result = invoke(size, "two_stations", "--goal", "deed<=100ms")
    assert isinstance(result.exception, UsageError)
    assert "dead" in str(result.exception)


@pytest.mark.slow
def test_simulation_agrees_with_the_law() -> None:
    changed = with_setting(bussim.load("electrical_noise"), "link", 0, 50 * 72_000)
    verdict = compare(changed, "link", Verification(0, 50 * 72_000), scans=4_000)
    assert verdict.agrees
    assert verdict.errors > 100  # without retries the noise is seen, so the agreement says something


CALLING = """\
schema: 1
name: sensors
duration: 1 s
buses: [{name: line, baud: 9600}, {name: link, nn: true}]
devices:
  - {name: sensor, model: map, bus: line, station: 2, registers: [{address: 0, call: 'exact_sensor:level'}]}
  - {name: panel, model: hmi, bus: line, polls: [{station: 2, function: 3, address: 0}]}
plcs:
  - {name: one, nn: {bus: link, port: COM4, station: 0, slaves: 1, retries: 3, timeout: 50 ms}}
  - {name: two, nn: {bus: link, port: COM4, station: 1}}
"""


@pytest.mark.parametrize("command", [["exact"], ["size", "--goal", "errors<=1/y"]])
def test_functions_of_the_user_take_a_permission(
    command: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("exact_sensor.py").write_text("def level(tick):\n    return 1\n")
    Path("x.yaml").write_text(CALLING)
    asked = [*command, "x.yaml", "--json"]
    assert main(asked) == 2
    assert "--allow-code" in capsys.readouterr().err
    assert main([*asked, "--allow-code"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["links"]["link"]
    if command == ["exact"]:
        assert found["polls"]["panel"]["valid"] is True


# -- without a file ----------------------------------------------------------------------------------

FOUR = """\
schema: 1
name: four stations
duration: 60 s
buses: [{name: link, nn: true}]
plcs:
  - {name: master, scan: 8 ms, profile: fx3u, nn: {bus: link, port: COM4, station: 0, slaves: 3, mode: 2}}
  - {name: slave1, scan: 8 ms, profile: fx3u, nn: {bus: link, port: COM4, station: 1}}
  - {name: slave2, scan: 8 ms, profile: fx3u, nn: {bus: link, port: COM4, station: 2}}
  - {name: slave3, scan: 8 ms, profile: fx3u, nn: {bus: link, port: COM4, station: 3}}
noise: [{name: line, bus: link, ber: 1.0e-6}]
"""
DESCRIBED = ("--stations", "4", "--mode", "2", "--scan", "8ms", "--ber", "1e-6", "--profile", "fx3u")


@pytest.mark.parametrize(
    "more",
    [
        ("--goal", "ride>=100ms"),
        *(pytest.param(each, marks=pytest.mark.slow) for each in ((), ("--goal", "dead<=150ms"))),
    ],
)
def test_a_link_of_equal_stations_is_sized_as_its_file_would_be(
    more: tuple[str, ...], tmp_path: Path
) -> None:
    (tmp_path / "four.yaml").write_text(FOUR, encoding="utf-8")
    assert link(size, *DESCRIBED, *more) == link(size, str(tmp_path / "four.yaml"), *more)


@pytest.mark.slow
def test_a_link_of_equal_stations_by_its_defaults() -> None:
    assert uniform_link(2, 0) == uniform_link(2, 0, profile="pw10", scan="10 ms", ber=0)
    found = link(size, "--stations", "2")
    assert found["assumed_noise"] == "ladder"
    said = invoke(size, "--stations", "8", "--mode", "2").stdout
    assert said.startswith("link: 8 stations, mode 2\n")
    assert "with a dead station" in said
    changed = invoke(size, "--stations", "2", "--set", "plcs.slave1.scan=40 ms").stdout
    assert "the timeout is at least 70 ms" in changed


@pytest.mark.slow
def test_a_link_of_equal_stations_can_be_verified_and_drawn(tmp_path: Path) -> None:
    result = invoke(size, *DESCRIBED, "--verify", "--out", str(tmp_path))
    assert result.exception is None
    assert result.stdout.count("agrees") == 4
    assert "times the noise, so that errors are seen" in result.stdout
    assert {path.name for path in tmp_path.iterdir()} == {"size.json", "size_link.png", "size_link.svg"}


@pytest.mark.parametrize(
    ("args", "said"),
    [
        ((), "name a SCENARIO, or describe a link: bussim size --stations 4 --mode 2"),
        (("--mode", "2"), "--mode needs --stations"),
        (("two_stations", "--stations", "2"), "two_stations and --stations exclude each other"),
        (("two_stations", "--ber", "0"), "two_stations and --ber exclude each other"),
        (("--stations", "1"), "--stations is 1, allowed 2..8"),
        (("--stations", "9"), "--stations is 9, allowed 2..8"),
        (("--stations", "4", "--mode", "5"), "--mode is 5, allowed 0..4 in profile pw10"),
        (
            ("--stations", "4", "--mode", "3", "--profile", "fx2n"),
            "--mode is 3, allowed 0..2 in profile fx2n",
        ),
        (("--stations", "4", "--mode", "1", "--profile", "fx1s"), "--mode is 1, allowed 0 only"),
        (("--stations", "4", "--profile", "pw1"), "did you mean pw10?"),
        (("--stations", "4", "--scan", "8"), "--scan is 8, a time without a unit"),
        (("--stations", "4", "--scan", "11 s"), "allowed 100 us to 10 s"),
        (("--stations", "4", "--ber", "-1"), "--ber is -1, allowed 0..1"),
    ],
)
def test_what_cannot_be_sized_without_a_file(args: tuple[str, ...], said: str) -> None:
    result = invoke(size, *args)
    assert isinstance(result.exception, UsageError)
    assert said in str(result.exception)


# -- faults that come and go -------------------------------------------------------------------------


def test_a_fault_for_a_time_has_figures_before_during_and_after() -> None:
    found = link(exact, "press_line")
    outside, during = found["periods"]  # type: ignore[misc]
    assert outside["spans"] == [{"from_s": 0.0, "until_s": 20.0}, {"from_s": 25.0, "until_s": 60.0}]
    assert outside["acting"] == []
    assert during["spans"] == [{"from_s": 20.0, "until_s": 25.0}]
    assert during["acting"] == ["power_off press2"]
    assert during["mean_ms"] == pytest.approx(348.57, abs=0.1)  # from a simulation: press2 dead
    assert outside["mean_ms"] == link(exact, "press_line", "--ignore-faults")["mean_ms"]
    said = invoke(exact, "press_line").stdout
    assert "link, 0 s to 20 s and 25 s to 60 s, undisturbed" in said
    assert "link, 20 s to 25 s, power_off press2" in said


def test_a_station_that_is_switched_on_late_is_dead_before() -> None:
    before, after = link(exact, "late_power_up")["periods"]  # type: ignore[misc]
    assert before["acting"] == ["oven not yet on"]
    assert before["spans"] == [{"from_s": 0.0, "until_s": 4.0}]
    assert before["mean_ms"] > 4 * 100  # four attempts of 100 ms
    assert after["mean_ms"] < 100


def test_what_damages_single_frames_is_left_out_and_named() -> None:
    (period,) = link(exact, "undetected_corruption")["periods"]  # type: ignore[misc]
    assert period["valid"]
    assert any("damages single frames only" in note for note in period["notes"])


def test_a_probability_of_one_is_almost_certain() -> None:
    said = invoke(exact, "electrical_noise", "--set", "plcs.crane.nn.retries=0").stdout
    assert "almost certain at least once a year" in said
    assert "1 at least once a year" not in said
    assert "a station's supply or STOP is not covered" in said.replace("\n", " ")


@pytest.mark.parametrize(
    ("arguments", "named"),
    [(["wrong_parity"], True), (["wrong_parity", "--ignore-faults"], False), (["two_stations"], False)],
)
def test_where_faults_come_and_go_the_option_that_leaves_them_out_is_named(
    arguments: list[str], named: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["exact", *arguments]) == 0
    assert ("--ignore-faults: one law for the whole run" in capsys.readouterr().out) == named


def test_a_single_station_is_one(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["exact", "bad_parameter"]) == 0
    assert capsys.readouterr().out.startswith("link: 1 station, mode 0")


@pytest.mark.parametrize("noise", ["reply_loss: 1", "ber: 0.9", "ber: 1"])
def test_where_nothing_arrives_there_are_dashes_and_a_sentence(noise: str) -> None:
    text = f"noise=[{{bus: link, station: feeder, {noise}}}]"
    result = invoke(exact, "two_stations", "--set", text)
    assert result.exit_code == 0
    assert "practically no block arrives" in result.stdout
    assert (
        "feeder->press          –          –" in result.stdout
        or "feeder->press       –       –" in result.stdout
    )
    found = link(exact, "two_stations", "--set", text)
    gap = found["refresh_gap_ms"]["feeder->press"]  # type: ignore[index]
    assert set(gap.values()) == {None}


def test_a_deaf_slave_has_valid_json() -> None:
    result = invoke(
        exact, "electrical_noise", "--set", "noise=[{bus: link, station: hoist, ber: 0.1}]", "--json"
    )
    assert result.exit_code == 0
    assert result.stderr == ""
    found = json.loads(result.stdout, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))
    assert found["links"]["link"]["refresh_gap_ms"]["crane->hoist"]["mean"] is None


def test_noise_beyond_all_measure_is_worked_out() -> None:
    rare = "noise=[{bus: link, reply_loss: 5e-324}]"
    assert invoke(exact, "two_stations", "--set", rare, "--set", "plcs.press.nn.retries=1").exit_code == 0
    found = link(exact, "two_stations", "--set", rare, "--set", "plcs.press.nn.retries=0")
    assert found["years_between_false_errors"] == pytest.approx(1e300)


def test_a_flag_that_is_always_on_is_no_lack_of_errors() -> None:
    result = invoke(exact, "two_stations", "--set", "noise=[{bus: link, station: feeder, reply_loss: 1}]")
    assert "with the noise as entered the error flag of feeder is always on" in result.stdout
    assert "no false station error" not in result.stdout


def test_slaves_that_hear_nothing_have_a_law() -> None:
    """What they remember then never changes, so that their chain has more than one stationary law."""
    noise = "{bus: link, ber: 0.999999999999}, {bus: link, station: hoist, ber: 1}"
    found = link(exact, "electrical_noise", "--set", f"noise=[{noise}]")
    assert found["refresh_gap_ms"]["crane->grab"]["mean"] is None  # type: ignore[index]


@pytest.mark.slow
def test_bursts_in_which_alone_frames_arrive_have_a_mean_and_a_bound() -> None:
    found = link(exact, str(Path(__file__).parents[2] / "exact" / "cases" / "nothing_arrives.yaml"))
    gaps = found["refresh_gap_ms"]
    assert all(gap["mean"] > 1e6 and gap["1e-3"] is None for gap in gaps.values())  # type: ignore[attr-defined]


def test_a_death_is_noticed_within_the_longest_scan() -> None:
    case = Path(__file__).parents[2] / "exact" / "cases" / "one_attempt_replies_lost.yaml"
    found = link(exact, str(case), "--q", "0.1,0.01")["detect_ms"]
    assert found == {
        "mean": pytest.approx(36.14, abs=0.05),
        "max": pytest.approx(69.72, abs=0.01),
        "bound": pytest.approx(73.78, abs=0.01),
        "0.1": pytest.approx(66.32, abs=0.05),
        "0.01": pytest.approx(71.69, abs=0.05),
    }

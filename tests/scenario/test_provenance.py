"""Where figures come from: their classes, what was measured, and in which recording."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

import bussim
from bussim.cli import main
from bussim.commands.exact.command import command as exact
from bussim.commands.size.command import command as size
from bussim.errors import ScenarioError
from bussim.exact.from_scenario import from_scenario
from bussim.exact.sizing.assumptions import rests_on
from bussim.scenario.loader import loads
from bussim.scenario.model import Scenario
from bussim.scenario.provenance import ASSUMED, CLASSES, DERIVED, ENTERED, FIGURES, classes, link_inputs
from tests.selection import quick

LINE = """\
schema: 1
name: line
duration: 2 s
buses: [{name: link, nn: true}]
plcs:
  - name: master
    profile: {base: pw10, master_gap: 0.45 ms, scan_overhead: 3 ms, MASTER}
    nn: {bus: link, port: COM4, station: 0, slaves: 1, mode: 1, timeout: 50 ms}
  - {name: slave, profile: SLAVE, nn: {bus: link, port: COM4, station: 1}}
noise: [{bus: link, ber: 1.0e-6NOISE}]
"""
MEASURED = {
    "MASTER": "measured: {master_gap: line.sr, scan_overhead: line.sr}",
    "SLAVE": "{base: pw10, turnaround: {mean: 0.5 ms, jitter: 0.2 ms}, measured: {turnaround: line.sr}}",
    "NOISE": ", measured: line.sr",
}
#: Keys of a link that say what was asked and whether there is an answer: they have no class.
SETTINGS = {"stations", "mode", "retries", "attempts", "timeout_ms"}
NO_FIGURES = {"valid", "reasons", "notes", "not_replying", "stations_dead", "mission_s"}


def line(**parts: str) -> Scenario:
    text = LINE
    for name, empty in (("MASTER", "attempts: retries"), ("SLAVE", "pw10"), ("NOISE", "")):
        text = text.replace(name, parts.get(name, empty))
    return loads(text)


def test_what_the_inputs_are() -> None:
    plain = link_inputs(bussim.load("electrical_noise"), "link")
    assert plain["frame lengths"] == plain["gaps and turnarounds"] == DERIVED
    assert plain["noise"] == plain["PLC scan times"] == ENTERED
    assert plain["attempts of D8179"] == plain["jitter of turnarounds"] == ASSUMED
    given = link_inputs(line(), "link")
    assert given["attempts of D8179"] == ENTERED  # the master's profile says it
    assert given["gaps and turnarounds"] == ENTERED  # of the master; the weakest counts
    assert given["absent_station"] == ASSUMED
    measured = link_inputs(line(**MEASURED), "link")
    for name in ("gaps and turnarounds", "jitter of turnarounds", "noise"):
        assert measured[name] == "measured in line.sr"
    assert measured["attempts of D8179"] == ASSUMED


def test_what_the_user_did_not_enter_is_assumed() -> None:
    found = link_inputs(line(), "link")
    assert found["PLC scan times"] == ASSUMED
    assert found["noise"] == ENTERED
    for none in ("noise: []", "noise: [{bus: link, ber: 0}]"):
        perfect = loads(
            LINE.split("noise:")[0].replace("MASTER", "attempts: retries").replace("SLAVE", "pw10") + none
        )
        assert link_inputs(perfect, "link")["noise"] == ASSUMED
    given = loads(_short("electrical_noise"))
    assert link_inputs(given, "link")["PLC scan times"] == ENTERED
    one_less = loads(_short("electrical_noise").replace("    scan: {mean: 5 ms, jitter: 1 ms}\n", ""))
    assert link_inputs(one_less, "link")["PLC scan times"] == ASSUMED


def test_all_recordings_are_named() -> None:
    two = {
        **MEASURED,
        "NOISE": ", measured: line.sr}, {bus: link, station: slave, reply_loss: 0.1, measured: b.sr",
    }
    assert link_inputs(line(**two), "link")["noise"] == "measured in line.sr, b.sr"
    some = {**MEASURED, "NOISE": ", measured: line.sr}, {bus: link, station: slave, reply_loss: 0.1"}
    assert link_inputs(line(**some), "link")["noise"] == "entered (in part measured in line.sr)"
    times = link_inputs(line(**{**MEASURED, "MASTER": "attempts: retries"}), "link")["gaps and turnarounds"]
    assert times == "entered (in part measured in line.sr)"
    other = {**MEASURED, "MASTER": "measured: {master_gap: b.sr, scan_overhead: line.sr}"}
    assert link_inputs(line(**other), "link")["gaps and turnarounds"] == "measured in b.sr, line.sr"
    said = classes(link_inputs(line(**some), "link"), ["failed_attempts"])
    assert said["figures"] == {"failed_attempts": ASSUMED}


def test_the_weakest_input_is_the_class_of_a_figure() -> None:
    found = classes(link_inputs(line(**MEASURED), "link"), FIGURES)["figures"]
    assert set(found) == set(FIGURES)
    assert found["mean_ms"] == DERIVED  # measured times and noise, derived frame lengths
    assert found["timeout_floor_ms"] == ASSUMED  # no PLC scan is given
    assert found["one_dead_ms"] == found["false_errors_per_year"] == ASSUMED
    assert set(found.values()) <= set(CLASSES)


@pytest.mark.parametrize(
    "scenario", quick(2, ["dead_from_start", "press_line", "electrical_noise", "bursts"])
)
def test_every_figure_of_a_link_has_a_class(scenario: str) -> None:
    result = CliRunner().invoke(exact, [scenario, "--json", "--ignore-faults", "--deadline", "100ms"])
    worked_out = json.loads(result.stdout)["links"]["link"]
    rest = worked_out.pop("rests_on")
    assert set(worked_out) == set(rest["figures"]) | SETTINGS | NO_FIGURES
    assert 2 <= len(rest["assumptions"]) <= 3
    summary = bussim.run(loads(_short(scenario))).summary
    simulated = summary["links"]["link"]
    rest = summary["rests_on"]["links"]["link"]
    assert set(simulated) == set(rest["figures"]) | SETTINGS
    assert rest["text"][0].strip() == "published: line format and settings"


def _short(scenario: str) -> str:
    from bussim.scenario.builtin import read

    return read(scenario).replace("duration: ", "duration: 2 s #")


@pytest.mark.slow
def test_every_figure_of_a_sizing_has_a_class() -> None:
    found = json.loads(CliRunner().invoke(size, ["electrical_noise", "--json"]).stdout)["links"]["link"]
    settings = {"D8179", "D8180", "attempts"}
    assert set(found["recommended"]) - settings < set(found["rests_on"]["figures"])
    assert found["rests_on"]["inputs"]["the level of noise bad"] == ASSUMED  # counts beside what is entered


def test_what_is_set_from_outside_is_not_measured(tmp_path: Path) -> None:
    text = LINE
    for name, part in MEASURED.items():
        text = text.replace(name, part)
    path = tmp_path / "line.yaml"
    path.write_text(text, encoding="utf-8")
    changed = bussim.load(path, ["noise.0.ber=1e-5", "plcs.slave.profile.turnaround.mean=1 ms"])
    assert changed.noise[0].measured == ""
    assert changed.plcs[1].origins == {"turnaround": ENTERED}
    assert changed.plcs[0].origins["master_gap"] == "measured in line.sr"
    kept = bussim.load(path, ["noise.0.measured=other.sr", "plcs.slave.scan=7 ms"])
    assert kept.noise[0].measured == "other.sr"
    assert kept.plcs[1].origins == {"turnaround": "measured in line.sr"}


def test_only_what_a_profile_gives_can_be_measured() -> None:
    with pytest.raises(ScenarioError, match="names 'turnaround', a field that this profile does not give"):
        line(SLAVE="{base: pw10, measured: {turnaround: line.sr}}")


@pytest.mark.slow
@pytest.mark.usefixtures("pictures_undrawn")
def test_a_fit_says_where_it_was_measured(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bussim.run(loads(_short("electrical_noise")), out=tmp_path / "run", trace=True)
    fitted = str(tmp_path / "fitted.yaml")
    assert main(["fit", str(tmp_path / "run"), "-o", fitted, "--simulate", "0 s"]) == 0
    loaded = bussim.load(fitted)
    where = "run (a simulation)"
    assert loaded.plcs[0].origins == dict.fromkeys(("master_gap", "scan_overhead"), f"measured in {where}")
    assert {plc.origins["turnaround"] for plc in loaded.plcs[1:]} == {f"measured in {where}"}
    for command in (["exact"], ["size"], ["run", "--out", str(tmp_path / "again")]):
        capsys.readouterr()
        main([command[0], fitted, *command[1:]])
        said = " ".join(capsys.readouterr().out.split())
        assert f"measured in {where}: gaps and turnarounds" in said.replace("- ", "-")
    # What the scenario gave before, and was not measured anew, stays as it was.
    base = tmp_path / "base.yaml"
    base.write_text(_short("electrical_noise"), encoding="utf-8")
    assert main(["fit", str(tmp_path / "run"), "--scenario", str(base), "-o", fitted, "--force"]) == 0
    assert bussim.load(fitted).plcs[1].origins == {"turnaround": f"measured in {where}"}


def test_without_a_law_there_are_classes_but_no_assumptions() -> None:
    model = from_scenario(bussim.load("timeout_too_short"))
    assert model == {}
    jabber = from_scenario(bussim.load("slow_slave_short_timeout"))["link"]
    assert rests_on(jabber, ["mean_ms"])["assumptions"] == []
    assert rests_on(jabber, ["mean_ms"])["figures"] == {"mean_ms": ASSUMED}  # no noise is given

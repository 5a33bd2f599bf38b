"""``bussim site`` and ``bussim run --readout``, end to end."""

import json
from pathlib import Path

import pytest

from bussim.cli import main
from bussim.scenario.yaml.dump import dumped
from tests.site.examples import healthy, seen


def written(folder: Path) -> str:
    data = healthy()
    for number in (1, 2, 3):
        seen(data, number, D8203=200, D8211=14)
    path = folder / "readout.yaml"
    path.write_text(dumped(data), encoding="utf-8")
    return str(path)


def test_the_likeliest_cause_comes_first_with_its_evidence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path)
    assert main(["site", path]) == 0
    said = capsys.readouterr().out
    assert "1. noise on the wire, for all alike" in said
    assert "D8203 is the same at all slaves, to the count's own spread (1: 200, 2: 200, 3: 200)" in said
    assert main(["site", path]) == 0
    assert capsys.readouterr().out == said


def test_json_has_the_causes_in_order(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["site", written(tmp_path), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["schema"], found["kind"]) == (1, "readout")
    assert {*found["causes"][0]} == {"cause", "station", "group", "score", "evidence"}
    assert [one["score"] for one in found["causes"]] == sorted(
        (one["score"] for one in found["causes"]), reverse=True
    )
    assert found["next"]
    assert {*found["stations"]["1"]["attempt_fails"]} == {"value", "low", "high", "lens"}
    assert found["bursts"] == "cannot tell"
    assert found["noise"] == [{"bus": "link", "ber": found["noise"][0]["ber"]}]
    assert found["size"]["likeliest"]["setting"]["D8180"] == 5


def test_a_plan_names_the_least_disturbing_reading_first(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["site", written(tmp_path), "--plan"]) == 0
    said = capsys.readouterr().out.partition("how long for 15 events")[2]
    assert said.index("D8203 of the slaves: ") < said.index("the ladder: ") < said.index("at D8179 = 0: ")
    assert "the ladder's thresholds: 70, 101, 125" in said


def test_what_is_wrong_with_the_file_is_said_without_a_traceback(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "readout.yaml"
    path.write_text("schema: 1\nkind: readout\n", encoding="utf-8")
    assert main(["site", str(path)]) == 2
    said = capsys.readouterr().err
    assert all(f"{key} is missing" in said for key in ("profile", "settings", "watched", "stations"))


@pytest.mark.parametrize("as_seen", [(), ("--as-seen",)])
def test_the_readout_of_a_run_is_read_again(
    as_seen: tuple[str, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The station that is off cannot be read; that alone decides."""
    monkeypatch.chdir(tmp_path)
    run = [
        "run",
        "press_line",
        "--duration",
        "30s",
        "--no-plots",
        "--set",
        "faults=[{at: 5 s, power_off: press3}]",
    ]
    assert main([*run, "--readout", "paper.yaml", *as_seen]) == 0
    paper = Path("paper.yaml").read_text(encoding="utf-8")
    assert ("number: 1" in paper, "plc_scan" in paper) == (not as_seen, not as_seen)
    assert "- place: press3\n  state: 'off'\n  lamps: {SD: dark, RD: dark}\n" in paper
    capsys.readouterr()
    assert main(["site", "paper.yaml", "--json"]) == 0
    first = json.loads(capsys.readouterr().out)["causes"][0]
    assert (first["cause"], first["station"]) == ("station_off", 2)
    assert main([*run, "--readout", "paper.yaml"]) == 2
    assert "paper.yaml exists" in capsys.readouterr().err
    assert main(["run", "--as-seen"]) == 2


CALIBRATION = """schema: 1
kind: calibration
profile: pw10
settings: {slaves: 3, mode: 2}
experiments:
  - {name: all, retries: 3, timeout: 100 ms, slaves: 3, D8201: [67, 66, 67]}
  - {name: off_3_100, retries: 3, timeout: 100 ms, slaves: 3, D8201: 461, cut: {number: 2, times: 3, last_for: 60 s}, D8205: 140}
"""


def test_a_calibration_writes_a_profile_that_a_readout_takes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("calibration.yaml").write_text(CALIBRATION, encoding="utf-8")
    assert main(["site", "calibration.yaml", "-o", "ours.yaml", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["fields"] == {
        "attempts": "retries+1", "absent_station": "full", "error_count": "per_scan", "reply": None, "link_scan_unit": "1 ms",
    }  # fmt: skip
    assert found["times_ms"]["master_gap"] == {"value": None, "low": None, "high": None}
    assert {text.partition(":")[0] for text in found["open"]} == {
        "reply",
        "master_gap",
        "turnaround",
        "scan_overhead",
    }
    Path("readout.yaml").write_text(dumped(healthy() | {"profile": "ours.yaml"}), encoding="utf-8")
    assert main(["site", "readout.yaml"]) == 0
    assert main(["site", "ours.yaml"]) == 2
    assert main(["site", "calibration.yaml", "--plan"]) == 2
    assert main(["site", "readout.yaml", "-o", "x.yaml"]) == 2


def test_the_form_is_printed_or_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["site", "--form", "en"]) == 0
    printed = capsys.readouterr().out
    target = tmp_path / "form.html"
    assert main(["site", "--form", "en", "-o", str(target)]) == 0
    assert capsys.readouterr().out == f"{target}\n"
    assert target.read_text("utf-8") == printed
    for words in (
        ["--form", "zh", "-o", str(target)],
        ["--form", "en", "--plan"],
        ["--form", "en", "--json"],
    ):
        assert main(["site", *words]) == 2

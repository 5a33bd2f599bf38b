"""A program alone: a scenario without buses, through the commands."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

import bussim
from bussim.cli import main
from bussim.scenario.loader import examine, load, loads
from bussim.scenario.yaml.dump import dumps

ALONE = """\
schema: 1
name: a program alone
duration: 5 s
plcs:
  - name: one
    scan: {mean: 10 ms, jitter: 1 ms}
    program: |
      LD  X0
      OUT C1 K5
      LD  C1
      OUT Y0
      END
    inputs: {X0: {square: 500 ms}}
observe: [one.CN1]
latency: [{from: one.X0, to: one.Y0, edge: rising}]
"""


@pytest.fixture
def alone(tmp_path: Path) -> str:
    (tmp_path / "alone.yaml").write_text(ALONE, encoding="utf-8")
    return str(tmp_path / "alone.yaml")


def test_the_scenario_is_whole_and_survives_being_written(alone: str) -> None:
    found = load(alone)
    assert (found.buses, found.warnings) == ((), ())
    assert loads(dumps(found)) == found
    for text in ("buses:\n", "buses: []\n"):
        assert loads(ALONE + text) == found


@pytest.mark.usefixtures("pictures_undrawn")
def test_its_run_shows_what_there_is(alone: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "run"
    assert main(["run", alone, "--out", str(folder), "--trace"]) == 0
    text = capsys.readouterr().out
    assert "no bus: every PLC runs by itself\none: PLC scan mean " in text
    assert "one.X0 to one.Y0" in text
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    assert (summary["links"], summary["buses"]) == ({}, {})
    # Ten rising edges, the first at once: the fifth closes the counter for good.
    with (folder / "values.csv").open(encoding="utf-8", newline="") as file:
        counted = [row["value"] for row in csv.DictReader(file) if row["device"] == "CN1"]
    assert counted == list("12345")
    assert summary["latency"]["one.X0 to one.Y0"]["delivered"] == 1
    assert main(["report", str(folder), "--out", str(tmp_path / "r.html")]) == 0
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert "The scenario has no bus: every PLC ran by itself" in page
    assert main(["export", str(folder), "--to", "perfetto"]) == 0
    assert main(["plot", str(folder), "--out", str(tmp_path / "pictures")]) == 0
    assert [path.name for path in (tmp_path / "pictures").glob("*.png")] == ["latency_one.X0_to_one.Y0.png"]
    capsys.readouterr()
    for words, reason in (
        (
            ["plot", str(folder), "--kind", "histogram"],
            "; without a bus: bussim watch SCENARIO --devices … --plot",
        ),
        (["timeline", str(folder)], "names no bus; there is nothing to draw"),
        (["export", str(folder), "--to", "pcapng"], "the trace has no frame"),
        (["size", alone], "has neither an N:N link nor a Modbus poll list"),
        (["serve", alone], "nothing on its buses that can be served"),
    ):
        assert main(words) == 2
        assert reason in capsys.readouterr().err


def test_exact_prints_its_latency_and_watch_its_devices(
    alone: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["exact", alone, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["links"], found["polls"]) == ({}, {})
    counted = found["latency"]["one.X0 to one.Y0"]
    assert counted["no_error_ms"] is None
    assert "C1 K5 at line 2" in counted["reasons"][0]
    text = ALONE.replace("OUT C1 K5", "OUT Y1").replace("LD  C1", "LD  X0").replace("observe: [one.CN1]", "")
    Path(alone).with_name("direct.yaml").write_text(text, encoding="utf-8")
    assert main(["exact", str(Path(alone).with_name("direct.yaml")), "--json"]) == 0
    # Two scans of 11 ms at most, and what the instructions take.
    assert 22 <= json.loads(capsys.readouterr().out)["latency"]["one.X0 to one.Y0"]["no_error_ms"] < 23
    assert main(["exact", alone, "--set", "latency=[]"]) == 2
    assert "neither an N:N link nor a Modbus poll list nor a latency" in capsys.readouterr().err
    assert main(["watch", alone, "--devices", "one.CN1,one.Y0", "--to-time", "3 s"]) == 0
    assert capsys.readouterr().out.splitlines()[-1].split()[1:] == ["5", "1"]
    with pytest.raises(bussim.UsageError, match="no N:N link"):
        bussim.run(alone).plot_scan_times()


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (ALONE.replace("name: one\n", "name: one\n    nn: {bus: link, station: 0}\n"), "buses is missing, but plcs.one.nn in line 6 needs one"),
        (ALONE.replace("name: one\n", "name: one\n    ports: {COM3: {bus: link}}\n") + "buses: []\n", "buses is empty, but plcs.one.ports in line 6 needs one"),
        (ALONE + "devices: [{name: o, model: lx, bus: x, station: 1}]\n", "buses is missing, but devices.o.bus in line 16 needs one"),
        (ALONE + "noise: [{bus: link, reply_loss: 0.1}]\n", "buses is missing, but noise.0.bus in line 16 needs one"),
        (ALONE + "faults: [{cable_cut: {bus: link, after: one}, at: 1 s}]\n", "buses is missing, but faults.0.cable_cut in line 16 needs one"),
        (ALONE.replace("LD  X0\n", "LD  M8002\n      MOV K1 D8176\n", 1), "write ports: {COM3: {bus: link}} and buses: [{name: link, nn: true}]"),
    ],
)  # fmt: skip
def test_what_needs_a_bus_says_so(text: str, expected: str, tmp_path: Path) -> None:
    (tmp_path / "x.yaml").write_text(text, encoding="utf-8")
    (found,) = examine(tmp_path / "x.yaml").errors
    assert expected in str(found)


def test_an_empty_link_does_not_hide_that_programs_run(tmp_path: Path) -> None:
    for text, besides in ((ALONE, "; programs run all the same"), (ALONE.split("    program")[0], "")):
        (tmp_path / "y.yaml").write_text(text + "buses: [{name: link, nn: true}]\n", encoding="utf-8")
        (found,) = examine(tmp_path / "y.yaml").warnings
        assert found.message == f"no PLC is on link: nothing is sent there{besides}"

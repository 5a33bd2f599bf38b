"""``bussim watch``."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from bussim.cli import main

DEVICES = "line.D0,packer.D0,packer.C0,line.Y0"


def test_a_table(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["watch", "counter_preset", "--devices", DEVICES, "--to-time", "5s"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["time", "(s)", "line.D0", "packer.D0", "packer.C0", "line.Y0"]
    assert [line.split()[1:] for line in lines[1:4]] == [
        ["0", "0", "0", "0"],
        ["10", "0", "0", "0"],
        ["10", "10", "0", "0"],
    ]
    # The tenth part passes at 3.25 s.
    closed = next(float(line.split()[0]) for line in lines if line.split()[3] == "1")
    assert closed == pytest.approx(3.26, abs=0.02)


def test_every_form_says_the_same(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table, picture = tmp_path / "w.csv", tmp_path / "w.svg"
    words = ["watch", "counter_preset", "--devices", DEVICES, "--from", "3 s", "--to-time", "6 s", "--json"]
    assert main([*words, "--csv", str(table), "--plot", str(picture)]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["from_s"], found["to_s"]) == (3.0, 6.0)
    assert found["devices"]["line.D0"] == {"kind": "word", "start": 10, "changes": []}
    rows = list(csv.reader(table.read_text(encoding="utf-8").splitlines()))
    assert rows[0] == ["time_s", *DEVICES.split(",")]
    assert rows[1] == ["3.000000000", "10", "10", "0", "0"]
    changes = found["devices"]["packer.C0"]["changes"]
    times = {row[0]: row[3] for row in rows[1:]}
    for time, value in changes:
        assert next(each for at, each in times.items() if float(at) == pytest.approx(time)) == str(value)
    assert picture.read_text(encoding="utf-8").startswith("<?xml")
    assert main([*words, "--csv", str(table)]) == 2
    assert "exists" in capsys.readouterr().err


def test_signed_words(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["watch", "foreign_block", "--devices", "press1.D0", "--to-time", "1 s", "--json"]
    setting = ["--set", "plcs.press1.sources.D0={constant: -5}"]
    for option, value in (([], 65531), (["--signed"], -5)):
        assert main([*words, *setting, *option]) == 0
        assert json.loads(capsys.readouterr().out)["devices"]["press1.D0"]["changes"][0][1] == value


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--devices", "D0"], "--devices has 'D0'; write such as line.D8201"),
        (["--devices", "pack.D0"], "--devices has pack.D0, but pack is no PLC; did you mean packer?"),
        (["--devices", "line.X8"], "--devices: the device of line is 'X8', but X is numbered in octal"),
        (["--devices", "line.D0", "--from", "5"], "--from is 5, a time without a unit"),
        (
            ["--devices", "line.D0", "--from", "2 s", "--to-time", "1 s"],
            "from 2 s to 1 s is no stretch of the run",
        ),
        (["--devices", "line.D0", "--csv", "x.txt"], "x.txt ends in .txt; write a name that ends in .csv"),
    ],
)
def test_bad_requests(words: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["watch", "counter_preset", *words]) == 2
    assert message in capsys.readouterr().err


def test_exact_tells_the_bounds(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["exact", "interlock", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["latency"]["door-to-press1"]
    assert found["valid"]
    assert sum(found["parts_ms"].values()) == pytest.approx(found["no_error_ms"])
    assert list(found["lost_replies_ms"]) == ["0", "1", "2", "3", "4"]
    assert found["no_error_ms"] < found["lost_replies_ms"]["0"] < found["lost_replies_ms"]["1"]
    assert found["lost_replies_ms"]["4"] < found["every_retry_ms"]
    assert main(["exact", "interlock"]) == 0
    text = capsys.readouterr().out
    assert "latency at worst (ms)" in text
    assert "door-to-press1" in text


def test_check_tells_the_steps(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "manual_programs"]) == 0
    text = capsys.readouterr().out
    assert "2 programs" in text
    assert "  slave: program of 34 steps (18 instructions)" in text
    assert "manual_slave.il:15:1: warning: slave: MOV writes Y10" in text

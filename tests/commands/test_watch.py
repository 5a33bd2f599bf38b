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


MONITORED = """\
schema: 1
name: monitored
duration: 3 s
buses: [{name: link, nn: true}]
plcs:
  - name: one
    scan: 10 ms
    program: |
      LD  M8002
      MOV K-3 Z1
      MOV K4 V7
      DMOV K-2 C200
      LD  M8000
      OUT T0 K100
      LD  M8013
      OUT C1 K2
      OUT C200 K9
      END
observe: [one.TN0]
"""


def test_current_values_and_index_registers(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A timer of 100 ms counts to 29 in 3 s; the clock of 1 s gives three edges, the counter stops at 2."""
    (tmp_path / "m.yaml").write_text(MONITORED, encoding="utf-8")
    devices = "one.TN0,one.T0,one.CN1,one.C1,one.CN200,one.V7,one.Z1"
    words = ["watch", str(tmp_path / "m.yaml"), "--devices", devices, "--json"]
    last = {}
    for option in ([], ["--signed"]):
        assert main([*words, *option]) == 0
        found = json.loads(capsys.readouterr().out)["devices"]
        last[bool(option)] = {
            name: entry["changes"][-1:] and entry["changes"][-1][1] for name, entry in found.items()
        }
        assert [found[name]["kind"] for name in devices.split(",")] == ["word", "bit", "word", "bit"] + [
            "word"
        ] * 3
        assert [value for _, value in found["one.TN0"]["changes"]] == list(range(1, 30))
    assert last[False] == {
        "one.TN0": 29,
        "one.T0": [],
        "one.CN1": 2,
        "one.C1": 1,
        "one.CN200": 1,
        "one.V7": 4,
        "one.Z1": 65533,
    }
    assert last[True]["one.Z1"] == -3
    assert main(words) == 0
    long = [value for _, value in json.loads(capsys.readouterr().out)["devices"]["one.CN200"]["changes"]]
    assert long == [(1 << 32) - 2, (1 << 32) - 1, 0, 1][-len(long) :]


AWAY = """\
schema: 1
name: away
duration: 6 s
plcs:
  - name: p
    scan: 10 ms
    registers: {D300: 5}
    program: |
      LD  M8000
      OUT Y0
      OUT M8033 ; what memory holds stays in STOP
      MOV K3 D0
      END
  - {name: q, scan: 10 ms}
faults:
  - {at: 1 s, for: 1 s, stop: p}
  - {at: 1 s, for: 1 s, stop: q}
  - {at: 3 s, for: 2 s, stop: p}
  - {at: 3500 ms, for: 1 s, power_off: p}
"""


def test_stop_and_a_time_without_supply_show_when_they_happen(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """M8033 keeps outputs and memory in STOP, not without supply: Y0 is off from 3.5 s to the RUN at 5 s."""
    (tmp_path / "a.yaml").write_text(AWAY, encoding="utf-8")
    names = "p.Y0,p.D0,p.D300,p.M8001,p.M8003,q.M8000,q.M8001,q.M8003"
    words = ["watch", str(tmp_path / "a.yaml"), "--devices", names]
    assert main([*words, "--json", "--plot", str(tmp_path / "a.svg")]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["without_supply"] == [["p", 3.5, 4.5]]
    devices = found["devices"]
    assert [devices[name]["start"] for name in names.split(",")] == [0, 0, 5, 0, 0, 1, 0, 0]
    changes = {name: [(round(at, 1), value) for at, value in devices[name]["changes"]] for name in devices}
    assert changes["p.Y0"] == [(0.0, 1), (3.5, 0), (5.0, 1)]
    assert changes["p.D0"] == [(0.0, 3), (4.5, 0), (5.0, 3)]
    assert changes["p.D300"] == []  # latched
    assert [at for at, value in changes["p.M8001"] if value] == [1.0, 3.0]
    assert changes["q.M8000"] == [(1.0, 0), (2.0, 1)]
    assert changes["q.M8001"] == [(1.0, 1), (2.0, 0)]
    assert changes["q.M8003"] == [(0.0, 1), (2.0, 0), (2.0, 1)]  # off in the first scan alone
    assert "without supply" in (tmp_path / "a.svg").read_text(encoding="utf-8")
    assert main([*words, "--from", "4 s"]) == 0
    text = capsys.readouterr().out
    assert text.endswith("p had no supply from 4.000000 to 4.500000 s: its outputs are off\n")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--devices", "D0"], "--devices has 'D0'; write such as line.D8201"),
        (["--devices", "pack.D0"], "--devices has pack.D0, but pack is no PLC; did you mean packer?"),
        (["--devices", "line.X8"], "--devices: the device of line is 'X8', but X is numbered in octal"),
        (["--devices", "line.X9"], "point 9 of X is X11"),
        (["--devices", ""], "--devices is empty; write such as line.D8201"),
        (["--devices", " "], "--devices is empty; write such as line.D8201"),
        (
            ["--devices", "line.D0,,line.D1"],
            "--devices: entry 2 of 3 is empty behind line.D0; remove a comma",
        ),
        (["--devices", ",line.D1"], "--devices: entry 1 of 2 is empty; remove a comma"),
        (
            ["--devices", "line.tnO"],
            "--devices: the device of line is 'tnO', not a device; did you mean TN0?",
        ),
        (["--devices", "line.Q1"], "write a letter of X Y M S T C D TN CN V Z and a number"),
        (["--devices", "line.Z8"], "--devices: the device of line is 'Z8', allowed Z0–Z7"),
        (["--devices", "line.D0", "--from", "5"], "--from is 5, a time without a unit"),
        (
            ["--devices", "line.D0", "--from", "2 s", "--to-time", "1 s"],
            "from 2 s to 1 s does not lie within the run",
        ),
        (["--devices", "line.D0", "--csv", "x.txt"], "x.txt ends in .txt; write a name that ends in .csv"),
    ],
)
def test_bad_requests(words: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["watch", "counter_preset", *words]) == 2
    assert message in capsys.readouterr().err


def test_exact_prints_the_bounds(capsys: pytest.CaptureFixture[str]) -> None:
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


def test_check_prints_the_steps(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "manual_programs"]) == 0
    text = capsys.readouterr().out
    assert "2 programs" in text
    assert "  slave: program of 34 steps (18 instructions)" in text
    assert "manual_slave.il:15:1: warning: slave: MOV writes Y10" in text


def test_a_file_that_exists_names_the_option_and_devices_are_named_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = tmp_path / "w.csv"
    table.write_text("mine", encoding="utf-8")
    words = ["watch", "counter_preset", "--to-time", "1s", "--devices"]
    assert main([*words, "line.d0", "--csv", str(table)]) == 2
    assert "choose another name with --csv, or replace it with --force" in capsys.readouterr().err
    assert main([*words, "line.X0,line.x000"]) == 2
    assert "--devices has line.X0 twice, the second time as line.x000" in capsys.readouterr().err
    assert main([*words, "line.d0,line.y0"]) == 0
    assert capsys.readouterr().out.split("\n")[0].split()[2:] == ["line.D0", "line.Y0"]


@pytest.mark.slow
def test_a_picture_has_room_for_so_many_and_says_which_are_left_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    devices = ",".join(f"line.D{number}" for number in range(38))
    picture = tmp_path / "w.png"
    words = ["watch", "counter_preset", "--to-time", "1s", "--devices", devices, "--plot", str(picture)]
    assert main(words) == 0
    assert capsys.readouterr().err == f"{picture} has no room for line.D36, line.D37\n"
    # Width and height in the PNG's header, at 150 dots an inch.
    assert int.from_bytes(picture.read_bytes()[20:24], "big") <= 22 * 150


def test_a_table_says_when_a_plc_had_no_supply(tmp_path: Path) -> None:
    scenario = tmp_path / "x.yaml"
    scenario.write_text(
        "schema: 1\nname: x\nduration: 3 s\nplcs:\n"
        "  - {name: p, scan: 5 ms, program: 'LD M8000\n\n    MOV K5 D300\n\n    END'}\n"
        "  - {name: q, scan: 5 ms}\n"
        "faults: [{at: 1 s, for: 500 ms, power_off: p}]\n",
        encoding="utf-8",
    )
    table = tmp_path / "x.csv"
    assert main(["watch", str(scenario), "--devices", "p.D300,q.D0", "--csv", str(table)]) == 0
    head, *rows = (line.split(",") for line in table.read_text(encoding="utf-8").splitlines())
    assert head == ["time_s", "p.D300", "q.D0", "p without supply"]
    # D300 is latched: nothing of memory changes where the supply goes and comes back.
    assert [row[1:] for row in rows] == [["0", "0", "0"], ["5", "0", "0"], ["5", "0", "1"], ["5", "0", "0"]]
    assert [row[0] for row in rows[2:]] == ["1.000000000", "1.500000000"]

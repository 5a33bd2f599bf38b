from __future__ import annotations

import csv
import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from bussim.cli import main
from bussim.devices.v80.map import V80
from bussim.engines.modbus.adu import Mode
from bussim.engines.modbus.server import Space
from bussim.line.characters import CharFormat
from bussim.live.faults import Injected, ReplyFault
from bussim.live.served import ServedSlave
from bussim.units import TICKS_PER_MS
from tests.live.peers import TerminalPair
from tests.live.recordings.reading import sniffed

posix = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")
PATIENCE = 20.0
LINE = ("-b", "115200", "-P", "none")


@pytest.fixture
def slave() -> Iterator[ServedSlave]:
    with ServedSlave(fmt=CharFormat(8, "N", 1), maps={1: V80(), 2: V80()}) as served:
        for number in range(50):
            device(served).set(Space.HOLDING, number, number * 1000)
        yield served


def device(served: ServedSlave, station: int = 1) -> V80:
    v80 = served.maps[station]
    assert isinstance(v80, V80)
    return v80


@posix
def test_once(slave: ServedSlave, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["poll", slave.device, *LINE, "-r", "2", "-c", "3", "-1"]) == 0
    out = capsys.readouterr().out
    assert "station 1  [2] 1000  [3] 2000  [4] 3000" in out
    assert "station 1        1     1                  0" in out


@posix
@pytest.mark.parametrize(
    ("options", "values"),
    [
        (("-0", "-r", "0x28"), [40000]),
        (("-r", "41", "-t", "4:int16"), [40000 - 65536]),
        (("-r", "41", "-t", "4:hex"), ["0x9C40"]),
        (("-r", "41", "-t", "4:int"), [41000 * 65536 + 40000 - (1 << 32)]),
        (("-r", "41", "-t", "4:int", "-B"), [40000 * 65536 + 41000 - (1 << 32)]),
        (("-t", "3", "-c", "2"), [0, 0]),
        (("-t", "0", "-c", "9"), [0] * 9),
        (("-t", "1"), [0]),
    ],
)
def test_formats(
    slave: ServedSlave, capsys: pytest.CaptureFixture[str], options: tuple[str, ...], values: list[object]
) -> None:
    assert main(["poll", slave.device, *LINE, *options, "-1", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["polls"][0]["values"] == values
    assert found["polls"][0]["ok"] == 1
    assert found["polls"][0]["response_ms"]["max"] > 0


@posix
@pytest.mark.parametrize(
    ("options", "values", "space", "written"),
    [
        (("-r", "5"), ["7"], Space.HOLDING, [7]),
        (("-r", "5"), ["7", "0xFFFF"], Space.HOLDING, [7, 65535]),
        (("-r", "5", "-t", "4:float"), ["1.5"], Space.HOLDING, [0, 0x3FC0]),
        (("-r", "5", "-t", "4:float", "-B"), ["1.5"], Space.HOLDING, [0x3FC0, 0]),
        (("-r", "5", "-t", "0"), ["1"], Space.COILS, [1]),
        (("-r", "5", "-t", "0"), ["1", "0", "1"], Space.COILS, [1, 0, 1]),
    ],
)
def test_writing(
    slave: ServedSlave, options: tuple[str, ...], values: list[str], space: Space, written: list[int]
) -> None:
    assert main(["poll", slave.device, *LINE, *options, "-a", "1,2", *values]) == 0
    for station in (1, 2):
        found = [device(slave, station).get(space, 4 + index) for index in range(len(written))]
        assert found == written


@posix
def test_negative_values_come_behind_dashes(slave: ServedSlave) -> None:
    assert main(["poll", slave.device, *LINE, "-t", "4:int16", "--", "-5"]) == 0
    assert device(slave).get(Space.HOLDING, 0) == 65531
    assert main(["poll", slave.device, *LINE, "-t", "4:int", "--", "-5"]) == 0
    assert [device(slave).get(Space.HOLDING, at) for at in (0, 1)] == [65531, 65535]


@posix
def test_a_broadcast_is_written_without_a_response(slave: ServedSlave) -> None:
    assert main(["poll", slave.device, *LINE, "-a", "0", "77"]) == 0
    assert [device(slave, station).get(Space.HOLDING, 0) for station in (1, 2)] == [77, 77]


@posix
def test_failures_are_counted_and_retried(slave: ServedSlave, capsys: pytest.CaptureFixture[str]) -> None:
    slave.faults.inject(Injected(ReplyFault.DROP))
    slave.faults.inject(Injected(ReplyFault.CORRUPT))
    slave.faults.inject(Injected(ReplyFault.EXCEPTION, code=4))
    assert main(["poll", slave.device, *LINE, "-1", "--retries", "2", "-o", "300 ms", "--json"]) == 1
    (poll,) = json.loads(capsys.readouterr().out)["polls"]
    assert (poll["turns"], poll["attempts"], poll["ok"], poll["exceptions"]) == (1, 3, 0, 1)
    assert poll["errors"] == {
        "CRC or LRC": 1,
        "exception 04, device failure": 1,
        "no response in time": 1,
    }


@posix
def test_no_station_there_is_exit_code_1(slave: ServedSlave, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["poll", slave.device, *LINE, "-a", "9", "-1", "-o", "50 ms"]) == 1
    assert "no response in time" in capsys.readouterr().out


@posix
def test_ascii(capsys: pytest.CaptureFixture[str]) -> None:
    with ServedSlave(mode=Mode.ASCII, fmt=CharFormat(8, "N", 1)) as served:
        assert (
            main(["poll", served.device, "-m", "ascii", "-b", "115200", "-d", "8", "-P", "none", "-1"]) == 0
        )
    assert "[1] 0" in capsys.readouterr().out


@posix
def test_parity_on_a_pseudo_terminal_is_a_warning(
    slave: ServedSlave, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["poll", slave.device, "-b", "115200", "-1"]) == 0
    assert "neither parity nor 7 data bits" in capsys.readouterr().err


@posix
def test_reserved_stations_are_asked_with_a_warning(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with TerminalPair() as pair:
        assert main(["poll", pair.left, *LINE, "-a", "247,248,255", "-1", "-o", "0.05"]) == 1
        asked = bytes(pair.carried[0])
    assert [frame[0] for frame in (asked[at : at + 8] for at in range(0, len(asked), 8))] == [247, 248, 255]
    err = capsys.readouterr().err
    assert "station 248: numbers above 247 are reserved" in err
    assert "station 247" not in err


@posix
def test_an_exception_has_its_name_and_is_exit_code_1(
    slave: ServedSlave, capsys: pytest.CaptureFixture[str]
) -> None:
    names = {1: "illegal function", 7: "negative acknowledge", 8: "memory parity error"}
    names |= {0x0A: "gateway path unavailable", 0x0B: "gateway target failed to respond", 0x0C: "unknown"}
    for code, name in names.items():
        slave.faults.inject(Injected(ReplyFault.EXCEPTION, code=code))
        assert main(["poll", slave.device, *LINE, "-1"]) == 1
        assert f"exception {code:02X}, {name}" in capsys.readouterr().out


@posix
def test_all_bytes_are_shown_in_lines_that_sniff_reads(
    slave: ServedSlave, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["poll", slave.device, *LINE, "-v", "--rounds", "3", "-c", "2", "-l", "10"]) == 0
    shown = capsys.readouterr().err
    directions = [line.split()[1] for line in shown.splitlines()]
    assert directions[0] == ">"
    assert directions.count(">") == 3
    carried = bytes.fromhex("".join(line.split(maxsplit=2)[2] for line in shown.splitlines()))
    assert carried == 3 * (bytes.fromhex("010300000002c40b") + bytes.fromhex("010304000003e8fa8d"))
    path = tmp_path / "line.txt"
    path.write_text(shown, encoding="utf-8")
    found = sniffed(path, *LINE)
    assert (found["outcomes"], found["unreadable_lines"]) == ({"ok": 3}, 0)


@posix
def test_csv_has_a_row_a_turn(slave: ServedSlave, tmp_path: Path) -> None:
    path = tmp_path / "polls.csv"
    command = ["poll", slave.device, *LINE, "-a", "1,9", "-c", "2", "-1", "-o", "50 ms", "--csv", str(path)]
    assert main(command) == 1  # one of them failed
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["station"] for row in rows] == ["1", "9"]
    assert rows[0]["values"] == "0 1000"
    assert rows[0]["outcome"] == "ok"
    assert float(rows[0]["response_ms"]) > 0
    assert rows[1]["outcome"] == "no response in time"
    assert rows[1]["response_ms"] == ""


@posix
def test_ctrl_c_ends_it_with_summary_and_whole_files(slave: ServedSlave, tmp_path: Path) -> None:
    path = tmp_path / "polls.csv"
    command = [
        sys.executable,
        "-m",
        "bussim",
        "poll",
        slave.device,
        *LINE,
        "-l",
        "10 ms",
        "--csv",
        str(path),
    ]
    running = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    until = time.monotonic() + PATIENCE
    while len(slave.requests) < 20 and time.monotonic() < until:
        time.sleep(0.02)
    running.send_signal(signal.SIGINT)
    out, err = running.communicate(timeout=PATIENCE)
    assert running.returncode == 0, err
    assert "Traceback" not in err
    assert "failed attempts" in out
    lines = path.read_text(encoding="utf-8").splitlines()
    assert len(lines) >= 20
    assert all(line.count(",") == lines[0].count(",") for line in lines)


SCENARIO = """\
schema: 1
name: feeder
duration: 5 s
buses: [{name: feeder, baud: 115200, format: 8N1}]
plcs:
  - name: press1
    scan: 5 ms
    registers: {D500: 4711}
    ports:
      COM3: {bus: feeder, protocol: modbus-rtu-master, timeout: 2000 ms, interval: 5 ms}
    polls:
      - {name: position, port: COM3, station: 1, function: 3, address: 2, count: 2, to: D400, every: 20 ms}
      - {name: speed, port: COM3, station: 1, function: 6, address: 16, from: D500, times: 1}
devices:
  - {name: feeder1, model: v80, bus: feeder, station: 1}
  - name: panel
    model: hmi
    bus: feeder
    polls: [{name: look, station: 1, function: 3, address: 1, count: 1, every: 20 ms}]
"""


@posix
@pytest.mark.parametrize(
    ("node", "seen"), [("press1.COM3", {"position": [2000, 3000], "speed": []}), ("panel", {"look": [1000]})]
)
def test_the_poll_list_of_a_scenario(
    slave: ServedSlave,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    node: str,
    seen: dict[str, list[int]],
) -> None:
    file = tmp_path / "s.yaml"
    file.write_text(SCENARIO, encoding="utf-8")
    command = ["poll", slave.device, "--scenario", str(file), "--list", node, "--rounds", "3", "--json"]
    assert main(command) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["baud"] == 115200
    assert {poll["name"]: poll["values"] for poll in found["polls"]} == seen
    assert all(poll["ok"] >= 1 for poll in found["polls"])
    if node == "press1.COM3":
        assert device(slave).get(Space.HOLDING, 16) == 4711


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["x", "-t", "9"], "allowed are 0, 1, 3 and 4"),
        (["x", "-t", "4:double"], "allowed are uint, int16, hex, int, float"),
        (["x", "-t", "0:int"], "have no format"),
        (["x", "-t", "3", "5"], "can only be read"),
        (["x", "-t", "0", "2"], "allowed are 0 and 1"),
        (["x", "70000"], "allowed 0…65535"),
        (["x", "word"], "no whole number"),
        (["x", "1.5"], "no whole number such as 100 or 0x64"),
        (["x", "010"], "write 10, without zeros in front"),
        (["x", "-t", "4:int", "--", "-0010"], "write -10, without zeros in front"),
        (["x", "-c", "2", "5"], "-c is how many values are read"),
        (["x", "-r", "0"], "allowed 1…65536"),
        (["x", "-r", "65536", "-c", "2"], "beyond the last one"),
        (["x", "-c", "126"], "a request may name 125"),
        (["x", "-a", "256"], "stations 1…255"),
        (["x", "-a", "a"], "such as 1 or 1,3,5:8"),
        (["x", "-a", "0"], "can only be written"),
        (["x", "-P", "mark"], "none, even and odd"),
        (["x", "-o", "500"], "without a unit that is 500 s, allowed 0.01…10"),
        (["x", "-o", "0"], "allowed 0.01…10"),
        (["x", "-o", "0.005"], "such as 5 ms"),
        (["x", "-o", "500"], "such as 500 ms"),
        (["x", "-o", "0 ms"], "must be above 0"),
        (["x", "-o", "nan"], "without a unit"),
        (["x", "-l", "0.5"], "such as 0.5 s"),
        (["x", "-l", "soon"], "not a time"),
        (["x", "-l", "soon", "5"], "not a time"),
        (
            ["x", "--scenario", "two_stations", "--list", "a", "-b", "9600", "--retries", "1", "-v"],
            "leave -b, --retries out",
        ),
        (["x", "-d", "7"], "RTU needs 8 data bits"),
        (["/dev/not/there"], "cannot be opened"),
        (["x", "--list", "a"], "belong together"),
        (["x", "--csv", "/no/such/folder/x.csv"], "there is no folder /no/such/folder"),
    ],
)
def test_mistakes_are_exit_code_2(
    arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["poll", *arguments]) == 2
    err = capsys.readouterr().err
    assert said in err
    assert "Traceback" not in err


def test_a_scenario_without_that_master_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "s.yaml"
    file.write_text(SCENARIO, encoding="utf-8")
    assert main(["poll", "x", "--scenario", str(file), "--list", "pres1.COM3"]) == 2
    assert "did you mean press1.COM3" in capsys.readouterr().err


TWO_POLLS = """\
schema: 1
name: two
duration: 1 s
buses: [{name: line, baud: 19200, format: 8N1}]
devices:
  - name: hmi
    model: hmi
    bus: line
    timeout: 100 ms
    polls:
      - {name: a, station: 1, function: 3, address: 1, count: 1}
      - {name: b, station: 1, function: 3, address: 2, count: 1}
"""


@posix
@pytest.mark.parametrize(("option", "late", "mismatched"), [("--resync", 1, 0), ("--no-resync", 0, 5)])
def test_a_late_response_is_thrown_away_or_told(
    slave: ServedSlave,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    option: str,
    late: int,
    mismatched: int,
) -> None:
    (tmp_path / "two.yaml").write_text(TWO_POLLS)
    slave.faults.inject(Injected(ReplyFault.DELAY, by=140 * TICKS_PER_MS))
    scenario = ("--scenario", str(tmp_path / "two.yaml"), "--list", "hmi")
    assert main(["poll", slave.device, *scenario, "--rounds", "3", option, "--json"]) == 1
    polls = json.loads(capsys.readouterr().out)["polls"]
    assert sum(poll["late"] for poll in polls) == late
    assert sum(poll["mismatched"] for poll in polls) == mismatched
    assert polls[1]["values"] == [2000]

"""Recordings as people bring them: Chinese loggers, no times, coarse times, one side of a line, two lines on a wire."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bussim.cli import main
from bussim.line.characters import NN_LINE
from bussim.live.recordings.source import LineSetup
from bussim.live.recordings.text import TextFile
from bussim.units import TICKS_PER_SECOND
from tests.live.recordings.generator import (
    Sent,
    Serial,
    ascii_frame,
    modbus,
    nn_link,
    pcap,
    rows,
    rtu,
    sigrok,
    wave,
)
from tests.live.recordings.reading import ok, sniffed

SERIAL = Serial(19200, 8, "E", 1)
SENT, _ = modbus(SERIAL, 20, 3)


def codes(found: dict[str, Any]) -> set[str]:
    """The codes of the warnings but that the rate is assumed, as it is of every text."""
    return {each["code"] for each in found["warnings"]} - {"assumed_rate"}


def written(
    path: Path, line: Callable[[float, Sent], str], *, head: str = "", encoding: str = "utf-8"
) -> Path:
    """A text with a line a frame, and its heading."""
    path.write_text(head + "".join(line(at, sent) + "\n" for at, sent in rows(SENT, SERIAL)), encoding)
    return path


@pytest.mark.parametrize(
    ("heading", "per_second"),
    [
        *(("time_ms", 1e3), ("时间(ms)", 1e3), ("时间（毫秒）", 1e3), ("Time (milliseconds)", 1e3)),
        *(("time [μs]", 1e6), ("时间/微秒", 1e6), ("time_ns", 1e9), ("时间(秒)", 1)),
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8", "gb18030"])
def test_a_heading_names_the_unit_of_times(
    heading: str, per_second: float, encoding: str, tmp_path: Path
) -> None:
    def line(at: float, sent: Sent) -> str:
        return f"{at * per_second:.0f},{sent.chars.hex(' ')}" if per_second > 1e3 else (
            f"{at * per_second:.3f},{sent.chars.hex(' ')}"
        )  # fmt: skip

    path = written(tmp_path / "log.csv", line, head=f"{heading},数据\n", encoding=encoding)
    found = sniffed(path)
    assert ok(found) == 20
    assert found["duration_s"] == pytest.approx(rows(SENT, SERIAL)[-1][0], abs=0.002)
    digits = {1: 3, 1e3: 6, 1e6: 6, 1e9: 9}[per_second]
    file = TextFile(path)
    assert sum(len(each.chars) for each in file.chunks(LineSetup(NN_LINE))) == found["characters"]
    assert file.resolution == TICKS_PER_SECOND // 10**digits
    assert "coarse_times" not in codes(found)


@pytest.mark.parametrize(
    "form",
    [
        lambda at, sent: f"{at:.6f};{'收' if sent.wire else '发'};{sent.chars.hex(' ')}",
        lambda at, sent: f"{at:.6f}\t{'接收' if sent.wire else '发送'}：{sent.chars.hex(' ')}",
        lambda at, sent: f"[08:00:{at:09.6f}]{'收←◆' if sent.wire else '发→◇'}{sent.chars.hex(' ').upper()} ",
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8", "gb18030"])
def test_chinese_loggers_name_directions(
    form: Callable[[float, Sent], str], encoding: str, tmp_path: Path
) -> None:
    found = sniffed(written(tmp_path / "log.txt", form, encoding=encoding))
    assert (ok(found), found["frames"], found["unreadable_lines"]) == (20, 40, 0)
    assert codes(found) == {"software_times"}


def test_bytes_without_times_are_no_times(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = written(tmp_path / "log.txt", lambda _, sent: sent.chars.hex(" "))
    assert main(["sniff", str(path)]) == 2
    assert "bytes without times" in capsys.readouterr().err


def test_coarse_times_are_said_and_give_no_precise_figures(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Six turns a second by a clock of whole seconds: the median distance of turns is 0, their mean is not."""
    lines = []
    for turn in range(60):
        clock = f"08:00:{turn // 6:02d}"
        reply = rtu(1, 3, 4, bytes((0, turn, 0, 1)))
        lines += [f"{clock} {rtu(1, 3, 0, 0, 0, 2).hex(' ')}", f"{clock} {reply.hex(' ')}"]
    path = tmp_path / "log.txt"
    path.write_text("\n".join(lines), encoding="utf-8")
    assert "coarse_times" in codes(sniffed(path))
    assert main(["fit", str(path), "--simulate", "0 s", "--json"]) == 0
    (poll,) = json.loads(capsys.readouterr().out)["modbus"]["polls"]
    assert poll["every_ms"] == pytest.approx(1000 / 6, rel=0.1)


@pytest.mark.parametrize(("wire", "said"), [(0, "master's side"), (1, "stations' side")])
def test_a_wire_with_one_side_of_the_line_is_named(wire: int, said: str, tmp_path: Path) -> None:
    sent = [each for each in SENT if each.wire == wire and each.chars[1] in (1, 3, 23)]
    found = sniffed(pcap(tmp_path / "line.pcap", sent, 147))
    assert ok(found) == 0
    assert [said in each["text"] for each in found["warnings"] if each["code"] == "one_side"] == [True]


def test_two_protocols_on_one_wire_are_no_clean_line(tmp_path: Path) -> None:
    def line(at: float, sent: Sent) -> str:
        other = ascii_frame(sent.chars[:-2]) if at > rows(SENT, SERIAL)[-1][0] / 2 else sent.chars
        return f"{at:.6f} {other.hex()}"

    assert codes(sniffed(written(tmp_path / "log.txt", line))) == {"mixed_line"}


def test_a_line_that_changes_its_rate_is_read_where_it_is_the_faster_one(tmp_path: Path) -> None:
    slow, rate = Serial(9600), 200_000
    levels = [wave(modbus(each, 30, seed)[0], each, rate) for seed, each in enumerate((slow, SERIAL))]
    found = sniffed(sigrok(tmp_path / "line.sr", rate, {"D0": np.concatenate(levels)}))
    assert (found["baud"], found["format"], found["inverted"], ok(found)) == (19200, "8E1", False, 30)
    assert codes(found) == {"mixed_line"}


@pytest.mark.parametrize("options", [("--invert",), ("--no-invert",), ("--channel", "A,B")])
def test_options_that_a_text_has_nothing_for_are_refused(
    options: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path / "log.txt", lambda at, sent: f"{at:.6f} {sent.chars.hex()}")
    for command in ("sniff", "fit"):
        assert main([command, str(path), *options]) == 2
        assert "sigrok" in capsys.readouterr().err


def test_a_wire_that_is_said_and_is_no_direction_of_the_line_is_told(tmp_path: Path) -> None:
    rate = 200_000
    level = wave(SENT, SERIAL, rate)
    clock = (np.arange(len(level)) // 50 % 2).astype(level.dtype)
    path = sigrok(tmp_path / "line.sr", rate, {"CLK": clock, "RX": level})
    suggested = sniffed(path, "--channel", "RX,CLK")["suggested"]
    assert suggested["channels"] == ["RX"]


def test_a_timeout_that_was_never_seen_is_unknown(tmp_path: Path) -> None:
    serial, rate = Serial(38400, 7, "E", 1), 400_000
    link = sniffed(sigrok(tmp_path / "line.sr", rate, {"D0": wave(nn_link(serial, 20), serial, rate)}))[
        "link"
    ]
    assert (link["settings_heard"], link["timeout_ms"]) == (False, None)


def test_lost_replies_of_a_station_that_no_scenario_has_refuse_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Stations 1, 2, 10 and 249 are asked in turn, every fifth reply is lost."""
    sent, now = [], 0.05
    for turn in range(80):
        station = (1, 2, 10, 249)[turn % 4]
        sent.append(Sent(now, rtu(station, 3, 0, 0, 0, 1)))
        if turn % 5:
            sent.append(Sent(now + 0.02, rtu(station, 3, 2, 0, turn), 1))
        now += 0.1
    path = pcap(tmp_path / "line.pcap", sent, 147)
    assert [name.split(":")[0] for name in sniffed(path)["exchanges"]] == ["1", "2", "10", "249"]
    target = tmp_path / "fitted.yaml"
    assert main(["fit", str(path), "--simulate", "0 s", "-o", str(target)]) == 0
    assert main(["check", str(target)]) == 0
    capsys.readouterr()
    assert "station249" not in target.read_text(encoding="utf-8")


def test_a_trace_that_was_not_written_to_its_end(tmp_path: Path) -> None:
    """It lasts as long as it goes: a run of which a third was written has not been silent for the rest."""
    run = ["run", "two_stations", "--trace", "--duration", "2s", "--no-plots", "--out", str(tmp_path / "run")]
    assert main(run) == 0
    whole = sniffed(tmp_path / "run" / "trace.jsonl")
    assert "cut_file" not in codes(whole)
    lines = (tmp_path / "run" / "trace.jsonl").read_text("utf-8").splitlines(keepends=True)
    third = "".join(lines[: len(lines) // 3])
    (tmp_path / "cut.jsonl").write_text(third[:-20], "utf-8")
    killed = tmp_path / "killed.incomplete"
    killed.mkdir()
    (killed / "trace.jsonl").write_text(third, "utf-8")
    (killed / "INCOMPLETE").touch()
    for path in (tmp_path / "cut.jsonl", killed):
        found = sniffed(path)
        assert "cut_file" in codes(found)
        assert 0.4 < found["duration_s"] < 0.9
        assert found["bus_load"] == pytest.approx(whole["bus_load"], rel=0.05)


@pytest.mark.slow
def test_a_trace_that_another_program_wrote_anew_is_read_as_it_was(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario = Path(__file__).parents[3] / "scenarios" / "press_line.yaml"
    folder = tmp_path / "run"
    assert main(["run", str(scenario), "--duration", "2 s", "--trace", "--no-plots", "-o", str(folder)]) == 0
    path = tmp_path / "anew.jsonl"
    whole = sniffed(folder)
    lines = [json.loads(line) for line in (folder / "trace.jsonl").read_text().splitlines()]
    for write in (json.dumps, lambda line: " " + json.dumps(line, sort_keys=True)):
        path.write_text("".join(f"{write(line)}\n" for line in lines))
        assert {**sniffed(path), "source": None} == {**whole, "source": None}
    path.write_text("".join(f"{json.dumps(line, indent=2)}\n" for line in lines))
    capsys.readouterr()
    assert main(["sniff", str(path)]) == 2
    assert "a trace has one object a line" in capsys.readouterr().err

"""Every form of text gives the frames of the plain one, with lines of garbage too."""

from __future__ import annotations

import random
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from bussim.cli import main
from tests.live.recordings.generator import Sent, Serial, modbus, pcap, rows, rtu
from tests.live.recordings.reading import attempts, ok, sniffed

SERIAL = Serial(9600, 8, "N", 1)
LINE = ("-b", "9600", "-P", "none")
SENT, OUTCOMES = modbus(SERIAL, 60, 11, lost=0.1, damaged=0.1, begin=86_390.0)
ROWS = rows(SENT, SERIAL)
SPAN = ROWS[-1][0] - ROWS[0][0]
DAY = datetime(2026, 1, 5, tzinfo=UTC)


def hexed(each: Sent, separator: str = " ") -> str:
    data = bytearray(each.chars)
    for bit in each.flips:
        char, number = divmod(bit, SERIAL.bits)
        data[char] ^= 1 << number - 1
    return bytes(data).hex(separator)


def line_by_line(write: Callable[[float, Sent], str]) -> list[str]:
    return [write(at, each) for at, each in ROWS]


def clock(at: float, form: str = "%H:%M:%S.%f") -> str:
    return (DAY + timedelta(seconds=round(at, 6))).strftime(form)


def socat(verbose: bool) -> list[str]:
    lines = []
    for at, each in ROWS:
        data = hexed(each)
        head = f"{'<' if each.wire else '>'} {clock(at, '%Y/%m/%d %H:%M:%S.%f')}  length={len(each.chars)} from=0 to={len(each.chars) - 1}"
        lines.append(head)
        if verbose:
            pairs = data.split()
            for start in range(0, len(pairs), 16):
                part = pairs[start : start + 16]
                lines.append(f" {' '.join(part):<48} {'.41 42.' * 2}")
        else:
            lines.append(f" {data}")
        lines.append("--")
    return lines


def saleae_1() -> list[str]:
    lines = ["Time [s],Value,Parity Error,Framing Error"]
    for each in SENT:
        lines += [
            f"{each.at + SERIAL.lasts(index):.12f},{f'0x{value}' if index % 2 else int(value, 16)},,"
            for index, value in enumerate(hexed(each).split())
        ]
    return lines


def saleae_2(iso: bool) -> list[str]:
    lines = ["name,type,start_time,duration,data,error"]
    for each in SENT:
        for index, value in enumerate(hexed(each).split()):
            at = each.at + SERIAL.lasts(index)
            start = clock(at, "%Y-%m-%dT%H:%M:%S.%f+00:00") if iso else f"{at:.9f}"
            lines.append(f'"Async Serial","data",{start},{SERIAL.lasts(1):.9f},0x{value.upper()},')
    return lines


FORMS: dict[str, Callable[[], list[str]]] = {
    "plain": lambda: line_by_line(lambda at, each: f"{at:.6f} {hexed(each)}"),
    "joined": lambda: line_by_line(lambda at, each: f"{at:.6f}\t{hexed(each).replace(' ', '').upper()}"),
    "first edge": lambda: ["# time: start", *(f"{each.at:.6f} {hexed(each)}" for each in SENT)],
    "csv": lambda: line_by_line(lambda at, each: f"{at:.6f},{hexed(each, ',')}"),
    "colons": lambda: line_by_line(lambda at, each: f"{at:.6f};{hexed(each, ':')}"),
    "dashes": lambda: line_by_line(lambda at, each: f"{at:.6f} {hexed(each, '-')}"),
    "0x": lambda: line_by_line(lambda at, each: f"{at:.6f} " + " ".join(f"0x{int(v, 16):X}" for v in hexed(each).split())),
    "brackets": lambda: line_by_line(lambda at, each: f"{at:.6f} " + "".join(f"[{v}]" for v in hexed(each).split())),
    "angles": lambda: line_by_line(lambda at, each: f"{at:.6f} " + "".join(f"<{v}>" for v in hexed(each).split())),
    "milliseconds": lambda: line_by_line(lambda at, each: f"{at * 1000:.3f} ms {hexed(each)}"),
    "microseconds": lambda: line_by_line(lambda at, each: f"{at * 1e6:.0f}us {hexed(each)}"),
    "unit in the heading": lambda: ["time_ms;data", *line_by_line(lambda at, each: f"{at * 1000:.3f};{hexed(each)}")],
    "heading in seconds": lambda: ["Time [s],Data", *line_by_line(lambda at, each: f"{at:.6f},{hexed(each)}")],
    "decimal comma": lambda: line_by_line(lambda at, each: f"{at:.6f} {hexed(each)}".replace(".", ",")),
    "decimal comma, semicolon": lambda: line_by_line(lambda at, each: f"{at:.6f};{hexed(each)}".replace(".", ",")),
    "clock over midnight": lambda: line_by_line(lambda at, each: f"{clock(at)} {hexed(each)}"),
    "clock in brackets": lambda: line_by_line(lambda at, each: f"[{clock(at)[:-3]}] {hexed(each)}"),
    "date": lambda: line_by_line(lambda at, each: f"{clock(at, '%Y-%m-%d %H:%M:%S,%f')} {hexed(each)}"),
    "date with slashes and zone": lambda: line_by_line(lambda at, each: f"{clock(at, '%Y/%m/%dT%H:%M:%S.%f')}+01:00 {hexed(each)}"),
    "since 1970": lambda: line_by_line(lambda at, each: f"{1_767_600_000 + at:.6f} {hexed(each)}"),
    "Tx and Rx": lambda: line_by_line(lambda at, each: f"{at:.6f} {'Rx' if each.wire else 'TX'}: {hexed(each)}"),
    "Send and Recv": lambda: line_by_line(lambda at, each: f"{clock(at)} {'Recv' if each.wire else 'Send'} {hexed(each)}"),
    "Req and Rsp": lambda: line_by_line(lambda at, each: f"{at:.6f},{'Rsp' if each.wire else 'Req'} -> {hexed(each)}"),
    "arrows": lambda: line_by_line(lambda at, each: f"{at:.6f} {'<-' if each.wire else '->'} {hexed(each)}"),
    "esphome": lambda: line_by_line(lambda at, each: f"[{clock(at)[:-3]}][D][uart_debug:114]: {'<<<' if each.wire else '>>>'} {hexed(each, ':').upper()}"),
    "socat -x": lambda: socat(False),
    "socat -x -v": lambda: socat(True),
    "Saleae Logic 1": saleae_1,
    "Saleae Logic 2": lambda: saleae_2(False),
    "Saleae Logic 2, dates": lambda: saleae_2(True),
    "mbpoll": lambda: [
        "mbpoll 1.0-0 - ModBus(R) Master Simulator", "Opening /dev/ttyUSB0 at 9600 bauds (N, 8, 1)", "",
        "-- Polling slave 1... (Ctrl-C to stop)",
        *(line for _, each in ROWS for line in (["<" + hexed(each).replace(" ", "><") + ">", "[1]: \t 123"] if each.wire else ["[" + hexed(each).replace(" ", "][") + "]", "Waiting for a confirmation..."])),
    ],
}  # fmt: skip
GARBAGE = [
    "zz zz",
    "---- reconnected ----",
    "86395.0",
    "86400.5 01 0",
    "\0\0\0\0\0\0\0\0",
    "error: port busy",
    "86400.1 01 03 xx",
]


def read(path: Path, *options: str) -> dict[str, Any]:
    return sniffed(path, "--protocol", "modbus-rtu", *LINE, *options)


def same(found: dict[str, Any]) -> None:
    """What every form of the same exchanges gives."""
    assert found["outcomes"] == OUTCOMES
    assert (found["frames"], found["damaged"], found["strays"]) == (len(SENT), OUTCOMES["damaged"], 0)
    assert attempts(found) == sum(OUTCOMES.values())


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("garbage", [False, True])
def test_every_form_gives_the_same_frames(form: str, garbage: bool, tmp_path: Path) -> None:
    lines, rng = FORMS[form](), random.Random(3)
    wrong = max(2, len(lines) // 100) if garbage else 0
    for number in range(wrong):
        # Not inside what a logger writes in several lines.
        at = rng.choice(
            [
                i
                for i, line in enumerate(lines)
                if i and not (form.startswith("socat") and lines[i - 1] != "--")
            ]
        )
        lines.insert(
            at,
            GARBAGE[(number + len(form)) % 2]
            if form.startswith("socat")
            else GARBAGE[(number + len(form)) % len(GARBAGE)],
        )
    path = tmp_path / "line.txt"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    found = read(path)
    if not garbage:
        same(found)
    assert (found["frames"], found["damaged"], ok(found)) == (len(SENT), OUTCOMES["damaged"], OUTCOMES["ok"])
    assert found["unreadable_lines"] == wrong
    assert len(found["unreadable"]) == min(3, wrong)
    codes = {each["code"] for each in found["warnings"]}
    assert ("unreadable_lines" in codes) == garbage
    directions = form in (
        "Tx and Rx",
        "Send and Recv",
        "Req and Rsp",
        "arrows",
        "esphome",
        "mbpoll",
    ) or form.startswith("socat")
    assert ("software_times" in codes) == directions
    if form == "mbpoll":
        assert found["times"] == "none"
    elif form in ("since 1970",) or form.startswith(
        ("clock", "date", "Send", "esphome", "socat", "Saleae Logic 2, d")
    ):
        assert found["duration_s"] == pytest.approx(SPAN, abs=0.1)
    else:
        assert found["duration_s"] == pytest.approx(ROWS[-1][0], abs=0.1)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-be"])
def test_files_are_decoded_by_their_byte_order_mark(encoding: str, tmp_path: Path) -> None:
    path = tmp_path / "line.txt"
    text = "\n".join(FORMS["plain"]())
    path.write_text("\ufeff" + text if encoding == "utf-16-be" else text, encoding=encoding)
    same(read(path))


@pytest.mark.parametrize("blank", ["\u00a0", "\u2003", "\u3000"])
def test_blanks_of_other_scripts_are_blanks(blank: str, tmp_path: Path) -> None:
    """As a page or a word processor leaves them: no-break, em and ideographic space."""
    lines = ("0.1 > 01 03 00 00 00 01 84 0a", "0.2 < 01 03 02 00 07 f9 86")
    path = tmp_path / "line.txt"
    path.write_text("\n".join(line.replace(" ", blank) for line in lines), encoding="utf-8")
    assert sniffed(path, "-b", "9600", "--protocol", "modbus-rtu")["outcomes"] == {"ok": 1}


def test_nothing_has_to_be_said_of_a_text(tmp_path: Path) -> None:
    path = tmp_path / "line.txt"
    path.write_text("\n".join(FORMS["plain"]()), encoding="utf-8")
    found = sniffed(path)
    assert (found["protocol"], ok(found)) == ("modbus-rtu", OUTCOMES["ok"])
    wrong = sniffed(path, "--protocol", "nn")
    assert (wrong["protocol"], wrong["frames"], ok(wrong)) == ("nn", wrong["damaged"], 0)
    assert wrong["suggested"]["protocol"] == "modbus-rtu"


def test_times_that_fall(tmp_path: Path) -> None:
    path = tmp_path / "line.txt"
    request, response = rtu(1, 3, 0, 0, 0, 1).hex(), rtu(1, 3, 2, 0, 7).hex()
    lines = []
    for number in range(20):
        lines += [f"{10 + number:.3f} {request}", f"{10.02 + number:.3f} {response}"]
    lines[5] = lines[5].replace("12.020", "11.990")  # held at the one before
    lines[11] = lines[11].replace("15.020", "3.000")  # cannot be read
    path.write_text("\n".join(lines), encoding="utf-8")
    found = read(path)
    assert (found["time_steps"], found["unreadable_lines"], ok(found)) == (1, 1, 19)
    assert found["outcomes"] == {"ok": 19, "undecided": 1}  # its response may be in the line that is lost
    assert "line.txt:12: its time is before" in found["unreadable"][0]


def test_most_lines_must_be_readable(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "line.txt"
    path.write_text("hello\nworld 1\n0.1 01 03\n0.2 1\n", encoding="utf-8")
    for command in ("sniff", "fit"):
        assert main([command, str(path)]) == 2
        err = capsys.readouterr().err
        for said in ("line.txt:2: 'world 1' has no time", "more than half", "socat -x"):
            assert said in err


def test_times_before_a_trigger_are_negative(tmp_path: Path) -> None:
    lines = saleae_1()
    moved = [lines[0]]
    for line in lines[1:]:
        at, rest = line.split(",", 1)
        moved.append(f"{float(at) - 86_391:.9f},{rest}")
    assert moved[1].startswith("-")
    path = tmp_path / "line.csv"
    path.write_text("\n".join(moved), encoding="utf-8")
    found = read(path)
    same(found)
    assert found["duration_s"] == pytest.approx(SPAN, abs=0.1)


def test_errors_of_saleae_are_wrong_bits(tmp_path: Path) -> None:
    lines = saleae_1()
    lines[3] = lines[3].replace(",,", ",Error,")
    lines[60] = lines[60].replace(",,", ",,Error")
    path = tmp_path / "line.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    found = read(path)
    assert (found["parity_errors"], found["stop_errors"]) == (1, 1)
    assert found["damaged"] == OUTCOMES["damaged"] + 2


@pytest.mark.parametrize("link_type", [147, 250])
@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("nano", [False, True])
def test_pcap(link_type: int, order: str, nano: bool, tmp_path: Path) -> None:
    sent, outcomes = modbus(SERIAL, 40, 2)
    path = pcap(tmp_path / "line.pcap", sent, link_type, order=order, nano=nano)
    found = sniffed(path, *LINE)
    assert (found["protocol"], found["frames"], ok(found)) == ("modbus-rtu", 80, outcomes["ok"])
    assert found["duration_s"] == pytest.approx(sent[-1].at - sent[0].at, abs=0.05)
    path.write_bytes(path.read_bytes()[:-3])
    cut = sniffed(path, *LINE)
    assert (cut["frames"], cut["outcomes"]) == (79, {"ok": 39, "undecided": 1})
    assert "cut_file" in {each["code"] for each in cut["warnings"]}

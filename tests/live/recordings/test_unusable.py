"""Recordings that are cut off, too coarse, of another protocol, or of more lines than one: what is said of them."""

from __future__ import annotations

import struct
import zipfile
from pathlib import Path

import pytest

from bussim.cli import main
from tests.live.recordings.generator import Sent, Serial, modbus, nn_link, rows, sigrok, wave
from tests.live.recordings.reading import ok, sniffed

SERIAL = Serial(19200, 8, "E", 1)


def said(path: Path, *options: str) -> dict[str, str]:
    """What is warned of, by code."""
    return {each["code"]: each["text"] for each in sniffed(path, *options)["warnings"]}


def parted(path: Path, parts: int) -> tuple[bytes, int]:
    """A session in several parts, and the bytes of its last one."""
    serial = Serial(9600)
    level = wave(modbus(serial, 12, 1)[0], serial, 96_000)
    with zipfile.ZipFile(sigrok(path, 96_000, {"D0": level})) as file:
        kept = {name: file.read(name) for name in file.namelist()}
    samples, size = kept.pop("logic-1-1"), -(-len(level) // parts)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, data in kept.items():
            file.writestr(name, data)
        for number in range(parts):
            file.writestr(f"logic-1-{number + 1}", samples[number * size : (number + 1) * size])
        last = file.getinfo(f"logic-1-{parts}")
    return path.read_bytes(), last.header_offset


def test_a_session_without_its_directory_can_be_recovered(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "line.sr"
    parted(path, 3)
    path.write_bytes(path.read_bytes()[:-200])
    size = path.stat().st_size
    assert main(["sniff", str(path)]) == 2
    error = capsys.readouterr().err
    assert "cut off" in error
    assert f"'zip -FF line.sr --out whole.sr' makes one of its {size:,} bytes" in error


def test_a_session_whose_last_part_is_cut_is_read_up_to_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "line.sr"
    whole, last = parted(path, 3)
    assert ok(sniffed(path)) == 12
    data = bytearray(whole)
    data[last + 14 : last + 18] = bytes(4)  # the CRC in front of the part, and that of the directory
    at = data.rindex(b"PK\x01\x02")
    data[at + 16 : at + 20] = bytes(4)
    path.write_bytes(data)
    found = sniffed(path)
    assert 8 <= ok(found) <= 12
    assert "logic-1-3" in {each["code"]: each["text"] for each in found["warnings"]}["cut_file"]
    parted(path, 1)
    data = bytearray(path.read_bytes())
    at = data.rindex(b"PK\x01\x02")
    data[at + 16 : at + 20] = bytes(4)
    path.write_bytes(data)
    assert main(["sniff", str(path)]) == 2  # there is no other part
    assert "logic-1-1 cannot be read" in capsys.readouterr().err


def test_too_few_samples_for_a_rate_that_is_no_standard_one_are_told(tmp_path: Path) -> None:
    serial = Serial(187_500, 8, "E", 1)
    path = sigrok(tmp_path / "line.sr", 562_500, {"D0": wave(modbus(serial, 40, 1)[0], serial, 562_500)})
    text = said(path)["few_samples"]
    assert "562,500 samples a second are too few for 187,500 bps; at least 750,000 are needed" in text


@pytest.mark.parametrize("kind", ["sr", "lines", "directions"])
def test_bytes_of_modbus_tcp_are_named(kind: str, tmp_path: Path) -> None:
    sent = []
    for number in range(30):
        request = struct.pack(">HHHB", number, 0, 6, 1) + struct.pack(">BHH", 3, 0, 10)
        response = struct.pack(">HHHB", number, 0, 23, 1) + bytes((3, 20)) + bytes(range(number, number + 20))
        sent += [Sent(0.1 * number + 0.05, request, 0), Sent(0.1 * number + 0.08, response, 1)]
    if kind == "sr":
        path = sigrok(tmp_path / "line.sr", 200_000, {"D0": wave(sent, SERIAL, 200_000)})
    else:
        path = tmp_path / "line.txt"
        words = ("", "") if kind == "lines" else ("Tx ", "Rx ")
        lines = [f"{at:.6f} {words[each.wire]}{each.chars.hex(' ')}" for at, each in rows(sent, SERIAL)]
        path.write_text("\n".join(lines), encoding="utf-8")
    assert "Modbus TCP" in said(path)["modbus_tcp"]
    assert main(["fit", str(path)]) == 1


def test_other_lines_on_other_channels_are_named(tmp_path: Path) -> None:
    rate = 400_000
    link = nn_link(Serial(38400, 7, "E", 1), 40)
    other = [each._replace(at=each.at * 1.03) for each in modbus(SERIAL, 30, 2)[0]]
    levels = {
        "link": wave(link, Serial(38400, 7, "E", 1), rate),
        "hmi": wave(other, SERIAL, rate),
        "pump": wave(modbus(SERIAL, 30, 5)[0], SERIAL, rate),
    }
    path = sigrok(tmp_path / "line.sr", rate, levels)
    found = sniffed(path)
    assert len(found["channels"]) == 1
    text = {each["code"]: each["text"] for each in found["warnings"]}["other_line"]
    forms = {
        "link": "nn, 38400 bps 7E1",
        "hmi": "modbus-rtu, 19200 bps 8E1",
        "pump": "modbus-rtu, 19200 bps 8E1",
    }
    assert [name for name in levels if f"{name} ({forms[name]})" in text] == [
        name for name in levels if name not in found["channels"]
    ]
    assert said(path, "--channel", "pump") == {}  # what was asked for


@pytest.mark.parametrize("encoding", ["utf-8", "latin-1", "cp1252"])
@pytest.mark.parametrize("unit", ["Zeit [µs];Größe", "Zeit;Bytes"])
def test_micro_signs_of_one_byte_are_read(unit: str, encoding: str, tmp_path: Path) -> None:
    sent = modbus(SERIAL, 20, 3)[0]
    suffix = "" if "µ" in unit else "µs"
    lines = [f"{at * 1e6:.0f}{suffix};{each.chars.hex(' ')}" for at, each in rows(sent, SERIAL)]
    path = tmp_path / "line.csv"
    path.write_text("\n".join([unit, *lines]), encoding=encoding)
    found = sniffed(path)
    assert (ok(found), found["unreadable_lines"]) == (20, 0)
    assert found["duration_s"] == pytest.approx(rows(sent, SERIAL)[-1][0], abs=0.002)


def test_a_long_recording_is_fitted_up_to_a_number_of_frames(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "line.txt"
    sent = modbus(SERIAL, 60, 3)[0]
    path.write_text("\n".join(f"{at:.6f} {each.chars.hex(' ')}" for at, each in rows(sent, SERIAL)), "utf-8")
    monkeypatch.setattr("bussim.commands.fit.recording._MOST_FRAMES", 40)
    assert main(["fit", str(path), "--simulate", "0 s"]) == 0
    output = capsys.readouterr().out
    assert "the estimates are of its first 40 frames" in output
    monkeypatch.undo()
    assert main(["fit", str(path), "--simulate", "0 s"]) == 0
    assert "the estimates are of" not in capsys.readouterr().out

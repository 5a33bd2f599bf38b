"""Recordings that other programs changed: cut packets, captures behind each other, lost parts, spreadsheets."""

from __future__ import annotations

import bz2
import gzip
import lzma
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from bussim.cli import main
from tests.live.recordings.generator import Serial, modbus, pcap, rows, sigrok, wave
from tests.live.recordings.reading import ok, sniffed

SERIAL = Serial(19200, 8, "E", 1)
SENT, _ = modbus(SERIAL, 20, 3)
HEADER = 24  # bytes of a pcap file before its packets


def refused(path: Path, capsys: pytest.CaptureFixture[str]) -> str:
    """What sniff says of a file that it does not read."""
    capsys.readouterr()
    assert main(["sniff", str(path)]) == 2
    return capsys.readouterr().err


def packets(path: Path) -> list[bytes]:
    """The packets of a pcap file, each with its head."""
    data, found = pcap(path, SENT, 147).read_bytes()[HEADER:], []
    while data:
        size = 16 + struct.unpack("<I", data[8:12])[0]
        found.append(data[:size])
        data = data[size:]
    return found


def test_packets_that_a_capture_cut_are_told(tmp_path: Path) -> None:
    path = tmp_path / "a.pcap"
    cut = [each[:8] + struct.pack("<I", 4) + each[12:20] for each in packets(path)[:5]]
    whole = path.read_bytes()
    assert "cut_packets" not in {each["code"] for each in sniffed(path)["warnings"]}
    path.write_bytes(whole[:HEADER] + b"".join(cut) + b"".join(packets(tmp_path / "b.pcap")[5:]))
    said = {each["code"]: each["text"] for each in sniffed(path)["warnings"]}["cut_packets"]
    assert said.startswith(f"5 packets of {len(SENT)} are only the first bytes of frames")


@pytest.mark.parametrize(
    "order", [lambda all_: all_[20:] + all_[:20], lambda all_: all_ + all_, lambda all_: all_[::-1]]
)
def test_packets_that_are_not_in_order_are_refused(
    order: Callable[[list[bytes]], list[bytes]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "a.pcap"
    found = order(packets(path))
    path.write_bytes(path.read_bytes()[:HEADER] + b"".join(found))
    assert "before one above it: the clock was set back, two captures follow" in refused(path, capsys)


@pytest.mark.parametrize(
    ("pack", "name"), [(gzip.compress, "gzip"), (lzma.compress, "xz"), (bz2.compress, "bzip2")]
)
def test_what_is_compressed_is_named(
    pack: Callable[[bytes], bytes], name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = pcap(tmp_path / "a.pcap", SENT, 147)
    path.write_bytes(pack(path.read_bytes()))
    assert f"a.pcap is compressed by {name}: unpack it first" in refused(path, capsys)


@pytest.mark.parametrize(("numbers", "lost"), [((1, 3), 2), ((2,), 1)])
def test_a_session_without_one_of_its_parts_is_refused(
    numbers: tuple[int, ...], lost: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = sigrok(tmp_path / "a.sr", 96_000, {"D0": wave(SENT, SERIAL, 96_000)})
    with zipfile.ZipFile(path) as file:
        metadata, samples = file.read("metadata"), file.read("logic-1-1")
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("metadata", metadata)
        for number in numbers:
            file.writestr(f"logic-1-{number}", samples)
    assert f"logic-1-{lost} is missing" in refused(path, capsys)


def test_a_table_of_a_spreadsheet_with_decimal_commas(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    lines = [f"{at:.6f};{sent.chars.hex(' ')}".replace(".", ",") for at, sent in rows(SENT, SERIAL)]
    path.write_text("\n".join(["time;data", *lines, ""]), encoding="utf-8-sig", newline="\r\n")
    assert ok(sniffed(path)) == len(SENT) // 2


@pytest.mark.parametrize("text", ["\n", "\ufeff", "# nothing\n", "time,data\n"])
def test_a_text_without_bytes_is_refused(
    text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "a.txt"
    path.write_text(text, encoding="utf-8")
    assert "a.txt has no line with bytes; readable are" in refused(path, capsys)


def test_a_cell_that_is_too_long_is_an_unreadable_line(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(f"Time [s],Value,Parity Error\n0.1,0x01,\n0.2,{'0' * 150_000},\n0.3,0x02,\n")
    found = sniffed(path)
    assert found["unreadable_lines"] == 1
    assert "field larger than field limit" in found["unreadable"][0]

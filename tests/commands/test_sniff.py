from __future__ import annotations

import json
import signal
import struct
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import serial

import bussim
from bussim.cli import main
from bussim.engines.modbus.adu import Mode, encode_adu
from bussim.line.characters import NN_LINE, CharFormat
from bussim.line.wave import low_intervals
from bussim.live.served import ServedSlave
from bussim.trace.file import read_trace
from bussim.trace.records import AttemptRecord, FrameRecord, ScanRecord, TransactionRecord
from bussim.units import TICKS_PER_SECOND
from tests.undrawn import undrawn

posix = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")
PATIENCE = 20.0


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a traced run, with an outage."""
    folder = tmp_path_factory.mktemp("runs") / "press"
    with undrawn():
        bussim.run(bussim.load("press_line", ["duration=12 s"]), out=folder, trace=True)
    return folder


def heard(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, Any]:
    assert main(["sniff", *arguments, "--json"]) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


def frames_of(run: Path) -> list[FrameRecord]:
    return list(read_trace(run).of(FrameRecord))


def truth(run: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((run / "summary.json").read_text(encoding="utf-8"))["links"]["link"]
    return found


def test_a_run_is_heard_as_it_was(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found, known = heard(capsys, str(run)), truth(run)
    assert (found["protocol"], found["baud"], found["format"], found["exact_times"]) == (
        "nn",
        38400,
        "7E1",
        True,
    )
    assert found["link"]["scans"] == known["scans"]
    assert found["link"]["scan_time_ms"]["mean"] == known["scan_time_ms"]["mean"]
    assert found["link"]["scan_time_ms"]["max"] == known["scan_time_ms"]["max"]
    assert found["link"]["station_errors"] == known["station_errors"]
    assert found["bus_load"] == pytest.approx(known["bus_load"], rel=1e-3)  # but for the frame at the end
    assert found["duration_s"] == 12


@pytest.mark.slow
def test_what_is_recorded_is_a_run_that_others_read(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "recorded"
    first = heard(capsys, str(run), "--out", str(folder))
    assert (folder / "link_scans.csv").read_bytes() == (run / "link_scans.csv").read_bytes()
    assert not (folder / "INCOMPLETE").exists()
    again = heard(capsys, str(folder))
    for key in ("link", "exchanges", "frames", "characters"):
        assert again[key] == first[key], key
    assert main(["plot", str(folder), "--force"]) == 0  # it has those of sniff
    assert (folder / "scan_time_link.png").is_file()
    trace = read_trace(folder)
    assert trace.header.exact
    assert trace.header.buses[0].stations == {"press1": 0, "press2": 1, "press3": 2}
    assert len(list(trace.of(ScanRecord))) == first["link"]["scans"]
    assert list(trace.of(AttemptRecord))


def raw_file(run: Path, path: Path, *, start: bool) -> Path:
    lines = ["# a recording", "# time: start"] if start else ["# a recording"]
    for frame in frames_of(run):
        tick = frame.start if start else frame.end
        lines.append(f"{tick / TICKS_PER_SECOND:.9f}  {frame.chars.hex(' ')}")
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


@pytest.mark.parametrize("start", [True, False])
def test_raw_bytes(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], start: bool) -> None:
    found = heard(capsys, str(raw_file(run, tmp_path / "line.txt", start=start)), "--tolerance", "0 ms")
    known = truth(run)
    assert found["protocol"] == "nn"
    assert not found["exact_times"]
    assert found["link"]["scans"] == pytest.approx(known["scans"], abs=2)
    assert found["link"]["scan_time_ms"]["mean"] == pytest.approx(known["scan_time_ms"]["mean"], rel=0.01)


def block(kind: int, body: bytes) -> bytes:
    size = struct.pack("<I", len(body) + 12)
    return struct.pack("<I", kind) + size + body + size


def pcapng_file(run: Path, path: Path, *, since: int) -> Path:
    """Written after the draft, with nanoseconds from ``since`` (seconds) on, and a foreign interface."""
    resolution = struct.pack("<HHB3xHH", 9, 1, 9, 0, 0)
    name = struct.pack("<HH4s", 2, 4, b"link") + resolution
    data = block(0x0A0D0D0A, struct.pack("<IHHq", 0x1A2B3C4D, 1, 0, -1))
    data += block(1, struct.pack("<HHI", 1, 0, 0)) + block(1, struct.pack("<HHI", 148, 0, 0) + name)
    for frame in frames_of(run):
        stamp = since * 10**9 + round(frame.start * 125 / 9)
        for interface, chars in ((0, b"ethernet"), (1, frame.chars)):
            head = struct.pack("<IIIII", interface, stamp >> 32, stamp & 0xFFFFFFFF, len(chars), len(chars))
            data += block(6, head + chars + bytes(-len(chars) % 4))
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("since", [0, 1_700_000_000])
def test_pcapng(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], since: int) -> None:
    path = pcapng_file(run, tmp_path / "line.pcapng", since=since)
    found, known = heard(capsys, str(path)), truth(run)
    assert found["exact_times"]
    assert found["link"]["scan_time_ms"]["mean"] == pytest.approx(known["scan_time_ms"]["mean"], rel=0.01)
    assert found["duration_s"] == pytest.approx(12, abs=0.2)
    assert main(["sniff", str(path), "--channel", "none"]) == 2
    assert "its interfaces are 0, link" in capsys.readouterr().err


def samples(run: Path, rate: int, seconds: float) -> bytes:
    """The line's level, sampled: bit 2 of each byte."""
    level = bytearray(b"\x04" * int(seconds * rate))
    for frame in frames_of(run):
        for low, high in low_intervals(frame.chars, NN_LINE, frame.start, frame.damaged_bits):
            first, last = -(-low * rate // TICKS_PER_SECOND), -(-high * rate // TICKS_PER_SECOND)
            if last < len(level):
                level[first:last] = bytes(last - first)
    return bytes(level)


def test_a_sigrok_session(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    import zipfile

    rate, seconds = 500_000, 2.0
    path = tmp_path / "line.sr"
    data = samples(run, rate, seconds)
    metadata = (
        "[global]\nsigrok version=0.5.2\n\n[device 1]\ncapturefile=logic-1\ntotal probes=3\n"
        "samplerate=500 kHz\nprobe1=D0\nprobe2=D1\nprobe3=RX\nunitsize=1\n"
    )
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("version", "2")
        file.writestr("metadata", metadata)
        for number, at in enumerate(range(0, len(data), 300_001), 1):  # in parts, as sigrok writes them
            file.writestr(f"logic-1-{number}", data[at : at + 300_001])
    found = heard(capsys, str(path), "--channel", "RX")
    scans = [
        (after.start - before.start) * 1000 / TICKS_PER_SECOND
        for before, after in pairwise(
            f
            for f in frames_of(run)
            if f.kind == "data" and f.station == 0 and f.end < seconds * TICKS_PER_SECOND
        )
    ]
    assert found["link"]["scans"] == len(scans)
    assert found["link"]["scan_time_ms"]["mean"] == pytest.approx(sum(scans) / len(scans), abs=0.01)
    damaged = sum(bool(f.damaged_bits) for f in frames_of(run) if f.end < seconds * TICKS_PER_SECOND)
    assert found["damaged"] - damaged in (0, 1)  # the frame that the end cuts off
    assert main(["sniff", str(path), "--channel", "X"]) == 2
    assert "D0, D1, RX" in capsys.readouterr().err
    assert main(["sniff", str(path), "-b", "1000000"]) == 2
    assert "too few" in capsys.readouterr().err


def test_a_session_that_sigrok_wrote(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    import os
    import shutil

    if shutil.which("sigrok-cli") is None:
        if os.environ.get("CI"):
            pytest.fail("CI must have sigrok-cli")
        pytest.skip("needs sigrok-cli")
    raw, path = tmp_path / "raw.bin", tmp_path / "line.sr"
    raw.write_bytes(samples(run, 500_000, 1.0))
    subprocess.run(
        ["sigrok-cli", "-I", "binary:numchannels=8:samplerate=500000", "-i", raw, "-o", path], check=True
    )
    found = heard(capsys, str(path), "--channel", "2")
    assert found["protocol"] == "nn"
    assert found["link"]["scans"] > 10
    assert found["link"]["scan_time_ms"]["min"] == pytest.approx(truth(run)["scan_time_ms"]["min"], abs=0.2)


@pytest.mark.slow
@posix
def test_a_line_is_listened_to_and_recorded(tmp_path: Path) -> None:
    """Two programs on a wire, and sniff in between; then Ctrl-C."""
    folder = tmp_path / "recorded"
    with ServedSlave(fmt=CharFormat(8, "N", 1)) as slave:
        link = tmp_path / "tap"
        command = [
            sys.executable, "-m", "bussim", "sniff", f"pty:{link}", "--bridge", slave.device,
            "--protocol", "modbus-rtu", "-b", "115200", "-P", "none", "--out", str(folder), "--json",
        ]  # fmt: skip
        running = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        until = time.monotonic() + PATIENCE
        while not link.exists() and time.monotonic() < until:
            time.sleep(0.02)
        with serial.Serial(str(link), timeout=PATIENCE) as client:
            for number in range(20):
                client.write(encode_adu(Mode.RTU, 1, bytes((3, 0, number, 0, 1))).chars)
                assert len(client.read(7)) == 7
        running.send_signal(signal.SIGINT)
        out, err = running.communicate(timeout=PATIENCE)
    assert running.returncode == 0, err
    assert "Traceback" not in err
    found = json.loads(out)
    assert found["protocol"] == "modbus-rtu"
    assert found["frames"] == 40
    assert found["damaged"] == 0
    assert not found["exact_times"]
    assert all(asked["outcomes"] == {"ok": 1} for asked in found["exchanges"].values())
    trace = read_trace(folder)
    assert not trace.header.exact
    assert len(list(trace.of(TransactionRecord))) == 20
    assert not (folder / "INCOMPLETE").exists()
    assert not link.is_symlink()


@posix
def test_it_ends_after_its_duration_and_nothing_heard_is_no_failure(
    capsys: pytest.CaptureFixture[str],
) -> None:
    found = heard(capsys, "pty", "--duration", "100 ms")
    assert (found["protocol"], found["frames"]) == (None, 0)


@pytest.fixture
def broken(tmp_path: Path) -> Path:
    return tmp_path / "broken"


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "is empty"),
        (b"PK\x03\x04 no zip", "no sigrok session"),
        (b"\n\r\r\n" + bytes(40), "at byte 0"),
        (b"0.0 01\n0.1 xyz\n0.2 q\n", "broken:2: 'xyz' are no bytes"),
        (b'{"type":1}\n', "is not a trace"),
        (b'{"ts": 1.5, "data": "01 03"}\n' * 2, "readable are lines"),
    ],
)
def test_broken_recordings_are_exit_code_2(
    broken: Path, content: bytes, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    broken.write_bytes(content)
    assert main(["sniff", str(broken)]) == 2
    err = capsys.readouterr().err
    assert said in err
    assert "Traceback" not in err


def test_mistakes(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, said in (
        (["/dev/not/there"], "cannot be opened"),
        ([str(run), "--bus", "lnk"], "no bus 'lnk'"),
        ([str(run), "--bridge", "loop://"], "joins two ports"),
        ([str(run), "--out", str(run)], "exists"),
    ):
        assert main(["sniff", *arguments]) == 2
        assert said in capsys.readouterr().err


def test_the_table_for_people(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sniff", str(run)]) == 0
    out = capsys.readouterr().out
    assert "link scan time   min" in out
    assert "station 2" in out

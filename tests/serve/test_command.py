"""``bussim serve`` from start to Ctrl-C, in a process of its own."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from bussim.cli import main
from bussim.engines.modbus.adu import Mode
from bussim.results.store.load import load_run
from bussim.scenario.loader import load
from tests.serve.serving import SLAVES

ROOT = Path(__file__).parents[2]
PATIENCE = 60.0
posix = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")


@pytest.fixture
def folder(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An empty current folder with the scenario in it, and control sockets of its own."""
    with tempfile.TemporaryDirectory(prefix="bs") as name:
        folder = Path(name)
        (folder / "slaves.yaml").write_text(SLAVES, encoding="utf-8")
        (folder / "run").mkdir()
        monkeypatch.setenv("XDG_RUNTIME_DIR", str(folder / "run"))
        monkeypatch.chdir(folder)
        yield folder


def start(folder: Path, *words: str) -> subprocess.Popen[str]:
    process = subprocess.Popen(
        [sys.executable, "-m", "bussim", "serve", *words],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    watchdog = threading.Timer(PATIENCE, process.kill)
    watchdog.daemon = True
    watchdog.start()
    return process


def wait_until_it_serves(process: subprocess.Popen[str]) -> list[str]:
    assert process.stderr is not None
    lines: list[str] = []
    while not any("Ctrl-C" in line for line in lines):
        line = process.stderr.readline()
        assert line, lines
        lines.append(line.strip())
    return lines


@pytest.mark.slow
@posix
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_ends_it_with_its_summary_printed_and_its_files_complete(folder: Path, number: int) -> None:
    from tests.live.peers import pymodbus_master

    process = start(folder, "slaves.yaml", "--port", "v80=pty:line", "--port", "oven=pty:line", "--out", "out",
                    "--trace", "--json")  # fmt: skip
    lines = wait_until_it_serves(process)
    assert lines[:2] == [
        "v80: Modbus RTU slave, station 1, 115200 8N1, on line",
        "oven: Modbus RTU slave, station 2, 115200 8N1, on line",
    ]
    client = pymodbus_master(str(folder / "line"), Mode.RTU)
    for value in range(5):
        assert not client.write_register(3, value, device_id=1 + value % 2).isError()
    client.close()
    process.send_signal(number)
    out, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, err
    summary = json.loads(out)
    served = summary["served"]["lines"]["line"]
    assert (served["url"], served["nodes"], served["received"]) == ("pty:line", ["v80", "oven"], 40)
    assert load_run(folder / "out").summary == summary
    assert summary["devices"]["v80"]["requests"] == 3
    lines = (folder / "out" / "trace.jsonl").read_text().splitlines()
    records = [json.loads(line) for line in lines]
    assert records[0]["exact"] is False
    frames = [(one["sender"], one["kind"]) for one in records if one["type"] == "frame"]
    assert frames.count(("outside", "request")) == 5
    assert frames.count(("v80", "response")) == 3
    # What it leaves behind can be simulated, for as long as it was served.
    again = load(folder / "out" / "scenario.yaml")
    assert again.duration / 72e6 == pytest.approx(summary["duration_s"], abs=1e-5)
    assert not (folder / "line").is_symlink()
    assert list((folder / "run" / "bussim").iterdir()) == []


@posix
def test_it_ends_by_itself_after_its_time(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["serve", "slaves.yaml", "v80", "--for", "200 ms"]) == 0
    captured = capsys.readouterr()
    assert "0.2 s simulated" in captured.out
    assert "v80: Modbus RTU slave" in captured.err
    assert {path.name for path in folder.iterdir()} == {"slaves.yaml", "run"}


@pytest.mark.parametrize(
    ("words", "text"),
    [
        ([], "plc.COM3  Modbus ASCII slave, station 5"),
        (["v81"], "did you mean v80?"),
        (["plc"], "it has plc.COM3"),
        (["--port", "v80"], "write NODE=URL"),
        (["--port", "v80=pty", "--port", "v80=COM7"], "v80 has a port already, pty"),
        (["--port", "v80=COM7", "--port", "ascii=COM7"], "COM7 cannot be the wire of line and of text"),
        (["--port", "v80=/dev/ttyNOTHERE"], "cannot be opened"),
        (["v80", "--for", "5"], "a time without a unit"),
    ],
)
def test_mistakes_are_reported_and_nothing_is_left(
    folder: Path, words: list[str], text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["serve", "slaves.yaml", *words, "--out", "out"]) == 2
    assert text in capsys.readouterr().err
    assert {path.name for path in folder.iterdir()} == {"slaves.yaml", "run"}

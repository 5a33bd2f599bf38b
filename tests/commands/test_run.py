"""End to end: the command, the built-in scenarios and the simulation."""

from __future__ import annotations

import csv
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from bussim.cli import main
from bussim.results.store.folder import INCOMPLETE
from bussim.results.store.load import FolderRows, load_run
from bussim.trace.records import AttemptRecord, ScanRecord

ROOT = Path(__file__).parents[2]
FILES = {
    "summary.json",
    "histograms.json",
    "scenario.yaml",
    "link_scans.csv",
    "scan_time_link.png",
    "scan_time_link.svg",
}


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty current folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def program(*arguments: str, cwd: Path) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "bussim", *arguments],
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def test_without_arguments_the_built_in_scenario_runs(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "--duration", "3s"]) == 0
    said = capsys.readouterr()
    assert said.err == ""
    assert "attempts a poll" in said.out
    assert str(Path("runs/press_line")) in said.out
    assert str(Path("runs/press_line/scan_time_link.png")) in said.out
    for word in ("link scan time", "mean", "longest", "D8201/D8202", "refresh gap", "station errors"):
        assert word in said.out
    assert names(here / "runs" / "press_line") == FILES
    assert load_run(here / "runs" / "press_line").summary["duration_s"] == 3.0


@pytest.mark.usefixtures("pictures_undrawn")
def test_later_runs_have_numbers(here: Path) -> None:
    for _ in range(3):
        assert main(["run", "press_line", "--duration", "1s", "--no-rows"]) == 0
    assert names(here / "runs") == {"press_line", "press_line-2", "press_line-3"}


def test_json_is_the_summary_and_nothing_else(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "--duration", "2 s", "--seed", "11", "--json", "--out", "o"]) == 0
    said = capsys.readouterr()
    assert json.loads(said.out) == json.loads((here / "o" / "summary.json").read_text())
    assert said.out == (here / "o" / "summary.json").read_text()
    assert said.err == ""
    assert json.loads(said.out)["seed"] == 11


@pytest.mark.usefixtures("pictures_undrawn")
def test_set_changes_the_scenario(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "--duration", "1s", "--set", "plcs.press1.nn.retries=2", "--out", "o"]) == 0
    assert "2 retries = 3 attempts a poll" in capsys.readouterr().out
    assert load_run(here / "o").summary["links"]["link"]["attempts"] == 3
    text = (here / "o" / "scenario.yaml").read_text()
    assert "retries: 2" in text
    assert "duration: 1 s" in text


@pytest.mark.usefixtures("pictures_undrawn")
def test_the_scenario_in_the_folder_gives_the_same_run_again(here: Path) -> None:
    assert main(["run", "--duration", "2s", "--seed", "5", "--trace", "--out", "first"]) == 0
    assert main(["run", "first/scenario.yaml", "--trace", "--out", "second"]) == 0
    for path in (here / "first").iterdir():
        assert path.read_bytes() == (here / "second" / path.name).read_bytes(), path.name


@pytest.mark.usefixtures("pictures_undrawn")
def test_trace_rows_and_format(here: Path) -> None:
    assert main(["run", "--duration", "1s", "--trace", "--format", "parquet", "--out", "o"]) == 0
    assert names(here / "o") == FILES - {"link_scans.csv"} | {
        "link_scans.parquet",
        "exchanges.parquet",
        "trace.jsonl",
    }
    summary, stored = load_run(here / "o").summary["links"]["link"], FolderRows(here / "o")
    assert len(stored.table(ScanRecord)) == summary["scans"] > 10
    assert (stored.table(AttemptRecord)["attempt"] == 1).sum() >= summary["polls"] - 1
    assert {line["type"] for line in stored.trace()} >= {"trace", "frame", "scan", "attempt", "note"}
    assert main(["run", "--duration", "1s", "--no-rows", "--out", "p"]) == 0
    assert names(here / "p") == FILES - {"link_scans.csv"}


@pytest.mark.usefixtures("pictures_undrawn")
def test_an_existing_folder_needs_force(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["run", "--duration", "1s", "--out", "o"]
    assert main(arguments) == 0
    capsys.readouterr()
    assert main(arguments) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("Error: o exists;")
    assert main([*arguments, "--seed", "12", "--force"]) == 0
    assert load_run(here / "o").summary["seed"] == 12
    assert names(here) == {"o"}


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--duration", "5"], "without a unit"),
        (["--seed", "many"], "--seed many"),
        (["--set", "plcs.press9.nn.retries=2"], "press9"),
        (["--set", "nonsense"], "--set nonsense"),
        (["pres_line"], "press_line"),
        (["--format", "xlsx"], "xlsx"),
    ],
)
def test_mistakes_exit_with_2_and_write_nothing(
    here: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], expected: str
) -> None:
    assert main(["run", *arguments]) == 2
    said = capsys.readouterr()
    assert expected in said.err
    assert said.out == ""
    assert "Traceback" not in said.err
    assert names(here) == set()


def test_a_folder_that_cannot_be_written(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (here / "file").write_text("x")
    assert main(["run", "--out", "file/o"]) == 2
    assert "cannot be written" in capsys.readouterr().err
    assert names(here) == {"file"}


@pytest.mark.skipif(sys.platform == "win32", reason="SIGINT cannot be sent to one process")
def test_interrupted_from_the_keyboard(tmp_path: Path) -> None:
    # Whoever started the tests may have SIGINT ignored (a shell's background job), and it is inherited.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        process = program("run", "--duration", "100h", "--out", "o", cwd=tmp_path)
    finally:
        signal.signal(signal.SIGINT, before)
    marker = tmp_path / "o.incomplete" / INCOMPLETE
    while not marker.exists() and process.poll() is None:
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate()
    assert process.returncode == 130, err
    assert "Traceback" not in err
    assert out == ""
    assert all((folder / INCOMPLETE).is_file() for folder in tmp_path.iterdir())


@pytest.mark.skipif(sys.platform == "win32", reason="SIGINT cannot be sent to one process")
def test_an_interrupt_while_text_is_executed_ends_with_130(tmp_path: Path) -> None:
    # Python would end by the signal itself: an interrupt that passes through exec() leaves a mark there.
    (tmp_path / "sitecustomize.py").write_text(
        "import click\n"
        "def interrupted(self, *arguments, **options):\n"
        "    exec('raise KeyboardInterrupt')\n"
        "click.Group.main = interrupted\n"
    )
    done = subprocess.run(
        [sys.executable, "-m", "bussim"],
        check=False,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])},
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "stopped\n")


@pytest.mark.slow
def test_two_runs_at_once_take_different_folders(tmp_path: Path) -> None:
    processes = [program("run", "--duration", "60s", "--no-rows", cwd=tmp_path) for _ in range(2)]
    said = [process.communicate()[1] for process in processes]
    assert [process.returncode for process in processes] == [0, 0], said
    assert names(tmp_path / "runs") == {"press_line", "press_line-2"}


@pytest.mark.usefixtures("pictures_undrawn")
def test_ports_in_words_and_as_files(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "nn_with_modbus", "--duration", "3s", "--out", "o"]) == 0
    said = capsys.readouterr().out
    assert "press1.COM3: modbus-rtu-master on feeder, timeout 200 ms" in said
    assert "feeder1: stepper, station 1 on feeder" in said
    assert f"picture: {Path('o') / 'response_time_press1.COM3.png'}" in said
    assert "modbus.csv" in names(here / "o")
    assert main(["run", "nn_with_modbus", "--duration", "3s", "--no-rows", "--out", "p"]) == 0
    assert not {name for name in names(here / "p") if name.endswith(".csv")}
    capsys.readouterr()
    assert main(["run", "barcode_reader", "--duration", "9s", "--json", "--out", "q"]) == 0
    port = json.loads(capsys.readouterr().out)["ports"]["sorter.COM3"]
    with (here / "q" / "free.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    received = [row for row in rows if row["node"] == "sorter.COM3" and row["direction"] == "received"]
    assert len(received) == port["received"] > 0
    assert sum(len(bytes.fromhex(row["bytes"])) for row in received) == port["bytes"]["received"]
    assert "modbus.csv" not in names(here / "q")


def test_a_run_that_would_be_too_large_is_given_up_early(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["run", "press_line", "--duration", "10h", "--trace", "--out", str(tmp_path / "x")]
    assert main([*words, "--largest", "0.05"]) == 2
    error = capsys.readouterr().err
    assert re.search(
        r"x would become about [\d.]+ GB \(0\.\d% of the run have [\d.e-]+ GB\), allowed are 0.05 GB", error
    )
    assert "raise --largest" in error
    assert not any(tmp_path.iterdir())
    assert main([*words[:3], "5s", *words[4:], "--no-plots", "--largest", "0.05"]) == 0

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest

from bussim.cli import main
from bussim.trace.file import read_trace
from bussim.trace.records import FrameRecord
from tests.undrawn import undrawn

FILES = {
    "pcapng": "trace.pcapng",
    "vcd": "trace.vcd",
    "sr": "trace.sr",
    "perfetto": "perfetto.json",
    "csv": "frames.csv",
    "parquet": "frames.parquet",
}


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("export")
    with undrawn():
        arguments = ["run", "nn_with_modbus", "--duration", "2s", "--out"]
        assert main([*arguments, str(folder / "traced"), "--trace"]) == 0
        assert main([*arguments, str(folder / "plain")]) == 0
    return folder


def said(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> tuple[int, str, str]:
    capsys.readouterr()
    code = main(["export", *map(str, arguments)])
    found = capsys.readouterr()
    return code, found.out, found.err


def test_where_a_trace_is_cut_off_is_said(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = shutil.copytree(runs / "traced", tmp_path / "cut")
    trace = folder / "trace.jsonl"
    trace.write_bytes(trace.read_bytes()[: trace.stat().st_size // 2])
    cut = "the trace was not written to its end, and is read as far as it goes"
    code, _, error = said(capsys, folder, "--to", "csv")
    assert (code, error) == (0, f"warning: {folder}: {cut}\n")
    assert main(["report", str(folder), "--no-exact", "--lang", "zh"]) == 0
    assert capsys.readouterr().err == f"警告：{folder}: 跟踪记录没有写完，只读到中断处\n"
    assert main(["timeline", str(folder)]) == 0
    assert cut in capsys.readouterr().err


@pytest.mark.parametrize("command", ["report", "timeline"])
def test_a_trace_of_another_run_is_refused(
    command: str, runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = shutil.copytree(runs / "traced", tmp_path / "mixed")
    trace = folder / "trace.jsonl"
    trace.write_text(re.sub('"seed":[0-9]+', '"seed":77', trace.read_text(), count=1))
    assert main([command, str(folder)]) == 2
    assert re.search(
        r"trace\.jsonl is of another run: of '.*' with seed 77; the folder has", capsys.readouterr().err
    )


@pytest.mark.parametrize(("fmt", "name"), FILES.items())
def test_a_file_is_written_to_the_run_and_said(
    runs: Path, capsys: pytest.CaptureFixture[str], fmt: str, name: str
) -> None:
    target = runs / "traced" / name
    code, out, err = said(capsys, runs / "traced", "--to", fmt)
    assert (code, err) == (0, "")
    assert out.splitlines()[0] == str(target)
    assert target.stat().st_size > 1000
    code, out, err = said(capsys, runs / "traced", "--to", fmt)
    assert (code, out) == (2, "")
    assert f"{target} exists; choose another name with -o, or replace it with --force" in err
    before = target.read_bytes()
    assert said(capsys, runs / "traced", "--to", fmt, "--force")[0] == 0
    assert target.read_bytes() == before
    assert not list((runs / "traced").glob("*.part"))


def test_json_names_what_was_written(runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / "a.pcapng"
    code, out, _ = said(capsys, runs / "traced", "--to", "pcapng", "--json", "-o", target, "--encap", "udp")
    found = json.loads(out)
    frames = list(read_trace(runs / "traced").of(FrameRecord))
    (hint,) = found.pop("open_with")
    assert code == 0
    assert "mbrtu.udp.port:5020" in hint
    assert "nn.lua" in hint
    assert found == {
        "schema": 1,
        "file": str(target),
        "format": "pcapng",
        "frames": len(frames),
        "buses": ["link", "feeder", "oven"],
    }


def test_one_bus_and_a_window_are_chosen(runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    choice = ["--bus", "oven", "--from", "500ms", "--to-time", "1.5s"]
    code, out, _ = said(capsys, runs / "traced", "--to", "csv", "--json", *choice)
    found = json.loads(out)
    start, stop = 36_000_000, 108_000_000
    expected = list(read_trace(runs / "traced").of(FrameRecord, bus="oven", start=start, stop=stop))
    assert code == 0
    assert found["file"] == str(runs / "traced" / "frames_oven.csv")
    assert (found["frames"], found["buses"]) == (len(expected), ["oven"])
    rows = Path(found["file"]).read_text("utf-8").splitlines()
    assert len(rows) == 1 + len(expected)
    assert all(row.startswith("oven,") for row in rows[1:])


def test_a_trace_file_is_taken_for_its_folder(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    target = tmp_path / "a.vcd"
    code, out, _ = said(capsys, runs / "traced" / "trace.jsonl", "--to", "vcd", "-o", target)
    assert code == 0
    assert target.is_file()
    assert "PulseView: decoder UART, lane link: 38400 7E1" in out
    assert out.count("stack Modbus on it") == 2  # on the feeder and on the oven, not on the link


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--to", "csv", "--bus", "ovn"], "the trace has no bus 'ovn'; did you mean oven?"),
        (
            ["--to", "vcd", "--from", "5s"],
            "the trace has no frame from 5 s to the end; its frames are between ",
        ),
        (
            ["--to", "perfetto", "--from", "5s"],
            "the trace has no event from 5 s to the end; its frames are between ",
        ),
        (["--to", "vcd", "--from", "3"], "--from is 3, a time without a unit"),
        (["--to", "vcd", "--from", "-1s"], "--from is '-1s', it must not be below 0"),
        (["--to", "vcd", "--from", "1s", "--to-time", "1s"], "--to-time is 1s, it must be after --from 1s"),
        (["--to", "vcd", "--to-time", "0s"], "--to-time is 0s, it must be above 0"),
        (["--to", "vcd", "--encap", "udp"], "--encap goes with --to pcapng, not with vcd"),
        (["--to", "vcd", "-o", "a.sr"], "a.sr ends in .sr; write a name that ends in .vcd"),
        (["--to", "vcd", "-o", "nowhere/a.vcd"], "there is no folder nowhere"),
        (["--to", "wav"], "'wav' is not one of 'pcapng', 'vcd'"),
        ([], "Missing option '--to'"),
    ],
)
def test_mistakes_are_named_and_leave_nothing(
    runs: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    expected: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    out = (
        [] if "-o" in arguments or not arguments else ["-o", f"a.{arguments[1].replace('perfetto', 'json')}"]
    )
    code, _, err = said(capsys, runs / "traced", *arguments, *out)
    assert code == 2
    assert expected in err
    assert "Traceback" not in err
    assert not list(tmp_path.iterdir())


def test_a_run_without_a_trace_says_how_to_get_one(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, _, err = said(capsys, runs / "plain", "--to", "vcd")
    assert code == 2
    assert f"{runs / 'plain'} has no trace to export; get one with bussim run " in err
    code, _, err = said(capsys, tmp_path / "none", "--to", "vcd")
    assert code == 2
    assert f"{tmp_path / 'none'} does not exist; name the folder of a run" in err
    code, _, err = said(capsys, runs, "--to", "vcd")  # the folder above
    assert code == 2
    assert f"{runs} is not the folder of a run" in err
    assert "plain, traced" in err


def test_a_damaged_trace_is_reported_by_its_line(
    tmp_path: Path, runs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = (runs / "traced" / "trace.jsonl").read_text("utf-8").splitlines()
    at = next(number for number, line in enumerate(lines) if '"type":"frame"' in line)
    lines[at] = lines[at].replace('"chars":"', '"chars":"x')
    (tmp_path / "trace.jsonl").write_text("\n".join(lines) + "\n", encoding="utf-8")
    code, _, err = said(capsys, tmp_path, "--to", "vcd")
    assert code == 2
    assert f"trace.jsonl:{at + 1}: is not a line of a trace: chars " in err
    assert [path.name for path in tmp_path.iterdir()] == ["trace.jsonl"]

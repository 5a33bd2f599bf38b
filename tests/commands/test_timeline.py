from __future__ import annotations

import json
from pathlib import Path

import pytest

from bussim.cli import main
from tests.undrawn import undrawn


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("timeline")
    with undrawn():
        arguments = ["run", "press_line", "--duration", "25s", "--out"]
        assert main([*arguments, str(folder / "traced"), "--trace"]) == 0
        assert main([*arguments, str(folder / "plain")]) == 0
    return folder


def said(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> tuple[int, str, str]:
    capsys.readouterr()
    code = main(["timeline", *map(str, arguments)])
    found = capsys.readouterr()
    return code, found.out, found.err


def test_the_worst_link_scan_is_the_default(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one, other = tmp_path / "a.png", tmp_path / "b.png"
    code, out, err = said(capsys, runs / "traced", "-o", one)
    assert (code, err) == (0, "")
    sentence, path = out.splitlines()
    assert path == str(one)
    assert "310.318 ms (attempts 1 to 6 at station 1 (press2): no reply, code 01, 51.720 ms each)" in sentence
    assert said(capsys, runs / "traced", "--worst", "-o", other)[0] == 0
    assert one.read_bytes() == other.read_bytes()


@pytest.mark.usefixtures("pictures_undrawn")
def test_json_adds_up(runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = said(capsys, runs / "traced", "--json", "-o", tmp_path / "a.svg")
    assert code == 0
    found = json.loads(out)
    (scan,) = found["scans"]
    summary = json.loads((runs / "traced" / "summary.json").read_text("utf-8"))
    assert scan["ms"] == summary["links"]["link"]["scan_time_ms"]["max"]
    assert sum(part["ms"] for part in scan["parts"]) == pytest.approx(scan["ms"], abs=1e-5)
    assert sum(part["lost"] and part["attempt"] is not None for part in scan["parts"]) == scan["failed"] == 6


@pytest.mark.usefixtures("pictures_undrawn")
def test_a_window_is_drawn_where_it_was_asked_for(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, _ = said(
        capsys,
        runs / "traced",
        "--from",
        "1s",
        "--span",
        "120ms",
        "--json",
        "--bus",
        "link",
        "-o",
        tmp_path / "a.png",
    )
    assert code == 0
    found = json.loads(out)
    assert (found["from_s"], found["to_s"]) == (1.0, 1.12)
    assert found["scans"]
    assert all(scan["start_s"] >= 1.0 and scan["failed"] == 0 for scan in found["scans"])


def test_by_itself_it_goes_into_the_runs_folder(runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = said(capsys, runs / "traced", "--from", "2s")
    assert code == 0
    path = runs / "traced" / "timeline_link_2.000s.png"
    assert out.splitlines()[-1] == str(path)
    assert path.read_bytes().startswith(b"\x89PNG")
    code, _, err = said(capsys, runs / "traced", "--from", "2s")
    assert code == 2
    assert "exists; choose another name with -o, or replace it with --force" in err
    assert said(capsys, runs / "traced", "--from", "2s", "--force")[0] == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--from", "30s"], "--from is 30 s; the run covers 0 s to 25 s"),
        (["--from", "-1s"], "it must not be below 0"),
        (["--from", "5"], "--from is 5, a time without a unit"),
        (["--from", "1s", "--span", "0ms"], "--span is '0ms', it must be above 0"),
        (
            ["--from", "0s", "--span", "25s"],
            "which cannot be distinguished; at most 1,000: choose a shorter --span",
        ),
        (["--span", "1s"], "name its beginning, too, with --from"),
        (["--worst", "--from", "1s"], "leave --from away"),
        (["--worst", "--span", "1s"], "leave --span away"),
        (["--bus", "lonk"], "has no bus 'lonk'; it has 'link'"),
        (["-o", "a.pdf"], "ends in .pdf; write a name that ends in .png or .svg"),
        (["-o", "none/a.png"], "there is no folder none"),
    ],
)
def test_what_cannot_be_drawn_is_said(
    runs: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    options: list[str],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    target = [] if "-o" in options else ["-o", "a.png"]
    code, out, err = said(capsys, runs / "traced", *options, *target)
    assert (code, out) == (2, "")
    assert message in err
    assert list(tmp_path.iterdir()) == []


def test_a_run_without_a_trace_says_how_to_get_one(runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, _, err = said(capsys, runs / "plain")
    assert code == 2
    assert f"{runs / 'plain'} has no trace to draw; get one with bussim run" in err
    assert "scenario.yaml --trace --out NEW_DIR" in err


def test_not_the_folder_of_a_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, _, err = said(capsys, tmp_path)
    assert code == 2
    assert "is not the folder of a run" in err


@pytest.mark.usefixtures("pictures_undrawn")
def test_of_a_modbus_bus_the_longest_attempt_is_drawn(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "run"
    assert main(["run", "two_masters", "--duration", "3s", "--trace", "--out", str(folder)]) == 0
    code, out, _ = said(capsys, folder, "--json")
    assert code == 0
    found = json.loads(out)
    lines = map(json.loads, (folder / "trace.jsonl").read_text("utf-8").splitlines())
    sent = [
        (line["end"] - line["sent"], line["sent"])
        for line in lines
        if line["type"] == "transaction" and line["sent"]
    ]
    longest = [start for length, start in sent if length == max(sent)[0]]
    assert any(found["from_s"] * 72e6 <= start <= found["to_s"] * 72e6 for start in longest)
    assert found["scans"] == []

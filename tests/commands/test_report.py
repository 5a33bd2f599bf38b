from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

from bussim.cli import main
from bussim.report import scene
from tests.undrawn import undrawn


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("report")
    with undrawn():
        arguments = ["run", "press_line", "--duration", "25s", "--out"]
        assert main([*arguments, str(folder / "traced"), "--trace"]) == 0
        assert main([*arguments, str(folder / "plain"), "--seed", "8"]) == 0
        twice = ["run", "same_number_twice", "--duration", "5s", "--out"]
        assert main([*twice, str(folder / "twice")]) == 0
    return folder


def report(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> tuple[int, str, str]:
    capsys.readouterr()
    code = main(["report", *map(str, arguments)])
    found = capsys.readouterr()
    return code, found.out, found.err


def page(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> str:
    code, out, err = report(capsys, *arguments)
    assert (code, err) == (0, "")
    return Path(out.strip()).read_text(encoding="utf-8")


def test_one_run_into_its_own_folder(runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = page(capsys, runs / "traced", "--force")
    assert len(text.encode()) < 5_000_000
    for part in (
        "Scenario three presses in a line, 25 s simulated, seed 7, bussim",
        "MOV K5 D8179",
        "link: the median link scan takes 50.4 ms",
        "no link scan can take longer than 642.7 ms",
        "While one station is dead, every link scan takes about 348.6 ms",
        "310.318 ms (attempts 1 to 6 at station 1 (press2): no reply, code 01, 51.720 ms each)",
        "press2 without supply for 5 s",
        "bussim run scenario.yaml",
        "power_off: press2",
        "Copyright (c) 2022 Leon Sorokin",
    ):
        assert part in text, part


def test_nothing_in_the_page_leads_out_of_it(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = page(capsys, runs / "traced", "-o", tmp_path / "a.html")
    assert "default-src 'none'" in text
    markup = re.sub(r"<script.*?</script>|<style.*?</style>", "", text, flags=re.S)
    links = re.findall(r'(?:src|href|action|srcset)="([^"]*)"', markup)
    assert all(link.startswith(("#", "data:")) for link in links)
    assert "@import" not in text
    assert "url(" not in text


def test_the_same_runs_give_the_same_bytes(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    texts = [page(capsys, runs / "plain", "-o", tmp_path / name) for name in ("a.html", "b.html")]
    assert texts[0] == texts[1]


def test_without_a_trace_it_says_how_to_get_a_timeline(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = page(capsys, runs / "plain", "-o", tmp_path / "a.html")
    assert "This run was not traced, so there is no timeline of it." in text
    assert "--trace --out NEW_DIR" in text


def test_a_timeline_that_is_too_much_for_the_page_is_left_to_its_command(
    runs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(scene, "MOST_SHAPES", 5)
    text = page(capsys, runs / "traced", "-o", tmp_path / "a.html")
    assert f"draw it with bussim timeline {runs / 'traced'} --worst" in text


def test_without_a_law_it_says_why(runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = page(capsys, runs / "twice", "-o", tmp_path / "a.html")
    assert "since no exact law holds:" in text
    assert "no link scan can take longer" not in text
    text = page(capsys, runs / "plain", "--no-exact", "-o", tmp_path / "b.html")
    assert "exact law holds" not in text
    assert "no link scan can take longer" not in text


def test_a_scenario_that_cannot_be_read_costs_the_law_only(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(runs / "plain", tmp_path / "run")
    (tmp_path / "run" / "scenario.yaml").write_text("schema: 99\n", encoding="utf-8")
    text = page(capsys, tmp_path / "run")
    assert "There is no exact law, since the scenario in the folder cannot be read" in text


def test_what_a_page_must_not_hold_stands_in_escapes(runs: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(runs / "plain", tmp_path / "run")
    (folder / "scenario.yaml").write_text("\ufeffname: \x1b]0;a\x07\n\0", encoding="utf-8")
    assert main(["report", str(folder), "--no-exact"]) == 0
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "<code>name: \\x1b]0;a\\x07\n\\x00</code>" in page


def test_several_runs_are_compared(runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = page(capsys, *(runs / name for name in ("traced", "plain", "twice")), "-o", tmp_path / "a.html")
    assert "3 runs compared" in text
    assert 'class="differs"' in text
    assert "The scenario of twice" in text
    for name in ("traced", "plain", "twice"):
        assert f">{name}</h2>" in text


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["{runs}"],
            "is not the folder of a run: it has no summary.json; folders of runs in it: plain, traced, twice",
        ),
        (["{runs}/none"], "does not exist"),
        (["{runs}/plain", "{runs}/plain"], "is named twice"),
        (["{runs}/plain", "-o", "a.txt"], "ends in .txt; write a name that ends in .html or .htm"),
        (["{runs}/plain", "-o", "none/a.html"], "there is no folder none"),
        (["{runs}/plain", "-o", "."], "ends in nothing"),
        (["{runs}/plain"] * 8, "8 runs on one page cannot be distinguished"),
    ],
)
def test_what_cannot_be_reported_is_said(
    runs: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, err = report(capsys, *(text.format(runs=runs) for text in arguments))
    assert (code, out) == (2, "")
    assert message in err
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_exists_is_kept(runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    kept = tmp_path / "a.html"
    kept.write_text("mine", encoding="utf-8")
    code, _, err = report(capsys, runs / "plain", "-o", kept)
    assert code == 2
    assert "exists; choose another name with -o, or replace it with --force" in err
    assert kept.read_text(encoding="utf-8") == "mine"
    assert report(capsys, runs / "plain", "-o", kept, "--force")[0] == 0
    assert kept.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")

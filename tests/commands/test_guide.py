"""``bussim guide``: whatever pages there are can be listed and shown."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import bussim
from bussim.cli import main
from bussim.commands import guide

FOLDER = Path(bussim.__file__).parent / "guide"
PAGES = sorted(FOLDER.rglob("*.md"))


@pytest.fixture
def pages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "guide"
    (folder / "zh").mkdir(parents=True)
    (folder / "wires.md").write_text("# Real wires\n\n`sniff` *listens*.\n", encoding="utf-8")
    (folder / "sizing.md").write_text("# Choosing `D8179`\n\n## First\n", encoding="utf-8")
    (folder / "tutorial.md").write_text("# Tutorial\n", encoding="utf-8")
    (folder / "zh" / "sizing.md").write_text("# 重试次数\n", encoding="utf-8")
    monkeypatch.setattr(guide, "files", lambda _package: tmp_path)
    return folder


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(FOLDER)))
def test_every_page_has_a_heading_and_can_be_shown(
    path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    language = "en" if path.parent == FOLDER else path.parent.name
    page = guide.topics(language)[path.stem]
    assert main(["guide", path.stem, "--lang", language]) == 0
    assert page == path.read_text(encoding="utf-8")
    piped = capsys.readouterr().out
    assert "<!--" not in piped
    without = [line for line in page.splitlines() if not line.startswith("<!--")]
    assert piped.splitlines() == without
    assert guide.heading(page)
    monkeypatch.setenv("COLUMNS", "80")
    shown = re.sub(r"\x1b\[[0-9;]*m", "", guide._rendered(page))
    assert "\x1b" not in shown
    assert "<!--" not in shown
    for word in re.findall(r"\w+", guide.heading(page)):
        assert word in shown


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(FOLDER)))
def test_links_between_pages_lead_to_pages(path: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", path.read_text(encoding="utf-8")):
        if "://" not in target:
            assert (path.parent / target).exists(), target


def test_every_page_in_another_language_has_one_in_english() -> None:
    for language in guide.LANGUAGES[1:]:
        assert set(guide.topics(language)) == set(guide.topics())


def test_the_topics_are_listed_with_their_headings(pages: Path, capsys: pytest.CaptureFixture[str]) -> None:
    del pages
    assert main(["guide"]) == 0
    assert capsys.readouterr().out == "tutorial  Tutorial\nsizing    Choosing D8179\nwires     Real wires\n"
    assert main(["guide", "--lang", "zh"]) == 0
    assert "sizing    重试次数\n" in capsys.readouterr().out


def test_a_topic_without_a_page_in_a_language_is_shown_in_english(
    pages: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    del pages
    assert main(["guide", "sizing", "--lang", "zh"]) == 0
    assert capsys.readouterr().out == "# 重试次数\n"
    assert main(["guide", "wires", "--lang", "zh"]) == 0
    assert capsys.readouterr().out.startswith("# Real wires\n")


def test_a_wrong_topic_names_the_nearest(pages: Path, capsys: pytest.CaptureFixture[str]) -> None:
    del pages
    assert main(["guide", "sising"]) == 2
    assert "the guide has no topic 'sising'; did you mean sizing?" in capsys.readouterr().err
    assert main(["guide", "x"]) == 2
    assert "allowed are tutorial, sizing, wires" in capsys.readouterr().err


def test_a_terminal_gets_a_pager(pages: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    del pages
    shown: list[str] = []
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    monkeypatch.setattr("click.echo_via_pager", shown.append)
    assert main(["guide", "wires"]) == 0
    (text,) = shown
    assert "\x1b[" in text
    assert re.sub(r"\x1b\[[0-9;]*m", "", text).split() == ["Real", "wires", "sniff", "listens."]


def test_the_package_can_be_run_as_a_module() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "bussim", "--version"],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
        env={**os.environ, "PYTHONPATH": str(FOLDER.parents[1])},
    )
    assert (done.returncode, done.stdout) == (0, f"bussim {bussim.__version__}\n")

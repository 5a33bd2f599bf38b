"""Warnings that a scenario carries are the first thing that is said of it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import bussim
from bussim.cli import main
from bussim.scenario.loader import from_data
from bussim.scenario.yaml.dump import dumps
from tests.commands.test_fit import SCENARIO

TEXT = "errors come in bursts whose lengths the recording does not tell"


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "s.yaml"
    text = SCENARIO.replace("duration: 40 s", "duration: 2 s").partition("faults:")[0]
    path.write_text(f"{text}warnings: [{{code: bursts, text: {TEXT}}}]\n", encoding="utf-8")
    return path


@pytest.mark.parametrize("command", [("run", "--no-rows", "--out"), ("exact",), ("size",)])
@pytest.mark.usefixtures("pictures_undrawn")
def test_they_are_the_first_line(
    command: tuple[str, ...], file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name, *options = command
    where = [str(tmp_path / "out")] if "--out" in options else []
    assert main([name, str(file), *options, *where]) == 0
    assert capsys.readouterr().out.splitlines()[0] == f"warning: {TEXT}"
    assert main([name, str(file), *options, *(f"{path}2" for path in where), "--json"]) == 0
    out, err = capsys.readouterr()
    assert TEXT in json.dumps(json.loads(out)["warnings"])
    assert TEXT in err


def test_they_are_written_and_read_again(file: Path) -> None:
    made = bussim.load(file)
    assert [(each.code, each.text) for each in made.carried] == [("bursts", TEXT)]
    assert made.warnings[0] == TEXT
    written = dumps(made)
    assert "warnings:" in written
    assert "warnings" not in from_data(bussim.load("press_line").source).source


def test_one_without_a_text_is_refused(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file.write_text(file.read_text(encoding="utf-8").replace(f", text: {TEXT}", ""), encoding="utf-8")
    assert main(["check", str(file)]) == 2
    assert "text is missing" in capsys.readouterr().err

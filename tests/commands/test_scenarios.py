"""``bussim scenarios``."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from bussim.cli import main
from bussim.scenario import builtin


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_the_list(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["scenarios"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == builtin.names()
    assert lines[0].endswith("  " + builtin.title("press_line"))


def test_one_is_shown_as_it_is(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["scenarios", "cable_cut"]) == 0
    assert capsys.readouterr().out == builtin.read("cable_cut")


def test_a_copy_here_there_and_under_another_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["scenarios", "cable_cut", "--copy"]) == 0
    assert capsys.readouterr().out == "copied to cable_cut.yaml\n"
    Path("there").mkdir()
    assert main(["scenarios", "cable_cut", "--copy", "there"]) == 0
    assert main(["scenarios", "cable_cut", "--copy", "mine.yaml"]) == 0
    text = builtin.path("cable_cut").read_bytes()
    for copy in (Path("cable_cut.yaml"), Path("there", "cable_cut.yaml"), Path("mine.yaml")):
        assert copy.read_bytes() == text
    assert sorted(path.name for path in Path().iterdir()) == ["cable_cut.yaml", "mine.yaml", "there"]


def test_nothing_is_overwritten_without_force(capsys: pytest.CaptureFixture[str]) -> None:
    Path("cable_cut.yaml").write_text("mine", encoding="utf-8")
    assert main(["scenarios", "cable_cut", "--copy"]) == 2
    assert "cable_cut.yaml exists" in capsys.readouterr().err
    assert Path("cable_cut.yaml").read_text(encoding="utf-8") == "mine"
    assert main(["scenarios", "cable_cut", "--copy", "--force"]) == 0
    assert Path("cable_cut.yaml").read_bytes() == builtin.path("cable_cut").read_bytes()


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["nothing_like_it"], 2, "no built-in scenario 'nothing_like_it'"),
        (["cable_cat"], 2, "did you mean cable_cut?"),
        (["cable_cat", "--copy"], 2, "did you mean cable_cut?"),
        (["--copy"], 2, "--copy needs the NAME of a scenario"),
        (["--copy", "cable_cut"], 2, "--copy needs the NAME of a scenario"),
        (["cable_cut", "--force"], 2, "--force goes with --copy"),
        (["cable_cut", "--copy", "no/such/folder/x.yaml"], 2, "there is no folder"),
    ],
)
def test_what_cannot_be_done(
    arguments: list[str], code: int, message: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert main(["scenarios", *arguments]) == code
    assert message in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such mode")
def test_a_copy_can_be_read_by_others() -> None:
    main(["scenarios", "cable_cut", "--copy"])
    assert Path("cable_cut.yaml").stat().st_mode & 0o777 == 0o644

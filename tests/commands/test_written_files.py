"""What all commands that write have in common: ``-o``, ``--out``, ``--force``, ``--json``."""

from __future__ import annotations

import json
from pathlib import Path

import click
import pytest

from bussim.cli import COMMANDS, cli, main
from tests.commands.site.test_site import CALIBRATION

#: Where each writes what the test puts there first, in the current folder; ``{run}`` is the folder of a run.
TARGETS = {
    "size two_stations --out o": "o/size.json",
    "size two_stations -o o --json": "o/size_link.svg",
    "size two_stations -o o/x.html --lang zh": "o/x.html",
    "size --standard-lines -o o/x.html": "o/x.html",
    "exact two_stations --plot": "law_link.png",
    "exact two_stations --plot --json -o o": "o/law_link.svg",
    "plot {run}": "{run}/scan_time_over_run_link.svg",
    "plot {run} --kind histogram --json -o o": "o/scan_time_link.png",
    "report {run} --json --no-exact": "{run}/report.html",
    "poll x -1 --csv o/polls.csv": "o/polls.csv",
    "new -o o/x.yaml": "o/x.yaml",
    "check --schema -o o/x.json": "o/x.json",
    "watch two_stations --devices press.D8201 --csv o/x.csv": "o/x.csv",
    "run two_stations --duration 1s --readout o/x.yaml": "o/x.yaml",
    "scenarios two_stations --copy o/x.yaml": "o/x.yaml",
}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("written") / "run"
    assert main(["run", "two_stations", "--duration", "1s", "--no-plots", "--out", str(folder)]) == 0
    return folder


@pytest.mark.parametrize("words", TARGETS)
def test_nothing_is_replaced_unasked(
    words: str, run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "o").mkdir()
    target = Path(TARGETS[words].format(run=run))
    target.write_text("mine", encoding="utf-8")
    before = {*tmp_path.rglob("*"), *run.rglob("*")}
    assert main(words.format(run=run).split()) == 2
    out, err = capsys.readouterr()
    assert (out, f"{target} exists" in err, "--force" in err) == ("", True, True)
    assert target.read_text(encoding="utf-8") == "mine"
    assert {*tmp_path.rglob("*"), *run.rglob("*")} == before
    target.unlink()


def test_what_was_written_is_printed_as_json(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page, line = tmp_path / "r.html", tmp_path / "x.yaml"
    for words, file in ((["report", str(run), "--no-exact"], page), (["new"], line)):
        file.write_text("old", encoding="utf-8")
        capsys.readouterr()
        assert main([*words, "--force", "--json", "-o", str(file)]) == 0
        assert json.loads(capsys.readouterr().out) == {"schema": 1, "files": [str(file)]}
        assert file.read_text(encoding="utf-8") != "old"


@pytest.mark.parametrize(
    ("words", "target"),
    [
        ("size two_stations -o x.html", "x.html"),
        ("size two_stations -o o", "o/size.json"),
        ("exact two_stations --plot", "law_link.svg"),
        ("site calibration.yaml -o x.yaml", "x.yaml"),
    ],
)
def test_files_are_whole_before_anything_is_printed(
    words: str, target: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # As under ``| head -1``: the screen is gone before all is printed.
    def gone() -> None:
        raise BrokenPipeError

    monkeypatch.chdir(tmp_path)
    Path("calibration.yaml").write_text(CALIBRATION, encoding="utf-8")
    monkeypatch.setattr("bussim.commands.common.console.wide_console", gone)
    main(words.split())
    assert Path(target).stat().st_size > 0


def test_every_command_that_writes_has_the_same_options() -> None:
    for name in COMMANDS:
        command = cli.get_command(click.Context(cli), name)
        assert command is not None
        options = {option for parameter in command.params for option in parameter.opts}
        if options & {"--out", "--csv", "--copy"}:
            assert "--force" in options, name
        if "--out" in options:
            assert {"-o", "--json"} <= options, name

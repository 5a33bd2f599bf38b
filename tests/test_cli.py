"""The command line as a whole: help, exit codes, no traceback, a quick start."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import click
import pytest

from bussim import cli
from bussim.errors import Problem, RunError, ScenarioError, UsageError
from bussim.version import __version__

ROOT = Path(__file__).parents[1]
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT)}


def _python(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=ENVIRONMENT, check=False, timeout=60
    )


def test_help_imports_nothing_expensive() -> None:
    done = _python(
        "import sys\nfrom bussim.cli import main\ncode = main(['--help'])\n"
        "print(sorted({name.split('.')[0] for name in sys.modules}))\nsys.exit(code)"
    )
    assert done.returncode == 0
    assert done.stderr == ""
    imported = set(re.findall(r"'(\w+)'", done.stdout.splitlines()[-1]))
    assert "click" in imported
    assert not imported & {
        "pandas",
        "matplotlib",
        "numpy",
        "pydantic",
        "yaml",
        "rich",
        "simpy",
        "serial",
        "pyarrow",
    }


def test_check_imports_no_results_and_no_plots() -> None:
    done = _python(
        "import sys\nfrom bussim.cli import main\ncode = main(['check', 'press_line'])\n"
        "print(sorted({name.split('.')[0] for name in sys.modules}))\nsys.exit(code)"
    )
    assert done.returncode == 0
    imported = set(re.findall(r"'(\w+)'", done.stdout.splitlines()[-1]))
    assert not imported & {"pandas", "matplotlib", "numpy", "simpy", "serial", "pyarrow"}


@pytest.mark.skipif(sys.platform == "win32", reason="Windows finds its folders without HOME")
@pytest.mark.slow
@pytest.mark.parametrize("home", ["/dev/null/nobody", ""])
def test_without_a_home_a_run_draws_and_complains_of_nothing(home: str, tmp_path: Path) -> None:
    code = (
        "import sys; from bussim.cli import main; sys.exit(main(['run', '--duration', '1s', '--out', 'o']))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        env={"HOME": home, "PATH": os.defpath, "PYTHONPATH": str(ROOT)},
        cwd=tmp_path,
        check=False,
        timeout=60,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "o" / "scan_time_link.png").exists()
    assert {path.name for path in tmp_path.iterdir()} == {"o"}


def test_help_names_every_command_with_its_purpose(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["--help"]) == 0
    text = capsys.readouterr().out
    for name, purpose in cli.COMMANDS.items():
        assert re.search(rf"^  {name} +{re.escape(purpose)}$", text, re.MULTILINE)
    assert cli.main(["-h"]) == 0
    assert capsys.readouterr().out == text


@pytest.mark.parametrize("name", cli.COMMANDS)
def test_every_command_can_be_asked_for_help(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main([name, "--help"]) == 0
    assert capsys.readouterr().out.startswith(f"Usage: bussim {name} ")


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out == f"bussim {__version__}\n"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["chek"], "no command 'chek'; did you mean check?"),
        (["check"], "name a SCENARIO, - for standard input, or --schema"),
        (["run", "x", "y"], "unexpected extra argument"),
        (["check", "--jsn", "x"], "No such option"),
        (["--nothing"], "No such option"),
    ],
)
def test_a_wrong_command_line_exits_with_2(
    arguments: Sequence[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(arguments) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("error", "code", "text"),
    [
        (ScenarioError([Problem("b", 2, 1, "y"), Problem("b", 1, 7, "x")]), 2, "b:1:7: x\nb:2:1: y\n"),
        (UsageError("not like this"), 2, "Error: not like this\n"),
        (RunError("disk full"), 1, "Error: disk full\n"),
        (KeyboardInterrupt(), 130, "\nstopped\n"),
        (cli.Terminated("stopped: nothing is left"), 143, "\nstopped: nothing is left\n"),
        (click.Abort(), 130, "stopped\n"),
        (MemoryError(), 1, "Error: there is not enough memory for this\n"),
        (OSError(28, "full", "x"), 1, "Error: x: full\n"),
        (OSError(36, "too long", "y"), 2, "Error: y: too long\n"),
        (BrokenPipeError(), 1, ""),
    ],
)
def test_exit_codes(
    error: BaseException,
    code: int,
    text: str,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    @click.command()
    def command() -> None:
        raise error

    monkeypatch.setattr(cli._Commands, "get_command", lambda *_: command)
    try:
        found = cli.main(["check"])
    except SystemExit as stopped:  # click ends the program itself where the reader has gone
        found = stopped.code
    assert found == code
    assert capfd.readouterr().err == text


def test_a_reader_that_goes_away_causes_no_complaint() -> None:
    code = "import sys; from bussim.cli import main; sys.exit(main(['scenarios', 'press_line']))"
    with subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=ENVIRONMENT
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == b""
    assert process.returncode in (0, 1)


def test_names_that_the_terminal_cannot_show_do_not_end_the_program(tmp_path: Path) -> None:
    code = "import sys; from bussim.cli import main; sys.exit(main(sys.argv[1:]))"
    done = subprocess.run(
        [sys.executable, "-c", code, "check", str(tmp_path / "站µ.yaml")],
        capture_output=True,
        env={**ENVIRONMENT, "PYTHONIOENCODING": "cp1252"},
        check=False,
        timeout=60,
    )
    assert done.returncode == 2
    assert done.stderr.strip().endswith(b"\\u7ad9\xb5.yaml: no such file")

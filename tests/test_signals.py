"""How commands end by Ctrl-C and SIGTERM: in order, said in a line, wherever the signal comes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NoReturn

import pytest

from bussim.cli import Terminated, main
from bussim.errors import RunError
from bussim.processes import signals_later
from bussim.sweep.executors import _close
from bussim.words import language
from tests.test_ends import ROOT, posix, program


@pytest.fixture
def interrupts() -> Iterator[None]:
    """Ctrl-C is not ignored, as it is by what a shell has put into the background."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def assert_only_stopped(error: str) -> None:
    """One line says that it was stopped; before it only how long all would have taken, where that is long."""
    said = [line for line in error.splitlines() if line and not line.endswith(" in all")]
    assert len(said) == 1, error
    assert said[0].startswith("stopped: ")


@posix
@pytest.mark.usefixtures("interrupts")
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
@pytest.mark.parametrize(
    "words",
    [
        ["run", "--duration", "100h", "--out", "o"],
        ["sweep", "press_line", "--duration", "100h", "--vary", "seed=1,2,3", "--workers", "2", "--out", "o"],
    ],
    ids=lambda words: words[0],
)
def test_a_signal_ends_a_command_in_order(
    words: list[str], number: signal.Signals, code: int, tmp_path: Path
) -> None:
    process = program(*words, cwd=tmp_path)
    while process.poll() is None and not (tmp_path / "o.incomplete").exists():
        time.sleep(0.01)
    time.sleep(0.3)
    for _ in range(9):  # as by somebody who is impatient
        process.send_signal(number)
        time.sleep(0.01)
    out, error = process.communicate()
    assert process.returncode == code, error
    assert out == ""
    assert_only_stopped(error)
    assert {path.name for path in tmp_path.iterdir()} <= {"o.incomplete"}


@posix
@pytest.mark.slow
@pytest.mark.usefixtures("interrupts")
@pytest.mark.parametrize("wait", [tenths / 10 for tenths in range(8)])
def test_an_interrupt_by_the_terminal_reaches_workers_as_well(wait: float, tmp_path: Path) -> None:
    """Ctrl-C goes to every process of the foreground; those that are starting would print tracebacks."""
    words = [
        "sweep",
        "press_line",
        "--duration",
        "100h",
        "--vary",
        "seed=1,2,3",
        "--workers",
        "2",
        "--out",
        "o",
    ]
    process = program(*words, cwd=tmp_path, start_new_session=True)
    while process.poll() is None and not (tmp_path / "o.incomplete").exists():
        time.sleep(0.01)
    time.sleep(wait)
    os.killpg(process.pid, signal.SIGINT)
    out, error = process.communicate()
    assert (process.returncode, out) == (130, ""), error
    assert_only_stopped(error)


@pytest.mark.parametrize(("kind", "code"), [(KeyboardInterrupt, 130), (Terminated, 143)])
def test_an_end_that_is_asked_for_while_a_mistake_is_put_into_words(
    kind: type[KeyboardInterrupt],
    code: int,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def asked(*_: object, **__: object) -> NoReturn:
        raise kind

    monkeypatch.setattr(language, "said_text", asked)
    assert main(["plot", "nowhere"]) == code
    assert capsys.readouterr().err.strip() == "stopped"


#: An interrupt in a callback, and one that a library makes an error of its own of.
LOST = """
import os, sys
import bussim.cli
from bussim.__main__ import program

class Callback:
    def __del__(self):
        os.kill(os.getpid(), int(sys.argv.pop()))

def main(real=bussim.cli.main):
    {}
    return real()

bussim.cli.main = main
program()
"""
CALLBACK = LOST.format("Callback()")
ERROR = LOST.format("""
    try:
        os.kill(os.getpid(), int(sys.argv.pop()))
    except BaseException:
        raise ValueError("an error of a library") from None
""")


@posix
@pytest.mark.usefixtures("interrupts")
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
@pytest.mark.parametrize("script", [CALLBACK, ERROR], ids=["callback", "error"])
def test_a_signal_is_not_lost(number: signal.Signals, code: int, script: str, tmp_path: Path) -> None:
    """What is raised in a callback is only printed: the command would go on to its end."""
    words = ["run", "--duration", "100h", "--out", "o", str(int(number))]
    process = subprocess.run(
        [sys.executable, "-c", script, *words],
        capture_output=True,
        check=False,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert (process.returncode, process.stdout) == (code, "")
    assert process.stderr.strip() == "stopped"


@posix
@pytest.mark.usefixtures("interrupts")
def test_a_signal_waits_until_workers_are_started() -> None:
    before = signal.getsignal(signal.SIGINT)
    started = []

    def start() -> None:
        with signals_later():
            os.kill(os.getpid(), signal.SIGINT)
            started.append("whole")
            raise RunError("a worker died of the same signal")

    with pytest.raises(KeyboardInterrupt):
        start()
    assert started == ["whole"]
    assert signal.getsignal(signal.SIGINT) is before


def test_what_a_thread_says_is_heard_again_after_a_sweep() -> None:
    """Also where giving up its tasks fails."""

    class Broken:
        def close(self) -> None:
            raise RuntimeError

    before = threading.excepthook
    with pytest.raises(RuntimeError):
        _close(Broken())
    assert threading.excepthook is before

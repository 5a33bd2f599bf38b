"""Simulations in a process of their own: told, stopped, lost."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import bussim
from tests.sweep.test_code import WORKS, scenario

pytestmark = pytest.mark.slow
LONG = ["duration=1000h"]


def test_it_is_the_run_of_run(tmp_path: Path) -> None:
    before = bussim.load("press_line", ["duration=600s"])
    with bussim.start(before, tmp_path / "started", trace=False) as started:
        told = list(started.progress())
        result = started.result(60)
    assert not started.stopped
    assert [each.done for each in told] == sorted({each.done for each in told})
    assert all(0 < each.done <= 1 and each.left_s >= 0 for each in told)
    assert all(each.simulated_s == pytest.approx(600 * each.done) for each in told)
    assert result.summary == bussim.run(before, rows=False).summary
    alone = bussim.run(before, out=tmp_path / "alone").folder
    assert alone is not None
    names = sorted(path.name for path in alone.iterdir())
    assert names == sorted(path.name for path in (tmp_path / "started").iterdir())
    for name in names:
        assert (alone / name).read_bytes() == (tmp_path / "started" / name).read_bytes()


def test_one_that_is_stopped_leaves_its_folder_incomplete(tmp_path: Path) -> None:
    started = bussim.start(bussim.load("press_line", LONG), tmp_path / "o", rows=False)
    told = started.progress()
    first = time.monotonic()
    for count, each in enumerate(told):
        assert each.done < 1
        if count == 5:
            break
    assert time.monotonic() - first >= 0.4  # ten times a second at most
    with pytest.raises(TimeoutError):
        started.result(0.01)
    started.stop()
    assert list(told) == []
    started.stop()  # nothing is left to stop
    with pytest.raises(bussim.RunError, match="stopped"):
        started.result()
    assert started.stopped
    assert [path.name for path in tmp_path.iterdir()] == ["o.incomplete"]
    assert (tmp_path / "o.incomplete" / "INCOMPLETE").is_file()
    # It has let go of its folder, and a run that is over is not stopped.
    again = bussim.start("press_line", tmp_path / "o")
    again.result(60)
    again.stop()
    assert not again.stopped
    assert [path.name for path in tmp_path.iterdir()] == ["o"]


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_a_process_that_dies_is_told(tmp_path: Path) -> None:
    started = bussim.start(bussim.load("press_line", LONG), tmp_path / "o", rows=False)
    next(started.progress())
    os.kill(started._process.pid, signal.SIGKILL)
    with pytest.raises(bussim.RunError, match=r"killed by SIGKILL \(is there enough memory\?\)"):
        started.result(20)
    assert not started.stopped


def test_mistakes_are_those_of_run(tmp_path: Path) -> None:
    with pytest.raises(bussim.ScenarioError, match="pres_line"):
        bussim.start("pres_line", tmp_path / "o")
    (tmp_path / "o").mkdir()
    (tmp_path / "o" / "mine").touch()
    started = bussim.start("press_line", tmp_path / "o")
    with pytest.raises(bussim.UsageError, match="exists"):
        started.result(60)


def test_functions_of_a_user_must_be_found_there(tmp_path: Path) -> None:
    path = scenario(tmp_path, "started_code", WORKS)
    loaded = bussim.load(path, allow_code=True)
    with pytest.raises(bussim.RunError, match="started_code"):
        bussim.start(loaded, tmp_path / "o").result(60)
    del sys.modules["started_code"]
    with pytest.raises(
        bussim.UsageError, match=r"sensors cannot be handed to another process: .*started_code"
    ):
        bussim.start(loaded, tmp_path / "o")


@pytest.mark.skipif(sys.platform == "win32", reason="the end of a parent cannot be noticed")
def test_it_ends_with_a_script_which_needs_no_guard(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        "import bussim, os, signal\n"
        f"s = bussim.start(bussim.load('press_line', {LONG}), 'o', rows=False)\n"
        "next(s.progress())\n"
        "print(s._process.pid, flush=True)\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    env = {**os.environ, "PYTHONPATH": str(Path(bussim.__file__).parents[1])}
    # What it has started would keep the pipe open.
    ended = subprocess.run(
        [sys.executable, script], cwd=tmp_path, env=env, stdout=subprocess.PIPE, timeout=60, check=False
    )
    (process,) = map(int, ended.stdout.split())
    deadline = time.monotonic() + 20
    while time.monotonic() < deadline and _lives(process):
        time.sleep(0.05)
    assert not _lives(process)


def _lives(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return (
        "Z"
        not in subprocess.run(
            ["ps", "-o", "stat=", "-p", str(process)], capture_output=True, text=True, check=False
        ).stdout
    )

"""A sweep's folder: killed at any step it goes on, and other people's folders are left alone."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from bussim.errors import RunError, UsageError
from bussim.sweep import plots, run
from bussim.sweep.folder import JOURNAL, MARKER, SweepFolder
from bussim.sweep.result import SweepResult
from bussim.sweep.run import sweep as run_sweep
from tests.sweep.samples import RETRIES, HereExecutor, contents, noisy

FILES = {"sweep.json", "scenario.yaml", "runs.csv", "runs.parquet", "points.csv", "sweep_link.png"}


class _Killed(BaseException):
    """Stands for the end of the process."""


class _Steps:
    """Ends the process before the n-th step that changes a file system."""

    #: What Python reports to its audit hooks, see its library reference.
    _CHANGES = frozenset({"os.rename", "os.remove", "os.rmdir", "os.mkdir", "os.truncate"})

    def __init__(self) -> None:
        self.left: int | None = None
        sys.addaudithook(self._hook)

    def _hook(self, event: str, arguments: tuple[Any, ...]) -> None:
        if self.left is None:
            return
        # Python's own open() names a mode; a lock's file is opened with flags alone.
        writes = event == "open" and bool(
            arguments[2] & os.O_CREAT if arguments[1] is None else arguments[1][0] in "wax"
        )
        if event in self._CHANGES or writes:
            self.left -= 1
            if self.left < 0:
                raise _Killed

    @contextmanager
    def kill(self, after: int) -> Iterator[None]:
        self.left = after
        try:
            yield
        finally:
            self.left = None


_STEPS = _Steps()


#: All executors so far; each has an order of its own.
_EXECUTORS: list[HereExecutor] = []


def _recorded() -> HereExecutor:
    _EXECUTORS.append(HereExecutor(len(_EXECUTORS), real=False))
    return _EXECUTORS[-1]


def ran() -> int:
    """How many runs have been simulated so far."""
    return sum(len(executor.ran) for executor in _EXECUTORS)


@pytest.fixture
def sweep(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., SweepResult]:
    """A small sweep into tmp_path/sweeps/out that costs nothing."""
    scenario = noisy(tmp_path)
    monkeypatch.setattr(run, "open_executor", lambda *_: _recorded())
    monkeypatch.setattr(plots, "draw", lambda *given: (given[-1] / "sweep_link.png").write_bytes(b"x"))

    def call(vary: str = f"{RETRIES}=0,1", *, out: str = "out", **options: object) -> SweepResult:
        return run_sweep(scenario, [vary], out=tmp_path / "sweeps" / out, **options)  # type: ignore[arg-type] # any option

    return call


def tree(folder: Path) -> dict[str, dict[str, bytes]]:
    return {path.name: contents(path) for path in sorted(folder.iterdir())}


def test_killed_at_any_step_it_goes_on_where_it_was(
    sweep: Callable[..., SweepResult], tmp_path: Path
) -> None:
    folder = tmp_path / "sweeps"
    sweep(out="undisturbed", repeat=2)
    wanted = contents(folder / "undisturbed")
    assert set(wanted) == FILES
    for steps in range(200):
        name, before = f"after{steps}", ran()
        killed = False
        try:
            with _STEPS.kill(steps):
                sweep(out=name, repeat=2)
        except _Killed:
            killed = True
            # Whatever stands at the target is whole or says that it is not.
            target = folder / name
            assert not target.exists() or (target / MARKER).exists() or contents(target) == wanted
        result = sweep(out=name, repeat=2)
        assert result.folder == folder / name
        assert contents(folder / name) == wanted, steps
        assert ran() - before == 4, steps  # nothing twice
        assert not [path.name for path in folder.iterdir() if path.name.startswith(f"{name}.")]
        if not killed:
            break
    assert steps > 12


@pytest.mark.slow
def test_replacing_another_sweep_may_be_killed_at_any_step(
    sweep: Callable[..., SweepResult], tmp_path: Path
) -> None:
    folder = tmp_path / "sweeps"
    sweep(out="undisturbed")
    wanted = contents(folder / "undisturbed")
    for steps in range(200):
        name = f"after{steps}"
        sweep(f"{RETRIES}=5,6,7", out=name)
        killed = False
        try:
            with _STEPS.kill(steps):
                sweep(out=name, force=True)
        except _Killed:
            killed = True
        sweep(out=name, force=True)
        assert contents(folder / name) == wanted, steps
        assert not [path.name for path in folder.iterdir() if path.name.startswith(f"{name}.")]
        if not killed:
            break
    assert steps > 20


def test_what_is_whole_is_not_run_again(sweep: Callable[..., SweepResult], tmp_path: Path) -> None:
    assert sweep().already_there == 0
    before = contents(tmp_path / "sweeps" / "out")
    assert sweep().already_there == 2
    assert sweep(workers=7).already_there == 2  # who runs it makes no difference
    assert contents(tmp_path / "sweeps" / "out") == before
    assert sweep(force=True).already_there == 0
    assert contents(tmp_path / "sweeps" / "out") == before


def test_another_sweep_is_refused_with_what_differs(
    sweep: Callable[..., SweepResult], tmp_path: Path
) -> None:
    sweep()
    before = tree(tmp_path / "sweeps")
    for vary, options, message in (
        (f"{RETRIES}=0,2", {}, f"{RETRIES} is varied over 0,2 here, 0,1 there"),
        (f"{RETRIES}=0,1", {"repeat": 2}, "--repeat is 2 here, 1 there"),
        (f"{RETRIES}=0,1", {"common_random_numbers": True}, "--same-luck is true here, false there"),
        (f"{RETRIES}=0,1", {"sets": ["seed=5"]}, "seed is 5 here, 3 there"),
        (
            f"{RETRIES}=0,1",
            {"sets": ["noise=[]"]},
            'noise is [] here, [{"bus": "link", "at": "0 s", "ber": 0.001}] there',
        ),
    ):
        with pytest.raises(UsageError) as caught:
            sweep(vary, **options)
        assert f"out is the folder of another sweep: {message}; choose another name" in str(caught.value)
    assert tree(tmp_path / "sweeps") == before


def test_another_version_of_bussim_is_another_sweep(
    sweep: Callable[..., SweepResult], tmp_path: Path
) -> None:
    sweep()
    manifest = tmp_path / "sweeps" / "out" / "sweep.json"
    manifest.write_text(json.dumps(json.loads(manifest.read_text()) | {"bussim": "0.0.1"}))
    with pytest.raises(UsageError, match=r'the version of bussim is "[\d.]+" here, "0.0.1" there'):
        sweep()
    assert sweep(force=True).already_there == 0
    assert sweep().already_there == 2


def test_an_unfinished_other_sweep_is_refused_too(sweep: Callable[..., SweepResult], tmp_path: Path) -> None:
    folder = tmp_path / "sweeps"
    steps = count(1)
    while not (folder / "out.incomplete" / JOURNAL).is_file():
        with pytest.raises(_Killed), _STEPS.kill(next(steps)):
            sweep(f"{RETRIES}=0:9:1")
    with pytest.raises(
        UsageError, match=r"another sweep \(unfinished, in .*out.incomplete\): .* is varied over"
    ):
        sweep()
    assert sweep(force=True).already_there == 0
    assert [path.name for path in folder.iterdir()] == ["out"]


def test_what_is_no_sweep_is_never_replaced(sweep: Callable[..., SweepResult], tmp_path: Path) -> None:
    folder = tmp_path / "sweeps"
    (folder / "out").mkdir(parents=True)
    (folder / "out" / "thesis.txt").write_text("precious")
    (folder / "file").write_text("precious")
    (folder / "more.incomplete").mkdir()
    (folder / "more.incomplete" / "thesis.txt").write_text("precious")
    before = {path: path.read_bytes() for path in folder.rglob("*.txt")}
    for force in (False, True):
        for name, message in (
            ("out", "is not the folder of a sweep"),
            ("more", "more.incomplete exists and is not the folder of a sweep"),
            ("file", "exists and is a file"),
            ("file/out", "cannot be written"),
            ("..", "is not a folder that can be made"),
        ):
            with pytest.raises(UsageError, match=message):
                sweep(out=name, force=force)
    assert {path: path.read_bytes() for path in folder.rglob("*.txt")} == before
    (folder / "empty").mkdir()
    assert sweep(out="empty").folder == folder / "empty"


def test_with_numbers_the_same_sweep_is_found_again(
    sweep: Callable[..., SweepResult], tmp_path: Path
) -> None:
    folder = tmp_path / "sweeps"
    assert sweep(numbered=True).folder.name == "out"
    assert sweep(f"{RETRIES}=5,6", numbered=True).folder.name == "out-2"
    with pytest.raises(_Killed), _STEPS.kill(8):
        sweep(f"{RETRIES}=7,8", numbered=True)
    assert (folder / "out-3.incomplete").is_dir()
    assert sweep(f"{RETRIES}=8,9", numbered=True).folder.name == "out-4"
    assert sweep(f"{RETRIES}=7,8", numbered=True).folder.name == "out-3"
    for vary, name in ((f"{RETRIES}=0,1", "out"), (f"{RETRIES}=5,6", "out-2"), (f"{RETRIES}=8,9", "out-4")):
        again = sweep(vary, numbered=True)
        assert (again.folder.name, again.already_there) == (name, 2)
    assert sorted(path.name for path in folder.iterdir()) == ["out", "out-2", "out-3", "out-4"]


def test_a_folder_in_use_is_left_alone(sweep: Callable[..., SweepResult], tmp_path: Path) -> None:
    target = tmp_path / "sweeps" / "out"
    manifest = sweep(out="other").plan.manifest()
    code = (
        "import json, sys\nfrom pathlib import Path\nfrom bussim.sweep.folder import SweepFolder\n"
        "folder = SweepFolder(Path(sys.argv[1]), json.loads(sys.argv[2]))\nfolder.begin()\n"
        "print('ready', flush=True)\nsys.stdin.read()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code, str(target), json.dumps(manifest)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={"PYTHONPATH": str(Path(__file__).parents[2])},
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "ready\n"
        for vary, force in ((f"{RETRIES}=0,1", False), (f"{RETRIES}=0,1", True), (f"{RETRIES}=5,6", True)):
            with pytest.raises(UsageError, match=r"out\.incomplete is being written by another process"):
                sweep(vary, force=force)
        other.kill()
    assert sweep().already_there == 0


def test_nothing_is_written_before_it_begins(tmp_path: Path) -> None:
    with SweepFolder(tmp_path / "a" / "out", {"vary": []}) as folder:
        assert folder.state == "new"
    assert list(tmp_path.iterdir()) == []


def test_a_sweep_whose_folder_cannot_be_begun_leaves_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    made = SweepFolder(tmp_path / "out", {"vary": []})
    with made as folder, pytest.raises(RunError, match="No space left on device"):
        folder.begin()
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_keeps_what_was_run(
    sweep: Callable[..., SweepResult], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(plots, "draw", full)
        with pytest.raises(RunError, match=r"out: writing failed: No space left on device"):
            sweep()
    assert [path.name for path in (tmp_path / "sweeps").iterdir()] == ["out.incomplete"]
    assert sweep().already_there == 2

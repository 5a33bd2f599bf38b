from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from bussim.errors import RunError, UsageError
from bussim.files import INCOMPLETE
from bussim.results.store.folder import RunFolder
from bussim.results.store.load import load_run
from bussim.results.store.rows import FileRows
from bussim.trace.file import read_trace
from bussim.trace.records import FrameRecord
from bussim.units import TICKS_PER_SECOND
from tests.results.fakes import Fake, quiet
from tests.selection import quick

pytestmark = pytest.mark.usefixtures("pictures_undrawn")

SCENARIO = "schema: 1\nname: three presses\n"
SHORT = quiet(duration=3 * TICKS_PER_SECOND)
FILES = {
    "summary.json",
    "histograms.json",
    "scenario.yaml",
    "link_scans.csv",
}
HERE = Path(__file__).parents[1]  # where the fakes are


def write(
    target: Path,
    *,
    fake: Fake = SHORT,
    traced: bool = False,
    rows: bool = True,
    fmt: str = "csv",
    force: bool = False,
) -> Path:
    with RunFolder(target, rows=rows, traced=traced, fmt=fmt, force=force) as folder:
        return folder.finish(fake.run(traced=traced, rows=folder.rows), SCENARIO)


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_a_whole_folder(tmp_path: Path) -> None:
    target = tmp_path / "deep" / "runs" / "press"
    assert write(target) == target
    assert names(target) == FILES
    assert names(target.parent) == {"press"}
    assert (target / "scenario.yaml").read_text() == SCENARIO
    assert json.loads((target / "summary.json").read_text())["scenario"] == "three presses"


def test_options_choose_the_files(tmp_path: Path) -> None:
    traced = write(tmp_path / "traced", traced=True)
    assert names(traced) == FILES | {"exchanges.csv", "trace.jsonl"}
    bare = write(tmp_path / "bare", rows=False)
    assert names(bare) == FILES - {"link_scans.csv"}
    parquet = write(tmp_path / "parquet", traced=True, fmt="parquet")
    assert {"link_scans.parquet", "exchanges.parquet", "trace.jsonl"} < names(parquet)


def test_rows_are_on_disk_while_the_run_goes_on(tmp_path: Path) -> None:
    with RunFolder(tmp_path / "run", rows=True, traced=False, fmt="csv") as folder:
        quiet().run(rows=folder.rows)  # 1,200 scans
        part = tmp_path / "run.incomplete"
        assert (part / INCOMPLETE).is_file()
        assert (part / "link_scans.csv").stat().st_size > 30_000
        assert not (tmp_path / "run").exists()


def test_a_run_that_failed_leaves_nothing(tmp_path: Path) -> None:
    def interrupted() -> None:
        with RunFolder(tmp_path / "run", rows=True, traced=True, fmt="csv") as folder:
            SHORT.run(traced=True, rows=folder.rows)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert names(tmp_path) == set()


def test_a_full_disk_is_a_failed_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(FileRows, "take", full)
    with pytest.raises(RunError, match=r"run: writing failed: No space left on device"):
        write(tmp_path / "run")
    assert names(tmp_path) == set()


def test_a_full_disk_loses_nothing_that_was_heard_on_a_line(tmp_path: Path) -> None:
    """A recording cannot be made again as a run can; the next one of its name may begin where it lies."""

    def recorded() -> None:
        with RunFolder(tmp_path / "line", rows=True, traced=True, fmt="csv", live=True) as folder:
            SHORT.run(traced=True, rows=folder.rows)
            raise OSError(28, "No space left on device")

    for _ in range(2):
        with pytest.raises(
            RunError, match=r"line: writing failed: No space left .* is in .*line\.incomplete"
        ):
            recorded()
        assert names(tmp_path) == {"line.incomplete"}
        trace = read_trace(tmp_path / "line.incomplete")
        assert trace.is_cut
        assert len(list(trace.of(FrameRecord))) > 10


def test_an_existing_folder_is_refused(tmp_path: Path) -> None:
    target = write(tmp_path / "run")
    before = {path.name: path.read_bytes() for path in target.iterdir()}
    with pytest.raises(UsageError, match=r"exists.*--force"):
        write(target, fake=quiet(seed=9))
    assert {path.name: path.read_bytes() for path in target.iterdir()} == before
    assert names(tmp_path) == {"run"}


def test_force_replaces_a_run_and_only_after_the_new_one_is_whole(tmp_path: Path) -> None:
    target = write(tmp_path / "run", traced=True)
    with RunFolder(target, rows=True, traced=False, fmt="csv", force=True) as folder:
        record = SHORT.run(rows=folder.rows, name="the new one")
        assert load_run(target).scenario == "three presses"
        folder.finish(record, SCENARIO)
    assert load_run(target).scenario == "the new one"
    assert names(target) == FILES  # nothing of the old one is mixed in
    assert names(tmp_path) == {"run"}


def test_a_failed_run_with_force_leaves_the_old_one(tmp_path: Path) -> None:
    target = write(tmp_path / "run")
    with pytest.raises(RuntimeError), RunFolder(target, rows=True, traced=False, fmt="csv", force=True):
        raise RuntimeError
    assert load_run(target).scenario == "three presses"
    assert names(tmp_path) == {"run"}


def test_force_never_removes_a_folder_that_is_no_run(tmp_path: Path) -> None:
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "chapter1.txt").write_text("years of work")
    with pytest.raises(UsageError, match="not the folder of a run"):
        write(tmp_path / "thesis", force=True)
    assert (tmp_path / "thesis" / "chapter1.txt").read_text() == "years of work"
    assert write(tmp_path / "new", force=True) == tmp_path / "new"


def test_a_file_in_the_way_is_refused(tmp_path: Path) -> None:
    (tmp_path / "run").write_text("a file")
    for force in (False, True):
        with pytest.raises(UsageError, match="is a file"):
            write(tmp_path / "run", force=force)
    with pytest.raises(UsageError, match="cannot be written"):
        write(tmp_path / "run" / "below")
    with pytest.raises(UsageError, match="give it a name"):
        write(Path())


def test_what_a_killed_run_left_is_replaced(tmp_path: Path) -> None:
    part = tmp_path / "run.incomplete"
    part.mkdir()
    (part / INCOMPLETE).write_text("left")
    (part / "link_scans.csv").write_text("half a li")
    write(tmp_path / "run")
    assert names(tmp_path) == {"run"}


def test_another_programs_folder_of_that_name_is_not(tmp_path: Path) -> None:
    part = tmp_path / "run.incomplete"
    part.mkdir()
    (part / "mine.txt").write_text("mine")
    with pytest.raises(UsageError, match="was not left by bussim"):
        write(tmp_path / "run")
    assert (part / "mine.txt").read_text() == "mine"


def test_a_folder_that_is_being_written_is_refused(tmp_path: Path) -> None:
    target = tmp_path / "run"
    with RunFolder(target, rows=True, traced=False, fmt="csv") as folder:
        with pytest.raises(UsageError, match="being written by another run"):
            write(target)
        assert taken(target) == tmp_path / "run-2"
        folder.finish(SHORT.run(rows=folder.rows), SCENARIO)
    assert names(target) == FILES
    assert taken(target) == tmp_path / "run-2"
    assert names(tmp_path) == {"run"}


def taken(wanted: Path) -> Path:
    """The folder that a run takes where a name may be numbered."""
    with RunFolder(wanted, rows=True, traced=False, fmt="csv", numbered=True) as folder:
        return folder.target


def test_free_folders_are_numbered_and_stale_ones_used_again(tmp_path: Path) -> None:
    wanted = tmp_path / "run"
    assert taken(wanted) == wanted
    (tmp_path / "run.incomplete").mkdir()
    (tmp_path / "run.incomplete" / INCOMPLETE).write_text("left")
    assert taken(wanted) == wanted
    for number in ("run", "run-2", "run-3"):
        (tmp_path / number).mkdir()
    (tmp_path / "run-4.incomplete").mkdir()
    (tmp_path / "run-4.incomplete" / "mine.txt").write_text("mine")
    assert taken(wanted) == tmp_path / "run-5"
    assert (tmp_path / "run-4.incomplete" / "mine.txt").read_text() == "mine"


def test_an_unknown_format_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="'xlsx', allowed are csv and parquet"):
        write(tmp_path / "run", fmt="xlsx")


PROGRAM = """
import sys
sys.path.insert(0, {here!r})
from pathlib import Path
from bussim.results.store.folder import RunFolder
from fakes import Fake
target, force, traced = Path(sys.argv[1]), sys.argv[2] == "force", sys.argv[3] == "trace"
with RunFolder(target, rows=True, traced=traced, fmt="csv", force=force) as folder:
    print("writing", flush=True)
    folder.finish(Fake(duration=72_000_000 * 40).run(traced=traced, rows=folder.rows), "schema: 1\\n")
print("done", flush=True)
"""


def start(target: Path, *options: str, seed: str = "0") -> subprocess.Popen[str]:
    # fakes.py is imported as a module of its own here: its relatives are all in bussim.
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM.format(here=str(HERE)), str(target), *options],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(HERE.parents[1]), "PYTHONHASHSEED": seed},
    )


@pytest.mark.slow
def test_two_processes_write_the_same_bytes(tmp_path: Path) -> None:
    folders = [tmp_path / "a", tmp_path / "b"]
    processes = [start(folder, "new", "trace", seed=str(n)) for n, folder in enumerate(folders)]
    for process in processes:
        process.communicate()
        assert process.returncode == 0
    first, second = ({path.name: path.read_bytes() for path in folder.iterdir()} for folder in folders)
    assert set(first) == FILES | {"exchanges.csv", "trace.jsonl"}
    assert [name for name in first if first[name] != second.get(name)] == []


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL is a POSIX signal")
@pytest.mark.parametrize("mode", ["new", "force"])
def test_killed_at_any_moment_a_folder_is_whole_or_marked(tmp_path: Path, mode: str) -> None:
    chance = random.Random(mode)
    for number in range(4):
        target = tmp_path / f"run{number}"
        if mode == "force":
            write(target)
        process = start(target, mode, "plain")
        assert process.stdout is not None
        assert process.stdout.readline() == "writing\n"
        # Simulating, drawing and moving take the child about a second and a half here; on another
        # machine other moments are hit, and every one of them must be harmless.
        time.sleep(chance.uniform(0.0, 2.5))
        process.send_signal(signal.SIGKILL)
        process.communicate()
        for folder in tmp_path.iterdir():
            if not (folder / INCOMPLETE).is_file():
                assert not any(folder.iterdir()) or folder == target
        if target.exists() and not (target / INCOMPLETE).is_file():
            assert names(target) == FILES
            load_run(target)
        # And the next run of that name has its way.
        write(target, force=True)
        assert names(target) == FILES
        assert names(tmp_path) == {target.name}
        for path in target.iterdir():
            path.unlink()
        target.rmdir()


@pytest.mark.skipif(sys.platform == "win32", reason="a closed file is all that Windows renames")
@pytest.mark.parametrize("mode", quick(1, ["new", "force"]))
def test_killed_between_any_two_changes_of_the_disk(
    tmp_path: Path, mode: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stop after each single change that finishing makes, as a kill would: nothing tidies up."""

    class Killed(BaseException):
        pass

    def attempt(allowed: int, target: Path) -> bool:
        left = allowed

        def counted(original: str) -> None:
            function = getattr(Path, original)

            def change(self: Path, *args: object, **how: object) -> object:
                nonlocal left
                if left == 0:
                    raise Killed
                left -= 1
                return function(self, *args, **how)

            patch.setattr(Path, original, change)

        folder = RunFolder(target, rows=True, traced=False, fmt="csv", force=mode == "force")
        record = SHORT.run(rows=folder.rows)
        with monkeypatch.context() as patch:
            for name in ("replace", "unlink", "rmdir", "mkdir", "write_bytes"):
                counted(name)
            try:
                folder.finish(record, SCENARIO)
            except Killed:
                folder._lock.release(force=True)  # as the system does for a dead process
                folder.rows.close()
                return False
        return True

    for allowed in range(100):
        target = tmp_path / "run"
        if mode == "force" and not target.exists():
            write(target)
        finished = attempt(allowed, target)
        for folder in tmp_path.iterdir():
            whole = names(folder) == FILES
            assert whole or (folder / INCOMPLETE).is_file() or not any(folder.iterdir())
        if finished:
            assert names(tmp_path) == {"run"}
            break
        write(target, force=True)
        assert names(tmp_path) == {"run"}
        if mode == "new":
            for path in target.iterdir():
                path.unlink()
            target.rmdir()
    assert finished
    assert allowed > 2

"""How commands end that cannot do what they are asked: a line on standard error, the exit code, nothing left."""

from __future__ import annotations

import ast
import ctypes
import errno
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier
from typing import NoReturn

import pytest

from bussim import files
from bussim.cli import main
from bussim.errors import RunError, UsageError
from bussim.files import written_whole
from bussim.results.store.folder import RunFolder

ROOT = Path(__file__).parents[1]
posix = pytest.mark.skipif(sys.platform == "win32", reason="devices, pipes and signals of POSIX")


def program(*arguments: str, cwd: Path, **options: object) -> subprocess.Popen[str]:
    return subprocess.Popen(  # type: ignore[call-overload, no-any-return]
        [sys.executable, "-m", "bussim", *arguments],
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        text=True,
        **{"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **options},
    )


def ended(*arguments: str, cwd: Path, **options: object) -> tuple[int, str]:
    process = program(*arguments, cwd=cwd, **options)
    _, error = process.communicate()
    return process.returncode, error


@posix
@pytest.mark.parametrize("words", [["scenarios"], ["exact", "two_stations"], ["--help"]], ids=lambda w: w[0])
def test_standard_output_that_is_full_or_closed(words: list[str], tmp_path: Path) -> None:
    with Path("/dev/full").open("w") as full:
        code, error = ended(*words, cwd=tmp_path, stdout=full)
    assert (code, error.count("\n")) == (1, 1)
    assert "No space left on device" in error
    code, error = ended(*words, cwd=tmp_path, preexec_fn=lambda: os.close(1))
    assert (code, error) == (0, "")


@posix
@pytest.mark.parametrize(
    "words",
    [
        ["exact", "two_stations"],
        pytest.param(
            ["sweep", "two_stations", "--duration", "1s", "--vary", "seed=1,2", "--workers", "2"],
            marks=pytest.mark.slow,
        ),
    ],
    ids=lambda words: words[0],
)
def test_streams_that_are_closed_are_no_failure(words: list[str], tmp_path: Path) -> None:
    """As those of what a system's timer starts; no file of ours may take the place of one."""
    assert ended(*words, cwd=tmp_path, preexec_fn=lambda: os.close(2))[0] == 0
    assert ended(*words, cwd=tmp_path, preexec_fn=lambda: os.closerange(0, 3))[0] == 0


@posix
def test_a_reader_that_went_away(tmp_path: Path) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "w") as pipe:
        assert ended("scenarios", cwd=tmp_path, stdout=pipe) == (1, "")


@posix
@pytest.mark.parametrize("command", ["check", "run", "exact", "size", "sweep"])
def test_what_is_no_scenario_file(command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    os.mkfifo(tmp_path / "pipe.yaml")
    (tmp_path / "loop.yaml").symlink_to("loop.yaml")
    more = ["--vary", "seed=1,2"] if command == "sweep" else []
    for name, word in (
        ("pipe.yaml", "pipe"),
        ("loop.yaml", "symbolic links"),
        ("x" * 300, "too long"),
        ("", "folder"),
    ):
        assert main([command, str(tmp_path / name), *more]) == 2
        error = capsys.readouterr().err
        assert word in error, name
        assert error.count("\n") == 1


@posix
@pytest.mark.parametrize(
    "words",
    [
        ["report", "loop"],
        ["run", "two_stations", "--out", "loop"],
        ["sweep", "two_stations", "--vary", "seed=1", "--out", "loop"],
    ],
    ids=lambda words: words[0],
)
def test_a_link_that_leads_to_itself(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("loop").symlink_to("loop")
    assert main(words) == 2
    assert capsys.readouterr() == ("", "Error: loop: Too many levels of symbolic links\n")


def obey_modes() -> None:
    """Let root be stopped by a file's mode as any user is, by dropping what lifts it (see capabilities(7))."""
    libc = ctypes.CDLL(None)
    for capability in (1, 2):  # CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH
        libc.prctl(24, capability, 0, 0, 0)  # PR_CAPBSET_DROP


@posix
@pytest.mark.parametrize(
    "words",
    [["export", "?", "--to", "vcd"], ["sniff", __file__, "--layout", "?"]],
    ids=lambda words: words[0],
)
def test_a_pipe_is_not_waited_for(words: list[str], tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    words = [word.replace("?", str(tmp_path / "pipe")) for word in words]
    process = program(*words, cwd=tmp_path)
    try:
        _, error = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 2
    assert error == f"Error: {tmp_path / 'pipe'} cannot be read: it is a pipe\n"


@posix
@pytest.mark.parametrize(
    "words",
    [
        ["run", "--duration", "1s", "--out", "?/x"],
        ["sweep", "two_stations", "--duration", "1s", "--vary", "seed=1", "--out", "?/x"],
        ["size", "two_stations", "--out", "?/x"],
        ["watch", "interlock", "--devices", "press1.D8201", "--csv", "?/x.csv"],
        ["scenarios", "two_stations", "--copy", "?/x.yaml"],
    ],
    ids=lambda words: words[0],
)
def test_a_folder_that_may_not_be_entered(words: list[str], tmp_path: Path) -> None:
    locked = tmp_path / "locked"
    locked.mkdir()
    locked.chmod(0)
    code, error = ended(
        *[word.replace("?", str(locked)) for word in words], cwd=tmp_path, preexec_fn=obey_modes
    )
    locked.chmod(0o700)
    assert "Traceback" not in error
    assert str(locked) in error
    assert "Permission denied" in error
    assert error.count("\n") == 1
    assert code == 1


@posix
@pytest.mark.parametrize(
    "words", [["report"], ["export", "--to", "vcd"], ["sniff"]], ids=lambda words: words[0]
)
def test_a_run_in_a_folder_that_may_not_be_entered_cannot_be_read(words: list[str], tmp_path: Path) -> None:
    (tmp_path / "locked").mkdir()
    (tmp_path / "locked").chmod(0)
    found = ended(*words, "locked/run", cwd=tmp_path, preexec_fn=obey_modes)
    (tmp_path / "locked").chmod(0o700)
    assert found == (2, "Error: locked/run cannot be read: Permission denied\n")


def test_two_writers_of_one_file(tmp_path: Path) -> None:
    target = tmp_path / "x.vcd"
    (tmp_path / "x.vcd.part").write_text("mine")

    def write(number: int) -> None:
        with written_whole(target) as part, part.open("w") as file:
            for _ in range(200):
                file.write(f"{number}\n")

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(write, range(64)))
    assert len(set(target.read_text().split())) == 1
    assert len(target.read_text().split()) == 200
    assert (tmp_path / "x.vcd.part").read_text() == "mine"
    assert {path.name for path in tmp_path.iterdir()} == {"x.vcd", "x.vcd.part"}


def test_of_two_writers_each_says_what_became_of_its_file(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    def said() -> str:
        text = " ".join(caplog.messages)
        caplog.clear()
        return text

    target = tmp_path / "x.vcd"
    target.write_text("before")
    first, second = written_whole(target), written_whole(target)
    first.__enter__().write_text("first")
    second.__enter__().write_text("second")
    assert said() == ""
    first.__exit__(None, None, None)
    assert target.read_text() == "first"
    assert f"{target} is whole; another command writes it, too, and will replace it" in said()
    second.__exit__(None, None, None)
    assert target.read_text() == "second"
    assert said() == f"{target} is whole, and replaces what another command wrote there meanwhile"
    with (
        written_whole(tmp_path / "y.vcd"),
        written_whole(target) as part,
    ):  # one behind the other, or elsewhere
        part.write_text("third")
    assert said() == ""


def test_a_file_that_is_replaced_at_once(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    target, replace = tmp_path / "x.vcd", Path.replace

    def replaced(part: Path, path: Path) -> None:
        replace(part, path)
        path.write_text("another's")

    monkeypatch.setattr(Path, "replace", replaced)
    with written_whole(target):
        pass
    assert caplog.messages == [
        f"{target} was replaced at once: another command wrote it at the same time, and its file is there now"
    ]


@pytest.mark.slow
@pytest.mark.parametrize("words", [["size"], ["exact", "--plot"]], ids=lambda words: words[0])
def test_a_folder_that_could_not_be_filled_is_not_left(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(path: Path) -> NoReturn:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))

    monkeypatch.setattr(files, "_version", full)
    (tmp_path / "old").mkdir()
    assert main([*words, "two_stations", "--out", str(tmp_path / "old" / "new" / "deep")]) == 1
    assert "No space left on device" in capsys.readouterr().err
    assert [*tmp_path.rglob("*")] == [tmp_path / "old"]
    monkeypatch.undo()
    assert main([*words, "two_stations", "--out", str(tmp_path / "old" / "new" / "deep")]) == 0
    assert any((tmp_path / "old" / "new" / "deep").iterdir())


def test_a_file_has_the_rights_of_any_other(tmp_path: Path) -> None:
    (tmp_path / "other").touch()
    with written_whole(tmp_path / "new") as part:
        part.write_text("x")
    assert (tmp_path / "new").stat().st_mode == (tmp_path / "other").stat().st_mode


def test_errors_of_writing_by_what_is_at_fault(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for path in (tmp_path / "file" / "x", tmp_path / "none" / "x", tmp_path / ("x" * 300)):
        with pytest.raises(UsageError, match="cannot be written"), written_whole(path) as part:
            part.write_text("x")

    def full() -> None:
        with written_whole(tmp_path / "y"):
            raise OSError(28, "No space left on device")

    with pytest.raises(RunError, match="y cannot be written: No space left on device"):
        full()
    assert {path.name for path in tmp_path.iterdir()} == {"file"}


def test_no_json_of_the_program_has_what_is_no_number_of_json() -> None:
    """Python writes NaN and Infinity unless it is told not to."""
    calls = [
        (path.name, node.lineno, ast.unparse(node))
        for path in sorted((ROOT / "bussim").rglob("*.py"))
        if "json.dump" in (text := path.read_text(encoding="utf-8"))
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Call) and ast.unparse(node.func) in ("json.dump", "json.dumps")
    ]
    assert len(calls) > 8
    assert [call for call in calls if "allow_nan=False" not in call[2]] == []


@pytest.mark.parametrize("place", ["bussim.results.store.folder.FileRows", "pathlib.Path.write_text"])
@pytest.mark.parametrize("error", [KeyboardInterrupt(), OSError(28, "No space left on device")], ids=repr)
def test_what_ends_a_run_as_its_folder_is_made_leaves_none(
    error: BaseException, place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def ends(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(place, ends)
    with pytest.raises((KeyboardInterrupt, RunError)):
        RunFolder(tmp_path / "run", rows=True, traced=True, fmt="csv")
    assert not any(tmp_path.iterdir())


@posix
def test_many_runs_take_folders_of_their_own(tmp_path: Path) -> None:
    all_taken = Barrier(8)

    def take(_: int) -> Path:
        with RunFolder(tmp_path / "run", rows=False, traced=False, fmt="csv", numbered=True) as folder:
            all_taken.wait()
            return folder.target

    with ThreadPoolExecutor(8) as pool:
        taken = list(pool.map(take, range(8)))
    assert len(set(taken)) == 8
    assert not any(tmp_path.iterdir())

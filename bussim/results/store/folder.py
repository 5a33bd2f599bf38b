"""The folder that a run leaves: written beside its target, marked incomplete, and moved there when whole."""

from __future__ import annotations

import contextlib
import json
import os
import sys
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from bussim.errors import RunError, UsageError
from bussim.files import INCOMPLETE, LOCK, empty_folder, followed, locked, not_written, reason, remove_folder
from bussim.results.run_record import RunRecord
from bussim.results.store.rows import FileRows
from bussim.results.store.tables import FORMATS, import_pyarrow
from bussim.trace.records import TraceHeader

if TYPE_CHECKING:
    from filelock import BaseFileLock

#: What is added to a folder's name while it is written.
SUFFIX = ".incomplete"

SUMMARY = "summary.json"
HISTOGRAMS = "histograms.json"
SCENARIO = "scenario.yaml"

_MARKER_TEXT = """\
This folder is incomplete: bussim is still writing it, or was stopped before it had finished.
Its numbers are not those of a whole run. It may be deleted.
"""
_REPLACED_TEXT = """\
This run was replaced by a new one of the same name, and bussim was stopped before it had
removed all of it. It may be deleted.
"""


class RunFolder:
    """The files of one run, in the making.

    ::

        with RunFolder(Path("runs/press"), rows=True, traced=False, fmt="csv", force=False) as folder:
            ...  # hand records to folder.rows
            folder.finish(record, scenario_yaml)

    Leaving the block without :meth:`finish` removes what was written, but where writing failed and it is
    ``live``: heard on a real line, which cannot be run again. A process that is killed
    leaves the folder ``<target>.incomplete`` with a file ``INCOMPLETE`` in it; the next run of the
    same name replaces it.

    With ``numbered`` a target that exists or is being written becomes ``<target>-2``, and so on;
    :attr:`target` is the one taken. Else raises UsageError if the target exists (with ``force``: if
    it is not a run's folder) or another process is writing it, in any case if the format is not
    available; where it cannot be written raises as :func:`bussim.files.not_written`. ``header`` is the
    first line of the trace.
    """

    def __init__(
        self,
        target: Path,
        *,
        rows: bool,
        traced: bool,
        fmt: str,
        force: bool = False,
        numbered: bool = False,
        header: TraceHeader | None = None,
        live: bool = False,
    ) -> None:
        if fmt not in FORMATS:
            raise UsageError(f"the format is {fmt!r}, allowed are {' and '.join(FORMATS)}")
        if fmt == "parquet":
            import_pyarrow()
        if target.is_symlink():
            target = followed(target)
        self._force = force
        self._live = live
        self._finished = False
        if not numbered:
            _check_target(target, force=force)
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            self.target, self._part, self._lock = _taken(target, numbered=numbered)
            try:
                self.rows = FileRows(self._part, rows=rows, traced=traced, fmt=fmt, header=header)
            except BaseException:
                remove_folder(self._part, [INCOMPLETE], self._lock)
                raise
        except OSError as error:
            raise not_written(target, error) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        kept = self._live and isinstance(error, OSError)
        if not self._finished:
            with contextlib.suppress(OSError):  # the error before it is the one to report
                self.rows.close()
            with contextlib.suppress(OSError):
                if kept:
                    self._lock.release()
                else:
                    remove_folder(self._part, [INCOMPLETE], self._lock)
        if isinstance(error, OSError):
            what = f"{self.target}: writing failed: {reason(error)}"
            where = f"; what was heard until then is in {self._part}, until another one of this name is begun"
            raise RunError(what + (where if kept and not self._finished else "")) from error

    def size(self) -> int:
        """Bytes that were written so far."""
        return sum(entry.stat().st_size for entry in os.scandir(self._part))

    def finish(self, record: RunRecord, scenario: str) -> Path:
        """Write summary, histograms and scenario, and move the folder to its target.

        ``scenario`` is the text of the scenario as run. Returns the target. Pictures are drawn into it
        afterwards (:func:`bussim.results.pictures.draw_run`): they take longer than many a run.
        """
        self.rows.close()
        _write_json(self._part / SUMMARY, record.summary, indent=2)
        _write_json(self._part / HISTOGRAMS, record.histograms(), indent=None)
        (self._part / SCENARIO).write_text(scenario, encoding="utf-8", newline="\n")
        self._move()
        self._finished = True
        return self.target

    def _move(self) -> None:
        _check_target(self.target, force=self._force)
        old = self.target.with_name(self.target.name + ".old" + SUFFIX)
        _remove_old(old)
        if self.target.exists():
            (self.target / INCOMPLETE).write_text(_REPLACED_TEXT, encoding="utf-8", newline="\n")
            try:
                self.target.replace(old)
            except OSError:  # on Windows: a file in it is open in another program
                (self.target / INCOMPLETE).unlink()
                raise
        if sys.platform == "win32":
            self._lock.release()  # an open file keeps its folder from being renamed there
        self._part.replace(self.target)
        (self.target / LOCK).unlink()
        self._lock.release()
        # The marker goes last: killed before, the folder is whole but still says incomplete.
        (self.target / INCOMPLETE).unlink()
        _remove_old(old)


def is_run(folder: Path) -> bool:
    """Whether a folder is a run's, be it whole or incomplete."""
    return (folder / INCOMPLETE).is_file() or (
        (folder / SUMMARY).is_file() and (folder / HISTOGRAMS).is_file()
    )


def numbered_names(wanted: Path) -> Iterator[Path]:
    """A folder's name, then the same with -2, -3 and so on."""
    yield wanted
    yield from (wanted.with_name(f"{wanted.name}-{number}") for number in count(2))


def _taken(target: Path, *, numbered: bool) -> tuple[Path, Path, BaseFileLock]:
    """The target, and the empty, marked folder beside it that this process has locked.

    Raises UsageError where it is in use or not bussim's; with ``numbered`` the next name is taken.
    """
    import filelock  # noqa: F401 - takes its time, in which an interrupt would leave a folder

    for candidate in numbered_names(target):
        part = candidate.with_name(candidate.name + SUFFIX)
        if numbered and (candidate.exists() or _is_foreign(part)):
            continue
        _check_not_foreign(part)
        part.mkdir(exist_ok=True)
        lock = locked(part)
        if lock is None:
            if numbered:
                continue
            raise UsageError(f"{part} is being written by another run; wait for it or choose another name")
        if numbered and candidate.exists():  # it became whole in between
            remove_folder(part, [INCOMPLETE], lock)
            continue
        try:
            empty_folder(part, [INCOMPLETE, LOCK])
            (part / INCOMPLETE).write_text(_MARKER_TEXT, encoding="utf-8", newline="\n")
        except BaseException:
            remove_folder(part, [INCOMPLETE], lock)
            raise
        return candidate, part, lock
    raise AssertionError


def _check_target(target: Path, *, force: bool) -> None:
    if target.name in ("", ".."):
        raise UsageError(
            f"{target} is not a folder that can be made; give it a name, such as runs/press_line"
        )
    if not target.exists():
        return
    if not target.is_dir():
        raise UsageError(f"{target} exists and is a file; choose another name")
    if not force:
        raise UsageError(f"{target} exists; choose another name, or replace it with --force (force=True)")
    if any(target.iterdir()) and not is_run(target):
        raise UsageError(
            f"{target} exists and is not the folder of a run (it has no {SUMMARY}), so that it is not "
            "replaced even by force; choose another name"
        )


def _is_foreign(part: Path) -> bool:
    """Whether a folder's name is taken by something that bussim did not leave."""
    if not part.is_dir():
        return part.exists()
    return not (part / INCOMPLETE).is_file() and any(entry.name != LOCK for entry in part.iterdir())


def _check_not_foreign(part: Path) -> None:
    if _is_foreign(part):
        raise UsageError(
            f"{part} is needed for writing, but exists and was not left by bussim (it has no file "
            f"{INCOMPLETE}); move it away or choose another name"
        )


def _remove_old(old: Path) -> None:
    if old.exists():
        _check_not_foreign(old)
        remove_folder(old, [INCOMPLETE])


def _write_json(path: Path, data: dict[str, Any], *, indent: int | None) -> None:
    separators = (",", ":") if indent is None else None
    text = json.dumps(data, ensure_ascii=False, allow_nan=False, indent=indent, separators=separators)
    path.write_text(text + "\n", encoding="utf-8", newline="\n")

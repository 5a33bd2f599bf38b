"""The folder that a run leaves: written beside its target, marked incomplete, and moved there when whole."""

from __future__ import annotations

import contextlib
import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

from bussim.errors import RunError, UsageError
from bussim.files import reason, remove_folder
from bussim.results.run_record import RunRecord
from bussim.results.store.rows import FileRows
from bussim.results.store.safe_names import file_names
from bussim.results.store.tables import FORMATS, import_pyarrow
from bussim.trace.records import TraceHeader

#: The file that marks a folder as incomplete.
MARKER = "INCOMPLETE"
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

    Leaving the block without :meth:`finish` removes what was written. A process that is killed
    leaves the folder ``<target>.incomplete`` with a file ``INCOMPLETE`` in it; the next run of the
    same name replaces it.

    With ``numbered`` a target that exists or is being written becomes ``<target>-2``, and so on;
    :attr:`target` is the one taken. Else raises UsageError if the target exists (with ``force``: if
    it is not a run's folder) or another process is writing it; in any case if it cannot be written,
    or if the format is not available. ``header`` is the first line of the trace.
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
    ) -> None:
        if fmt not in FORMATS:
            raise UsageError(f"the format is {fmt!r}, allowed are {' and '.join(FORMATS)}")
        if fmt == "parquet":
            import_pyarrow()
        if target.is_symlink():
            target = target.resolve()
        self._force = force
        self._finished = False
        if not numbered:
            _check_target(target, force=force)
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            with _one_at_a_time(target.parent):
                self.target = free_folder(target) if numbered else target
                self._part = self.target.with_name(self.target.name + SUFFIX)
                _clear(self._part)
                self._part.mkdir()
                self._lock = _write_marker(self._part, _MARKER_TEXT)
            self.rows = FileRows(self._part, rows=rows, traced=traced, fmt=fmt, header=header)
        except OSError as error:
            raise UsageError(f"{target}: cannot be written: {reason(error)}") from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if not self._finished:
            with contextlib.suppress(OSError):  # the error before it is the one to report
                self.rows.close()
            self._lock.close()
            with contextlib.suppress(OSError):
                remove_folder(self._part, [MARKER])
        if isinstance(error, OSError):
            raise RunError(f"{self.target}: writing failed: {reason(error)}") from error

    def finish(self, record: RunRecord, scenario: str) -> Path:
        """Write summary, histograms, scenario and pictures, and move the folder to its target.

        ``scenario`` is the text of the scenario as run. Returns the target.
        """
        from bussim.results.plots.latency import latency_picture, measured
        from bussim.results.plots.responses import masters, response_time_histogram
        from bussim.results.plots.scan_times import scan_time_histogram

        self.rows.close()
        _write_json(self._part / SUMMARY, record.summary, indent=2)
        _write_json(self._part / HISTOGRAMS, record.histograms(), indent=None)
        (self._part / SCENARIO).write_text(scenario, encoding="utf-8", newline="\n")
        for bus, stem in file_names(record.links).items():
            if record.links[bus].scan_times.histogram.count:
                scan_time_histogram([record], bus).save_both(self._part / f"scan_time_{stem}")
        for node, stem in file_names(masters(record)).items():
            response_time_histogram([record], node).save_both(self._part / f"response_time_{stem}")
        for name, stem in file_names(measured(record)).items():
            latency_picture([record], name).save_both(self._part / f"latency_{stem}")
        self._move()
        self._lock.close()
        self._finished = True
        return self.target

    def _move(self) -> None:
        _check_target(self.target, force=self._force)
        old = self.target.with_name(self.target.name + ".old" + SUFFIX)
        _clear(old)
        if self.target.exists():
            _write_marker(self.target, _REPLACED_TEXT).close()
            try:
                self.target.replace(old)
            except OSError:  # on Windows: a file in it is open in another program
                (self.target / MARKER).unlink()
                raise
        if sys.platform == "win32":
            self._lock.close()  # an open file keeps its folder from being renamed there
        self._part.replace(self.target)
        # The marker goes last: killed before, the folder is whole but still says incomplete.
        (self.target / MARKER).unlink()
        _clear(old)


def is_run(folder: Path) -> bool:
    """Whether a folder is a run's, be it whole or incomplete."""
    return (folder / MARKER).is_file() or ((folder / SUMMARY).is_file() and (folder / HISTOGRAMS).is_file())


def free_folder(wanted: Path) -> Path:
    """The wanted folder if it is neither there nor being written, else its name with -2, -3 and so on."""
    number, candidate = 1, wanted
    while True:
        part = candidate.with_name(candidate.name + SUFFIX)
        if not candidate.exists() and (not part.exists() or _is_stale(part)):
            return candidate
        number += 1
        candidate = wanted.with_name(f"{wanted.name}-{number}")


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


def _clear(part: Path) -> None:
    """Remove what a killed run left. Raises UsageError where it is something else, or in use."""
    if not part.exists():
        return
    if not (part / MARKER).is_file() and any(part.iterdir()):
        raise UsageError(
            f"{part} is needed for writing, but exists and was not left by bussim (it has no file "
            f"{MARKER}); move it away or choose another name"
        )
    if (part / MARKER).is_file() and not _is_stale(part):
        raise UsageError(f"{part} is being written by another run; wait for it or choose another name")
    remove_folder(part, [MARKER])


def _write_marker(folder: Path, text: str) -> IO[str]:
    """Mark a folder as incomplete; until the returned file is closed also as in use."""
    marker = (folder / MARKER).open("w", encoding="utf-8", newline="\n")
    _try_lock(marker)
    marker.write(text)
    marker.flush()
    return marker


def _is_stale(part: Path) -> bool:
    """Whether no process writes a marked folder any more."""
    try:
        with (part / MARKER).open("r+", encoding="utf-8") as marker:
            return _try_lock(marker)
    except OSError:
        return False


if sys.platform == "win32":

    def _try_lock(file: IO[str]) -> bool:
        """Lock a byte far behind the text, which other processes can go on reading."""
        import msvcrt

        file.seek(1 << 20)
        try:
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        finally:
            file.seek(0)
        return True

    @contextlib.contextmanager
    def _one_at_a_time(_: Path) -> Iterator[None]:
        """Folders cannot be locked there: of two runs that start at the same instant one may fail."""
        yield

else:

    def _try_lock(file: IO[str]) -> bool:
        """Lock a file until it is closed; False if another process has it."""
        import fcntl

        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        except OSError:
            return True  # a file system without locks: no process can hold one
        return True

    @contextlib.contextmanager
    def _one_at_a_time(folder: Path) -> Iterator[None]:
        """Let one process at a time find a free name in a folder and take it."""
        import fcntl

        handle = os.open(folder, os.O_RDONLY)
        try:
            with contextlib.suppress(OSError):  # a file system without locks
                fcntl.flock(handle, fcntl.LOCK_EX)
            yield
        finally:
            os.close(handle)


def _write_json(path: Path, data: dict[str, Any], *, indent: int | None) -> None:
    separators = (",", ":") if indent is None else None
    text = json.dumps(data, ensure_ascii=False, allow_nan=False, indent=indent, separators=separators)
    path.write_text(text + "\n", encoding="utf-8", newline="\n")

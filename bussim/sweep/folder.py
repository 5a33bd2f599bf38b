"""The folder of a sweep: made beside its target, gone on with after any interruption, moved when whole."""

import contextlib
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self

from bussim.errors import RunError, UsageError
from bussim.files import (
    LOCK,
    empty_folder,
    followed,
    locked,
    not_written,
    reason,
    remove_folder,
    written_whole,
)
from bussim.results.store.folder import SUFFIX, numbered_names
from bussim.sweep.identity import MANIFEST, differences, manifest_text, read_manifest
from bussim.sweep.journal import Journal

if TYPE_CHECKING:
    from filelock import BaseFileLock

#: The file that marks a folder as incomplete. Not that of a run, which a run may remove.
MARKER = "INCOMPLETE-SWEEP"
JOURNAL = "journal.jsonl"
_OLD = ".old" + SUFFIX
#: What identifies a folder is removed last.
_IDENTITY = (MARKER, MANIFEST)

_MARKER_TEXT = """\
This folder is incomplete: bussim sweep is still writing it, or was stopped before it had finished.
The same command goes on where it was stopped. The folder may also be deleted.
"""

#: What is there before a sweep begins: nothing, some of its runs, or all of it.
State = Literal["new", "begun", "whole"]


class SweepFolder:
    """Finds and fills the folder of a sweep.

    ::

        with SweepFolder(wanted, manifest, force=False, numbered=False) as folder:
            if folder.state != "whole":
                folder.begin()
                folder.journal.append(...)  # for every run that is not in folder.journal.done
                folder.finish(write_results)

    All work is done in ``<target>.incomplete``. A process that is killed at any instant leaves
    either that folder, with every finished run, or the whole one; :attr:`state` is for the next
    process what it finds. Nothing is written before :meth:`begin`.

    ``manifest`` is what the sweep is, see :mod:`bussim.sweep.identity`. With ``force`` another
    sweep's folder is replaced, and a whole one of this sweep made again. With ``numbered`` a target
    that is something else becomes ``<target>-2``, and so on.

    Raises UsageError if the target is something else (the message has what differs) or is being written
    by another process; where it cannot be written raises as :func:`bussim.files.not_written`.
    """

    def __init__(
        self, wanted: Path, manifest: Mapping[str, Any], *, force: bool = False, numbered: bool = False
    ) -> None:
        self._manifest = manifest
        self._force = force
        self._lock: BaseFileLock | None = None
        self._journal: Journal | None = None
        if wanted.name in ("", ".."):
            raise UsageError(f"{wanted} is not a folder that can be made; give it a name, as in sweeps/press")
        if wanted.is_symlink():
            wanted = followed(wanted)
        self.target = wanted
        try:
            self.state = self._numbered() if numbered else self._found(wanted)
        except OSError as error:
            raise not_written(wanted, error) from error

    @property
    def journal(self) -> Journal:
        """The finished runs. Only after :meth:`begin`."""
        if self._journal is None:
            raise AssertionError("the folder was not begun")
        return self._journal

    def __enter__(self) -> Self:
        return self

    def __exit__(self, _kind: object, error: BaseException | None, _traceback: object) -> None:
        if self._journal is not None:
            with contextlib.suppress(OSError):  # what went wrong before counts
                self._journal.close()
        if self._lock is not None:
            self._lock.release()
        if isinstance(error, OSError):
            raise RunError(f"{self.target}: writing failed: {reason(error)}") from error

    def begin(self) -> None:
        """Take the folder for this process, and make it if it is not there.

        Raises UsageError if another process was quicker, and as :func:`bussim.files.not_written`.
        """
        part = _part(self.target)
        try:
            self.target.parent.mkdir(parents=True, exist_ok=True)
            part.mkdir(exist_ok=True)
            self._lock = locked(part)
            if self._lock is None:
                raise _in_use(part)
            self.state = self._found(self.target)
            if self.state == "whole":
                remove_folder(part, _IDENTITY, self._lock)
                raise UsageError(f"{self.target} was finished by another process just now")
            (part / MARKER).write_text(_MARKER_TEXT, encoding="utf-8", newline="\n")
            if self.state == "new":
                empty_folder(part, [MARKER, LOCK])
                with written_whole(part / MANIFEST) as manifest:
                    manifest.write_text(manifest_text(self._manifest), encoding="utf-8", newline="\n")
            self._journal = Journal(part / JOURNAL)
        except OSError as error:
            if self._lock is not None and self.state == "new":  # nothing in it is worth to be kept
                with contextlib.suppress(OSError):
                    remove_folder(part, _IDENTITY, self._lock)
            raise not_written(self.target, error) from error

    def finish(self, write: Callable[[Path], None]) -> None:
        """Let ``write`` write the results into the folder, and move it to its target."""
        part, old = _part(self.target), self.target.with_name(self.target.name + _OLD)
        self.journal.close()
        empty_folder(part, [MANIFEST, JOURNAL, MARKER, LOCK])  # of an earlier process that was killed here
        write(part)
        if self.target.exists():
            if any(self.target.iterdir()) and read_manifest(self.target) is None:
                raise UsageError(f"{self.target} appeared meanwhile, and is not the folder of a sweep")
            if old.exists():
                remove_folder(old, _IDENTITY)
            self.target.replace(old)
        if sys.platform == "win32" and self._lock is not None:
            self._lock.release()  # an open file keeps its folder from being renamed there
        part.replace(self.target)
        self._tidy()
        self.state = "whole"

    def _tidy(self) -> None:
        """What is left to do when everything is at its target; the marker goes last."""
        old = self.target.with_name(self.target.name + _OLD)
        for name in (JOURNAL, LOCK):
            (self.target / name).unlink(missing_ok=True)
        if old.exists():
            remove_folder(old, _IDENTITY)
        (self.target / MARKER).unlink(missing_ok=True)

    def _numbered(self) -> State:
        for target in numbered_names(self.target):
            # What another sweep has taken is passed over; the same one in use is worth an error.
            if all(
                not folder.exists() or self._is_this(folder) or _is_empty_start(folder)
                for folder in (target, _part(target))
            ):
                self.target = target
                return self._found(target)
        raise AssertionError

    def _is_this(self, folder: Path) -> bool:
        known = read_manifest(folder)
        return known is not None and not differences(self._manifest, known)

    def _found(self, target: Path) -> State:
        part = _part(target)
        if target.exists():
            same = self._check(target, target)
            if (target / MARKER).exists() and same:
                # Killed when it was at its target but for the last steps.
                self._check_free(target)
                self._tidy()
                return "whole"
            if same and not self._force:
                return "whole"
        if part.exists():
            same = self._check(part, target)
            self._check_free(part)
            return "begun" if same else "new"
        return "new"

    def _check_free(self, folder: Path) -> None:
        """Raise UsageError if another process has the folder."""
        if self._lock is None:
            lock = locked(folder)
            if lock is None:
                raise _in_use(folder)
            lock.release()

    def _check(self, folder: Path, target: Path) -> bool:
        """Whether a folder is this sweep's. Raises UsageError if it is not and may not be replaced."""
        if not folder.is_dir():
            raise UsageError(f"{folder} exists and is a file; choose another name")
        known = read_manifest(folder)
        if known is None:
            if _is_empty_start(folder):
                return False
            raise UsageError(
                f"{folder} exists and is not the folder of a sweep (it has no {MANIFEST} that can be "
                "read), so that it is not replaced even by force; choose another name with --out"
            )
        different = differences(self._manifest, known)
        if different and not self._force:
            unfinished = "" if folder == target else f" (unfinished, in {folder})"
            raise UsageError(
                f"{target} is the folder of another sweep{unfinished}: {'; '.join(different)}; choose "
                "another name with --out, or replace it with --force"
            )
        return not different


def _part(target: Path) -> Path:
    return target.with_name(target.name + SUFFIX)


def _is_empty_start(folder: Path) -> bool:
    """Whether there is nothing in a folder but, perhaps, what a sweep that began makes first."""
    return folder.is_dir() and all(
        entry.name in (MARKER, LOCK) or entry.suffix == ".part" for entry in folder.iterdir()
    )


def _in_use(folder: Path) -> UsageError:
    return UsageError(
        f"{folder} is being written by another process; wait for it, or choose another name with --out"
    )

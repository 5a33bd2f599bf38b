"""Files and folders that are there whole or not at all, and errors of files in words."""

from __future__ import annotations

import errno
import logging
import os
import shutil
import stat
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING
from zlib import crc32

from bussim.errors import RunError, UsageError
from bussim.wording import visible

if TYPE_CHECKING:
    from filelock import BaseFileLock

#: The file in a folder that the process that writes it has locked.
LOCK = "LOCK"
#: The file that marks a run's folder as incomplete.
INCOMPLETE = "INCOMPLETE"

#: What a file may be that is no plain one.
_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device of the system"),
    (stat.S_ISBLK, "a device of the system"),
)

#: What is wrong with the path that the user named. All else, such as a full disk, is a failure of the place.
_BAD_PATHS = frozenset(
    {
        errno.EEXIST,
        errno.EINVAL,
        errno.EISDIR,
        errno.ELOOP,
        errno.ENAMETOOLONG,
        errno.ENOENT,
        errno.ENOTDIR,
        errno.ENOTEMPTY,
    }
)


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """A new file beside a path, which becomes it if all goes well and is removed if not.

    No other file has its name: of several writers of one path the last one's file stays, whole. Each that
    notices another one says so in a line of the log (level WARNING, which is standard error by default).
    Raises UsageError or RunError where it cannot be written, as :func:`not_written` says.
    """
    writers = f"bussim-{crc32(os.fsencode(path.name)):08x}-"
    part = path.with_name(f"{writers}{os.urandom(8).hex()}.part")
    try:
        part.open("x").close()
        try:
            before = _version(path)
            yield part
            own, found = _version(part), _version(path)
            part.replace(path)
            others = [other.name for other in path.parent.glob(f"{writers}*.part")]
            now = _version(path)
        finally:
            part.unlink(missing_ok=True)
    except OSError as error:
        raise not_written(path, error) from error
    if now != own:
        said = "was replaced at once: another command wrote it at the same time, and its file is there now"
    elif others:
        said = f"is whole; another command writes it, too, and will replace it, or was killed ({others[0]})"
    elif found != before:
        said = "is whole, and replaces what another command wrote there meanwhile"
    else:
        return
    logging.getLogger("bussim").warning("%s %s", visible(str(path)), said)


def _version(path: Path) -> tuple[int, ...] | None:
    """What distinguishes a file from another one that takes its name; None where there is none."""
    try:
        found = path.stat()
    except FileNotFoundError:
        return None
    return found.st_dev, found.st_ino, found.st_mtime_ns, found.st_size


def not_written(path: Path, error: OSError, what: str = "be written") -> UsageError | RunError:
    """What a command raises where a path cannot be written: by :func:`is_bad_path` the one or the other."""
    kind = UsageError if is_bad_path(error) else RunError
    where = error.filename
    aside = f" ({where})" if where and Path(where).parent != path.parent else ""
    return kind(f"{path} cannot {what}: {error.strerror or error}{aside}")


def is_bad_path(error: OSError) -> bool:
    """Whether the path itself is at fault (too long, a loop, not a folder), not the place that it names."""
    return error.errno in _BAD_PATHS


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """While it is open, UsageError with the reason is raised where the path cannot be read."""
    try:
        yield
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror or error}") from error


def followed(path: Path) -> Path:
    """The absolute path without symbolic links, there or not. Raises OSError for a loop of links."""
    found = os.path.realpath(path)
    if os.path.islink(found):  # noqa: PTH114 - that one raises where a folder may not be entered
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), str(path))
    return Path(found)


def plain(path: Path) -> Path:
    """The path of a plain file, which can be read without waiting. Raises OSError for anything else."""
    mode = path.stat().st_mode
    if not stat.S_ISREG(mode):
        raise OSError(errno.EINVAL, f"it is {kind_of(mode)}", str(path))
    return path


def last_byte(path: Path) -> bytes:
    """The last byte of a plain file, none of an empty one. Raises OSError where it cannot be read."""
    with plain(path).open("rb") as file:
        file.seek(-min(1, file.seek(0, os.SEEK_END)), os.SEEK_END)
        return file.read()


def kind_of(mode: int) -> str:
    """What something is that is no plain file, with its article."""
    return next((kind for test, kind in _KINDS if test(mode)), "no plain file")


def empty_folder(folder: Path, keep: Sequence[str]) -> None:
    """Remove everything in a folder but the files ``keep``."""
    for entry in folder.iterdir():
        if entry.name not in keep:
            shutil.rmtree(entry) if entry.is_dir() and not entry.is_symlink() else entry.unlink()


def remove_folder(folder: Path, last: Sequence[str], lock: BaseFileLock | None = None) -> None:
    """Remove a folder, the files ``last`` at the end, so that what is left of it can be identified.

    A ``lock`` of :func:`locked` is released.
    """
    empty_folder(folder, [*last, LOCK])
    if lock is not None and sys.platform == "win32":
        lock.release()  # an open file cannot be removed there
    for name in (*last, LOCK):
        (folder / name).unlink(missing_ok=True)
    folder.rmdir()
    if lock is not None:
        lock.release()


def locked(folder: Path) -> BaseFileLock | None:
    """Take a folder for this process until the lock is released; None if another process has or had it."""
    from filelock import FileLock, Timeout

    lock = FileLock(folder / LOCK, timeout=0)
    try:
        lock.acquire()
    except (FileNotFoundError, Timeout):
        return None
    if not (folder / LOCK).exists():  # the other process moved or removed the folder meanwhile
        lock.release()
        return None
    return lock


def reason(error: OSError) -> str:
    """Why something could not be written, and where."""
    where = f" ({error.filename})" if error.filename else ""
    return f"{error.strerror or error}{where}"

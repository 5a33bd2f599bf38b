"""Files and folders that are there whole or not at all."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from bussim.errors import UsageError


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """A path beside a file, which becomes it if all goes well and is removed if not.

    Raises UsageError where it cannot be written.
    """
    part = path.with_name(f"{path.name}.part")
    try:
        yield part
        part.replace(path)
    except OSError as error:
        raise UsageError(f"{path} cannot be written: {error.strerror or error}") from error
    finally:
        part.unlink(missing_ok=True)


def remove_folder(folder: Path, last: Sequence[str]) -> None:
    """Remove a folder, the files ``last`` at the end, so that what is left of it can be identified."""
    for entry in folder.iterdir():
        if entry.name not in last:
            shutil.rmtree(entry) if entry.is_dir() and not entry.is_symlink() else entry.unlink()
    for name in last:
        (folder / name).unlink(missing_ok=True)
    folder.rmdir()


def reason(error: OSError) -> str:
    """Why something could not be written, and where."""
    where = f" ({error.filename})" if error.filename else ""
    return f"{error.strerror or error}{where}"

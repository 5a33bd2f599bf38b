"""The finished runs of a sweep in the making, kept so that a process killed at any time loses none."""

import json
import os
import time
import zlib
from collections.abc import Iterator
from pathlib import Path

from bussim.sweep.figures import Number

#: Runs finished less than so many seconds ago may be lost with the machine's power; a process that
#: is killed loses none.
_SYNC_SECONDS = 1.0

Figures = dict[str, Number | None]


class Journal:
    """A file with one line a finished run, in the order in which they finished.

    A line is a checksum and JSON. What is not whole (the last line of a killed process) is cut off
    when the file is opened, and its run is taken for missing. ``done`` are the numbers of the runs
    that are there.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.done: set[int] = set()
        whole = 0
        if path.exists():
            with path.open("rb") as file:
                for line in file:
                    if not line.endswith(b"\n"):
                        break
                    whole += len(line)
                    entry = _read(line)
                    if entry is not None:
                        self.done.add(entry[0])
        self._file = path.open("ab")
        self._file.truncate(whole)
        self._synced = time.monotonic()

    def append(self, run: int, figures: Figures) -> None:
        """Keep the figures of a run. A run that is there already is not kept again."""
        if run in self.done:
            return
        self._file.write(_line(run, figures))
        self._file.flush()
        self.done.add(run)
        if time.monotonic() - self._synced > _SYNC_SECONDS:
            os.fsync(self._file.fileno())
            self._synced = time.monotonic()

    def entries(self) -> Iterator[tuple[int, Figures]]:
        """Every run that is there, once, with its figures."""
        seen: set[int] = set()
        with self._path.open("rb") as file:
            for line in file:
                entry = _read(line)
                if entry is not None and entry[0] not in seen:
                    seen.add(entry[0])
                    yield entry

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _line(run: int, figures: Figures) -> bytes:
    text = json.dumps([run, figures], ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    data = text.encode("utf-8")
    return b"%08x %s\n" % (zlib.crc32(data), data)


def _read(line: bytes) -> tuple[int, Figures] | None:
    """A line's run, None if the line is not as it was written."""
    check, _, data = line.rstrip(b"\n").partition(b" ")
    if check != b"%08x" % zlib.crc32(data):
        return None
    run, figures = json.loads(data)
    return run, figures

"""Raw bytes with timestamps: a text file, one chunk of bytes a line.

::

    # seconds  bytes in hexadecimal
    0.000000   01 03 00 00 00 0A C5 CD
    0.012500   0103140000

The first field is a time in seconds, never less than the one before; the rest of the line are
bytes, with or without spaces. The time is that of the chunk's last stop bit, which is what a program
that reads a port can know; with ``# time: start`` on a line of its own before the first chunk it is
that of the first edge. Empty lines and what follows a ``#`` are ignored. CSV works as well: commas
and semicolons count as spaces.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from decimal import Decimal, InvalidOperation
from typing import NamedTuple

from bussim.live.recordings.errors import RecordingError
from bussim.units import TICKS_PER_SECOND

_START = re.compile(r"#\s*time\s*:\s*start\b", re.IGNORECASE)
_SPACES = re.compile(r"[\s,;]+")
#: Characters of a line: 64 KiB of bytes, far more than comes at once.
LONGEST_LINE = 200_000
#: Seconds: a century.
_LATEST = Decimal(100 * 366 * 86400)


class Chunk(NamedTuple):
    """Bytes that came together. ``tick`` is their first edge (``from_start``) or their last stop bit."""

    tick: int
    data: bytes
    from_start: bool


def read_raw(lines: Iterable[str], name: str) -> Iterator[Chunk]:
    """The chunks of such a file, in order. Raises RecordingError with ``name`` and line."""
    from_start = False
    before = Decimal(0)
    for number, line in enumerate(lines, 1):
        if len(line) > LONGEST_LINE:
            raise RecordingError(f"{name}:{number}: the line is longer than {LONGEST_LINE:,} characters")
        if _START.match(line):
            from_start = True
        fields = _SPACES.split(line.partition("#")[0].strip(" \t\r\n,;"), maxsplit=1)
        if fields == [""]:
            continue
        seconds = _seconds(fields[0], f"{name}:{number}")
        if seconds < before:
            raise RecordingError(f"{name}:{number}: the time {fields[0]} is before the one above")
        before = seconds
        data = _bytes(fields[1] if len(fields) > 1 else "", f"{name}:{number}")
        if data:
            yield Chunk(int(seconds * TICKS_PER_SECOND), data, from_start)


def _seconds(text: str, where: str) -> Decimal:
    try:
        seconds = Decimal(text)
    except InvalidOperation:
        seconds = Decimal(-1)
    if not seconds.is_finite() or not 0 <= seconds <= _LATEST:
        raise RecordingError(
            f"{where}: {text[:40]!r} is no time in seconds; write lines such as 0.0125 01 03"
        )
    return seconds


def _bytes(text: str, where: str) -> bytes:
    try:
        return bytes.fromhex(_SPACES.sub("", text))
    except ValueError:
        raise RecordingError(f"{where}: {text[:40]!r} are no bytes in hexadecimal") from None

"""Exports a trace to a file: the one way in, for the command and for Python."""

from __future__ import annotations

from pathlib import Path

from bussim.errors import UsageError
from bussim.export.formats import FORMATS
from bussim.export.selection import Job, Selection, Written
from bussim.files import written_whole
from bussim.trace.file import Trace
from bussim.wording import suggest


def export_trace(
    trace: Trace,
    path: Path,
    to: str,
    *,
    bus: str | None = None,
    start: int | None = None,
    stop: int | None = None,
    encapsulation: str = "serial",
) -> Written:
    """Write a trace, or one bus and the window ``start <= tick < stop`` of it, in a format.

    ``to`` is one of :data:`bussim.export.formats.FORMATS`, ``encapsulation`` ("serial" or "udp") how pcapng
    wraps Modbus RTU. The file appears whole or not at all; an existing one is replaced. Raises UsageError
    where the request cannot be carried out: an unknown bus, nothing in the window, a file that cannot be
    written, a damaged trace.
    """
    if to not in FORMATS:
        raise UsageError(f"no format {to!r}; {suggest(to, list(FORMATS))}")
    header = trace.header
    seed = f", seed {header.seed}" if header.seed is not None else ""
    job = Job(Selection(trace, bus, start, stop), f"{header.scenario}{seed}", encapsulation)
    with written_whole(path) as part:
        return FORMATS[to].write(part, job)

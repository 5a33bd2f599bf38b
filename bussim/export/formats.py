"""The formats, each with its writer: one line here and one module make a new one."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple

from bussim.errors import UsageError
from bussim.export.lanes import write_lanes
from bussim.export.packets import write_pcapng
from bussim.export.perfetto import write_perfetto
from bussim.export.selection import Job, Selection, Written
from bussim.export.sigrok import write_sigrok
from bussim.export.tables import write_table
from bussim.export.vcd import write_vcd
from bussim.files import written_whole
from bussim.results.store.tables import CsvTable, ParquetTable
from bussim.trace.file import Trace
from bussim.words.values import suggest


class Format(NamedTuple):
    """A format: the ending of its files, what reads them, its writer, and the file's name by default.

    ``items`` is what the writer counts.
    """

    ending: str
    tool: str
    write: Callable[[Path, Job], Written]
    stem: str = "trace"
    items: str = "frames"


FORMATS: Final[dict[str, Format]] = {
    "pcapng": Format(".pcapng", "Wireshark", write_pcapng),
    "vcd": Format(".vcd", "PulseView", partial(write_lanes, write=write_vcd)),
    "sr": Format(".sr", "PulseView", partial(write_lanes, write=write_sigrok)),
    "perfetto": Format(".json", "ui.perfetto.dev", write_perfetto, "perfetto", "events"),
    "csv": Format(".csv", "one row a frame", partial(write_table, table_type=CsvTable), "frames"),
    "parquet": Format(".parquet", "one row a frame", partial(write_table, table_type=ParquetTable), "frames"),
}


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
    where the request cannot be carried out: an unknown bus, nothing in the window, a damaged trace;
    raises as :func:`bussim.files.written_whole` where the file cannot be written.
    """
    if to not in FORMATS:
        raise UsageError(f"no format {to!r}; {suggest(to, list(FORMATS))}")
    header = trace.header
    seed = f", seed {header.seed}" if header.seed is not None else ""
    job = Job(Selection(trace, bus, start, stop), f"{header.scenario}{seed}", encapsulation)
    with written_whole(path) as part:
        return FORMATS[to].write(part, job)

"""The formats, each with its writer: one line here and one module make a new one."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple

from bussim.export.lanes import write_lanes
from bussim.export.packets import write_pcapng
from bussim.export.perfetto import write_perfetto
from bussim.export.selection import Job, Written
from bussim.export.sigrok import write_sigrok
from bussim.export.tables import write_table
from bussim.export.vcd import write_vcd
from bussim.results.store.tables import CsvTable, ParquetTable


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

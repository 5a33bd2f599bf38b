"""Frames as a table, CSV or Parquet: one row a frame, by their first edges."""

from pathlib import Path

from bussim.export.received import Received, receive
from bussim.export.selection import Job, Written, in_order
from bussim.results.store import tables as column
from bussim.results.store.tables import Columns, CsvTable, ParquetTable
from bussim.units import format_time

#: ``bytes`` are the characters sent, ``heard`` those that :mod:`bussim.export.received` reads of them;
#: bits are counted from the frame's first start bit. ``damaged_at`` names the receivers in which alone bits
#: were inverted, ``damaged_at_bits`` says which, receiver by receiver.
COLUMNS: Columns[Received] = Columns(
    {
        "bus": (column.TEXT, lambda it: it.frame.bus),
        "start_s": (column.SECONDS, lambda it: it.frame.start),
        "end_s": (column.SECONDS, lambda it: it.frame.end),
        "sender": (column.TEXT, lambda it: it.frame.sender),
        "protocol": (column.TEXT, lambda it: it.frame.protocol),
        "kind": (column.TEXT, lambda it: it.frame.kind),
        "station": (column.OPTIONAL_INT, lambda it: it.frame.station),
        "counter": (column.OPTIONAL_INT, lambda it: it.frame.counter),
        "characters": (column.INT, lambda it: len(it.frame.chars)),
        "bytes": (column.BYTES, lambda it: it.frame.chars.hex(" ").upper()),
        "heard": (column.BYTES, lambda it: it.chars.hex(" ").upper()),
        "wrong_characters": (column.INT, lambda it: len(it.wrong)),
        "damaged_bits": (column.BYTES, lambda it: _numbers(it.frame.damaged_bits)),
        "damaged_at": (column.TEXT, lambda it: "; ".join(it.frame.damaged_at)),
        "damaged_at_bits": (column.BYTES, lambda it: "; ".join(map(_numbers, it.frame.damaged_at.values()))),
        "collided": (column.FLAG, lambda it: it.frame.collided),
        "cut": (column.FLAG, lambda it: it.frame.cut),
        "released_s": (column.SECONDS, lambda it: it.frame.released),
        "pauses": (
            column.BYTES,
            lambda it: "; ".join(f"{at}: {format_time(by)}" for at, by in it.frame.pauses),
        ),
        "baud": (column.INT, lambda it: it.frame.baud),
        "format": (column.TEXT, lambda it: it.frame.format),
    }
)


def _numbers(bits: tuple[int, ...]) -> str:
    return " ".join(map(str, bits))


def write_table(path: Path, job: Job, table_type: type[CsvTable | ParquetTable]) -> Written:
    """Write a row a frame into a table of that type."""
    survey = job.survey
    table = table_type(path, COLUMNS.kinds)
    try:
        for received in receive(in_order(job.selection.frames(), survey.lateness), survey):
            table.append(COLUMNS.row(received))
    finally:
        table.close()
    return Written(survey.frames, tuple(survey.buses))

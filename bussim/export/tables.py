"""Frames as a table, CSV or Parquet: one row a frame, by their first edges."""

from __future__ import annotations

from pathlib import Path

from bussim.export.received import Received, receive
from bussim.export.source import Job, Written, in_order
from bussim.results.store.tables import (
    BYTES,
    FLAG,
    INT,
    OPTIONAL_INT,
    SECONDS,
    TEXT,
    Columns,
    CsvTable,
    ParquetTable,
)

#: ``bytes`` are the characters sent, ``heard`` those that :mod:`bussim.export.received` reads of them;
#: bits are counted from the frame's first start bit. ``damaged_at`` names the receivers in which alone bits
#: were inverted, ``damaged_at_bits`` says which, receiver by receiver.
COLUMNS: Columns[Received] = Columns(
    {
        "bus": (TEXT, lambda it: it.frame.bus),
        "start_s": (SECONDS, lambda it: it.frame.start),
        "end_s": (SECONDS, lambda it: it.frame.end),
        "sender": (TEXT, lambda it: it.frame.sender),
        "protocol": (TEXT, lambda it: it.frame.protocol),
        "kind": (TEXT, lambda it: it.frame.kind),
        "station": (OPTIONAL_INT, lambda it: it.frame.station),
        "counter": (OPTIONAL_INT, lambda it: it.frame.counter),
        "characters": (INT, lambda it: len(it.frame.chars)),
        "bytes": (BYTES, lambda it: it.frame.chars.hex(" ").upper()),
        "heard": (BYTES, lambda it: it.chars.hex(" ").upper()),
        "wrong_characters": (INT, lambda it: len(it.wrong)),
        "damaged_bits": (BYTES, lambda it: _numbers(it.frame.damaged_bits)),
        "damaged_at": (TEXT, lambda it: "; ".join(it.frame.damaged_at)),
        "damaged_at_bits": (BYTES, lambda it: "; ".join(map(_numbers, it.frame.damaged_at.values()))),
        "collided": (FLAG, lambda it: it.frame.collided),
        "cut": (FLAG, lambda it: it.frame.cut),
        "baud": (INT, lambda it: it.frame.baud),
        "format": (TEXT, lambda it: it.frame.format),
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

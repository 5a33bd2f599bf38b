"""Frames as a table, CSV or Parquet: one row a frame, by their first edges."""

from __future__ import annotations

from pathlib import Path

from bussim.export.heard import Heard, hear
from bussim.export.source import Selection, Survey, in_order
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
    Table,
)

#: ``bytes`` are the characters sent, ``heard`` those that a receiver on the bus read
#: (:mod:`bussim.export.heard`); bits are counted from the frame's first start bit. ``damaged_at`` names the
#: receivers in which alone bits were inverted, ``damaged_at_bits`` says which, receiver by receiver.
COLUMNS: Columns[Heard] = Columns(
    {
        "bus": (TEXT, lambda heard: heard.frame.bus),
        "start_s": (SECONDS, lambda heard: heard.frame.start),
        "end_s": (SECONDS, lambda heard: heard.frame.end),
        "sender": (TEXT, lambda heard: heard.frame.sender),
        "protocol": (TEXT, lambda heard: heard.frame.protocol),
        "kind": (TEXT, lambda heard: heard.frame.kind),
        "station": (OPTIONAL_INT, lambda heard: heard.frame.station),
        "counter": (OPTIONAL_INT, lambda heard: heard.frame.counter),
        "characters": (INT, lambda heard: len(heard.frame.chars)),
        "bytes": (BYTES, lambda heard: heard.frame.chars.hex(" ").upper()),
        "heard": (BYTES, lambda heard: heard.chars.hex(" ").upper()),
        "wrong_characters": (INT, lambda heard: len(heard.wrong)),
        "damaged_bits": (BYTES, lambda heard: _numbers(heard.frame.damaged_bits)),
        "damaged_at": (TEXT, lambda heard: "; ".join(heard.frame.damaged_at)),
        "damaged_at_bits": (BYTES, lambda heard: "; ".join(map(_numbers, heard.frame.damaged_at.values()))),
        "collided": (FLAG, lambda heard: heard.frame.collided),
        "cut": (FLAG, lambda heard: heard.frame.cut),
        "baud": (INT, lambda heard: heard.frame.baud),
        "format": (TEXT, lambda heard: heard.frame.format),
    }
)


def _numbers(bits: tuple[int, ...]) -> str:
    return " ".join(map(str, bits))


def write_table(path: Path, selection: Selection, survey: Survey, fmt: str) -> None:
    """Write the frames."""
    table: Table = CsvTable(path, COLUMNS.kinds) if fmt == "csv" else ParquetTable(path, COLUMNS.kinds)
    try:
        for heard in hear(in_order(selection.frames(), survey.lateness), survey):
            table.append(COLUMNS.row(heard))
    finally:
        table.close()

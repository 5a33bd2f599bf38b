"""Frames as a table, CSV or Parquet: one row a frame, by their first edges."""

from __future__ import annotations

from pathlib import Path

from bussim.export.heard import Heard, hear
from bussim.export.source import Selection, Survey, in_order
from bussim.results.store.rows import nanoseconds
from bussim.results.store.tables import CsvTable, ParquetTable, Row, Table

#: Columns, and what they hold (as in :mod:`bussim.results.store.tables`). ``bytes`` are the characters sent,
#: ``heard`` those that a receiver on the bus read (:mod:`bussim.export.heard`); bits are counted from
#: the frame's first start bit. ``damaged_at`` names the receivers in which alone bits were inverted,
#: ``damaged_at_bits`` says which, receiver by receiver.
COLUMNS = {
    "bus": "text",
    "start_s": "s",
    "end_s": "s",
    "sender": "text",
    "protocol": "text",
    "kind": "text",
    "station": "int?",
    "counter": "int?",
    "characters": "int",
    "bytes": "bytes",
    "heard": "bytes",
    "wrong_characters": "int",
    "damaged_bits": "bytes",
    "damaged_at": "text",
    "damaged_at_bits": "bytes",
    "collided": "flag",
    "cut": "flag",
    "baud": "int",
    "format": "text",
}


def write_table(path: Path, selection: Selection, survey: Survey, fmt: str) -> None:
    """Write the frames."""
    table: Table = CsvTable(path, COLUMNS) if fmt == "csv" else ParquetTable(path, COLUMNS)
    try:
        for heard in hear(in_order(selection.frames(), survey.lateness), survey):
            table.append(_row(heard))
    finally:
        table.close()


def _row(heard: Heard) -> Row:
    frame = heard.frame
    return (
        frame.bus,
        nanoseconds(frame.start),
        nanoseconds(frame.end),
        frame.sender,
        frame.protocol,
        frame.kind,
        frame.station,
        frame.counter,
        len(frame.chars),
        frame.chars.hex(" ").upper(),
        heard.chars.hex(" ").upper(),
        len(heard.wrong),
        _numbers(frame.damaged_bits),
        "; ".join(frame.damaged_at),
        "; ".join(map(_numbers, frame.damaged_at.values())),
        frame.collided,
        frame.cut,
        frame.baud,
        frame.format,
    )


def _numbers(bits: tuple[int, ...]) -> str:
    return " ".join(map(str, bits))

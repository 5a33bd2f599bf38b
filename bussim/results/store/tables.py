"""Tables that are written row by row: columns, CSV and Parquet files.

Times are decimal fractions of whole nanoseconds, so that a row says the same in every format and
on every machine.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol, TextIO

from bussim.errors import UsageError
from bussim.results.store.names import cell

#: Formats of the tables, by the extension of their files.
FORMATS = ("csv", "parquet")

#: Columns of the tables, and what they hold: text, bytes, a whole number (with "?" perhaps none), yes
#: (1) or no (0), or a time in s or ms.
SCAN_COLUMNS = {
    "bus": "text",
    "index": "int",
    "start_s": "s",
    "duration_ms": "ms",
    "attempts": "int",
    "failed": "int",
    "stations_in_error": "int",
}
ATTEMPT_COLUMNS = {
    "bus": "text",
    "start_s": "s",
    "end_s": "s",
    "station": "int",
    "attempt": "int",
    "outcome": "text",
    "code": "text",
    "turnaround_ms": "ms",
}
TRANSACTION_COLUMNS = {
    "bus": "text",
    "master": "text",
    "poll": "text",
    "attempt": "int",
    "station": "int",
    "function": "int",
    "address": "int",
    "count": "int",
    "sent_s": "s",
    "asked_s": "s",
    "answered_s": "s",
    "end_s": "s",
    "taken_s": "s",
    "response_ms": "ms",
    "outcome": "text",
    "error": "int?",
    "exception": "int",
    "mismatched": "flag",
}
FREE_COLUMNS = {
    "bus": "text",
    "node": "text",
    "poll": "text",
    "direction": "text",
    "start_s": "s",
    "end_s": "s",
    "bytes": "bytes",
    "ended": "text",
    "damaged": "int",
}
VALUE_COLUMNS = {
    "time_s": "s",
    "plc": "text",
    "device": "text",
    "value": "int",
}
INPUT_COLUMNS = {
    "time_s": "s",
    "plc": "text",
    "device": "text",
    "level": "int",
    "sampled_s": "s",
    "seen": "flag",
}
#: Decimals of times: whole nanoseconds.
DECIMALS = {"s": 9, "ms": 6}
#: pandas' types of the columns.
PANDAS_TYPES = {
    "text": "str",
    "bytes": "str",
    "int": "int64",
    "int?": "Int64",
    "flag": "bool",
    "s": "float64",
    "ms": "float64",
}
_ROW_GROUP = 65_536

#: A value of a row; a time is a whole number of ns whatever its column's unit, bytes are written
#: ``02 41 0D``, which no spreadsheet takes for a number.
Value = str | int | None
Row = tuple[Value, ...]


class Table(Protocol):
    """A table that is being written."""

    def append(self, row: Row) -> None:
        """Write a row, a value for every column."""

    def close(self) -> None:
        """Finish the file."""


class CsvTable:
    """A CSV file after RFC 4180: a header, a comma, a decimal point, CR LF; spreadsheets open it."""

    def __init__(self, path: Path, columns: dict[str, str]) -> None:
        self._file: TextIO = path.open("w", encoding="utf-8", newline="")
        self._forms = [_TO_TEXT[kind] for kind in columns.values()]
        self._texts: dict[str, str] = {}
        self._file.write(",".join(columns) + "\r\n")

    def append(self, row: Row) -> None:
        """Write a row."""
        texts = []
        for value, form in zip(row, self._forms, strict=True):
            if value is None:
                texts.append("")
            elif form is None:
                texts.append(self._name(str(value)))
            else:
                texts.append(form(value))
        self._file.write(",".join(texts) + "\r\n")

    def close(self) -> None:
        """Finish the file."""
        self._file.close()

    def _name(self, text: str) -> str:
        # Names come again in every row; there are few of them.
        known = self._texts.get(text)
        if known is None:
            buffer = io.StringIO()
            csv.writer(buffer).writerow([cell(text)])
            known = self._texts[text] = buffer.getvalue().removesuffix("\r\n")
        return known


def _seconds_text(ns: int) -> str:
    whole, rest = divmod(ns, 1_000_000_000)
    return f"{whole}.{rest:09d}"


def _milliseconds_text(ns: int) -> str:
    whole, rest = divmod(ns, 1_000_000)
    return f"{whole}.{rest:06d}"


#: None: a name, which may need quotes.
_TO_TEXT: dict[str, Callable[[Any], str] | None] = {
    "text": None,
    "bytes": str,
    "int": str,
    "int?": str,
    "flag": lambda flag: "1" if flag else "0",
    "s": _seconds_text,
    "ms": _milliseconds_text,
}


class ParquetTable:
    """A Parquet file, written in row groups."""

    def __init__(self, path: Path, columns: dict[str, str]) -> None:
        pyarrow, parquet = import_pyarrow()
        whole, text = pyarrow.int64(), pyarrow.string()
        types = {"text": text, "bytes": text, "int": whole, "int?": whole, "flag": pyarrow.bool_()}
        self._table = pyarrow.table
        self._columns = columns
        self._schema = pyarrow.schema(
            [(name, types.get(kind, pyarrow.float64())) for name, kind in columns.items()]
        )
        self._writer = parquet.ParquetWriter(path, self._schema)
        self._rows: list[Row] = []

    def append(self, row: Row) -> None:
        """Write a row."""
        self._rows.append(row)
        if len(self._rows) == _ROW_GROUP:
            self._flush()

    def close(self) -> None:
        """Finish the file."""
        try:
            if self._rows:
                self._flush()
        finally:
            self._writer.close()

    def _flush(self) -> None:
        values = dict(zip(self._columns, zip(*self._rows, strict=True), strict=True))
        for name, kind in self._columns.items():
            if kind in DECIMALS:
                unit = 10 ** DECIMALS[kind]
                values[name] = tuple(None if ns is None else ns / unit for ns in values[name])
        self._writer.write_table(self._table(values, schema=self._schema))
        self._rows.clear()


def import_pyarrow() -> tuple[Any, Any]:
    """Pyarrow and its parquet module. Raises UsageError when it is not installed."""
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError as error:
        raise UsageError(
            "the format parquet needs pyarrow, which is not installed; install bussim with the extra "
            "parquet (pip install 'bussim[parquet]') or use the format csv"
        ) from error
    return pyarrow, parquet


def open_table(folder: Path, stem: str, columns: dict[str, str], fmt: str) -> Table:
    """Begin a table ``stem.csv`` or ``stem.parquet`` in a folder."""
    path = folder / f"{stem}.{fmt}"
    return CsvTable(path, columns) if fmt == "csv" else ParquetTable(path, columns)

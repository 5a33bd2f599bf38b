"""Tables that are written row by row: kinds of columns, CSV and Parquet files.

Times are decimal fractions of whole nanoseconds, so that a row says the same in every format and
on every machine.
"""

import csv
import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import repeat
from pathlib import Path
from typing import Any, Generic, NamedTuple, TextIO, TypeVar

from bussim.errors import UsageError
from bussim.results.store.safe_names import cell
from bussim.trace.blocks import in_turn
from bussim.units import nanoseconds

#: Formats of the tables, by the extension of their files.
FORMATS = ("csv", "parquet")


class Kind(NamedTuple):
    """What a column holds, and how.

    ``decimals`` are those of a time; its values in a row are whole nanoseconds. ``text`` writes a value
    into a CSV file; None: as a name, which may need quotes. ``packed`` is the type code of an array that
    holds the values in memory, empty where a value may be missing.
    """

    pandas: str
    arrow: str
    text: Callable[[Any], str] | None = str
    decimals: int = 0
    packed: str = ""
    may_miss: bool = False


def _seconds_text(ns: int) -> str:
    whole, rest = divmod(ns, 1_000_000_000)
    return f"{whole}.{rest:09d}"


def _milliseconds_text(ns: int) -> str:
    whole, rest = divmod(ns, 1_000_000)
    return f"{whole}.{rest:06d}"


TEXT = Kind("str", "string", None, packed="i", may_miss=True)
#: Bytes as ``02 41 0D``, which no spreadsheet takes for a number.
BYTES = Kind("str", "string", may_miss=True)
INT = Kind("int64", "int64", packed="i")
OPTIONAL_INT = Kind("Int64", "int64", may_miss=True)
FLAG = Kind("bool", "bool_", lambda flag: "1" if flag else "0")
SECONDS = Kind("float64", "float64", _seconds_text, decimals=9, packed="q", may_miss=True)
MILLISECONDS = Kind("float64", "float64", _milliseconds_text, decimals=6, packed="q", may_miss=True)

_ROW_GROUP = 65_536

Value = str | int | None
#: A time is a whole number of nanoseconds whatever its column's unit. Of many rows the values that differ
#: are arrays of numpy.
Row = tuple[Any, ...]

R = TypeVar("R")


class Columns(Generic[R]):
    """The columns of a table of records: of each its name, its kind and its value (a time in ticks)."""

    def __init__(self, columns: Mapping[str, tuple[Kind, Callable[[R], Value]]]) -> None:
        self.kinds = {name: kind for name, (kind, _) in columns.items()}
        self._values = [
            _in_nanoseconds(value) if kind.decimals else value for kind, value in columns.values()
        ]

    def row(self, record: R) -> Row:
        """The row of a record, or those of many: see :attr:`bussim.trace.blocks.Alike.record`."""
        return tuple([value(record) for value in self._values])


def _in_nanoseconds(value: Callable[[R], Value]) -> Callable[[R], Value]:
    def converted(record: R) -> Value:
        ticks: Any = value(record)
        return None if ticks is None else nanoseconds(ticks)

    return converted


class CsvTable:
    """A CSV file after RFC 4180: a header, a comma, a decimal point, CR LF; spreadsheets open it."""

    def __init__(self, path: Path, kinds: Mapping[str, Kind]) -> None:
        self._file: TextIO = path.open("w", encoding="utf-8", newline="")
        self._kinds = list(kinds.values())
        self._names: dict[str, str] = {}
        self._file.write(",".join(kinds) + "\r\n")

    def append(self, row: Row) -> None:
        """Write a row."""
        self._file.write(",".join(map(self._text, row, self._kinds)) + "\r\n")

    def append_many(self, rows: Sequence[Row]) -> None:
        """Write rows that take turns."""
        self._file.write("".join(in_turn(map(self._texts, rows))))

    def _texts(self, row: Row) -> Iterator[str]:
        formats: list[str] = []
        values: list[list[int]] = []
        for value, kind in zip(row, self._kinds, strict=True):
            if isinstance(value, Value):
                formats.append(self._text(value, kind).replace("%", "%%"))
            elif kind.decimals:
                formats.append(f"%d.%0{kind.decimals}d")
                values += (each.tolist() for each in divmod(value, 10**kind.decimals))
            else:
                formats.append("%d")
                values.append(value.tolist())
        template = ",".join(formats) + "\r\n"
        return map(template.__mod__, zip(*values, strict=True))

    def close(self) -> None:
        """Finish the file."""
        self._file.close()

    def _text(self, value: Value, kind: Kind) -> str:
        if value is None:
            return ""
        return self._name(str(value)) if kind.text is None else kind.text(value)

    def _name(self, text: str) -> str:
        # Names come again in every row; there are few of them.
        known = self._names.get(text)
        if known is None:
            buffer = io.StringIO()
            csv.writer(buffer).writerow([cell(text)])
            known = self._names[text] = buffer.getvalue().removesuffix("\r\n")
        return known


class ParquetTable:
    """A Parquet file, written in row groups."""

    def __init__(self, path: Path, kinds: Mapping[str, Kind]) -> None:
        pyarrow, parquet = import_pyarrow()
        self._table = pyarrow.table
        self._kinds = kinds
        self._schema = pyarrow.schema(
            [(name, getattr(pyarrow, kind.arrow)()) for name, kind in kinds.items()]
        )
        self._file = path.open("wb")  # pyarrow opens no path that is no text
        self._writer = parquet.ParquetWriter(self._file, self._schema)
        self._rows: list[Row] = []

    def append(self, row: Row) -> None:
        """Write a row."""
        self._rows.append(row)
        if len(self._rows) == _ROW_GROUP:
            self._flush()

    def append_many(self, rows: Sequence[Row]) -> None:
        """Write rows that take turns."""
        for row in rows_of(rows):
            self.append(row)

    def close(self) -> None:
        """Finish the file."""
        try:
            if self._rows:
                self._flush()
        finally:
            with self._file:
                self._writer.close()

    def _flush(self) -> None:
        values = dict(zip(self._kinds, zip(*self._rows, strict=True), strict=True))
        for name, kind in self._kinds.items():
            if kind.decimals:
                unit = 10**kind.decimals
                values[name] = tuple(None if ns is None else ns / unit for ns in values[name])
        self._writer.write_table(self._table(values, schema=self._schema))
        self._rows.clear()


def rows_of(rows: Sequence[Row]) -> Iterator[Row]:
    """Each of some rows that take turns."""
    return in_turn(
        zip(*(repeat(value) if isinstance(value, Value) else value.tolist() for value in row), strict=False)
        for row in rows
    )


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


#: A table that is being written.
Table = CsvTable | ParquetTable


def open_table(path: Path, kinds: Mapping[str, Kind]) -> Table:
    """Begin a table; its format is the path's ending, one of :data:`FORMATS`."""
    return CsvTable(path, kinds) if path.suffix == ".csv" else ParquetTable(path, kinds)

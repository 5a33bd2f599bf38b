"""Single records kept in memory, for a run without a folder."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from bussim.errors import UsageError
from bussim.results.store.rows import FORMS, SCANS
from bussim.results.store.tables import TEXT, Kind, Row, rows_of
from bussim.trace.blocks import RecordBlock, in_turn, pieces
from bussim.trace.codec import header_line, to_line
from bussim.trace.file import Trace, trace_of
from bussim.trace.records import Record, ScanRecord, TraceHeader

if TYPE_CHECKING:
    import pandas as pd


class MemoryRows:
    """Keeps records: of ``rows`` those of the tables, 36 bytes a link scan; of a traced run every one."""

    def __init__(self, *, rows: bool, traced: bool, header: TraceHeader | None = None) -> None:
        self._header = header or TraceHeader()
        self._scans = _PackedRows(SCANS.kinds)
        self._rows: dict[type[Record], list[Row]] | None = None
        if rows:
            self._rows = {kind: [] for kind, form in FORMS.items() if not form.traced}
        self._records: list[Record] | None = [] if traced else None

    def take(self, record: Record) -> None:
        """Keep a record."""
        if self._records is not None:
            self._records.append(record)
        if self._rows is None:
            return
        if isinstance(record, ScanRecord):
            self._scans.append(SCANS.row(record))
        elif (rows := self._rows.get(type(record))) is not None:
            rows.append(FORMS[type(record)].columns.row(record))

    def take_many(self, block: RecordBlock, breaks: Iterable[int] = ()) -> None:
        """Keep records that come many at once; see :meth:`bussim.trace.sink.Sink.take_many`."""
        if self._records is not None:
            for records in pieces(in_turn(each.records() for each in block), breaks):
                self._records += records
        if self._rows is not None:
            scans = [SCANS.row(each.record) for each in block if isinstance(each.pattern, ScanRecord)]
            for row in rows_of(scans):
                self._scans.append(row)

    def table(self, kind: type[Record]) -> pd.DataFrame:
        """The table of a type of record. Raises UsageError if the run did not keep it."""
        form = FORMS[kind]
        if form.traced:
            rows = [form.columns.row(record) for record in self.open_trace().of(kind)]
        elif self._rows is None:
            raise UsageError("this run kept no rows; run it with rows=True")
        elif kind is ScanRecord:
            return frame(self._scans.columns(), form.columns.kinds)
        else:
            rows = self._rows[kind]
        values = list(zip(*rows, strict=True)) or [()] * len(form.columns.kinds)
        return frame([list(column) for column in values], form.columns.kinds)

    def trace(self) -> list[dict[str, Any]]:
        """The lines that ``trace.jsonl`` would have. Raises UsageError if the run was not traced."""
        buses = {bus.name: bus for bus in self._header.buses}
        return [header_line(self._header), *(to_line(record, buses) for record in self.open_trace())]

    def open_trace(self) -> Trace:
        """The trace. Raises UsageError if the run was not traced."""
        if self._records is None:
            raise UsageError("this run was not traced; run it with trace=True")
        return trace_of(self._header, self._records)


class _PackedRows:
    """Rows column by column in arrays; a text is kept once."""

    def __init__(self, kinds: Mapping[str, Kind]) -> None:
        self._are_texts = [kind is TEXT for kind in kinds.values()]
        self._columns: list[Any] = [array(kind.packed) if kind.packed else [] for kind in kinds.values()]
        self._texts: dict[Any, int] = {}

    def append(self, row: Row) -> None:
        texts = self._texts
        for column, is_text, value in zip(self._columns, self._are_texts, row, strict=True):
            column.append(texts.setdefault(value, len(texts)) if is_text else value)

    def columns(self) -> list[Any]:
        import numpy as np

        texts = np.array(list(self._texts) or [""], dtype=object)
        return [
            texts[np.array(column, dtype=np.intp)] if is_text else np.array(column)
            for column, is_text in zip(self._columns, self._are_texts, strict=True)
        ]


def frame(values: Sequence[Any], kinds: Mapping[str, Kind]) -> pd.DataFrame:
    """A table of columns; times become fractions of their unit."""
    import pandas as pd

    data = {
        name: pd.Series(column, dtype=kind.pandas)
        for column, (name, kind) in zip(values, kinds.items(), strict=True)
    }
    for name, kind in kinds.items():
        if kind.decimals:
            data[name] /= 10**kind.decimals
    return pd.DataFrame(data)

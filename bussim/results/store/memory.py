"""Single records kept in memory, for a run without a folder."""

from __future__ import annotations

from array import array
from typing import TYPE_CHECKING, Any

from bussim.errors import UsageError
from bussim.results.store.rows import FORMS, scan_numbers
from bussim.results.store.tables import DECIMALS, PANDAS_TYPES, SCAN_COLUMNS, Row
from bussim.trace.codec import header_line, to_line
from bussim.trace.file import Trace, trace_of
from bussim.trace.records import (
    AttemptRecord,
    DeviceValueRecord,
    FreeRecord,
    InputRecord,
    Record,
    ScanRecord,
    TraceHeader,
    TransactionRecord,
)

if TYPE_CHECKING:
    import pandas as pd


class MemoryRows:
    """Keeps records: of ``rows`` those of the tables, 35 bytes a link scan; of a traced run every one."""

    def __init__(self, *, rows: bool, traced: bool, header: TraceHeader | None = None) -> None:
        self._header = header or TraceHeader()
        self._buses: list[str] = []
        self._scans = tuple(array(code) for code in "HqqqiiB")
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
            self._scan(record)
        elif (rows := self._rows.get(type(record))) is not None:
            rows.append(FORMS[type(record)].row(record))

    def _scan(self, record: ScanRecord) -> None:
        if record.bus not in self._buses:
            self._buses.append(record.bus)
        row = (self._buses.index(record.bus), *scan_numbers(record))
        for column, number in zip(self._scans, row, strict=True):
            column.append(number)

    def link_scans(self) -> pd.DataFrame:
        """The table of link scans. Raises UsageError if rows were not kept."""
        self._kept()
        import numpy as np

        buses = np.array(self._buses or [""], dtype=object)
        bus, *numbers = (np.array(column) for column in self._scans)
        return _frame([buses[bus.astype(np.intp)], *numbers], SCAN_COLUMNS)

    def transactions(self) -> pd.DataFrame:
        """The table of Modbus transactions. Raises UsageError if rows were not kept."""
        return _table(TransactionRecord, self._kept()[TransactionRecord])

    def free(self) -> pd.DataFrame:
        """The table of the free protocol. Raises UsageError if rows were not kept."""
        return _table(FreeRecord, self._kept()[FreeRecord])

    def values(self) -> pd.DataFrame:
        """The table of observed devices. Raises UsageError if rows were not kept."""
        return _table(DeviceValueRecord, self._kept()[DeviceValueRecord])

    def inputs(self) -> pd.DataFrame:
        """The table of driven inputs. Raises UsageError if rows were not kept."""
        return _table(InputRecord, self._kept()[InputRecord])

    def exchanges(self) -> pd.DataFrame:
        """The table of attempts. Raises UsageError if the run was not traced."""
        form = FORMS[AttemptRecord]
        return _table(AttemptRecord, [form.row(attempt) for attempt in self.open_trace().of(AttemptRecord)])

    def trace(self) -> list[dict[str, Any]]:
        """The lines that ``trace.jsonl`` would have. Raises UsageError if the run was not traced."""
        buses = {bus.name: bus for bus in self._header.buses}
        return [header_line(self._header), *(to_line(record, buses) for record in self.open_trace())]

    def open_trace(self) -> Trace:
        """The trace. Raises UsageError if the run was not traced."""
        if self._records is None:
            raise UsageError("this run was not traced; run it with trace=True")
        return trace_of(self._header, self._records)

    def _kept(self) -> dict[type[Record], list[Row]]:
        if self._rows is None:
            raise UsageError("this run kept no rows; run it with rows=True")
        return self._rows


def _table(kind: type[Record], rows: list[Row]) -> pd.DataFrame:
    columns = FORMS[kind].columns
    values = list(zip(*rows, strict=True)) or [()] * len(columns)
    return _frame([list(column) for column in values], columns)


def _frame(values: list[Any], columns: dict[str, str]) -> pd.DataFrame:
    import pandas as pd

    data = {
        name: pd.Series(column, dtype=PANDAS_TYPES[kind])
        for column, (name, kind) in zip(values, columns.items(), strict=True)
    }
    for name, kind in columns.items():
        if kind in DECIMALS:
            data[name] /= 10 ** DECIMALS[kind]
    return pd.DataFrame(data)

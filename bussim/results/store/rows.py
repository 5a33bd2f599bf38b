"""Single records as rows of tables and lines of a trace, written to files while a run goes on."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from bussim.results.meters.ports import response_time
from bussim.results.store.tables import (
    ATTEMPT_COLUMNS,
    FREE_COLUMNS,
    INPUT_COLUMNS,
    SCAN_COLUMNS,
    TRANSACTION_COLUMNS,
    VALUE_COLUMNS,
    Row,
    Table,
    open_table,
)
from bussim.trace.file import TRACE, TraceWriter
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


def nanoseconds(ticks: int) -> int:
    """Ticks as the nearest whole number of nanoseconds (a tick is 125/9 ns, so a half never occurs)."""
    return (ticks * 125 + 4) // 9


def scan_row(scan: ScanRecord) -> Row:
    """The row of a link scan, after :data:`SCAN_COLUMNS`."""
    return (scan.bus, *scan_numbers(scan))


def scan_numbers(scan: ScanRecord) -> tuple[int, ...]:
    """The row of a link scan without its bus."""
    return (
        scan.number,
        nanoseconds(scan.start),
        nanoseconds(scan.duration),
        scan.attempts,
        scan.failed,
        scan.stations_in_error,
    )


def attempt_row(attempt: AttemptRecord) -> Row:
    """The row of an attempt, after :data:`ATTEMPT_COLUMNS`; code 00 where nothing failed."""
    return (
        attempt.bus,
        nanoseconds(attempt.start),
        nanoseconds(attempt.end),
        attempt.station,
        attempt.number,
        attempt.outcome,
        f"{attempt.code:02X}",
        None if attempt.turnaround is None else nanoseconds(attempt.turnaround),
    )


def transaction_row(record: TransactionRecord) -> Row:
    """The row of a transaction, after :data:`TRANSACTION_COLUMNS`; no error where all went well."""
    return (
        record.bus,
        record.master,
        record.poll,
        record.attempt,
        record.station,
        record.function,
        record.address,
        record.quantity,
        _ns(record.sent),
        _ns(record.asked),
        _ns(record.answer_end),
        nanoseconds(record.end),
        nanoseconds(record.taken),
        _ns(response_time(record)),
        record.outcome,
        record.error,
        record.exception,
        record.mismatched,
    )


def free_row(record: FreeRecord) -> Row:
    """The row of a sending or reception, after :data:`FREE_COLUMNS`."""
    return (
        record.bus,
        record.node,
        record.poll,
        record.direction,
        _ns(record.start),
        nanoseconds(record.end),
        record.data.hex(" ").upper(),
        record.ended,
        record.damaged,
    )


def value_row(record: DeviceValueRecord) -> Row:
    """The row of a device's new value, after :data:`VALUE_COLUMNS`."""
    return (nanoseconds(record.tick), record.plc, record.device, record.value)


def input_row(record: InputRecord) -> Row:
    """The row of a change on an input's wire, after :data:`INPUT_COLUMNS`."""
    return (
        nanoseconds(record.tick),
        record.plc,
        record.device,
        record.level,
        nanoseconds(record.sampled),
        record.seen,
    )


def _ns(ticks: int | None) -> int | None:
    return None if ticks is None else nanoseconds(ticks)


class Form(NamedTuple):
    """The table of one type of record."""

    stem: str  # of the file
    columns: dict[str, str]
    row: Callable[[Any], Row]
    traced: bool = False  # only of a traced run
    always: bool = False  # there also without a row


#: The tables by type of record. The file of one that is not always there begins with its first row.
FORMS: dict[type[Record], Form] = {
    ScanRecord: Form("link_scans", SCAN_COLUMNS, scan_row, always=True),
    AttemptRecord: Form("exchanges", ATTEMPT_COLUMNS, attempt_row, traced=True, always=True),
    TransactionRecord: Form("modbus", TRANSACTION_COLUMNS, transaction_row),
    FreeRecord: Form("free", FREE_COLUMNS, free_row),
    DeviceValueRecord: Form("values", VALUE_COLUMNS, value_row),
    InputRecord: Form("inputs", INPUT_COLUMNS, input_row),
}


class FileRows:
    """Writes records to a folder: tables if ``rows``, exchanges and trace.jsonl if ``traced``.

    ``header`` is the first line of the trace.
    """

    def __init__(
        self, folder: Path, *, rows: bool, traced: bool, fmt: str, header: TraceHeader | None = None
    ) -> None:
        self._folder = folder
        self._fmt = fmt
        self._forms = {kind: form for kind, form in FORMS.items() if (traced if form.traced else rows)}
        self._tables: dict[type[Record], Table] = {}
        for kind, form in self._forms.items():
            if form.always:
                self._open(kind, form)
        self._trace: TraceWriter | None = None
        if traced:
            file = (folder / TRACE).open("w", encoding="utf-8", newline="\n")
            self._trace = TraceWriter(file, header or TraceHeader())

    def take(self, record: Record) -> None:
        """Write a record where it belongs."""
        if self._trace is not None:
            self._trace.write(record)
        kind = type(record)
        form = self._forms.get(kind)
        if form is not None:
            table = self._tables.get(kind) or self._open(kind, form)
            table.append(form.row(record))

    def close(self) -> None:
        """Finish all files."""
        for file in (*self._tables.values(), self._trace):
            if file is not None:
                file.close()

    def _open(self, kind: type[Record], form: Form) -> Table:
        return self._tables.setdefault(kind, open_table(self._folder, form.stem, form.columns, self._fmt))

"""Single records as rows of tables and lines of a trace, written to files while a run goes on."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

from bussim.results.meters.ports import response_time
from bussim.results.store import tables as column
from bussim.results.store.tables import Columns, Table, open_table
from bussim.trace import records
from bussim.trace.blocks import RecordBlock
from bussim.trace.file import TRACE, TraceWriter
from bussim.trace.records import Record, ScanRecord, TraceHeader

# The columns of each table. One that is added must be of a kind whose value may be missing: it is in the
# tables of earlier versions.

SCANS: Columns[ScanRecord] = Columns(
    {
        "bus": (column.TEXT, lambda scan: scan.bus),
        "index": (column.INT, lambda scan: scan.number),
        "start_s": (column.SECONDS, lambda scan: scan.start),
        "duration_ms": (column.MILLISECONDS, lambda scan: scan.duration),
        "attempts": (column.INT, lambda scan: scan.attempts),
        "failed": (column.INT, lambda scan: scan.failed),
        "stations_in_error": (column.INT, lambda scan: scan.stations_in_error),
    }
)
ATTEMPTS: Columns[records.AttemptRecord] = Columns(
    {
        "bus": (column.TEXT, lambda attempt: attempt.bus),
        "start_s": (column.SECONDS, lambda attempt: attempt.start),
        "end_s": (column.SECONDS, lambda attempt: attempt.end),
        "station": (column.INT, lambda attempt: attempt.station),
        "attempt": (column.INT, lambda attempt: attempt.number),
        "outcome": (column.TEXT, lambda attempt: attempt.outcome),
        "code": (column.TEXT, lambda attempt: f"{attempt.code:02X}"),
        "turnaround_ms": (column.MILLISECONDS, lambda attempt: attempt.turnaround),
    }
)
TRANSACTIONS: Columns[records.TransactionRecord] = Columns(
    {
        "bus": (column.TEXT, lambda record: record.bus),
        "master": (column.TEXT, lambda record: record.master),
        "poll": (column.TEXT, lambda record: record.poll),
        "attempt": (column.INT, lambda record: record.attempt),
        "station": (column.INT, lambda record: record.station),
        "function": (column.INT, lambda record: record.function),
        "address": (column.INT, lambda record: record.address),
        "count": (column.INT, lambda record: record.quantity),
        "sent_s": (column.SECONDS, lambda record: record.sent),  # first edge of the request
        "asked_s": (column.SECONDS, lambda record: record.asked),  # its last stop bit
        "answered_s": (column.SECONDS, lambda record: record.answer_end),  # last stop bit of what decided it
        "end_s": (column.SECONDS, lambda record: record.end),  # decision
        "taken_s": (column.SECONDS, lambda record: record.taken),  # take-over at END
        "response_ms": (column.MILLISECONDS, response_time),
        "outcome": (column.TEXT, lambda record: record.outcome),
        "error": (column.OPTIONAL_INT, lambda record: record.error),  # yy of D8063 = 7xyy
        "exception": (column.INT, lambda record: record.exception),
        "mismatched": (column.FLAG, lambda record: record.mismatched),
    }
)
FREE: Columns[records.FreeRecord] = Columns(
    {
        "bus": (column.TEXT, lambda record: record.bus),
        "node": (column.TEXT, lambda record: record.node),
        "poll": (column.TEXT, lambda record: record.poll),
        "direction": (column.TEXT, lambda record: record.direction),
        "start_s": (column.SECONDS, lambda record: record.start),
        "end_s": (column.SECONDS, lambda record: record.end),
        "bytes": (column.BYTES, lambda record: record.data.hex(" ").upper()),
        "ended": (column.TEXT, lambda record: record.ended),
        "damaged": (column.INT, lambda record: record.damaged),  # characters
    }
)
VALUES: Columns[records.DeviceValueRecord] = Columns(
    {
        "time_s": (column.SECONDS, lambda record: record.tick),
        "plc": (column.TEXT, lambda record: record.plc),
        "device": (column.TEXT, lambda record: record.device),
        "value": (column.INT, lambda record: record.value),
    }
)
INPUTS: Columns[records.InputRecord] = Columns(
    {
        "time_s": (column.SECONDS, lambda record: record.tick),  # when the wire changed
        "plc": (column.TEXT, lambda record: record.plc),
        "device": (column.TEXT, lambda record: record.device),
        "level": (column.INT, lambda record: record.level),  # from then on
        # The beginning of the scan that sampled it next, and whether it still had the level then.
        "sampled_s": (column.SECONDS, lambda record: record.sampled),
        "seen": (column.FLAG, lambda record: record.seen),
    }
)


class Form(NamedTuple):
    """The table of one type of record."""

    stem: str  # of the file
    columns: Columns[Any]
    traced: bool = False  # only of a traced run
    always: bool = False  # there also without a row


#: The tables by type of record. The file of one that is not always there begins with its first row.
FORMS: dict[type[Record], Form] = {
    ScanRecord: Form("link_scans", SCANS, always=True),
    records.AttemptRecord: Form("exchanges", ATTEMPTS, traced=True, always=True),
    records.TransactionRecord: Form("modbus", TRANSACTIONS),
    records.FreeRecord: Form("free", FREE),
    records.DeviceValueRecord: Form("values", VALUES),
    records.InputRecord: Form("inputs", INPUTS),
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
            table.append(form.columns.row(record))

    def take_many(self, block: RecordBlock, breaks: Iterable[int] = ()) -> None:
        """Write many records where they belong; see :meth:`bussim.trace.sink.Sink.take_many`."""
        if self._trace is not None:
            self._trace.write_many(block, breaks)
        for kind in {type(each.pattern) for each in block} & self._forms.keys():
            form = self._forms[kind]
            table = self._tables.get(kind) or self._open(kind, form)
            table.append_many([form.columns.row(each.record) for each in block if type(each.pattern) is kind])

    def close(self) -> None:
        """Finish all files."""
        for file in (*self._tables.values(), self._trace):
            if file is not None:
                file.close()

    def _open(self, kind: type[Record], form: Form) -> Table:
        path = self._folder / f"{form.stem}.{self._fmt}"
        return self._tables.setdefault(kind, open_table(path, form.columns.kinds))

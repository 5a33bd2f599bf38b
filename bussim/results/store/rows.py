"""Single records as rows of tables and lines of a trace, written to files while a run goes on."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

from bussim.results.meters.ports import response_time
from bussim.results.store.tables import (
    BYTES,
    FLAG,
    INT,
    MILLISECONDS,
    OPTIONAL_INT,
    SECONDS,
    TEXT,
    Columns,
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

# The columns of each table. One that is added must be of a kind whose value may be missing: it is in the
# tables of earlier versions.

SCANS: Columns[ScanRecord] = Columns(
    {
        "bus": (TEXT, lambda scan: scan.bus),
        "index": (INT, lambda scan: scan.number),
        "start_s": (SECONDS, lambda scan: scan.start),
        "duration_ms": (MILLISECONDS, lambda scan: scan.duration),
        "attempts": (INT, lambda scan: scan.attempts),
        "failed": (INT, lambda scan: scan.failed),
        "stations_in_error": (INT, lambda scan: scan.stations_in_error),
    }
)
ATTEMPTS: Columns[AttemptRecord] = Columns(
    {
        "bus": (TEXT, lambda attempt: attempt.bus),
        "start_s": (SECONDS, lambda attempt: attempt.start),
        "end_s": (SECONDS, lambda attempt: attempt.end),
        "station": (INT, lambda attempt: attempt.station),
        "attempt": (INT, lambda attempt: attempt.number),
        "outcome": (TEXT, lambda attempt: attempt.outcome),
        "code": (TEXT, lambda attempt: f"{attempt.code:02X}"),
        "turnaround_ms": (MILLISECONDS, lambda attempt: attempt.turnaround),
    }
)
TRANSACTIONS: Columns[TransactionRecord] = Columns(
    {
        "bus": (TEXT, lambda record: record.bus),
        "master": (TEXT, lambda record: record.master),
        "poll": (TEXT, lambda record: record.poll),
        "attempt": (INT, lambda record: record.attempt),
        "station": (INT, lambda record: record.station),
        "function": (INT, lambda record: record.function),
        "address": (INT, lambda record: record.address),
        "count": (INT, lambda record: record.quantity),
        "sent_s": (SECONDS, lambda record: record.sent),  # first edge of the request
        "asked_s": (SECONDS, lambda record: record.asked),  # its last stop bit
        "answered_s": (SECONDS, lambda record: record.answer_end),  # last stop bit of what decided it
        "end_s": (SECONDS, lambda record: record.end),  # decision
        "taken_s": (SECONDS, lambda record: record.taken),  # take-over at END
        "response_ms": (MILLISECONDS, response_time),
        "outcome": (TEXT, lambda record: record.outcome),
        "error": (OPTIONAL_INT, lambda record: record.error),  # yy of D8063 = 7xyy
        "exception": (INT, lambda record: record.exception),
        "mismatched": (FLAG, lambda record: record.mismatched),
    }
)
FREE: Columns[FreeRecord] = Columns(
    {
        "bus": (TEXT, lambda record: record.bus),
        "node": (TEXT, lambda record: record.node),
        "poll": (TEXT, lambda record: record.poll),
        "direction": (TEXT, lambda record: record.direction),
        "start_s": (SECONDS, lambda record: record.start),
        "end_s": (SECONDS, lambda record: record.end),
        "bytes": (BYTES, lambda record: record.data.hex(" ").upper()),
        "ended": (TEXT, lambda record: record.ended),
        "damaged": (INT, lambda record: record.damaged),  # characters
    }
)
VALUES: Columns[DeviceValueRecord] = Columns(
    {
        "time_s": (SECONDS, lambda record: record.tick),
        "plc": (TEXT, lambda record: record.plc),
        "device": (TEXT, lambda record: record.device),
        "value": (INT, lambda record: record.value),
    }
)
INPUTS: Columns[InputRecord] = Columns(
    {
        "time_s": (SECONDS, lambda record: record.tick),  # when the wire changed
        "plc": (TEXT, lambda record: record.plc),
        "device": (TEXT, lambda record: record.device),
        "level": (INT, lambda record: record.level),  # from then on
        "sampled_s": (SECONDS, lambda record: record.sampled),  # beginning of the scan that sampled it next
        "seen": (FLAG, lambda record: record.seen),  # whether it still had the level then
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
    AttemptRecord: Form("exchanges", ATTEMPTS, traced=True, always=True),
    TransactionRecord: Form("modbus", TRANSACTIONS),
    FreeRecord: Form("free", FREE),
    DeviceValueRecord: Form("values", VALUES),
    InputRecord: Form("inputs", INPUTS),
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

    def close(self) -> None:
        """Finish all files."""
        for file in (*self._tables.values(), self._trace):
            if file is not None:
                file.close()

    def _open(self, kind: type[Record], form: Form) -> Table:
        path = self._folder / f"{form.stem}.{self._fmt}"
        return self._tables.setdefault(kind, open_table(path, form.columns.kinds))

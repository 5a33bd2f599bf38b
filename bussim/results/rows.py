"""Single records as rows of tables and lines of a trace, kept in files or in memory."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bussim.errors import UsageError
from bussim.results.tables import (
    ATTEMPT_COLUMNS,
    DECIMALS,
    PANDAS_TYPES,
    SCAN_COLUMNS,
    Row,
    Table,
    open_table,
)
from bussim.results.trace_file import TRACE, Record, Trace, TraceWriter, trace_of
from bussim.results.trace_lines import header_line, to_line
from bussim.trace import (
    AttemptRecord,
    CycleRecord,
    DeviceValueRecord,
    EndsRecord,
    FrameRecord,
    FreeRecord,
    NoteRecord,
    PollRecord,
    ScanRecord,
    TraceHeader,
    TransactionRecord,
)

if TYPE_CHECKING:
    import pandas as pd


def nanoseconds(ticks: int) -> int:
    """Ticks as the nearest whole number of nanoseconds (a tick is 125/9 ns, so a half never occurs)."""
    return (ticks * 125 + 4) // 9


def scan_numbers(scan: ScanRecord) -> tuple[int, ...]:
    """The row of a link scan, after :data:`SCAN_COLUMNS`, without the bus."""
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


class FileRows:
    """Writes rows to a folder: link_scans if ``scans``, exchanges and trace.jsonl if ``traced``.

    ``header`` is the first line of the trace.
    """

    def __init__(
        self, folder: Path, *, scans: bool, traced: bool, fmt: str, header: TraceHeader | None = None
    ) -> None:
        self._scans = open_table(folder, "link_scans", SCAN_COLUMNS, fmt) if scans else None
        self._attempts: Table | None = None
        self._trace: TraceWriter | None = None
        if traced:
            self._attempts = open_table(folder, "exchanges", ATTEMPT_COLUMNS, fmt)
            file = (folder / TRACE).open("w", encoding="utf-8", newline="\n")
            self._trace = TraceWriter(file, header or TraceHeader())

    def scan(self, record: ScanRecord) -> None:
        """Write a link scan."""
        if self._scans is not None:
            self._scans.append((record.bus, *scan_numbers(record)))
        self._traced(record)

    def attempt(self, record: AttemptRecord) -> None:
        """Write an attempt."""
        if self._attempts is not None:
            self._attempts.append(attempt_row(record))
        self._traced(record)

    def frame(self, record: FrameRecord) -> None:
        """Write a frame."""
        self._traced(record)

    def note(self, record: NoteRecord) -> None:
        """Write a note."""
        self._traced(record)

    def transaction(self, record: TransactionRecord) -> None:
        """Write a transaction."""
        self._traced(record)

    def poll_turn(self, record: PollRecord) -> None:
        """Write a turn of a poll."""
        self._traced(record)

    def cycle(self, record: CycleRecord) -> None:
        """Write a cycle of a poll list."""
        self._traced(record)

    def free(self, record: FreeRecord) -> None:
        """Write bytes of the free protocol."""
        self._traced(record)

    def value(self, record: DeviceValueRecord) -> None:
        """Write a device's new value."""
        self._traced(record)

    def ends(self, plc: str, ticks: Sequence[int]) -> None:
        """Write ENDs."""
        self._traced(EndsRecord(plc, tuple(ticks)))

    def close(self) -> None:
        """Finish all files."""
        for file in (self._scans, self._attempts, self._trace):
            if file is not None:
                file.close()

    def _traced(self, record: Record) -> None:
        if self._trace is not None:
            self._trace.write(record)


class MemoryRows:
    """Keeps rows in memory: 35 bytes a link scan; of a traced run also every record."""

    def __init__(self, *, scans: bool, traced: bool, header: TraceHeader | None = None) -> None:
        self._scans = scans
        self._header = header or TraceHeader()
        self._buses: list[str] = []
        self._bus = array("H")
        self._ints = tuple(array(code) for code in "qqqiiB")
        self._records: list[Record] | None = [] if traced else None

    def scan(self, record: ScanRecord) -> None:
        """Keep a link scan."""
        self._traced(record)
        if not self._scans:
            return
        if record.bus not in self._buses:
            self._buses.append(record.bus)
        self._bus.append(self._buses.index(record.bus))
        for column, number in zip(self._ints, scan_numbers(record), strict=True):
            column.append(number)

    def attempt(self, record: AttemptRecord) -> None:
        """Keep an attempt."""
        self._traced(record)

    def frame(self, record: FrameRecord) -> None:
        """Keep a frame."""
        self._traced(record)

    def note(self, record: NoteRecord) -> None:
        """Keep a note."""
        self._traced(record)

    def transaction(self, record: TransactionRecord) -> None:
        """Keep a transaction."""
        self._traced(record)

    def poll_turn(self, record: PollRecord) -> None:
        """Keep a turn of a poll."""
        self._traced(record)

    def cycle(self, record: CycleRecord) -> None:
        """Keep a cycle of a poll list."""
        self._traced(record)

    def free(self, record: FreeRecord) -> None:
        """Keep bytes of the free protocol."""
        self._traced(record)

    def value(self, record: DeviceValueRecord) -> None:
        """Keep a device's new value."""
        self._traced(record)

    def ends(self, plc: str, ticks: Sequence[int]) -> None:
        """Keep ENDs."""
        if self._records is not None:
            self._records.append(EndsRecord(plc, tuple(ticks)))

    def link_scans(self) -> pd.DataFrame:
        """The table of link scans. Raises UsageError if they were not kept."""
        if not self._scans:
            raise UsageError("this run kept no rows; run it with rows=True")
        import numpy as np

        buses = np.array(self._buses or [""], dtype=object)
        bus = buses[np.array(self._bus, dtype=np.intp)]
        return _frame([bus, *(np.array(column) for column in self._ints)], SCAN_COLUMNS)

    def exchanges(self) -> pd.DataFrame:
        """The table of attempts. Raises UsageError if the run was not traced."""
        rows = [attempt_row(attempt) for attempt in self.open_trace().of(AttemptRecord)]
        columns = list(zip(*rows, strict=True)) or [()] * len(ATTEMPT_COLUMNS)
        return _frame([list(column) for column in columns], ATTEMPT_COLUMNS)

    def trace(self) -> list[dict[str, Any]]:
        """The lines that ``trace.jsonl`` would have. Raises UsageError if the run was not traced."""
        buses = {bus.name: bus for bus in self._header.buses}
        return [header_line(self._header), *(to_line(record, buses) for record in self.open_trace())]

    def open_trace(self) -> Trace:
        """The trace. Raises UsageError if the run was not traced."""
        if self._records is None:
            raise UsageError("this run was not traced; run it with trace=True")
        return trace_of(self._header, self._records)

    def _traced(self, record: Record) -> None:
        if self._records is not None:
            self._records.append(record)


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

"""Single records as rows of tables and lines of a trace, kept in files or in memory."""

from __future__ import annotations

import json
from array import array
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from bussim.errors import UsageError
from bussim.results.record import note_to_json
from bussim.results.tables import (
    ATTEMPT_COLUMNS,
    DECIMALS,
    PANDAS_TYPES,
    SCAN_COLUMNS,
    Row,
    Table,
    open_table,
)
from bussim.trace import AttemptRecord, FrameRecord, NoteRecord, ScanRecord

if TYPE_CHECKING:
    import pandas as pd

#: The file of every frame and event of a traced run, one JSON object a line.
TRACE = "trace.jsonl"


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


def frame_line(frame: FrameRecord) -> dict[str, Any]:
    """A frame as a line of ``trace.jsonl``: ticks of 1/72 MHz, characters in hexadecimal."""
    return {
        "type": "frame",
        "tick": frame.start,
        "end": frame.end,
        "bus": frame.bus,
        "sender": frame.sender,
        "kind": frame.kind,
        "station": frame.station,
        "counter": frame.counter,
        "chars": frame.chars.hex(),
        "damaged_bits": list(frame.damaged_bits),
        "damaged_at": {name: list(bits) for name, bits in frame.damaged_at.items()},
        "collided": frame.collided,
        "cut": frame.cut,
    }


def note_line(note: NoteRecord) -> dict[str, Any]:
    """A note as a line of ``trace.jsonl``."""
    return {"type": "note", **note_to_json(note)}


class FileRows:
    """Writes rows to a folder: link_scans if ``scans``, exchanges and trace.jsonl if ``traced``."""

    def __init__(self, folder: Path, *, scans: bool, traced: bool, fmt: str) -> None:
        self._scans = open_table(folder, "link_scans", SCAN_COLUMNS, fmt) if scans else None
        self._attempts: Table | None = None
        self._trace: TextIO | None = None
        if traced:
            self._attempts = open_table(folder, "exchanges", ATTEMPT_COLUMNS, fmt)
            self._trace = (folder / TRACE).open("w", encoding="utf-8", newline="\n")

    def scan(self, record: ScanRecord) -> None:
        """Write a link scan."""
        if self._scans is not None:
            self._scans.append((record.bus, *scan_numbers(record)))

    def attempt(self, record: AttemptRecord) -> None:
        """Write an attempt."""
        if self._attempts is not None:
            self._attempts.append(attempt_row(record))

    def frame(self, record: FrameRecord) -> None:
        """Write a frame."""
        self._line(frame_line(record))

    def note(self, record: NoteRecord) -> None:
        """Write a note."""
        self._line(note_line(record))

    def close(self) -> None:
        """Finish all files."""
        for file in (self._scans, self._attempts, self._trace):
            if file is not None:
                file.close()

    def _line(self, data: dict[str, Any]) -> None:
        if self._trace is not None:
            self._trace.write(json.dumps(data, ensure_ascii=False, separators=(",", ":")) + "\n")


class MemoryRows:
    """Keeps rows in memory: 35 bytes a link scan; of a traced run also attempts, frames and notes."""

    def __init__(self, *, scans: bool, traced: bool) -> None:
        self._scans = scans
        self._traced = traced
        self._buses: list[str] = []
        self._bus = array("H")
        self._ints = tuple(array(code) for code in "qqqiiB")
        self._attempts: list[Row] = []
        self._lines: list[dict[str, Any]] = []

    def scan(self, record: ScanRecord) -> None:
        """Keep a link scan."""
        if not self._scans:
            return
        if record.bus not in self._buses:
            self._buses.append(record.bus)
        self._bus.append(self._buses.index(record.bus))
        for column, number in zip(self._ints, scan_numbers(record), strict=True):
            column.append(number)

    def attempt(self, record: AttemptRecord) -> None:
        """Keep an attempt."""
        if self._traced:
            self._attempts.append(attempt_row(record))

    def frame(self, record: FrameRecord) -> None:
        """Keep a frame."""
        if self._traced:
            self._lines.append(frame_line(record))

    def note(self, record: NoteRecord) -> None:
        """Keep a note."""
        if self._traced:
            self._lines.append(note_line(record))

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
        self._need_trace()
        columns = list(zip(*self._attempts, strict=True)) or [()] * len(ATTEMPT_COLUMNS)
        return _frame([list(column) for column in columns], ATTEMPT_COLUMNS)

    def trace(self) -> list[dict[str, Any]]:
        """The lines that ``trace.jsonl`` would have. Raises UsageError if the run was not traced."""
        self._need_trace()
        return self._lines

    def _need_trace(self) -> None:
        if not self._traced:
            raise UsageError("this run was not traced; run it with trace=True")


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

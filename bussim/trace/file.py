"""Traces: ``trace.jsonl``, written line by line, and read back as the records of :mod:`bussim.trace.records`.

::

    trace = read_trace("runs/press_line")
    for frame in trace.of(FrameRecord, bus="link", start=0, stop=72_000_000):
        ...
    for record in trace.records(AttemptRecord, ScanRecord):
        ...

Reading streams: memory does not depend on the length of the trace. Records come in the order in
which they were recorded: what lasts when it is over, ENDs in blocks after they happened.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Collection, Iterable, Iterator
from pathlib import Path
from typing import Any, TextIO, TypeVar, assert_never, cast

from bussim.errors import UsageError
from bussim.files import INCOMPLETE, last_byte, plain, reading
from bussim.trace.blocks import RecordBlock, pieces
from bussim.trace.codec import Line, LineTexts, from_line, header_line, header_of, type_of
from bussim.trace.records import (
    AttemptRecord,
    CycleRecord,
    DeviceValueRecord,
    EndsRecord,
    FrameRecord,
    FreeRecord,
    InputRecord,
    NoteRecord,
    PollRecord,
    Record,
    ScanRecord,
    TraceBus,
    TraceHeader,
    TransactionRecord,
)

#: The file of every frame and event of a traced run, one JSON object a line.
TRACE = "trace.jsonl"
#: No line of a trace is longer (characters).
_LONGEST_LINE = 16 * 1024 * 1024
#: How lines begin that were not rewritten by another program, which may put blanks and other keys before.
_TYPE_FIRST = '{"type":"'

_encode = json.JSONEncoder(ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode

R = TypeVar("R", bound=Record)
#: Gives the records of some types (None: of all) from the beginning.
Source = Callable[[Collection[type[Record]] | None], Iterator[Record]]


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is no number of JSON")


#: The value of a JSON text. Raises ValueError for any other text, and RecursionError.
strict_json: Callable[[str], Any] = json.JSONDecoder(parse_constant=_refuse).decode


class TraceWriter:
    """Writes a trace to a text file that is open: the header at once, then record by record."""

    def __init__(self, file: TextIO, header: TraceHeader) -> None:
        self._file = file
        self._texts = LineTexts(_encode, {bus.name: bus for bus in header.buses})
        file.write(_encode(header_line(header)) + "\n")

    def write(self, record: Record) -> None:
        """Write a record."""
        self._file.write(self._texts.of(record) + "\n")

    def write_many(self, block: RecordBlock, breaks: Iterable[int]) -> None:
        """Write records that come many at once; others come at some breaks."""
        for lines in pieces(self._texts.of_block(block), breaks):
            self._file.write("".join(lines))

    def flush(self) -> None:
        """Hand what was written to the system."""
        self._file.flush()

    def close(self) -> None:
        """Finish the file."""
        self._file.close()


class Trace:
    """A trace's header and its records, which may be read any number of times.

    ``is_cut`` says that it was not written to its end, so that it may be over long before the run's.
    """

    def __init__(self, header: TraceHeader, source: Source, *, is_cut: bool = False) -> None:
        self.header = header
        self.is_cut = is_cut
        self._source = source

    def __iter__(self) -> Iterator[Record]:
        """Every record."""
        return self._source(None)

    def of(
        self, kind: type[R], *, bus: str | None = None, start: int | None = None, stop: int | None = None
    ) -> Iterator[R]:
        """The records of one type; else as :meth:`records`."""
        kinds = cast("type[Record]", kind)
        return cast("Iterator[R]", self.records(kinds, bus=bus, start=start, stop=stop))

    def records(
        self, *kinds: type[Record], bus: str | None = None, start: int | None = None, stop: int | None = None
    ) -> Iterator[Record]:
        """The records of these types (none given: of all) that concern a bus and touch a window.

        The window is ``start <= tick < stop``; what lasts is in it if any of it is. A block of ENDs
        comes with only those in the window. To a bus belong its own records, ENDs and values of its
        PLCs, and notes of itself and of its nodes. Raises UsageError for an unknown bus, and where
        the trace is damaged.
        """
        where = None if bus is None else self.bus(bus)
        of_the_bus = (each for each in self._source(kinds or None) if where is None or _concerns(each, where))
        clipped = (_clipped(each, start, stop) for each in of_the_bus)
        return (each for each in clipped if each is not None)

    def bus(self, name: str) -> TraceBus:
        """A bus of the header. Raises UsageError if there is none of that name."""
        bus = self.header.bus(name)
        if bus is None:
            known = ", ".join(bus.name for bus in self.header.buses) or "none"
            raise UsageError(f"the trace has no bus {name!r}; it has {known}")
        return bus


def interval(record: Record) -> tuple[int, int]:
    """When a record began and when it was over, in ticks; equal for what happens at an instant.

    A frame lasts as long as its sender's driver is on. A transaction begins with its request (or, never
    sent, where it ended) and is over when it was taken. ENDs last from the first to the last of them.
    """
    match record:
        case FrameRecord():
            return record.start, record.driven_until
        case AttemptRecord() | PollRecord():
            return record.start, record.end
        case ScanRecord() | CycleRecord():
            return record.start, record.start + record.duration
        case TransactionRecord():
            return record.end if record.sent is None else record.sent, record.taken
        case FreeRecord():
            return record.end if record.start is None else record.start, record.end
        case DeviceValueRecord() | InputRecord() | NoteRecord():
            return record.tick, record.tick
        case EndsRecord():
            return (record.ticks[0], record.ticks[-1]) if record.ticks else (0, 0)
        case _:
            assert_never(record)


def read_trace(path: str | os.PathLike[str]) -> Trace:
    """The trace in a file, or in the folder of a traced run.

    Raises UsageError if there is none or it is damaged; a damaged line raises when it is reached. A
    last line that was cut off, as of a recording that was killed, is left out.
    """
    location = Path(path)
    with reading(location):
        if location.is_dir():
            if not (location / TRACE).is_file():
                raise UsageError(f"{location} has no {TRACE}: it was run without a trace (--trace)")
            location /= TRACE
        file = _File(location)
        is_cut = file.lacks_its_end() or location.with_name(INCOMPLETE).is_file()
    return Trace(file.header, file.records, is_cut=is_cut)


def trace_of(header: TraceHeader, records: Iterable[Record]) -> Trace:
    """A trace that is held in memory; ``records`` can be gone through more than once."""

    def source(kinds: Collection[type[Record]] | None) -> Iterator[Record]:
        return iter(records) if kinds is None else (each for each in records if type(each) in kinds)

    return Trace(header, source)


class _File:
    """A file of lines, opened anew for every reading."""

    def __init__(self, path: Path) -> None:
        self._path = path
        with self._open() as file:
            try:
                line = _parsed(_next(file))
                self.header = header_of(line)
            except ValueError as error:
                raise UsageError(
                    f"{path} is not a trace of this bussim: its first line {error}; run it again"
                ) from error
        self._buses = {bus.name: bus for bus in self.header.buses}

    def records(self, kinds: Collection[type[Record]] | None) -> Iterator[Record]:
        # Lines in which the type stands first, as they are written, need not be parsed where it is another.
        names = () if kinds is None else ("trace", *map(type_of, kinds))
        starts = None if kinds is None else tuple(f'{_TYPE_FIRST}{name}"' for name in names)
        number = 1
        with self._open() as file:
            try:
                _next(file)
                while text := _next(file):
                    number += 1
                    if starts is not None and text.startswith(_TYPE_FIRST) and not text.startswith(starts):
                        continue
                    if not text.endswith("\n") and not _is_whole(text):
                        return
                    record = self._record(text, kinds)
                    if record is not None:
                        yield record
            except ValueError as error:
                raise UsageError(f"{self._path}:{number}: is not a line of a trace: {error}") from error
            except OSError as error:
                raise UsageError(f"{self._path} cannot be read: {error.strerror or error}") from error

    def _record(self, text: str, kinds: Collection[type[Record]] | None) -> Record | None:
        line = _parsed(text)
        if line.get("type") == "trace":
            raise ValueError("begins another trace; a file holds one")
        record = from_line(line, self._buses)
        if kinds is None or type(record) in kinds:
            return record
        if text.startswith(_TYPE_FIRST):
            raise ValueError("'type' is given twice")
        return None

    def lacks_its_end(self) -> bool:
        """Whether the last line, in which every trace ends, has no end."""
        return last_byte(self._path) != b"\n"

    def _open(self) -> TextIO:
        try:
            return plain(self._path).open(encoding="utf-8-sig")
        except FileNotFoundError:
            raise UsageError(f"{self._path} does not exist") from None


def _next(file: TextIO) -> str:
    text = file.readline(_LONGEST_LINE + 1)
    if len(text) > _LONGEST_LINE:
        raise ValueError(f"is longer than {_LONGEST_LINE:,} characters")
    return text


def _parsed(text: str) -> Line:
    try:
        line = strict_json(text)
    except RecursionError:
        line = None
    except ValueError as error:
        raise ValueError(f"is not JSON, of which a trace has one object a line: {error}") from None
    if isinstance(line, dict):
        return line
    raise ValueError("is not a JSON object")


def _is_whole(text: str) -> bool:
    try:
        _parsed(text)
    except ValueError:
        return False
    return True


def _concerns(record: Record, bus: TraceBus) -> bool:
    match record:
        case EndsRecord() | DeviceValueRecord() | InputRecord():
            return record.plc in bus.plcs
        case NoteRecord():
            names = {record.where, record.detail.get("bus"), record.detail.get("node")}
            return not names.isdisjoint({bus.name, *bus.nodes, *bus.plcs})
        case _:  # of one bus: mypy refuses a record without
            return record.bus == bus.name


def _clipped(record: Record, start: int | None, stop: int | None) -> Record | None:
    """The record, or what of it is in the window; None for nothing."""
    if start is None and stop is None:
        return record
    if isinstance(record, EndsRecord):
        ticks = tuple(
            tick
            for tick in record.ticks
            if (start is None or tick >= start) and (stop is None or tick < stop)
        )
        return EndsRecord(record.plc, ticks) if ticks else None
    begin, end = interval(record)
    inside = (start is None or end >= start) and (stop is None or begin < stop)
    return record if inside else None

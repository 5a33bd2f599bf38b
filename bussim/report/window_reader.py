"""A window of a run, read from its trace."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeVar

from bussim.report.trace_window import TraceWindow
from bussim.results.meters.timeline import fault_spans
from bussim.results.run_record import RunRecord
from bussim.trace.file import Trace
from bussim.trace.records import (
    AttemptRecord,
    DeviceValueRecord,
    EndsRecord,
    FrameRecord,
    InputRecord,
    NoteRecord,
    ScanRecord,
    TransactionRecord,
)
from bussim.units import TICKS_PER_MS

#: The margin on each side of a link scan is so small a part of it.
_MARGIN = 20
#: Of a bus that is no link at least so much is shown (ticks): 200 ms.
_LEAST = 200 * TICKS_PER_MS
_KINDS = (FrameRecord, AttemptRecord, TransactionRecord, ScanRecord, NoteRecord, EndsRecord)


def worst_window(trace: Trace, run: RunRecord, bus: str) -> tuple[int, int] | None:
    """The window of a bus around its longest link scan or attempt, in ticks, with a margin.

    The longest link scan; on another bus the longest attempt of a Modbus master, or what was sent
    first. None where there was nothing. Raises UsageError as :func:`read_window`.
    """
    link = run.links.get(bus)
    if link is not None:
        start, duration = link.scan_times.longest_at, link.scan_times.histogram.maximum
        return None if start is None or duration is None else _around(run, start, start + duration)
    longest = None
    for request in trace.of(TransactionRecord, bus=bus):
        sent, end = request.sent, request.end
        if sent is not None and (longest is None or end - sent > longest[1] - longest[0]):
            longest = sent, end
    if longest is None:
        first = next(trace.of(FrameRecord, bus=bus), None)
        longest = None if first is None else (first.start, first.end)
    return None if longest is None else _around(run, *longest, least=_LEAST)


def _around(run: RunRecord, start: int, end: int, least: int = 0) -> tuple[int, int]:
    """A little more than from start to end, at least so long, within the run."""
    margin = max(1, (end - start) // _MARGIN, (least - (end - start)) // 2)
    return max(0, start - margin), min(run.duration, end + margin)


def read_window(trace: Trace, run: RunRecord, bus: str, begin: int, end: int) -> TraceWindow:
    """The records of a bus from ``begin`` to ``end`` (ticks).

    Raises UsageError for a bus that the trace does not have, and where it is damaged.
    """
    where = trace.bus(bus)
    found = list(trace.records(*_KINDS, bus=bus, start=begin, stop=end))
    stations: dict[int, str] = {}
    for node, number in where.stations.items():
        stations.setdefault(number, node)
    ends: dict[str, list[int]] = {}
    for block in found:
        if isinstance(block, EndsRecord):
            ends.setdefault(block.plc, []).extend(block.ticks)
    link = run.links.get(bus)
    return TraceWindow(
        bus,
        begin,
        end,
        where.nodes,
        stations,
        [record for record in found if isinstance(record, FrameRecord)],
        [record for record in found if isinstance(record, AttemptRecord)],
        [record for record in found if isinstance(record, TransactionRecord)],
        [record for record in found if isinstance(record, ScanRecord)],
        [record for record in found if isinstance(record, NoteRecord)],
        _changes(trace.of(DeviceValueRecord, bus=bus, stop=end), begin),
        _changes(trace.of(InputRecord, bus=bus, stop=end), begin),
        ends,
        fault_spans(run.notes, {bus, *where.nodes, *where.plcs}),
        {} if link is None else link.in_error,
    )


C = TypeVar("C", DeviceValueRecord, InputRecord)


def _changes(records: Iterable[C], begin: int) -> list[C]:
    """The changes in the window, and before them the last one of each device from before it."""
    before: dict[tuple[str, str], C] = {}
    inside: list[C] = []
    for record in records:
        if record.tick < begin:
            before[record.plc, record.device] = record
        else:
            inside.append(record)
    found = list(before.values())
    return found + inside

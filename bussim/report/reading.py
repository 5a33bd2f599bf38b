"""A stretch of a run, read from its trace."""

from __future__ import annotations

from bussim.report.stretch import Stretch
from bussim.results.record import RunRecord
from bussim.results.timeline import fault_spans
from bussim.results.trace_file import Trace
from bussim.trace import (
    AttemptRecord,
    DeviceValueRecord,
    EndsRecord,
    FrameRecord,
    NoteRecord,
    ScanRecord,
    TransactionRecord,
)

#: The margin on each side of a link scan is so small a part of it.
_MARGIN = 20
_KINDS = (FrameRecord, AttemptRecord, TransactionRecord, ScanRecord, NoteRecord, EndsRecord)


def window_of_longest(run: RunRecord, bus: str) -> tuple[int, int] | None:
    """From when until when the longest link scan of a link lasted, with a margin; None without one."""
    link = run.links.get(bus)
    if link is None or link.scan_times.longest_at is None or link.scan_times.histogram.maximum is None:
        return None
    start, duration = link.scan_times.longest_at, link.scan_times.histogram.maximum
    margin = max(1, duration // _MARGIN)
    return max(0, start - margin), min(run.duration, start + duration + margin)


def read_stretch(trace: Trace, run: RunRecord, bus: str, begin: int, end: int) -> Stretch:
    """What a trace tells of a bus from ``begin`` to ``end`` (ticks).

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
    return Stretch(
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
        _values(trace, bus, begin, end),
        ends,
        fault_spans(run.notes, {bus, *where.nodes, *where.plcs}),
        {} if link is None else link.in_error,
    )


def _values(trace: Trace, bus: str, begin: int, end: int) -> list[DeviceValueRecord]:
    """The changes in the window, and before them the last one of each device from before it."""
    before: dict[tuple[str, str], DeviceValueRecord] = {}
    inside: list[DeviceValueRecord] = []
    for value in trace.of(DeviceValueRecord, bus=bus, stop=end):
        if value.tick < begin:
            before[value.plc, value.device] = value
        else:
            inside.append(value)
    return [*before.values(), *inside]

"""A window of a traced run on one bus: the records that a timeline is drawn from, read from its trace.

Times are ticks of 1/72 MHz from the start of the run.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import TypeVar

from bussim.results.meters.timeline import Span, fault_spans
from bussim.results.numbers import adding_up
from bussim.results.registers import own_name
from bussim.results.run_record import RunRecord
from bussim.trace import records
from bussim.trace.file import Trace
from bussim.trace.records import (
    AttemptRecord,
    DeviceValueRecord,
    FrameRecord,
    InputRecord,
    ScanRecord,
    TransactionRecord,
)
from bussim.units import TICKS_PER_MS, format_ms, milliseconds
from bussim.words.language import say

#: The margin on each side of a link scan is so small a part of it.
_MARGIN = 20
#: Of a bus that is no link at least so much is shown (ticks): 200 ms.
_LEAST = 200 * TICKS_PER_MS
_KINDS = (FrameRecord, AttemptRecord, TransactionRecord, ScanRecord, records.NoteRecord, records.EndsRecord)
#: M8183 + k is the error flag of station k (PW10 board manual, section 7.5).
_FLAG = 8183

C = TypeVar("C", DeviceValueRecord, InputRecord)


@dataclass(frozen=True, slots=True)
class TraceWindow:
    """What happened on ``bus`` from ``begin`` to ``end`` (ticks), records that reach in included.

    ``nodes`` are the nodes of the bus in cable order; ``stations`` the names of an N:N
    link's stations by number; ``ends`` are the ENDs of each PLC. ``values`` are what memories
    hold at ENDs, ``inputs`` the changes on the wires of driven inputs. ``faults`` are the texts of faults and
    when they acted, ``flags`` when the master had each station in error, ``flag_names`` its names of them.
    """

    bus: str
    begin: int
    end: int
    nodes: Sequence[str]
    stations: Mapping[int, str] = field(default_factory=dict)
    frames: Sequence[FrameRecord] = ()
    attempts: Sequence[AttemptRecord] = ()
    transactions: Sequence[TransactionRecord] = ()
    scans: Sequence[ScanRecord] = ()
    notes: Sequence[records.NoteRecord] = ()
    values: Sequence[DeviceValueRecord] = ()
    inputs: Sequence[InputRecord] = ()
    ends: Mapping[str, Sequence[int]] = field(default_factory=dict)
    faults: Sequence[tuple[str, Span]] = ()
    flags: Mapping[int, Sequence[Span]] = field(default_factory=dict)
    flag_names: Mapping[int, str] = field(default_factory=dict)

    def station(self, number: int | None) -> str:
        """``station 1 (press2)``."""
        if number is None:
            return say("scene_no_station")
        name = self.stations.get(number)
        return say("station", number=number, plc=name) if name else say("station_number", number=number)


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
        if isinstance(block, records.EndsRecord):
            ends.setdefault(block.plc, []).extend(block.ticks)
    link = run.links.get(bus)
    in_error = {} if link is None else link.in_error
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
        [record for record in found if isinstance(record, records.NoteRecord)],
        _changes(trace.of(DeviceValueRecord, bus=bus, stop=end), begin),
        _changes(trace.of(InputRecord, bus=bus, stop=end), begin),
        ends,
        fault_spans(run.notes, {bus, *where.nodes, *where.plcs}),
        in_error,
        {number: own_name(run.summary, stations.get(0, ""), f"M{_FLAG + number}") for number in in_error},
    )


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


@dataclass(frozen=True, slots=True)
class Part:
    """A part of a link scan: what took so many ticks. ``lost`` marks what a plain scan has not.

    ``attempt`` is the attempt's number where the part is one, else 0.
    """

    start: int
    end: int
    what: str
    attempt: int = 0
    lost: bool = False
    ordinary: bool = False

    @property
    def ticks(self) -> int:
        """How long it took."""
        return self.end - self.start


def parts_of_scan(window: TraceWindow, scan: ScanRecord) -> list[Part]:
    """A link scan cut into what its time went to; the parts' lengths add up to its duration.

    The master's data frame, then each attempt with the gap before its poll, then what is left until
    the next data frame. A part without the records that explain it says so.
    """
    end = scan.start + scan.duration
    parts: list[Part] = []
    at = scan.start
    opening = next((f for f in window.frames if f.start == scan.start and f.kind == "data"), None)
    if opening is not None and opening.end <= end:
        parts.append(Part(at, opening.end, say("part_data", sender=opening.sender)))
        at = opening.end
    inside = (a for a in window.attempts if scan.start <= a.start and a.end <= end)
    for attempt in sorted(inside, key=lambda record: record.start):
        what, ordinary = _outcome(window, attempt)
        lost = attempt.code != 0
        parts.append(Part(at, attempt.end, what, attempt.number, lost=lost, ordinary=ordinary))
        at = attempt.end
    frame = next((f for f in window.frames if f.kind == "parameters" and at <= f.start < end), None)
    if frame is not None:
        parts.append(Part(at, frame.start, say("part_overhead")))
        parts.append(Part(frame.start, end, say("part_parameters"), lost=True))
    elif at < end:
        parts.append(Part(at, end, say("part_overhead")))
    return parts


#: A reply is named when its turnaround is so many times the shortest one.
_LATE = 4


def _outcome(window: TraceWindow, attempt: AttemptRecord) -> tuple[str, bool]:
    """What became of an attempt, and whether it was an ordinary exchange."""
    station = window.station(attempt.station)
    if attempt.code:
        code = f"{attempt.code:02X}"
        return say("part_code", station=station, outcome=attempt.outcome, code=code), False
    shortest = min((a.turnaround for a in window.attempts if a.turnaround is not None), default=0)
    if attempt.turnaround is not None and attempt.turnaround > _LATE * shortest:
        return say("part_late", station=station, time=format_ms(attempt.turnaround)), False
    return say("part_reply", station=station), True


def in_words(parts: Sequence[Part]) -> str:
    """What a link scan took and what that consists of: times that add up to the one before them.

    Neighbours in which nothing was lost are one time, attempts that failed alike as well. At the end
    stands what the lost ones took together.
    """
    groups = [list(alike) for _, alike in groupby(parts, _likeness)]
    spans = [milliseconds(sum(part.ticks for part in group)) for group in groups]
    words, lost, kinds = list[str](), 0.0, dict[str, None]()
    for group, total in zip(groups, adding_up(spans, sum(spans)), strict=True):
        first = group[0]
        if first.lost:
            lost += float(total)
            kinds["part_failed" if first.attempt else "part_parameter_frame"] = None
        if len(group) == 1:
            words.append(say("part_one", total=total, what=_named(first)))
        elif first.lost:
            numbers = {"first": first.attempt, "last": group[-1].attempt}
            values = {"total": total, "what": first.what, "each": ms(first.ticks)}
            words.append(say("part_attempts", **numbers, **values))
        else:
            ordinary = sum(part.ordinary for part in group)
            names = [_named(part) for part in group if not part.ordinary]
            names += [say("part_polls", number=ordinary)] if ordinary else []
            words.append(say("part_several", total=total, names=names))
    if not lost:
        return say("part_sum", sum=sum(spans), parts=words)
    return say("part_sum_lost", sum=sum(spans), parts=words, lost=lost, kinds=[say(key) for key in kinds])


def _likeness(part: Part) -> tuple[str, str] | None:
    # To the microsecond that is shown: two attempts seldom end on the same tick.
    return (part.what, ms(part.ticks)) if part.lost else None


def _named(part: Part) -> str:
    return say("part_attempt", number=part.attempt, what=part.what) if part.attempt else part.what


def ms(ticks: float) -> str:
    """``51.719 ms``."""
    return f"{milliseconds(ticks):.3f} ms"

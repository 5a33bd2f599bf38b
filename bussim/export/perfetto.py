"""Chrome's trace-event format (JSON), for ui.perfetto.dev: what each node did and when, as tracks.

Each bus is a process: a track (thread) per node with its frames, and tracks for link scans, attempts,
transactions, turns of polls, poll lists and free-protocol calls. Each PLC is a process: its program
scans, from END to END, and a counter per watched device. Faults are a process of their own. What is
wrong (failed attempts, damaged frames, flags) is an instant on the track that it concerns.
Times are microseconds with five decimals, which name each tick uniquely.
"""

import json
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any, assert_never

from bussim.errors import UsageError
from bussim.export.selection import Job, Selection, Written, nothing_there
from bussim.line.protocols import BusProtocol
from bussim.trace import records
from bussim.trace.file import interval
from bussim.trace.records import Record
from bussim.units import TICKS_PER_US
from bussim.version import __version__

#: Most events: they are sorted in memory, and the browser's own limit is not far.
MOST_EVENTS = 2_000_000
_DECIMALS = 5

Event = dict[str, Any]
#: An event and its time in ticks.
Timed = tuple[int, Event]
#: Numbers of a process and of a thread of it.
Track = tuple[int, int]
OnBus = (
    records.FrameRecord
    | records.ScanRecord
    | records.AttemptRecord
    | records.TransactionRecord
    | records.PollRecord
    | records.CycleRecord
    | records.FreeRecord
)


def write_perfetto(path: Path, job: Job) -> Written:
    """Write the trace as events.

    Raises UsageError where there is none, or more than :data:`MOST_EVENTS`.
    """
    selection, comment = job.selection, job.comment
    tracks = _Tracks(selection)
    events: list[Timed] = []
    for timed in _Events(selection, tracks).all():
        events.append(timed)
        if len(events) > MOST_EVENTS:
            raise UsageError(
                f"there are more than {MOST_EVENTS:,} events; choose less with --bus, --from and --to-time"
            )
    if not events:
        raise UsageError(nothing_there(selection, "no event"))
    # At one time the longer slice comes first: it is the outer one.
    events.sort(key=lambda timed: (timed[0], -timed[1].get("dur", 0)))
    with path.open("w", encoding="utf-8", newline="\n") as file:
        head = {"displayTimeUnit": "ms", "otherData": {"version": f"bussim {__version__}", "run": comment}}
        file.write(json.dumps(head, ensure_ascii=False, allow_nan=False)[:-1] + ', "traceEvents": [\n')
        lines = (*tracks.named, *(event for _, event in events))
        for number, event in enumerate(lines):
            file.write(",\n" if number else "")
            file.write(json.dumps(event, ensure_ascii=False, allow_nan=False, separators=(",", ":")))
        file.write("\n]}\n")
    return Written(len(events), tuple(selection.buses), ("open it at https://ui.perfetto.dev",))


def microseconds(ticks: int) -> float:
    """Ticks as microseconds; five decimals distinguish each tick from the next."""
    return round(ticks / TICKS_PER_US, _DECIMALS)


class _Tracks:
    """Numbers of processes and threads. Buses come first, then PLCs, then faults.

    A track is a process and a thread of it, ``(pid, tid)``; 0 is the process itself.
    """

    def __init__(self, selection: Selection) -> None:
        self._processes: dict[str, int] = {}
        self._threads: dict[tuple[int, str], int] = {}
        self._bus_of: dict[str, str] = {}
        #: The metadata events that name them all.
        self.named: list[Event] = []
        for bus in selection.trace.header.buses:
            if bus.name in selection.buses:
                for name in ("link scans", "attempts") if bus.protocol is BusProtocol.NN else ():
                    self.bus(bus.name, name)
                for node in bus.nodes:
                    self._bus_of[node] = bus.name
                    self.bus(bus.name, node)

    def bus(self, name: str, thread: str) -> Track:
        """A thread of a bus."""
        return self._track(f"bus {name}", thread)

    def plc(self, name: str, thread: str = "") -> Track:
        """A thread of a PLC, or the PLC itself."""
        return self._track(f"PLC {name}", thread)

    def fault(self, name: str) -> Track:
        """The thread of a fault, or of what is of no bus."""
        return self._track("faults and notes", name)

    def note(self, where: str) -> Track:
        """Where a note belongs: its bus, its node on a bus, or neither."""
        if f"bus {where}" in self._processes:
            return self.bus(where, "notes")
        bus = self._bus_of.get(where)
        return self.fault(where or "notes") if bus is None else self.bus(bus, where)

    def _track(self, process: str, thread: str) -> Track:
        pid = self._processes.get(process)
        if pid is None:
            pid = self._processes[process] = len(self._processes) + 1
            self._name("process", pid, 0, process)
        if not thread:
            return pid, 0
        tid = self._threads.get((pid, thread))
        if tid is None:
            tid = self._threads[pid, thread] = 1 + sum(owner == pid for owner, _ in self._threads)
            self._name("thread", pid, tid, thread)
        return pid, tid

    def _name(self, what: str, pid: int, tid: int, name: str) -> None:
        for key, args in (("name", {"name": name}), ("sort_index", {"sort_index": tid or pid})):
            meta = {"name": f"{what}_{key}", "ph": "M", "ts": 0, "pid": pid, "tid": tid, "args": args}
            self.named.append(meta)


class _Events:
    def __init__(self, selection: Selection, tracks: _Tracks) -> None:
        self._selection = selection
        self._tracks = tracks
        self._last_end: dict[str, int] = {}
        self._faults: dict[str, records.NoteRecord] = {}

    def all(self) -> Iterator[Timed]:
        chosen, until = self._selection, 0
        for record in chosen.trace.records(bus=chosen.bus, start=chosen.start, stop=chosen.stop):
            for tick, event in self._of(record):
                until = max(until, tick)
                yield tick, event
        for fault in self._faults.values():  # those that never ended, or not in the window
            yield self._fault(fault, max(until, fault.tick))

    def _of(self, record: Record) -> Iterator[Timed]:
        tracks = self._tracks
        match record:
            case records.FrameRecord():
                yield from self._frame(record)
            case records.ScanRecord():
                args = {
                    "attempts": record.attempts,
                    "failed": record.failed,
                    "stations in error": record.stations_in_error,
                    "cause": record.cause,
                }
                yield _slice(
                    record, f"link scan {record.number}", "scan", self._on(record, "link scans"), args
                )
            case records.AttemptRecord():
                yield from self._attempt(record)
            case records.TransactionRecord():
                yield from self._transaction(record)
            case records.PollRecord():
                late = microseconds(record.late)
                args = {"attempts": record.attempts, "error": record.error, "late_us": late}
                track = self._on(record, f"{record.master} polls")
                yield _slice(record, record.poll or "poll", "poll", track, args)
            case records.CycleRecord():
                track = self._on(record, f"{record.master} poll lists")
                yield _slice(record, f"poll list {record.number}", "cycle", track, {})
            case records.FreeRecord():
                args = {"bytes": _hex(record.data), "ended": record.ended, "damaged": record.damaged}
                track = self._on(record, f"{record.node} free protocol")
                yield _slice(record, f"{record.poll} {record.direction}".strip(), "free", track, args)
            case records.DeviceValueRecord():
                value = {"value": record.value}
                yield _event("C", record.device, "register", record.tick, tracks.plc(record.plc), value)
            case records.InputRecord():
                name, level = f"{record.device} (wire)", {"value": record.level}
                yield _event("C", name, "input", record.tick, tracks.plc(record.plc), level)
            case records.EndsRecord():
                track = tracks.plc(record.plc, "program scans")
                last = [self._last_end[record.plc]] if record.plc in self._last_end else []
                for begin, end in pairwise([*last, *record.ticks]):
                    yield _event("X", "program scan", "plc", begin, track, {}, end - begin)
                if record.ticks:
                    self._last_end[record.plc] = record.ticks[-1]
            case records.NoteRecord():
                yield from self._note(record)
            case _:
                assert_never(record)

    def _frame(self, frame: records.FrameRecord) -> Iterator[Timed]:
        track = self._on(frame, frame.sender)
        name = frame.kind if frame.station is None else f"{frame.kind} {frame.station}"
        wrong: dict[str, Any] = {}
        if frame.damaged_bits:
            wrong["damaged bits"] = list(frame.damaged_bits)
        for node, bits in frame.damaged_at.items():
            wrong[f"damaged at {node}"] = list(bits)
        if frame.collided:
            wrong["collided"] = True
        if frame.cut:
            wrong["cut off"] = True
        for index, ticks in frame.pauses:
            wrong[f"pause after character {index + 1}, us"] = microseconds(ticks)
        if frame.released is not None:
            wrong["driver on after it, us"] = microseconds(frame.released - frame.end)
        args = {"protocol": frame.protocol, "counter": frame.counter, "bytes": _hex(frame.chars)}
        yield _slice(frame, name, "frame", track, args | wrong)
        if wrong:
            yield _instant(f"{name}: {next(iter(wrong))}", frame.end, track, wrong)

    def _attempt(self, attempt: records.AttemptRecord) -> Iterator[Timed]:
        track = self._on(attempt, "attempts")
        turnaround = None if attempt.turnaround is None else microseconds(attempt.turnaround)
        args = {"outcome": attempt.outcome, "code": f"{attempt.code:02X}", "turnaround_us": turnaround}
        yield _slice(attempt, f"station {attempt.station}, attempt {attempt.number}", "attempt", track, args)
        if attempt.code:
            text = f"code {attempt.code:02X}: {attempt.outcome}"
            yield _instant(text, attempt.end, track, {"station": attempt.station})

    def _transaction(self, done: records.TransactionRecord) -> Iterator[Timed]:
        track = self._on(done, f"{done.master} transactions")
        name = f"{done.poll or 'program'}: station {done.station}, function {done.function:02X}"
        keys = ("attempt", "address", "quantity", "outcome", "error", "exception")
        yield _slice(done, name, "transaction", track, {key: getattr(done, key) for key in keys})
        if done.error is not None:
            yield _instant(f"error {done.error}: {done.outcome}", done.end, track, {"poll": done.poll})

    def _note(self, note: records.NoteRecord) -> Iterator[Timed]:
        if note.kind == "fault":
            self._faults[note.where] = note
        elif note.kind == "fault_over" and note.where in self._faults:
            yield self._fault(self._faults.pop(note.where), note.tick)
        else:
            args = {"where": note.where, **note.detail}
            yield _instant(
                f"{note.kind}: {note.text}", note.tick, self._tracks.note(note.where), args, note.kind
            )

    def _fault(self, note: records.NoteRecord, until: int) -> Timed:
        track = self._tracks.fault(note.where)
        return _event("X", note.text, "fault", note.tick, track, dict(note.detail), until - note.tick)

    def _on(self, record: OnBus, thread: str) -> Track:
        return self._tracks.bus(record.bus, thread)


def _hex(data: bytes) -> str:
    return data.hex(" ").upper()


def _event(
    phase: str, name: str, category: str, tick: int, track: Track, args: Event, duration: int | None = None
) -> Timed:
    event: Event = {
        "name": name,
        "cat": category,
        "ph": phase,
        "ts": microseconds(tick),
        "pid": track[0],
        "tid": track[1],
        "args": args,
    }
    if duration is not None:
        event["dur"] = microseconds(duration)
    return tick, event


def _slice(record: OnBus, name: str, category: str, track: Track, args: Event) -> Timed:
    """What lasts as long as a record; arguments without a value are left out."""
    begin, end = interval(record)
    given = {key: value for key, value in args.items() if value not in (None, "")}
    return _event("X", name, category, begin, track, given, end - begin)


def _instant(name: str, tick: int, track: Track, args: Event, category: str = "error") -> Timed:
    at, event = _event("i", name, category, tick, track, args)
    return at, event | {"s": "t"}

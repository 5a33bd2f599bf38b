"""Chrome's trace-event format (JSON), for ui.perfetto.dev: what each node did and when, as tracks.

Each bus is a process: a track (thread) per node with its frames, and tracks for link scans, attempts,
transactions, turns of polls, poll lists and free-protocol calls. Each PLC is a process: its program
scans, from END to END, and a counter per watched device. Faults are a process of their own. What is
wrong (failed attempts, damaged frames, flags) is an instant on the track that it concerns.
Times are microseconds with five decimals, which name each tick uniquely.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from bussim.errors import UsageError
from bussim.export.source import Job, Selection, Written, nothing_there
from bussim.line.protocols import BusProtocol
from bussim.trace import records
from bussim.trace.records import Record
from bussim.units import TICKS_PER_US
from bussim.version import __version__

#: Most events: they are sorted in memory, and the browser's own limit is not far.
MOST_EVENTS = 2_000_000
_DECIMALS = 5

Event = dict[str, Any]
#: Events in the making: time in ticks, then their order in the trace.
Timed = tuple[int, int, Event]


def write_perfetto(path: Path, job: Job) -> Written:
    """Write the trace as events.

    Raises UsageError where there is none, or more than :data:`MOST_EVENTS`.
    """
    selection, comment = job.selection, job.comment
    tracks = _Tracks(selection)
    events: list[Timed] = []
    for number, (tick, event) in enumerate(_Events(selection, tracks).all()):
        events.append((tick, number, event))
        if number >= MOST_EVENTS:
            raise UsageError(
                f"there are more than {MOST_EVENTS:,} events; choose less with --bus, --from and --to-time"
            )
    if not events:
        raise UsageError(nothing_there(selection, "no event"))
    # At one time the longer slice comes first: it is the outer one.
    events.sort(key=lambda timed: (timed[0], -timed[2].get("dur", 0), timed[1]))
    with path.open("w", encoding="utf-8", newline="\n") as file:
        head = {"displayTimeUnit": "ms", "otherData": {"version": f"bussim {__version__}", "run": comment}}
        file.write(json.dumps(head, ensure_ascii=False)[:-1] + ', "traceEvents": [\n')
        lines = (*tracks.named(), *(event for _, _, event in events))
        for number, event in enumerate(lines):
            file.write(",\n" if number else "")
            file.write(json.dumps(event, ensure_ascii=False, separators=(",", ":")))
        file.write("\n]}\n")
    return Written(len(events), tuple(selection.buses), ("open it at https://ui.perfetto.dev",))


def microseconds(ticks: int) -> float:
    """Ticks as microseconds; five decimals distinguish each tick from the next."""
    return round(ticks / TICKS_PER_US, _DECIMALS)


class _Tracks:
    """Numbers of processes and threads. Buses come first, then PLCs, then faults."""

    def __init__(self, selection: Selection) -> None:
        self._processes: dict[str, int] = {}
        self._threads: dict[tuple[int, str], int] = {}
        self._names: list[Event] = []
        self.buses: dict[str, int] = {}
        self.bus_of: dict[str, str] = {}
        for bus in selection.trace.header.buses:
            if bus.name in selection.buses:
                pid = self.bus(bus.name)
                if bus.protocol is BusProtocol.NN:
                    for name in ("link scans", "attempts"):
                        self.thread(pid, name)
                for node in bus.nodes:
                    self.bus_of[node] = bus.name
                    self.thread(pid, node)

    def bus(self, name: str) -> int:
        if name not in self.buses:
            self.buses[name] = self._process(f"bus {name}")
        return self.buses[name]

    def plc(self, name: str) -> int:
        return self._process(f"PLC {name}")

    def faults(self) -> int:
        return self._process("faults and notes")

    def thread(self, pid: int, name: str) -> int:
        key = (pid, name)
        if key not in self._threads:
            tid = self._threads[key] = 1 + sum(process == pid for process, _ in self._threads)
            self._names += [
                self._meta("thread_name", pid, tid, {"name": name}),
                self._meta("thread_sort_index", pid, tid, {"sort_index": tid}),
            ]
        return self._threads[key]

    def _process(self, name: str) -> int:
        if name not in self._processes:
            pid = self._processes[name] = len(self._processes) + 1
            self._names += [
                self._meta("process_name", pid, 0, {"name": name}),
                self._meta("process_sort_index", pid, 0, {"sort_index": pid}),
            ]
        return self._processes[name]

    @staticmethod
    def _meta(name: str, pid: int, tid: int, args: dict[str, str | int]) -> Event:
        return {"name": name, "ph": "M", "ts": 0, "pid": pid, "tid": tid, "args": args}

    def named(self) -> list[Event]:
        """The metadata events that name them all."""
        return self._names


class _Events:
    """From records to events."""

    def __init__(self, selection: Selection, tracks: _Tracks) -> None:
        self._selection = selection
        self._tracks = tracks
        self._last_end: dict[str, int] = {}
        self._faults: dict[str, records.NoteRecord] = {}

    def all(self) -> Iterator[tuple[int, Event]]:
        chosen, until = self._selection, 0
        for record in chosen.trace.records(bus=chosen.bus, start=chosen.start, stop=chosen.stop):
            for tick, event in self._of(record):
                until = max(until, tick)
                yield tick, event
        for fault in self._faults.values():  # those that never ended, or not in the window
            yield self._fault(fault, max(until, fault.tick))

    def _of(self, record: Record) -> Iterator[tuple[int, Event]]:
        match record:
            case records.FrameRecord():
                yield from self._frame(record)
            case records.ScanRecord():
                yield self._scan(record)
            case records.AttemptRecord():
                yield from self._attempt(record)
            case records.TransactionRecord():
                yield from self._transaction(record)
            case records.PollRecord():
                late = microseconds(record.late)
                args = {"attempts": record.attempts, "error": record.error, "late_us": late}
                track, name = f"{record.master} polls", record.poll or "poll"
                yield self._on_bus(record, track, "poll", name, record.start, record.end, args)
            case records.CycleRecord():
                end = record.start + record.duration
                track, name = f"{record.master} poll lists", f"poll list {record.number}"
                yield self._on_bus(record, track, "cycle", name, record.start, end, {})
            case records.FreeRecord():
                yield from self._free(record)
            case records.DeviceValueRecord():
                pid, value = self._tracks.plc(record.plc), {"value": record.value}
                yield record.tick, _event("C", record.device, "register", record.tick, pid, 0, value)
            case records.InputRecord():
                pid, level = self._tracks.plc(record.plc), {"value": record.level}
                name = f"{record.device} (wire)"
                yield record.tick, _event("C", name, "input", record.tick, pid, 0, level)
            case records.EndsRecord():
                yield from self._ends(record)
            case records.NoteRecord():
                yield from self._note(record)

    def _frame(self, frame: records.FrameRecord) -> Iterator[tuple[int, Event]]:
        pid = self._tracks.bus(frame.bus)
        tid = self._tracks.thread(pid, frame.sender)
        name = frame.kind if frame.station is None else f"{frame.kind} {frame.station}"
        args: dict[str, Any] = {
            "protocol": frame.protocol,
            "counter": frame.counter,
            "bytes": frame.chars.hex(" ").upper(),
        }
        wrong: dict[str, Any] = {}
        if frame.damaged_bits:
            wrong["damaged bits"] = list(frame.damaged_bits)
        for node, bits in frame.damaged_at.items():
            wrong[f"damaged at {node}"] = list(bits)
        if frame.collided:
            wrong["collided"] = True
        if frame.cut:
            wrong["cut off"] = True
        args = {key: value for key, value in (args | wrong).items() if value is not None}
        yield frame.start, _slice(name, "frame", frame.start, frame.end, pid, tid, args)
        if wrong:
            what = next(iter(wrong))
            yield frame.end, _instant(f"{name}: {what}", frame.end, pid, tid, wrong)

    def _scan(self, scan: records.ScanRecord) -> tuple[int, Event]:
        args = {
            "attempts": scan.attempts,
            "failed": scan.failed,
            "stations in error": scan.stations_in_error,
            "cause": scan.cause,
        }
        end = scan.start + scan.duration
        return self._on_bus(scan, "link scans", "scan", f"link scan {scan.number}", scan.start, end, args)

    def _attempt(self, attempt: records.AttemptRecord) -> Iterator[tuple[int, Event]]:
        name = f"station {attempt.station}, attempt {attempt.number}"
        turnaround = None if attempt.turnaround is None else microseconds(attempt.turnaround)
        args = {"outcome": attempt.outcome, "code": f"{attempt.code:02X}", "turnaround_us": turnaround}
        yield self._on_bus(attempt, "attempts", "attempt", name, attempt.start, attempt.end, args)
        if attempt.code:
            pid = self._tracks.bus(attempt.bus)
            tid = self._tracks.thread(pid, "attempts")
            text = f"code {attempt.code:02X}: {attempt.outcome}"
            yield attempt.end, _instant(text, attempt.end, pid, tid, {"station": attempt.station})

    def _transaction(self, done: records.TransactionRecord) -> Iterator[tuple[int, Event]]:
        track = f"{done.master} transactions"
        name = f"{done.poll or 'program'}: station {done.station}, function {done.function:02X}"
        args = {
            "attempt": done.attempt,
            "address": done.address,
            "quantity": done.quantity,
            "outcome": done.outcome,
            "error": done.error,
            "exception": done.exception,
        }
        begin = done.end if done.sent is None else done.sent
        yield self._on_bus(done, track, "transaction", name, begin, done.taken, args)
        if done.error is not None:
            pid = self._tracks.bus(done.bus)
            tid = self._tracks.thread(pid, track)
            text = f"error {done.error}: {done.outcome}"
            yield done.end, _instant(text, done.end, pid, tid, {"poll": done.poll})

    def _free(self, record: records.FreeRecord) -> Iterator[tuple[int, Event]]:
        args = {"bytes": record.data.hex(" ").upper(), "ended": record.ended, "damaged": record.damaged}
        begin = record.end if record.start is None else record.start
        track = f"{record.node} free protocol"
        name = f"{record.poll} {record.direction}".strip()
        yield self._on_bus(record, track, "free", name, begin, record.end, args)

    def _ends(self, record: records.EndsRecord) -> Iterator[tuple[int, Event]]:
        pid = self._tracks.plc(record.plc)
        tid = self._tracks.thread(pid, "program scans")
        last = self._last_end.get(record.plc)
        for tick in record.ticks:
            if last is not None:
                yield last, _slice("program scan", "plc", last, tick, pid, tid, {})
            last = tick
        if last is not None:
            self._last_end[record.plc] = last

    def _note(self, note: records.NoteRecord) -> Iterator[tuple[int, Event]]:
        if note.kind == "fault":
            self._faults[note.where] = note
        elif note.kind == "fault_over" and note.where in self._faults:
            yield self._fault(self._faults.pop(note.where), note.tick)
        else:
            tracks = self._tracks
            if note.where in tracks.buses:
                pid = tracks.buses[note.where]
                tid = tracks.thread(pid, "notes")
            elif note.where in tracks.bus_of:
                pid = tracks.buses[tracks.bus_of[note.where]]
                tid = tracks.thread(pid, note.where)
            else:
                pid = tracks.faults()
                tid = tracks.thread(pid, note.where or "notes")
            text = f"{note.kind}: {note.text}"
            args = {"where": note.where, **note.detail}
            yield note.tick, _instant(text, note.tick, pid, tid, args, note.kind)

    def _fault(self, note: records.NoteRecord, until: int) -> tuple[int, Event]:
        pid = self._tracks.faults()
        tid = self._tracks.thread(pid, note.where)
        return note.tick, _slice(note.text, "fault", note.tick, until, pid, tid, dict(note.detail))

    def _on_bus(
        self,
        record: records.ScanRecord
        | records.AttemptRecord
        | records.TransactionRecord
        | records.PollRecord
        | records.CycleRecord
        | records.FreeRecord,
        track: str,
        category: str,
        name: str,
        begin: int,
        end: int,
        args: dict[str, Any],
    ) -> tuple[int, Event]:
        pid = self._tracks.bus(record.bus)
        tid = self._tracks.thread(pid, track)
        given = {key: value for key, value in args.items() if value not in (None, "")}
        return begin, _slice(name, category, begin, end, pid, tid, given)


def _event(
    phase: str, name: str, category: str, tick: int, pid: int, tid: int, args: dict[str, Any]
) -> Event:
    return {
        "name": name,
        "cat": category,
        "ph": phase,
        "ts": microseconds(tick),
        "pid": pid,
        "tid": tid,
        "args": args,
    }


def _slice(name: str, category: str, begin: int, end: int, pid: int, tid: int, args: dict[str, Any]) -> Event:
    event = _event("X", name, category, begin, pid, tid, args)
    event["dur"] = microseconds(end - begin)
    return event


def _instant(
    name: str, tick: int, pid: int, tid: int, args: dict[str, Any], category: str = "error"
) -> Event:
    event = _event("i", name, category, tick, pid, tid, args)
    event["s"] = "t"
    return event

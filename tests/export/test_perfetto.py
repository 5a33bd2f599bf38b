from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

import bussim
from bussim.errors import UsageError
from bussim.export import perfetto
from bussim.export.formats import export_trace
from bussim.trace.file import Trace, interval, read_trace
from bussim.trace.records import (
    AttemptRecord,
    CycleRecord,
    DeviceValueRecord,
    EndsRecord,
    FrameRecord,
    FreeRecord,
    NoteRecord,
    PollRecord,
    Record,
    ScanRecord,
    TransactionRecord,
)
from tests.export.samples import FEEDER, LINK, exported, frame, link_frames, trace
from tests.undrawn import undrawn

NUMBER, TEXT = {"type": "number"}, {"type": "string"}
COMMON = {
    "name": TEXT,
    "ts": NUMBER,
    "pid": {"type": "integer"},
    "tid": {"type": "integer"},
    "args": {"type": "object"},
}


def phase(letter: str, required: list[str], more: dict[str, Any]) -> dict[str, Any]:
    return {
        "properties": {**COMMON, "cat": TEXT, "ph": {"const": letter}, **more},
        "required": ["name", "ph", "pid", *required],
        "additionalProperties": False,
    }


#: The trace-event format ("Trace Event Format", Google, sections "JSON Object Format" and "Event
#: Descriptions"), as far as its phases X (complete), i (instant), C (counter) and M (metadata) go.
SCHEMA = {
    "type": "object",
    "required": ["traceEvents"],
    "properties": {
        "displayTimeUnit": {"enum": ["ms", "ns"]},
        "otherData": {"type": "object"},
        "traceEvents": {
            "type": "array",
            "items": {
                "oneOf": [
                    phase("X", ["ts", "tid", "dur", "cat"], {"dur": {"type": "number", "minimum": 0}}),
                    phase("i", ["ts", "tid", "s"], {"s": {"enum": ["g", "p", "t"]}}),
                    phase(
                        "C",
                        ["ts", "args"],
                        {"args": {"type": "object", "minProperties": 1, "additionalProperties": NUMBER}},
                    ),
                    phase(
                        "M",
                        ["args"],
                        {
                            "name": {
                                "enum": [
                                    "process_name",
                                    "process_sort_index",
                                    "thread_name",
                                    "thread_sort_index",
                                ]
                            }
                        },
                    ),
                ]
            },
        },
    },
}


def ticks(us: float) -> int:
    found = us * 72
    assert abs(found - round(found)) < 1e-3
    return round(found)


def events_of(path: Path) -> list[dict[str, Any]]:
    """The events, after the format was checked; metadata first, the others by time."""
    data = json.loads(path.read_text("utf-8"))
    Draft202012Validator(SCHEMA).validate(data)
    events: list[dict[str, Any]] = data["traceEvents"]
    head = sum(event["ph"] == "M" for event in events)
    assert all(event["ph"] == "M" for event in events[:head])
    rest = events[head:]
    assert [event["ts"] for event in rest] == sorted(event["ts"] for event in rest)
    named = {(event["pid"], event["tid"]) for event in events[:head] if event["name"] == "thread_name"}
    for event in rest:
        if event["ph"] != "C":
            assert (event["pid"], event["tid"]) in named
    return events


def track_names(events: list[dict[str, Any]]) -> dict[tuple[int, int], tuple[str, str]]:
    processes = {event["pid"]: event["args"]["name"] for event in events if event["name"] == "process_name"}
    return {
        (event["pid"], event["tid"]): (processes[event["pid"]], event["args"]["name"])
        for event in events
        if event["name"] == "thread_name"
    }


def slices(events: list[dict[str, Any]], category: str) -> list[tuple[int, int]]:
    return sorted(
        (ticks(event["ts"]), ticks(event["dur"]))
        for event in events
        if event["ph"] == "X" and event["cat"] == category
    )


def lengths(records: list[Record]) -> list[tuple[int, int]]:
    return sorted((begin, end - begin) for begin, end in map(interval, records))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Trace:
    folder = tmp_path_factory.mktemp("run") / "traced"
    with undrawn():
        bussim.run(bussim.load("nn_with_modbus", ["duration=4s"]), out=folder, trace=True)
    return read_trace(folder)


def test_every_record_of_a_run_is_a_slice_as_long_as_it_was(run: Trace, tmp_path: Path) -> None:
    events = events_of(exported(run, tmp_path / "a.json", "perfetto"))
    for category, kind in {
        "frame": FrameRecord,
        "scan": ScanRecord,
        "attempt": AttemptRecord,
        "transaction": TransactionRecord,
        "poll": PollRecord,
        "cycle": CycleRecord,
    }.items():
        records: list[Record] = list(run.of(kind))
        assert records
        assert slices(events, category) == lengths(records)
    names = track_names(events)
    senders = Counter((each.bus, each.sender) for each in run.of(FrameRecord))
    shown = Counter(
        names[event["pid"], event["tid"]]
        for event in events
        if event["ph"] == "X" and event["cat"] == "frame"
    )
    assert shown == {(f"bus {bus}", sender): count for (bus, sender), count in senders.items()}


def test_slices_of_a_track_never_overlap_but_nest(run: Trace, tmp_path: Path) -> None:
    events = events_of(exported(run, tmp_path / "a.json", "perfetto"))
    open_until: dict[tuple[int, int], list[int]] = {}
    for event in events:
        if event["ph"] == "X":
            begin, end = ticks(event["ts"]), ticks(event["ts"]) + ticks(event["dur"])
            stack = open_until.setdefault((event["pid"], event["tid"]), [])
            while stack and stack[-1] <= begin:
                stack.pop()
            assert not stack or end <= stack[-1], event
            stack.append(end)


def test_the_scans_of_a_program_lie_between_its_ends(tmp_path: Path) -> None:
    records = [
        EndsRecord("press1", (100, 300, 600)),
        EndsRecord("press2", (50,)),
        EndsRecord("press1", (650,)),
    ]
    events = events_of(exported(trace(*records), tmp_path / "a.json", "perfetto"))
    assert slices(events, "plc") == [(100, 200), (300, 300), (600, 50)]


def test_registers_are_counters(tmp_path: Path) -> None:
    records = [
        DeviceValueRecord(144, "press1", "D0", 7),
        DeviceValueRecord(7200, "press2", "M1064", 1),
        DeviceValueRecord(7201, "press1", "D0", 65535),
    ]
    events = events_of(exported(trace(*records), tmp_path / "a.json", "perfetto"))
    processes = {event["pid"]: event["args"]["name"] for event in events if event["name"] == "process_name"}
    counters = [
        (processes[event["pid"]], event["name"], ticks(event["ts"]), event["args"]["value"])
        for event in events
        if event["ph"] == "C"
    ]
    assert counters == [
        ("PLC press1", "D0", 144, 7),
        ("PLC press2", "M1064", 7200, 1),
        ("PLC press1", "D0", 7201, 65535),
    ]


def test_what_went_wrong_is_an_instant_where_it_happened(tmp_path: Path) -> None:
    hit = frame(LINK, 1000, "press2", b"\x0511A2", kind="poll", station=1, damaged=(4,))
    late = frame(LINK, 500_000, "press3", b"\x05", damaged_at={"press1": (2, 3)}, collided=True)
    records: list[Record] = [
        hit,
        AttemptRecord("link", 0, 400_000, 2, 1, "no reply", 1, None),
        NoteRecord(400_000, "station_error", "press1", "station 2: code 01", {"station": 2}),
        NoteRecord(420_000, "healthy", "link", "all well", {}),
        NoteRecord(430_000, "watchdog", "nowhere", "stopped", {}),
        late,
        TransactionRecord(
            "feeder", "press1.COM3", "p", 1, 17, 3, 0, 1, None, None, None, None, 600_000, 610_000,
            "no response in time", 9, 0, None, False, 8,
        ),
    ]  # fmt: skip
    events = events_of(exported(trace(*records, buses=(LINK, FEEDER)), tmp_path / "a.json", "perfetto"))
    names = track_names(events)
    found = {
        (event["name"], names[event["pid"], event["tid"]], ticks(event["ts"]))
        for event in events
        if event["ph"] == "i"
    }
    assert found == {
        ("poll 1: damaged bits", ("bus link", "press2"), hit.end),
        ("code 01: no reply", ("bus link", "attempts"), 400_000),
        ("station_error: station 2: code 01", ("bus link", "press1"), 400_000),
        ("healthy: all well", ("bus link", "notes"), 420_000),
        ("watchdog: stopped", ("faults and notes", "nowhere"), 430_000),
        ("data: damaged at press1", ("bus link", "press3"), late.end),
        ("error 9: no response in time", ("bus feeder", "press1.COM3 transactions"), 600_000),
    }
    categories = {event["cat"] for event in events if event["ph"] == "i"}
    assert categories == {"error", "station_error", "healthy", "watchdog"}
    (args,) = [event["args"] for event in events if event["ph"] == "X" and event["name"] == "poll 1"]
    assert args == {"protocol": "nn", "bytes": "05 31 31 41 32", "damaged bits": [4]}


def test_faults_last_from_their_beginning_to_their_end(tmp_path: Path) -> None:
    records = [
        NoteRecord(100, "fault", "faults.0", "press2 without supply", {"node": "press2"}),
        NoteRecord(300, "fault", "faults.1", "jabber", {}),
        NoteRecord(1100, "fault_over", "faults.0", "press2 without supply", {}),
        *link_frames(1),
    ]
    events = events_of(exported(trace(*records), tmp_path / "a.json", "perfetto"))
    until = link_frames(1)[0].start
    assert slices(events, "fault") == [(100, 1000), (300, until - 300)]


def test_free_protocol_calls_are_slices(tmp_path: Path) -> None:
    records = [
        FreeRecord("feeder", "press1.COM3", "scan", "received", 72, 720, b"AB", "timeout", 0),
        FreeRecord("feeder", "press1.COM3", "scan", "received", None, 900, b"", "timeout", 0),
    ]
    events = events_of(exported(trace(*records, buses=(FEEDER,)), tmp_path / "a.json", "perfetto"))
    assert slices(events, "free") == [(72, 648), (900, 0)]


def test_one_bus_and_a_window_leave_out_the_rest(run: Trace, tmp_path: Path) -> None:
    start, stop = 72_000_000, 2 * 72_000_000
    path = exported(run, tmp_path / "a.json", "perfetto", bus="feeder", start=start, stop=stop)
    events = events_of(path)
    expected: list[Record] = list(run.of(FrameRecord, bus="feeder", start=start, stop=stop))
    assert slices(events, "frame") == lengths(expected)
    assert not slices(events, "scan")


def test_nothing_to_show_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="the trace has no event; there is nothing to export"):
        export_trace(trace(), tmp_path / "a.json", "perfetto")
    assert not list(tmp_path.iterdir())


def test_too_much_for_a_browser_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(perfetto, "MOST_EVENTS", 9)
    with pytest.raises(UsageError, match="more than 9 events; choose less with --bus, --from and --to-time"):
        export_trace(trace(*link_frames(10)), tmp_path / "a.json", "perfetto")
    assert not list(tmp_path.iterdir())
    export_trace(trace(*link_frames(9)), tmp_path / "a.json", "perfetto")

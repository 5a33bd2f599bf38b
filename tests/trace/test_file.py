from __future__ import annotations

import json
from collections.abc import Iterable
from functools import partial
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import bussim
from bussim.errors import UsageError
from bussim.line.protocols import BusProtocol
from bussim.scenario.build.trace_header import trace_header
from bussim.trace.file import TRACE, Trace, TraceWriter, interval, read_trace, trace_of
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
    TraceBus,
    TraceHeader,
    TransactionRecord,
)
from bussim.wording import visible

LINK = TraceBus("link", BusProtocol.NN, 38400, "7E1", ("press1", "press2"), {"press1": 0, "press2": 1})
FEEDER = TraceBus("feeder", BusProtocol.SERIAL, 9600, "8N1", ("press1.COM3", "feeder1"), {"feeder1": 1})
HEADER = TraceHeader((LINK, FEEDER), "three presses", 7, 72_000_000)

names = st.text(alphabet=st.characters(codec="utf-8"), max_size=8).map(visible)
buses = st.sampled_from(["link", "feeder", "elsewhere"])
ticks = st.integers(0, 2**59)
counts = st.integers(0, 300)
maybe = ticks | st.none()
bits = st.lists(counts, max_size=4).map(tuple)
text_or_int = st.integers(-(2**40), 2**40) | names

FRAMES = st.builds(
    FrameRecord,
    bus=buses,
    start=ticks,
    end=ticks,
    sender=names,
    kind=names,
    station=counts | st.none(),
    counter=counts | st.none(),
    chars=st.binary(max_size=20),
    damaged_bits=bits,
    damaged_at=st.dictionaries(names, bits, max_size=2),
    collided=st.booleans(),
    cut=st.booleans(),
    protocol=st.sampled_from(["nn", "modbus-rtu", "modbus-ascii", "free"]),
    baud=st.sampled_from([9600, 38400]),
    format=st.sampled_from(["7E1", "8N1"]),
    ppm=st.floats(-1e5, 1e5, allow_nan=False),
    released=st.none() | st.integers(1, 2**59),  # it is later than the end
    pauses=st.lists(st.tuples(counts, ticks), max_size=3).map(tuple),
)
SCANS = st.builds(ScanRecord, buses, counts, ticks, ticks, counts, counts, counts, names)
ATTEMPTS = st.builds(AttemptRecord, buses, ticks, ticks, counts, counts, names, counts, maybe)
TRANSACTIONS = st.builds(
    TransactionRecord,
    *(buses, names, names, *(counts,) * 5, *(maybe,) * 4, ticks, ticks, names),
    *(counts | st.none(), counts, maybe, st.booleans(), counts),
)
POLLS = st.builds(PollRecord, buses, names, names, ticks, ticks, counts, counts | st.none(), ticks)
CYCLES = st.builds(CycleRecord, buses, names, counts, ticks, ticks)
FREES = st.builds(FreeRecord, buses, names, names, names, maybe, ticks, st.binary(max_size=20), names, counts)
VALUES = st.builds(DeviceValueRecord, ticks, names, names, st.integers(-(2**31), 2**32))
ENDS = st.builds(EndsRecord, names, st.lists(ticks, max_size=5).map(tuple))
NOTES = st.builds(NoteRecord, ticks, names, names, names, st.dictionaries(names, text_or_int, max_size=3))
KINDS = [FRAMES, SCANS, ATTEMPTS, TRANSACTIONS, POLLS, CYCLES, FREES, VALUES, ENDS, NOTES]


def written(path: Path, records: Iterable[Record], header: TraceHeader = HEADER) -> Path:
    writer = TraceWriter(path.open("w", encoding="utf-8", newline="\n"), header)
    for record in records:
        writer.write(record)
    writer.close()
    return path


@given(st.lists(st.one_of(KINDS), max_size=12))
def test_every_record_comes_back(tmp_path_factory: pytest.TempPathFactory, records: list[Record]) -> None:
    path = written(tmp_path_factory.mktemp("trace") / TRACE, records)
    trace = read_trace(path)
    assert trace.header == HEADER
    assert list(trace) == records
    assert [list(map(type, record)) for record in trace] == [list(map(type, record)) for record in records]
    assert list(read_trace(path.parent)) == records  # the folder will do
    for kind in {type(record) for record in records}:
        assert list(trace.of(kind)) == [record for record in records if type(record) is kind]


@given(st.lists(st.one_of(KINDS), max_size=12), st.integers(0, 3), ticks, ticks)
def test_a_file_and_memory_are_filtered_alike(
    tmp_path_factory: pytest.TempPathFactory, records: list[Record], choice: int, start: int, stop: int
) -> None:
    there = read_trace(written(tmp_path_factory.mktemp("trace") / TRACE, records))
    here = trace_of(HEADER, records)
    kinds: tuple[type[Record], ...] = (FrameRecord, NoteRecord, EndsRecord)[:choice]
    for bus in (None, "link"):
        seen = list(there.records(*kinds, bus=bus, start=start, stop=stop))
        assert seen == list(here.records(*kinds, bus=bus, start=start, stop=stop))
        assert set(map(type, seen)) <= set(kinds or map(type, records))


def test_headers_come_back(tmp_path: Path) -> None:
    for header in (HEADER, TraceHeader(), TraceHeader(exact=False, duration=None, scenario="ttyUSB0")):
        assert read_trace(written(tmp_path / "t.jsonl", [], header)).header == header


def test_lines_are_plain_and_short(tmp_path: Path) -> None:
    frame = FrameRecord("feeder", 5, 90, "a", "request", 1, None, b"\x01\x03", (), {}, False, False)
    usual = frame._replace(protocol="modbus-rtu", baud=9600, format="8N1")
    odd = usual._replace(baud=4800, ppm=30.0)
    lines = written(tmp_path / TRACE, [usual, odd]).read_text().splitlines()
    assert lines[0].startswith('{"type":"trace","schema":1,"tick_hz":72000000,')
    assert json.loads(lines[0])["buses"]["feeder"] == {
        "nn": False, "baud": 9600, "format": "8N1", "nodes": ["press1.COM3", "feeder1"],
        "stations": {"feeder1": 1},
    }  # fmt: skip
    assert json.loads(lines[1]) == {
        "type": "frame", "tick": 5, "bus": "feeder", "end": 90, "sender": "a", "kind": "request", "station": 1,
        "counter": None, "chars": "0103", "damaged_bits": [], "damaged_at": {}, "collided": False, "cut": False,
        "protocol": "modbus-rtu",
    }  # fmt: skip
    assert json.loads(lines[2]).keys() - json.loads(lines[1]).keys() == {"baud", "ppm"}


CYCLE = CycleRecord("feeder", "press1.COM3", 0, 100, 50)
NEVER_SENT = TransactionRecord(
    "feeder", "press1.COM3", "p", 1, 1, 3, 0, 2, None, None, None, None, 300, 310, "x", 4, 0, None, False, 0
)


@pytest.mark.parametrize(
    ("record", "expected"),
    [
        (FrameRecord("link", 5, 90, "a", "poll", 1, 0, b"1", (), {}, False, False), (5, 90)),
        (ScanRecord("link", 0, 7, 3, 1, 0, 0, ""), (7, 10)),
        (AttemptRecord("link", 1, 4, 1, 1, "ok", 0, 2), (1, 4)),
        (CYCLE, (100, 150)),
        (NEVER_SENT, (300, 310)),
        (NEVER_SENT._replace(sent=200), (200, 310)),
        (PollRecord("feeder", "m", "p", 20, 60, 1, None, 0), (20, 60)),
        (FreeRecord("feeder", "m", "p", "received", None, 60, b"", "timeout", 0), (60, 60)),
        (FreeRecord("feeder", "m", "p", "sent", 10, 60, b"1", "", 0), (10, 60)),
        (DeviceValueRecord(9, "press1", "D1", 2), (9, 9)),
        (NoteRecord(8, "fault", "f", "", {}), (8, 8)),
        (EndsRecord("press1", (3, 6, 9)), (3, 9)),
    ],
)
def test_a_window_takes_what_touches_it(record: Record, expected: tuple[int, int]) -> None:
    begin, end = expected
    assert interval(record) == expected
    trace = trace_of(HEADER, [record])
    assert list(trace.records(start=end, stop=end + 1))
    assert list(trace.records(start=begin, stop=begin + 1))
    assert list(trace.records(stop=begin + 1))
    assert list(trace.records(start=begin))
    assert not list(trace.records(stop=begin))
    assert not list(trace.records(start=end + 1))


def test_ends_are_cut_to_the_window() -> None:
    trace = trace_of(HEADER, [EndsRecord("press1", (3, 6, 9, 12))])
    assert list(trace.of(EndsRecord, start=4, stop=12)) == [EndsRecord("press1", (6, 9))]
    assert list(trace.of(EndsRecord, start=7, stop=9)) == []


def test_a_bus_has_its_records_its_plcs_and_its_notes() -> None:
    mine: list[Record] = [
        CYCLE,
        EndsRecord("press1", (1,)),
        DeviceValueRecord(1, "press1", "D1", 2),
        NoteRecord(1, "undetected", "feeder1", "", {}),
        NoteRecord(1, "healthy", "feeder", "", {}),
        NoteRecord(1, "fault", "drop", "", {"node": "press1.COM3"}),
        NoteRecord(1, "fault", "cut", "", {"bus": "feeder"}),
    ]
    others: list[Record] = [
        ScanRecord("link", 0, 7, 3, 1, 0, 0, ""),
        EndsRecord("press2", (1,)),
        DeviceValueRecord(1, "press2", "D1", 2),
        NoteRecord(1, "healthy", "link", "", {}),
        NoteRecord(1, "fault", "drop", "", {"node": "press2"}),
    ]
    trace = trace_of(HEADER, [*others, *mine, *others])
    assert list(trace.records(bus="feeder")) == mine
    with pytest.raises(UsageError, match="no bus 'lonk'; it has link, feeder"):
        trace.records(bus="lonk")


def test_records_are_read_as_they_are_asked_for(tmp_path: Path) -> None:
    path = written(tmp_path / TRACE, [CYCLE] * 3)
    with path.open("a") as file:
        file.write("no JSON\n")
    trace = read_trace(path)
    records = iter(trace)
    assert [next(records) for _ in range(3)] == [CYCLE] * 3
    with pytest.raises(UsageError, match=r"trace\.jsonl:5: is not a line of a trace: is not JSON"):
        next(records)


def test_a_recording_that_was_killed_is_read_to_its_last_whole_line(tmp_path: Path) -> None:
    path = written(tmp_path / TRACE, [CYCLE, CYCLE])
    whole = path.read_bytes()
    last = whole.rstrip(b"\n").rfind(b"\n") + 1
    for length in range(last, len(whole)):
        path.write_bytes(whole[:length])
        assert list(read_trace(path)) == [CYCLE] * (1 + (length == len(whole) - 1))


def test_lines_of_a_later_version_are_passed_over(tmp_path: Path) -> None:
    path = written(tmp_path / TRACE, [CYCLE])
    with path.open("a") as file:
        file.write('{"type":"wavelet","tick":1}\n')
    assert list(read_trace(path)) == [CYCLE]


def test_a_mark_at_its_beginning_is_no_part_of_a_file(tmp_path: Path) -> None:
    path = written(tmp_path / TRACE, [CYCLE])
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert list(read_trace(path)) == [CYCLE]


@pytest.mark.parametrize("kinds", [(), (FrameRecord,)])
def test_two_traces_behind_each_other_are_refused(kinds: tuple[type[Record], ...], tmp_path: Path) -> None:
    path = written(tmp_path / TRACE, [CYCLE])
    path.write_bytes(path.read_bytes() * 2)
    with pytest.raises(UsageError, match=r"trace\.jsonl:3: is not a line of a trace: begins another trace"):
        list(read_trace(path).records(*kinds))


def test_a_file_that_another_program_wrote_anew_has_the_same_records(tmp_path: Path) -> None:
    frame = FrameRecord("link", 1, 2, "press1", "poll", 1, 0, b"x", (), {}, False, False)
    path = written(tmp_path / TRACE, [frame, CYCLE, frame])
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    for rewritten in (json.dumps, partial(json.dumps, sort_keys=True)):
        path.write_text("".join(f"{rewritten(line)}\n" for line in lines))
        trace = read_trace(path)
        assert list(trace) == [frame, CYCLE, frame]
        assert list(trace.of(FrameRecord)) == [frame, frame]
        assert list(trace.of(CycleRecord)) == [CYCLE]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"tick": "1"}, "tick is '1', not a whole number"),
        ({"tick": True}, "tick is True, not a whole number"),
        ({"end": None}, "end is None, not a whole number"),
        ({"chars": "0g"}, "chars "),
        ({"sender": 4}, "sender is 4, not a text"),
        ({"cut": 1}, "cut is 1, not true or false"),
        ({"ppm": "x"}, "ppm is 'x', not a number"),
        ({"damaged_bits": 5}, "damaged_bits is 5, not a list"),
        ({"damaged_at": [1]}, r"damaged_at is \[1\], not an object"),
        ({"bus": "elsewhere"}, "baud is missing"),
        ({"type": 7}, "type is 7, not a text"),
        ({"protocol": "1e30h"}, "protocol is '1e30h', not one of nn, modbus-rtu, modbus-ascii, free"),
        ({"protocol": ["nn"]}, r"protocol is \['nn'\], not a text"),
    ],
)
def test_a_damaged_line_is_reported(tmp_path: Path, change: dict[str, object], message: str) -> None:
    frame = FrameRecord("link", 5, 90, "a", "poll", 1, 0, b"1", (), {}, False, False)
    path = written(tmp_path / TRACE, [frame])
    header, line = path.read_text().splitlines()
    path.write_text(f"{header}\n{json.dumps({**json.loads(line), **change})}\n")
    with pytest.raises(UsageError, match=rf"trace\.jsonl:2: is not a line of a trace: {message}"):
        list(read_trace(path))


@pytest.mark.parametrize(
    ("first", "message"),
    [
        ("", "is not JSON"),
        ("[" * 100_000, "is not"),
        ("[]", "is not a JSON object"),
        ('{"type":"frame"}', "is not the header of a trace"),
        ('{"type":"trace","schema":2}', "has schema 2; this bussim reads up to 1"),
        ('{"type":"trace","schema":1,"tick_hz":1000}', "counts 1000 ticks a second, not 72000000"),
        ('{"type":"trace","schema":1,"tick_hz":72000000}', "buses is missing"),
    ],
)
def test_what_is_no_trace_is_refused(tmp_path: Path, first: str, message: str) -> None:
    path = tmp_path / "t.jsonl"
    path.write_text(first)
    with pytest.raises(UsageError, match=message):
        read_trace(path)


def test_what_is_not_there_is_said(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"has no trace\.jsonl: it was run without a trace"):
        read_trace(tmp_path)
    with pytest.raises(UsageError, match="does not exist"):
        read_trace(tmp_path / "t.jsonl")
    (tmp_path / "t.jsonl").write_bytes(b"\xff\xfe\n")
    with pytest.raises(UsageError, match="is not a trace"):
        read_trace(tmp_path / "t.jsonl")


@pytest.mark.usefixtures("pictures_undrawn")
def test_a_run_is_traced_whole(tmp_path: Path) -> None:
    scenario = bussim.load("press_line", ["duration=1 s"])
    written = bussim.run(scenario, trace=True, out=tmp_path / "run")
    memory = bussim.run(scenario, trace=True)
    trace: Trace = written.open_trace()
    assert trace.header == memory.open_trace().header == trace_header(scenario)
    assert list(trace) == list(memory.open_trace())
    link = trace.bus("link")
    assert link.nodes == ("press1", "press2", "press3")
    assert link.stations == {"press1": 0, "press2": 1, "press3": 2}
    scans = list(trace.of(ScanRecord))
    assert len(scans) == written.summary["links"]["link"]["scans"] > 10
    # Every attempt of a scan lies in the window of that scan.
    scan = scans[5]
    inside = list(trace.of(AttemptRecord, start=scan.start, stop=scan.start + scan.duration))
    assert (
        sum(scan.start <= attempt.start < scan.start + scan.duration for attempt in inside) == scan.attempts
    )
    frames = list(trace.of(FrameRecord, bus="link"))
    assert {frame.sender for frame in frames} == set(link.nodes)

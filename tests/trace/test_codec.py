from __future__ import annotations

import json
from pathlib import Path
from typing import Any, get_args

import pytest

from bussim.errors import UsageError
from bussim.trace.codec import LineTexts, from_line, header_line, header_of, to_line, type_of
from bussim.trace.file import TRACE, read_trace
from bussim.trace.records import (
    AttemptRecord,
    EndsRecord,
    FrameRecord,
    PollRecord,
    Record,
    ScanRecord,
    TraceHeader,
)

#: Folders of runs that were written by bussim 0.1.0 and stay as they are.
STORED = Path(__file__).parents[1] / "results" / "stored"
RUNS = sorted(path.name for path in STORED.iterdir())
RECORDS: tuple[type[Record], ...] = get_args(Record)


def lines_of(run: str) -> list[dict[str, Any]]:
    with (STORED / run / TRACE).open(encoding="utf-8") as file:
        return [json.loads(line) for line in file]


def test_every_type_of_record_is_in_a_stored_trace() -> None:
    stored = {line["type"] for run in RUNS for line in lines_of(run)}
    assert stored == {"trace", *map(type_of, RECORDS)}


@pytest.mark.parametrize("run", RUNS)
def test_a_trace_of_an_earlier_version_is_read_and_keeps_its_keys(run: str) -> None:
    header, *lines = lines_of(run)
    trace = read_trace(STORED / run)
    assert header_line(trace.header).items() >= header.items()
    buses = {bus.name: bus for bus in trace.header.buses}
    for line, record in zip(lines, trace, strict=True):
        again = json.loads(json.dumps(to_line(record, buses)))
        assert again.items() >= line.items()
        known = [key for key in again if key in line]
        assert known == list(line)  # in their order


def _encoded(line: dict[str, Any]) -> str:
    return json.dumps(line, ensure_ascii=False, separators=(",", ":"))


@pytest.mark.parametrize("run", RUNS)
def test_texts_of_lines_are_those_of_their_objects(run: str) -> None:
    trace = read_trace(STORED / run)
    buses = {bus.name: bus for bus in trace.header.buses}
    texts = LineTexts(_encoded, buses)
    names = ('50 % "of" %d\\', "\0", "\u7ebf")
    for number, record in enumerate(trace):
        name = "plc" if "plc" in record._fields else "bus" if "bus" in record._fields else "where"
        for each in (record, record._replace(**{name: names[number % 3]})):
            assert texts.of(each) == _encoded(to_line(each, buses))


def test_recurring_lines_differ_in_their_numbers_alone() -> None:
    texts, scan = LineTexts(_encoded, {}), ScanRecord("link", 0, 7, 3, 1, 0, 0, "")
    attempt = AttemptRecord("link", 1, 2, 3, 1, "ok", 0, 5)
    frame = FrameRecord("link", 5, 9, "p0", "data", 0, 1, b"ab", (), {}, collided=False, cut=False)
    for record in (scan, attempt, frame, attempt._replace(turnaround=None)):
        for changes in ({}, {"start": 11}, {"start": 2**60}, {"bus": "other"}):
            changed = record._replace(**changes)
            assert texts.of(changed) == _encoded(to_line(changed, {}))
    for name in ("p0", '%d "1"', "线"):
        for ticks in ((), (7,), (7, 2**60)):
            ends = EndsRecord(name, ticks)
            assert texts.of(ends) == _encoded(to_line(ends, {}))
    damaged = frame._replace(damaged_at={"p1": (3,)}, pauses=((1, 20),), released=30)
    assert texts.of(damaged) == _encoded(to_line(damaged, {}))
    for number in range(10_000):  # as many as are kept, and more
        image = frame._replace(chars=number.to_bytes(2, "big"), start=number)
        assert texts.of(image) == _encoded(to_line(image, {}))


@pytest.mark.parametrize("record", RECORDS, ids=type_of)
def test_keys_of_a_later_version_are_left_out(record: type[Record]) -> None:
    run, line = next((run, line) for run in RUNS for line in lines_of(run) if line["type"] == type_of(record))
    buses = {bus.name: bus for bus in read_trace(STORED / run).header.buses}
    assert from_line({**line, "phase": 3}, buses) == from_line(line, buses)


@pytest.mark.parametrize("record", RECORDS, ids=type_of)
def test_a_field_with_a_default_may_be_missing_and_no_other(record: type[Record]) -> None:
    run, line = next((run, line) for run in RUNS for line in lines_of(run) if line["type"] == type_of(record))
    buses = {bus.name: bus for bus in read_trace(STORED / run).header.buses}
    whole = from_line(line, buses)
    assert whole is not None
    for name in record._fields:
        key = "tick" if name == "start" and "start" not in line else name
        if name in record._field_defaults and not (record is FrameRecord and name in ("baud", "format")):
            found = from_line({k: v for k, v in line.items() if k != key}, buses)
            assert found == whole._replace(**{name: record._field_defaults[name]})
        elif key in line:
            with pytest.raises(ValueError, match=f"{key} is missing"):
                from_line({k: v for k, v in line.items() if k != key}, buses)


def test_a_header_lacks_what_was_added_later() -> None:
    header = header_of({"type": "trace", "schema": 1, "tick_hz": 72_000_000, "buses": {}, "later": 1})
    assert header == TraceHeader()


def test_ticks_are_called_tick_where_they_are_always_known() -> None:
    scan = to_line(ScanRecord("link", 0, 7, 3, 1, 0, 0, ""), {})
    assert list(scan)[:3] == ["type", "tick", "bus"]
    assert scan["tick"] == 7
    assert list(to_line(PollRecord("b", "m", "p", 20, 60, 1, None, 0), {}))[:2] == ["type", "tick"]


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("tick", 10**30, "tick is beyond every run"),
        ("tick", -(2**62), "tick is beyond every run"),
        ("tick", True, "tick is True, not a whole number"),
    ],
)
def test_numbers_that_no_run_has(key: str, value: object, message: str) -> None:
    line = next(line for line in lines_of("interlock") if line["type"] == "scan")
    with pytest.raises(ValueError, match=message):
        from_line({**line, key: value}, {})


def test_a_text_that_a_terminal_would_obey_stands_in_escapes() -> None:
    line = next(line for line in lines_of("interlock") if line["type"] == "scan")
    record = from_line({**line, "cause": "\x1b[31mred\u202e"}, {})
    assert isinstance(record, ScanRecord)
    assert record.cause == "\\x1b[31mred\\u202e"


def test_nan_is_no_number_of_a_trace(tmp_path: Path) -> None:
    header, *_ = (STORED / "interlock" / TRACE).read_text(encoding="utf-8").splitlines()
    (tmp_path / TRACE).write_text(f'{header}\n{{"type":"frame","ppm":NaN}}\n', encoding="utf-8")
    with pytest.raises(UsageError, match="NaN is no number of JSON"):
        list(read_trace(tmp_path))


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("baud", 0, "baud is 0, not 1 to 100,000,000"),
        ("format", "inf", "format is 'inf', not a character format"),
        ("ppm", -1e6, "ppm is -1000000.0, not -500,000 to 500,000"),
    ],
)
def test_lines_that_nothing_drives(key: str, value: object, message: str) -> None:
    header, line = (
        next(x for x in lines_of("interlock") if x["type"] == kind) for kind in ("trace", "frame")
    )
    with pytest.raises(ValueError, match=message):
        from_line({**line, key: value}, {bus.name: bus for bus in header_of(header).buses})
    header["buses"]["link"][key] = value
    if key != "ppm":
        with pytest.raises(ValueError, match=message):
            header_of(header)

"""Records that come many at once are to everybody who takes them what they are one by one."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from bussim.results.store.in_memory import MemoryRows
from bussim.results.store.rows import FileRows
from bussim.trace.blocks import Alike, RecordBlock, in_turn, pieces
from bussim.trace.file import read_trace
from bussim.trace.records import AttemptRecord, EndsRecord, FrameRecord, ScanRecord, TraceHeader

FRAME = FrameRecord("a %d", 0, 0, 'plc "1"', "data", 1, 0, b"", (), {}, collided=False, cut=False)


def frames(number: int, first: int) -> Alike:
    starts = first + 3_000_000 * np.arange(number)
    chars = np.array([b"%02X\x03" % index for index in range(number)], object)
    counters = np.arange(number) & 15
    return Alike(FRAME, {"start": starts, "end": starts + 93_750, "counter": counters, "chars": chars})


def attempts(number: int, first: int, station: int) -> Alike:
    starts = first + 3_000_000 * np.arange(number)
    pattern = AttemptRecord("a %d", 0, 0, station, 1, "ok", 0, 0)
    return Alike(pattern, {"start": starts, "end": starts + 700_001, "turnaround": 7 + np.arange(number)})


def scans(number: int, first: int) -> Alike:
    starts = first + 3_000_000 * np.arange(number)
    durations = np.full(number, 3_000_000)
    varying = {"start": starts, "number": 5 + np.arange(number), "duration": durations}
    return Alike(ScanRecord("a %d", 0, 0, 0, 2, 0, 0, ""), varying)


BLOCKS: list[RecordBlock] = [
    [frames(40, 100), attempts(40, 100, 1), attempts(40, 900_000, 2), frames(39, 3_000_100), scans(39, 100)],
    [frames(1, 7), attempts(1, 7, 1)],
    [scans(3, 0)],
]


def test_columns_take_turns() -> None:
    assert list(in_turn(["adg", "be", "cf"])) == list("abcdefg")
    assert list(in_turn([["a"]])) == ["a"]


def test_the_next_break_is_asked_for_after_the_piece_before_it() -> None:
    seen: list[object] = []

    def breaks() -> Iterator[int]:
        for index in (0, 2, 2, 5):
            yield index
            seen.append(index)

    seen.extend("".join(piece) for piece in pieces("abcde", breaks()))
    assert seen == ["", 0, "ab", 2, "", 2, "cde", 5, ""]


@pytest.mark.parametrize("block", BLOCKS)
def test_records_have_plain_values_in_their_order(block: RecordBlock) -> None:
    records = list(in_turn(each.records() for each in block))
    assert len(records) == sum(len(each.varying["start"]) for each in block)
    for index, record in enumerate(records):
        column, row = block[index % len(block)], index // len(block)
        values = {name: values[row] for name, values in column.varying.items()}
        assert record == column.pattern._replace(**values)
        assert {type(value) for value in record} <= {int, str, bytes, bool, tuple, dict, float, type(None)}


@pytest.mark.parametrize("fmt", ["csv", "parquet", "memory"])
@pytest.mark.parametrize("block", BLOCKS)
def test_files_and_memory_are_those_of_single_records(block: RecordBlock, fmt: str, tmp_path: Path) -> None:
    records = list(in_turn(each.records() for each in block))
    ends = [EndsRecord("p", (index,)) for index in range(0, len(records), 7)]
    found = []
    for at_once in (True, False):
        folder = tmp_path / str(at_once)
        folder.mkdir()
        rows: FileRows | MemoryRows = MemoryRows(rows=True, traced=True)
        if fmt != "memory":
            rows = FileRows(folder, rows=True, traced=True, fmt=fmt, header=TraceHeader())

        def breaks(rows: FileRows | MemoryRows = rows) -> Iterator[int]:
            for each in ends:
                yield each.ticks[0]
                rows.take(each)

        if at_once:
            rows.take_many(block, breaks())
        else:
            for index, record in enumerate(records):
                if not index % 7:
                    rows.take(ends[index // 7])
                rows.take(record)
        if isinstance(rows, MemoryRows):
            found.append([rows.trace(), rows.table(ScanRecord).to_csv(), rows.table(AttemptRecord).to_csv()])
        else:
            rows.close()
            assert [each for each in read_trace(folder) if not isinstance(each, EndsRecord)] == records
            found.append([(path.name, path.read_bytes()) for path in sorted(folder.iterdir())])
    assert found[0] == found[1]

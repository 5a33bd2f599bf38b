from __future__ import annotations

import csv
import sys
from fractions import Fraction
from pathlib import Path

import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

import bussim
from bussim.errors import UsageError
from bussim.results.store.in_memory import MemoryRows
from bussim.results.store.load import FolderRows
from bussim.results.store.rows import SCANS, FileRows
from bussim.results.store.safe_names import cell, file_name, file_names, from_cell
from bussim.results.store.tables import INT, TEXT, CsvTable, open_table
from bussim.trace.records import AttemptRecord, ScanRecord
from bussim.units import TICKS_PER_SECOND, nanoseconds
from tests.results.fakes import Fake

#: The first columns, which stay; others may be added behind them.
HEADER = "bus,index,start_s,duration_ms,attempts,failed,stations_in_error"
FAKE = Fake(duration=20 * TICKS_PER_SECOND, bus="=link,1")


def written(folder: Path, fmt: str, fake: Fake = FAKE) -> Path:
    rows = FileRows(folder, rows=True, traced=True, fmt=fmt)
    fake.run(traced=True, rows=rows)
    rows.close()
    return folder


@given(st.integers(0, 10**16))
def test_nanoseconds_are_the_nearest(ticks: int) -> None:
    assert abs(Fraction(ticks * 125, 9) - nanoseconds(ticks)) < Fraction(1, 2)


def test_csv_is_what_rfc_4180_and_a_spreadsheet_want(tmp_path: Path) -> None:
    written(tmp_path, "csv")
    raw = (tmp_path / "link_scans.csv").read_bytes()
    lines = raw.decode().split("\r\n")
    assert lines[0].startswith(HEADER)
    assert lines[-1] == ""
    assert raw.count(b"\n") == raw.count(b"\r\n")
    # A comma in a name is quoted, and a name that looks like a formula is no formula.
    assert lines[1].startswith('"\'=link,1",0,0.000000000,')
    with (tmp_path / "link_scans.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert {len(row) for row in rows} == {len(SCANS.kinds)}
    assert all(float(row["duration_ms"]) > 49 for row in rows)


ROW = "link,3,1.000000014,50.000069,8,2,1"


def test_a_row_says_what_the_record_said(tmp_path: Path) -> None:
    rows = FileRows(tmp_path, rows=True, traced=False, fmt="csv")
    rows.take(ScanRecord("link", 3, 72_000_001, 3_600_005, 8, 2, 1, "cause"))
    rows.close()
    lines = (tmp_path / "link_scans.csv").read_text().splitlines()
    assert [line[: len(start)] for line, start in zip(lines, (HEADER, ROW), strict=True)] == [HEADER, ROW]
    assert [path.name for path in tmp_path.iterdir()] == ["link_scans.csv"]


def test_all_formats_and_memory_give_the_same_tables(tmp_path: Path) -> None:
    memory = MemoryRows(rows=True, traced=True)
    FAKE.run(traced=True, rows=memory)
    for fmt in ("csv", "parquet"):
        folder = tmp_path / fmt
        folder.mkdir()
        stored = FolderRows(written(folder, fmt))
        pd.testing.assert_frame_equal(stored.table(ScanRecord), memory.table(ScanRecord), check_exact=True)
        pd.testing.assert_frame_equal(
            stored.table(AttemptRecord), memory.table(AttemptRecord), check_exact=True
        )
        assert stored.trace() == memory.trace()
    scans = memory.table(ScanRecord)
    assert list(scans.columns) == list(SCANS.kinds)
    assert set(scans["bus"]) == {"=link,1"}
    assert scans["start_s"].is_monotonic_increasing
    exchanges = memory.table(AttemptRecord)
    assert set(exchanges["code"]) == {"00", "01"}
    assert exchanges["turnaround_ms"].isna().equals(exchanges["outcome"] == "no reply")


def test_tables_of_a_run_without_scans_have_their_columns(tmp_path: Path) -> None:
    memory = MemoryRows(rows=True, traced=True)
    assert list(memory.table(ScanRecord).columns) == list(SCANS.kinds)
    for fmt in ("csv", "parquet"):
        FileRows(tmp_path, rows=True, traced=True, fmt=fmt).close()
        stored = FolderRows(tmp_path)
        pd.testing.assert_frame_equal(stored.table(ScanRecord), memory.table(ScanRecord))
        pd.testing.assert_frame_equal(stored.table(AttemptRecord), memory.table(AttemptRecord))
        (tmp_path / f"link_scans.{fmt}").unlink()
        (tmp_path / f"exchanges.{fmt}").unlink()


def test_parquet_is_written_in_row_groups_and_is_the_same_every_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from pyarrow import parquet

    monkeypatch.setattr("bussim.results.store.tables._ROW_GROUP", 100)
    contents = []
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        path = written(tmp_path / name, "parquet") / "link_scans.parquet"
        contents.append(path.read_bytes())
    assert contents[0] == contents[1]
    file = parquet.ParquetFile(path)
    assert file.metadata.num_row_groups == -(-file.metadata.num_rows // 100) > 1


def test_without_pyarrow_the_message_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(UsageError, match=r"bussim\[parquet\]"):
        open_table(tmp_path / "link_scans.parquet", {"bus": TEXT})


def test_what_was_not_kept_is_said(tmp_path: Path) -> None:
    memory = MemoryRows(rows=False, traced=False)
    for kept in (memory, FolderRows(tmp_path)):
        for kind, word in ((ScanRecord, "rows"), (AttemptRecord, "trace")):
            with pytest.raises(UsageError, match=word):
                kept.table(kind)
        with pytest.raises(UsageError, match="trace"):
            kept.trace()


@given(st.text(max_size=20))
def test_a_cell_is_never_a_formula_and_reads_back(text: str) -> None:
    assert cell(text)[:1] not in {"=", "+", "-", "@", "\t", "\r"}
    assert from_cell(cell(text)) == text


@given(st.text(alphabet=st.characters(codec="utf-8"), max_size=8))
def test_any_text_survives_csv(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    path = tmp_path_factory.mktemp("csv") / "t.csv"
    table = CsvTable(path, {"bus": TEXT, "number": INT})
    table.append((text, 1))
    table.close()
    with path.open(newline="", encoding="utf-8") as file:
        (row,) = list(csv.reader(file))[1:]
    assert [from_cell(row[0]), row[1]] == [text, "1"]


@pytest.mark.parametrize(
    ("name", "safe"),
    [
        ("link", "link"),
        ("three presses", "three_presses"),
        ("a/b\\c:d*e?f", "a_b_c_d_e_f"),
        ("..", "_"),
        ("", "_"),
        ("CON", "_CON"),
        ("com7.x", "_com7.x"),
        ("Presse Süd", "Presse_Süd"),
        ("x" * 100, "x" * 60),
    ],
)
def test_file_names(name: str, safe: str) -> None:
    assert file_name(name) == safe


@given(st.lists(st.text(max_size=70), unique=True, max_size=8))
def test_file_names_are_safe_and_different_on_every_system(names: list[str]) -> None:
    safe = file_names(names)
    assert list(safe) == names
    assert len({name.casefold() for name in safe.values()}) == len(names)
    for name in safe.values():
        assert name.strip(". ") == name != ""
        assert not set(name) & set('<>:"/\\|?*\0\n ')


def test_a_run_fills_every_column() -> None:
    result = bussim.run(bussim.load("press_line", ["duration=1 s"]), trace=True)
    for table in (result.link_scans, result.exchanges):
        assert table.notna().any().all(), table.isna().all()

from __future__ import annotations

import csv
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from bussim.errors import UsageError
from bussim.sweep.intervals import mean_of
from bussim.sweep.plan import Plan
from bussim.sweep.result import SweepResult
from bussim.sweep.tables import (
    POINTS,
    RUNS,
    Table,
    figure_names,
    mean_at,
    points_table,
    read_csv,
    runs_table,
    write_csv,
    write_parquet,
)
from tests.sweep.samples import RETRIES, TIMEOUT, noisy

#: Scan counts and error counts of four runs: two points, two repeats.
ENTRIES = [
    (3, {"link.scans": 13, "link.failed_attempts": 2, "link.failed_attempts_04": 2, "link.mean_ms": 1.5}),
    (0, {"link.scans": 10, "link.failed_attempts": 0, "link.mean_ms": 0.1}),
    (2, {"link.scans": 12, "link.failed_attempts": 5, "link.failed_attempts_01": 5, "link.mean_ms": None}),
    (1, {"link.scans": 11, "link.failed_attempts": 0, "link.mean_ms": 0.2}),
]


@pytest.fixture
def plan(tmp_path: Path) -> Plan:
    return Plan(noisy(tmp_path), [f"{TIMEOUT}=50ms,0.1s"], repeat=2)


@pytest.fixture
def runs(plan: Plan) -> Table:
    return runs_table(plan, ENTRIES)  # type: ignore[arg-type] # mypy infers object


def test_one_row_a_run_whatever_the_order_of_the_outcomes(plan: Plan, runs: Table) -> None:
    assert runs == {
        "run": [1, 2, 3, 4],
        "point": [1, 1, 2, 2],
        f"{TIMEOUT}_ms": [50, 50, 100, 100],
        "repeat": [1, 2, 1, 2],
        "seed": [plan.seed(run) for run in range(4)],
        "link.scans": [10, 11, 12, 13],
        "link.failed_attempts": [0, 0, 5, 2],
        "link.failed_attempts_01": [0, 0, 5, 0],  # what did not occur counts 0
        "link.failed_attempts_04": [0, 0, 0, 2],
        "link.mean_ms": [0.1, 0.2, None, 1.5],
    }
    assert list(runs) == list(runs_table(plan, ENTRIES[::-1]))  # type: ignore[arg-type] # the same


def test_a_code_that_did_not_occur_counts_0_where_its_port_was(plan: Plan) -> None:
    entries: list[tuple[int, dict[str, int | float | None]]] = [
        (0, {"a.COM3.ok": 5, "a.COM3.exceptions.02": 1, "b.rejected.framing error": 4, "b.requests": 9}),
        (1, {"a.COM3.ok": 6, "b.requests": 9}),
        (2, {"a.COM3.response_ms.max": None}),
        (3, {"a.COM3.ok": 6, "a.COM3.exceptions.02": 2, "b.requests": 9}),
    ]
    table = runs_table(plan, entries)
    assert table["a.COM3.exceptions.02"] == [1, 0, None, 2]
    assert table["b.rejected.framing error"] == [4, 0, None, 0]
    assert table["a.COM3.ok"] == [5, 6, None, 6]


def test_one_row_a_point(plan: Plan, runs: Table) -> None:
    points = points_table(plan, runs)
    assert points["point"] == [1, 2]
    assert points["runs"] == [2, 2]
    assert figure_names(runs, plan) == [name for name in runs if name.startswith("link.")]
    expected = mean_of([12, 13])
    assert points["link.scans"] == [10.5, 12.5]
    assert (points["link.scans_low"][1], points["link.scans_high"][1]) == (expected.low, expected.high)
    assert points["link.scans_needed"] == [mean_of([10, 11]).needed, expected.needed]
    assert mean_at(points, "link.scans", 1) == expected
    del points["link.scans_needed"]  # as a table of an earlier version
    assert mean_at(points, "link.scans", 1) == replace(expected, needed=None)
    # A count that was 0 in every repeat has no interval, a figure that one repeat lacks no mean.
    assert (points["link.failed_attempts"][0], points["link.failed_attempts_high"][0]) == (0.0, None)
    assert points["link.mean_ms"] == [0.15, None]


def test_a_table_is_the_same_when_it_is_read_again(tmp_path: Path) -> None:
    table: Table = {
        "point": [1, 2, 3],
        "k": ["pw10", "=cmd()", "a,b"],
        "n": [1, None, 3],
        "big": [2**48 - 1, 0, 1],
        "x": [0.1, 1 / 3, 1e-300],
    }
    write_csv(tmp_path / "t.csv", table)
    raw = (tmp_path / "t.csv").read_bytes()
    assert raw.count(b"\r\n") == 4
    assert b"'=cmd()" in raw  # no formula in a spreadsheet
    head = ["point", "k"]
    assert read_csv(tmp_path / "t.csv", head, 3) == table
    with (tmp_path / "t.csv").open(newline="") as file:
        assert [len(row) for row in csv.reader(file)] == [5] * 4
    (tmp_path / "t.csv").write_bytes(b"\xef\xbb\xbf" + raw)  # as an editor on Windows saves it
    assert read_csv(tmp_path / "t.csv", head, 3) == table


def test_a_table_in_which_the_seed_is_varied_has_it_once(tmp_path: Path) -> None:
    plan = Plan(noisy(tmp_path), ["seed=5,6"], repeat=1)
    runs = runs_table(plan, [(run, {"link.scans": 10 + run}) for run in (0, 1)])
    write_csv(tmp_path / RUNS, runs)
    write_csv(tmp_path / POINTS, points_table(plan, runs))
    result = SweepResult(plan, tmp_path, already_there=0)
    assert result.runs.to_dict("list") == runs
    assert [*result.runs["seed"]] == [*result.points["seed"]] == [5, 6]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda raw: raw[:0], "its last line is cut off"),
        (lambda raw: raw[:-9], "its last line is cut off"),
        (lambda raw: raw[: raw.rindex(b"3,")], "its column point does not count 3 rows"),
        (lambda raw: raw[-1:], "its columns begin with"),
        (lambda raw: raw.replace(b",", b";"), r"its columns begin with \['point;x'\], not with \['point'\]"),
        (lambda raw: raw.replace(b"0.25", b'"0,25"'), "its column x has '0,25', no number"),
        (lambda raw: raw.replace(b"0.25", b"1_0"), "its column x has '1_0', no number"),
        (lambda raw: raw.replace(b"0.25", b"nan"), "its column x has nan, no number"),
        (lambda raw: raw.replace(b"0.25", b"1e999"), "its column x has inf, no number"),
        (lambda raw: raw.replace(b"0.25", b"0.25,"), "row 2 has 3 columns, its heading 2"),
        (lambda raw: raw.replace(b"0.25", b"0" * 150_000), "field larger than field limit"),
        (lambda raw: raw.decode().encode("utf-16"), "can't decode byte 0xff"),
    ],
)
def test_a_table_that_a_spreadsheet_or_a_crash_changed_is_refused(
    change: Callable[[bytes], bytes], message: str, tmp_path: Path
) -> None:
    path = tmp_path / "t.csv"
    write_csv(path, {"point": [1, 2, 3], "x": [0.25, 1, 2]})
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(UsageError, match=rf"t\.csv cannot be read: .*{message}.*; --force"):
        read_csv(path, ["point"], 3)


def test_parquet_says_the_same_as_csv(tmp_path: Path, runs: Table) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    assert write_parquet(tmp_path / "t.parquet", runs)
    table = parquet.read_table(tmp_path / "t.parquet")
    assert table.to_pydict() == runs
    types = {field.name: str(field.type) for field in table.schema}
    assert (types["seed"], types["link.mean_ms"]) == ("int64", "double")


def test_without_pyarrow_there_is_only_csv(
    tmp_path: Path, runs: Table, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert not write_parquet(tmp_path / "t.parquet", runs)
    assert list(tmp_path.glob("*.parquet")) == []


def test_columns_of_texts(tmp_path: Path) -> None:
    plan = Plan(noisy(tmp_path), ["plcs.press.profile=pw10,{base: pw10}", f"{RETRIES}=1"])
    table = runs_table(plan, [(run, {"link.scans": run}) for run in range(2)])
    assert table["plcs.press.profile"] == ["pw10", "{base: pw10}"]
    assert table[RETRIES] == [1, 1]


def test_a_varied_seed_is_one_column(tmp_path: Path) -> None:
    plan = Plan(noisy(tmp_path), ["seed=5,9"])
    table = runs_table(plan, [(run, {"link.scans": run}) for run in range(2)])
    assert list(table) == ["run", "point", "seed", "repeat", "link.scans"]
    assert table["seed"] == [5, 9]

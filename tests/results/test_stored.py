"""Runs that earlier versions left are read, drawn and printed."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import pytest
from rich.console import Console

from bussim.report.page import report_page
from bussim.report.runs import Source
from bussim.results.store.load import FolderRows, load_run
from bussim.results.store.rows import FORMS, SCANS
from bussim.results.text.run import show_result
from bussim.trace.records import Record, ScanRecord

STORED = Path(__file__).parent / "stored"
RUNS = sorted(path for path in STORED.iterdir())
TABLES = [(run, kind) for run in RUNS for kind, form in FORMS.items() if (run / f"{form.stem}.csv").is_file()]


def test_every_table_is_stored_once() -> None:
    assert {kind for _, kind in TABLES} == FORMS.keys()


@pytest.mark.parametrize("run", RUNS, ids=lambda run: str(run.name))
def test_summary_and_histograms_are_read_and_come_back(run: Path) -> None:
    record = load_run(run)
    again = type(record).from_json(record.summary, record.histograms())
    assert again.histograms() == record.histograms()
    output = io.StringIO()
    show_result(Console(file=output, width=120), record, {})
    assert output.getvalue().startswith(record.scenario)
    page = report_page([Source("stored", "stored", record, (run / "scenario.yaml").read_text())])
    assert all(bus in page for bus in record.summary["links"])


@pytest.mark.parametrize(("run", "kind"), TABLES, ids=lambda value: getattr(value, "__name__", ""))
def test_tables_are_read_with_the_columns_of_today(run: Path, kind: type[Record]) -> None:
    form = FORMS[kind]
    with (run / f"{form.stem}.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    table = FolderRows(run).table(kind)
    assert list(table.columns) == list(form.columns.kinds)
    assert len(table) == len(rows)
    for name in rows[0] if rows else ():
        assert name in table.columns  # none is renamed
    if kind is ScanRecord and rows:
        assert table["duration_ms"].tolist() == [float(row["duration_ms"]) for row in rows]


def test_a_column_of_a_later_version_is_left_out(tmp_path: Path) -> None:
    rows = (RUNS[-1] / "link_scans.csv").read_text(encoding="utf-8").splitlines()
    lines = [f"{rows[0]},phase", *(f"{row},3" for row in rows[1:])]
    (tmp_path / "link_scans.csv").write_text("\r\n".join([*lines, ""]), encoding="utf-8")
    assert list(FolderRows(tmp_path).table(ScanRecord).columns) == list(SCANS.kinds)

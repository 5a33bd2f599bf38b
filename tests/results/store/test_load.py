from __future__ import annotations

import json
import os
import re
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from bussim.commands.report import report
from bussim.errors import UsageError
from bussim.results.store.folder import INCOMPLETE
from bussim.results.store.load import FolderRows, load_run
from bussim.trace.records import AttemptRecord, InputRecord, ScanRecord
from bussim.units import TICKS_PER_SECOND
from tests.results.fakes import Fake
from tests.results.store.test_folder import write

FAKE = Fake(duration=20 * TICKS_PER_SECOND)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("load") / "run", fake=FAKE, traced=True)


@pytest.fixture
def folder(finished: Path, tmp_path: Path) -> Path:
    """A copy that a test may damage."""
    return shutil.copytree(finished, tmp_path / "run")


def change(path: Path, **changes: Any) -> None:
    path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))


def test_a_run_reads_back_as_it_was(finished: Path) -> None:
    there, back = FAKE.run(traced=True), load_run(finished)
    assert back.summary == there.summary
    assert back.histograms() == there.histograms()
    assert back.notes == there.notes
    assert back.links["link"].in_error == there.links["link"].in_error
    assert back.links["link"].timeline == there.links["link"].timeline


def test_data_age_of_an_earlier_version_is_the_total(folder: Path) -> None:
    links = json.loads((folder / "summary.json").read_text())["links"]
    links["link"]["stale_ms"] = {"a->b": 12.5}
    change(folder / "summary.json", links=links)
    assert load_run(folder).summary["links"]["link"]["stale_ms"] == {"a->b": {"total": 12.5, "longest": None}}


def test_what_is_no_folder(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    (tmp_path / "killed.incomplete").mkdir()
    with pytest.raises(UsageError, match=r"nothing does not exist$"):
        load_run(tmp_path / "nothing")
    with pytest.raises(UsageError, match="file is a file, not the folder of a run"):
        load_run(tmp_path / "file")
    with pytest.raises(UsageError, match=r"killed\.incomplete is a run that was not finished"):
        load_run(tmp_path / "killed")


def test_a_folder_of_something_else(finished: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"has no summary\.json$"):
        load_run(tmp_path)
    with pytest.raises(UsageError, match=r"has no summary\.json; folders of runs in it: run$"):
        load_run(finished.parent)


def test_an_incomplete_one(folder: Path) -> None:
    (folder / INCOMPLETE).write_text("")
    with pytest.raises(UsageError, match="is incomplete"):
        load_run(folder)


def test_a_newer_schema(folder: Path) -> None:
    change(folder / "summary.json", schema=2, bussim="9.1")
    with pytest.raises(UsageError, match=r"schema 2, written by bussim 9\.1; this one reads up to 1"):
        load_run(folder)


@pytest.mark.parametrize("schema", ["1", 0, None, 1.5])
def test_no_schema_of_ours(folder: Path, schema: object) -> None:
    change(folder / "summary.json", schema=schema)
    with pytest.raises(UsageError, match="schema is"):
        load_run(folder)


@pytest.mark.parametrize("text", ["", "{", "[1]", '"x"', "[" * 100_000, "\x00\x01", '{"schema": NaN}'])
@pytest.mark.parametrize("name", ["summary.json", "histograms.json"])
def test_files_that_are_no_json_objects(folder: Path, name: str, text: str) -> None:
    (folder / name).write_text(text)
    with pytest.raises(UsageError, match=name):
        load_run(folder)


@pytest.mark.parametrize(
    "changes",
    [
        {"links": 5},
        {"links": {"link": {}}},
        {"duration": "long"},
        {"notes": [{}]},
        {"notes": None},
        {"notes_left_out": {"watchdog": "many"}},
    ],
)
def test_damaged_histograms(folder: Path, changes: dict[str, Any]) -> None:
    change(folder / "histograms.json", **changes)
    with pytest.raises(UsageError, match=r"histograms\.json is damaged"):
        load_run(folder)


def test_missing_histograms(folder: Path) -> None:
    (folder / "histograms.json").unlink()
    with pytest.raises(UsageError, match=r"histograms\.json is missing"):
        load_run(folder)


def test_a_file_that_is_too_large(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bussim.results.store.load._LARGEST", 1000)
    with pytest.raises(UsageError, match="more than any run writes"):
        load_run(folder)


@pytest.mark.parametrize("text", ["", "a,b\n1,2\n", "bus,index\nlink,x\n", "\x00"])
def test_damaged_tables(folder: Path, text: str) -> None:
    (folder / "link_scans.csv").write_text(text)
    with pytest.raises(UsageError, match=r"link_scans\.csv"):
        FolderRows(folder).table(ScanRecord)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text[:-3], "its last line is cut off"),
        (lambda text: text.replace(",0\n", ",99999999999999999999\n"), "Overflow"),
        (lambda text: text.replace("\nlink,", "\n9,link,"), "its rows have more columns than its heading"),
        (lambda text: re.sub(r"[0-9]+\.[0-9]+,", "inf,", text), "its column start_s has an infinite number"),
        (
            lambda text: text.replace("duration_ms", "duration_ms "),
            "has the columns .*; those of such a table",
        ),
    ],
)
def test_tables_that_other_programs_or_a_crash_changed(
    change: Callable[[str], str], message: str, folder: Path
) -> None:
    path = folder / "link_scans.csv"
    path.write_text(change(path.read_text()))
    with pytest.raises(UsageError, match=rf"link_scans\.csv .*{message}"):
        FolderRows(folder).table(ScanRecord)


def test_flags_that_became_texts_are_refused(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    row = {"time_s": 0.5, "plc": "a", "device": "X0", "level": 1, "sampled_s": 0.6, "seen": "False"}
    pd.DataFrame([row]).to_parquet(tmp_path / "inputs.parquet")
    with pytest.raises(UsageError, match=r"inputs\.parquet cannot be read: its column seen has .*, no flags"):
        FolderRows(tmp_path).table(InputRecord)
    pd.DataFrame([row | {"seen": True}]).set_index("plc").to_parquet(tmp_path / "inputs.parquet")
    with pytest.raises(UsageError, match="its rows have more columns than its heading"):
        FolderRows(tmp_path).table(InputRecord)


def test_what_a_spreadsheet_takes_for_a_number_is_a_code(folder: Path) -> None:
    before = FolderRows(folder).table(AttemptRecord)
    path = folder / "exchanges.csv"
    path.write_text(re.sub(r",0([0-9]),", r",\1,", path.read_text()), encoding="utf-8-sig")
    assert set(before["code"]) >= {"00", "01"}
    assert FolderRows(folder).table(AttemptRecord).equals(before)
    path.write_text(re.sub(r",code|,[0-9](?=,[0-9.]*$)", "", path.read_text("utf-8-sig"), flags=re.MULTILINE))
    assert set(FolderRows(folder).table(AttemptRecord)["code"]) == {""}  # of a table without codes: unknown


def test_json_of_an_editor_on_windows_begins_with_a_mark(folder: Path) -> None:
    before = load_run(folder)
    for name in ("summary.json", "histograms.json"):
        (folder / name).write_text((folder / name).read_text(), encoding="utf-8-sig", newline="\r\n")
    assert load_run(folder).summary == before.summary


def test_a_damaged_trace(folder: Path) -> None:
    (folder / "trace.jsonl").write_text("{}\n{")
    with pytest.raises(UsageError, match=r"trace\.jsonl cannot be read"):
        FolderRows(folder).trace()


@pytest.mark.skipif(sys.platform == "win32", reason="pipes of POSIX")
@pytest.mark.parametrize("name", ["histograms.json", "scenario.yaml"])
def test_a_pipe_in_a_run_is_not_waited_for(name: str, folder: Path) -> None:
    (folder / name).unlink()
    os.mkfifo(folder / name)
    with pytest.raises(UsageError, match=rf"{name} cannot be read: it is a pipe"):
        report(folder)

"""The Python interface, end to end with the simulation."""

from __future__ import annotations

import os
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pandas as pd
import pytest

import bussim
from bussim.units import TICKS_PER_SECOND

SHORT = ["duration=2 s"]


def test_three_lines_in_a_notebook() -> None:
    scenario = bussim.load("press_line", SHORT)
    result = bussim.run(scenario)
    picture = result.plot_scan_times()
    assert picture.axes
    assert isinstance(result, bussim.Result)
    assert isinstance(scenario, bussim.Scenario)
    assert result.folder is None
    assert result.totals is not None
    assert result.totals.duration == 2 * TICKS_PER_SECOND
    link = result.summary["links"]["link"]
    assert len(result.link_scans) == link["scans"] > 20
    assert link["scan_time_ms"]["mean"] == pytest.approx(result.link_scans["duration_ms"].mean())


@pytest.mark.usefixtures("pictures_undrawn")
def test_memory_and_folder_hold_the_same(tmp_path: Path) -> None:
    scenario = bussim.load("press_line", SHORT)
    there = bussim.run(scenario, trace=True)
    written = bussim.run(scenario, trace=True, out=tmp_path / "run")
    opened = bussim.open_run(tmp_path / "run")
    assert there.summary == written.summary == opened.summary
    assert opened.totals is None
    assert written.folder == opened.folder == tmp_path / "run"
    for other in (written, opened):
        pd.testing.assert_frame_equal(other.link_scans, there.link_scans, check_exact=True)
        pd.testing.assert_frame_equal(other.exchanges, there.exchanges, check_exact=True)
        assert other.trace == there.trace
        assert other.record.histograms() == there.record.histograms()


@pytest.mark.usefixtures("pictures_undrawn")
def test_ports_in_memory_and_in_a_folder(tmp_path: Path) -> None:
    scenario = bussim.load("nn_with_modbus", ["duration=3 s"])
    there = bussim.run(scenario, trace=True)
    written = bussim.run(scenario, trace=True, out=tmp_path / "run")
    opened = bussim.open_run(tmp_path / "run")
    assert there.summary == written.summary == opened.summary
    for other in (written, opened):
        pd.testing.assert_frame_equal(other.transactions, there.transactions, check_exact=True)
        assert list(other.open_trace()) == list(there.open_trace())
        assert other.record.histograms() == there.record.histograms()
        assert len(other.free) == len(other.values) == 0
    assert not (tmp_path / "run" / "free.csv").exists()
    table = there.transactions
    for node in ("press1.COM3", "press2.COM5"):
        port = there.summary["ports"][node]
        mine = table[table["master"] == node]
        assert len(mine) == port["transactions"] > 40
        assert (mine["outcome"] == "ok").sum() == port["ok"]
        assert mine["response_ms"].max() == port["response_ms"]["max"]
        # What the rows say of times is in order: asked, response ended, decided, taken.
        for earlier, later in (("sent_s", "asked_s"), ("asked_s", "answered_s"), ("end_s", "taken_s")):
            assert (mine[earlier] <= mine[later]).all()
    rounds = table[table["poll"] == "position"].groupby("master")["taken_s"].diff().dropna()
    age = there.summary["ports"]["press1.COM3"]["polls"]["position"]["age_ms"]
    assert age["before_refresh"]["max"] >= rounds.max() * 1000


def test_the_summary_agrees_with_the_rows() -> None:
    result = bussim.run(bussim.load("press_line", ["duration=30 s"]), trace=True)
    link, scans, tries = result.summary["links"]["link"], result.link_scans, result.exchanges
    assert link["scan_time_ms"]["max"] == scans["duration_ms"].max()
    longest = scans["start_s"].to_numpy()[scans["duration_ms"].to_numpy().argmax()]
    assert link["scan_time_ms"]["max_at_s"] == pytest.approx(longest, abs=1e-6)
    pairs = zip(tries["station"].tolist(), tries["code"].tolist(), strict=True)
    failed = Counter((station, code) for station, code in pairs if code != "00")
    counted = {
        (int(station), code): number
        for station, codes in link["failed_attempts"].items()
        for code, number in codes.items()
    }
    assert failed == counted
    assert int(scans["failed"].sum()) <= sum(counted.values())
    # The second scan time in a row starts where the first one ends.
    ends = (scans["start_s"] + scans["duration_ms"] / 1000).round(8)
    assert (ends.iloc[:-1].to_numpy() - scans["start_s"].iloc[1:].to_numpy()).max() < 1e-7


def test_progress_is_reported() -> None:
    seen: list[tuple[int, int]] = []
    scenario = bussim.load("manual_programs", ["duration=2 s"])
    bussim.run(scenario, rows=False, progress=lambda *step: seen.append(step))
    assert len(seen) > 2
    assert seen[-1] == (2 * TICKS_PER_SECOND, 2 * TICKS_PER_SECOND)
    assert seen == sorted(seen)


def test_what_is_wrong_is_raised(tmp_path: Path) -> None:
    with pytest.raises(bussim.ScenarioError):
        bussim.run("no such scenario")
    with pytest.raises(bussim.UsageError, match="allowed are csv and parquet"):
        bussim.run(bussim.load("press_line", SHORT), out=tmp_path / "run", format="xlsx")
    with pytest.raises(bussim.UsageError, match="give out as well"):
        bussim.run(bussim.load("press_line", SHORT), force=True)
    with pytest.raises(bussim.UsageError, match="does not exist"):
        bussim.open_run(tmp_path / "run")
    with pytest.raises(AttributeError, match="no attribute 'simulate'"):
        _ = bussim.simulate


def test_everything_exported_is_there() -> None:
    for name in bussim.__all__:
        assert getattr(bussim, name) is not None
        assert name in dir(bussim)


def test_importing_bussim_is_cheap() -> None:
    code = "import sys, bussim; print(*sorted(sys.modules))"
    root = Path(__file__).parents[2]
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": str(root)},
        capture_output=True,
        text=True,
        check=True,
    )
    loaded = {name.partition(".")[0] for name in done.stdout.split()}
    assert not loaded & {"numpy", "pandas", "matplotlib", "pydantic", "yaml", "rich", "click", "simpy"}

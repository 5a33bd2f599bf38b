from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from bussim.errors import UsageError
from bussim.results.result import Result
from bussim.results.store.in_memory import MemoryRows
from bussim.results.store.load import FolderRows
from bussim.units import TICKS_PER_SECOND
from tests.results.fakes import Fake, quiet


def result_of(fake: Fake, *, rows: bool = True, name: str = "three presses") -> Result:
    memory = MemoryRows(rows=rows, traced=False)
    return Result(fake.run(rows=memory, name=name), memory)


def test_a_result_describes_itself_in_one_line() -> None:
    result = result_of(quiet(jitter=0))
    assert repr(result) == (
        "<Result of 'three presses', seed 7, 60 s: link: 1,200 scans, mean 50.000 ms, max 50.000 ms>"
    )
    assert "link: no complete scan" in repr(result_of(quiet(duration=10)))
    assert " in there:" in repr(Result(result.record, FolderRows(Path("there")), folder=Path("there")))


def test_a_notebook_shows_a_small_table() -> None:
    html = result_of(quiet(jitter=0), name="<b>presses</b>")._repr_html_()
    assert "<b>" not in html
    assert "a warning" in html
    table = ET.fromstring(f"<div>{html}</div>")[0]  # noqa: S314 (own output)
    heads, cells = ([cell.text for cell in row] for row in table.iter("tr"))
    assert heads == ["link", "scans", "attempts", "min (ms)", "mean (ms)", "p99 (ms)", "max (ms)"]
    assert cells == ["link", "1200", "6", "50.000", "50.000", "50.000", "50.000"]


def test_rows_come_when_asked_for() -> None:
    result = result_of(Fake())
    assert len(result.link_scans) == result.summary["links"]["link"]["scans"]
    assert result.link_scans is result.link_scans
    assert result.link_scans["duration_ms"].max() == result.summary["links"]["link"]["scan_time_ms"]["max"]
    with pytest.raises(UsageError, match="rows=True"):
        _ = result_of(Fake(), rows=False).link_scans
    with pytest.raises(UsageError, match="trace=True"):
        _ = result.exchanges
    with pytest.raises(UsageError, match="trace=True"):
        _ = result.trace


def test_a_figure_shows_itself_and_is_saved(tmp_path: Path) -> None:
    result = result_of(quiet(duration=TICKS_PER_SECOND))
    picture = result.plot_scan_times(tmp_path / "a.png")
    assert picture._repr_png_() == (tmp_path / "a.png").read_bytes()  # type: ignore[attr-defined] # a Picture's
    result.plot_scan_times_over_run(str(tmp_path / "b.svg"), "link")
    assert (tmp_path / "b.svg").read_text(encoding="utf-8").lstrip().startswith("<?xml")
    with pytest.raises(UsageError, match="'lonk'"):
        result.plot_scan_times(bus="lonk")
    with pytest.raises(UsageError, match="no N:N link made a complete scan"):
        result_of(quiet(duration=10)).plot_scan_times()

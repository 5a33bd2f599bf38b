"""Traced runs for the tests of timelines and reports."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import bussim
from bussim.report.trace_window import TraceWindow, read_window, worst_window
from bussim.results.run_record import RunRecord
from bussim.trace.file import Trace, read_trace
from tests.undrawn import undrawn

#: Eight stations on a line so noisy that some link scan repeats a poll.
EIGHT = """\
schema: 1
name: eight on a noisy line
duration: 10 s
seed: 8
buses:
  - {name: link, nn: true}
noise:
  - {bus: link, ber: 3.0e-5}
plcs:
"""
NAMES = ("filler", "capper", "labeller", "inspector", "packer", "palletizer", "wrapper", "conveyor")


def eight_stations() -> str:
    """The scenario of eight stations as YAML."""
    master = "station: 0, slaves: 7, mode: 2, retries: 3, timeout: 100 ms"
    lines = [
        f"  - {{name: {name}, scan: {4 + 2 * number} ms, nn: {{bus: link, port: COM4, "
        f"{master if number == 0 else f'station: {number}'}}}}}\n"
        for number, name in enumerate(NAMES)
    ]
    return EIGHT + "".join(lines)


@cache
def eight_folder() -> Path:
    """The folder of a traced run of eight stations."""
    folder = Path(mkdtemp(prefix="bussim-eight-"))
    scenario = folder / "eight.yaml"
    scenario.write_text(eight_stations(), encoding="utf-8")
    with undrawn():
        bussim.run(scenario, out=folder / "run", trace=True)
    return folder / "run"


def opened(folder: Path) -> tuple[Trace, RunRecord]:
    """The trace and the record of a run."""
    return read_trace(folder), bussim.open_run(folder).record


def longest(folder: Path, bus: str = "link") -> TraceWindow:
    """The window of the longest link scan."""
    trace, record = opened(folder)
    window = worst_window(trace, record, bus)
    assert window is not None
    return read_window(trace, record, bus, *window)

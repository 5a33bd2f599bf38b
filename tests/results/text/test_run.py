from __future__ import annotations

import io
from dataclasses import replace

from rich.console import Console

from bussim.results.collector import Collector
from bussim.results.run_record import RunRecord
from bussim.results.text.run import show_result
from bussim.trace.records import PlcTotals, RunTotals
from bussim.units import TICKS_PER_SECOND
from tests.results.fakes import NODES, Fake, quiet, record_of
from tests.results.test_collector import LINK


def shown(record: RunRecord) -> str:
    console = Console(file=io.StringIO(), width=100)
    show_result(console, record, {"link": dict(enumerate(NODES))})
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def lines_of(record: RunRecord) -> dict[str, str]:
    """The text after each line's first words, without runs of spaces."""
    return {" ".join(line.split()[:2]): " ".join(line.split()) for line in shown(record).splitlines() if line}


def test_the_numbers_are_those_of_the_summary() -> None:
    record = Fake().run()
    text, link = shown(record), record.summary["links"]["link"]
    times = link["scan_time_ms"]
    assert "link: 3 stations, mode 2, 5 retries = 6 attempts a poll, timeout 50 ms" in text
    assert f"median {times['p50']:.3f}, mean {times['mean']:.3f}, p99 {times['p99']:.3f}" in text
    assert f"at {times['max_at_s']:.3f} s: station 1 (press2): 6 attempts, all 01" in text
    assert f"link scans       {link['scans']:,}, bus load 80.0%" in text
    failed, errors = link["failed_attempts"]["1"]["01"], link["station_errors"]["1"]
    assert lines_of(record)["1 (press2)"] == f"1 (press2) {failed} {errors} 1 –"
    assert "press1 50/349, press2 50/349, press3 50/349" in text
    assert "warning: a warning" in text


def test_a_missing_quantile_is_said_to_be_missing() -> None:
    text = shown(quiet(duration=3 * TICKS_PER_SECOND).run())
    assert "(too few scans for p99)" in text
    assert "None" not in text


def test_the_flag_is_the_masters_at_the_end() -> None:
    link = replace(LINK, station_errors={1: 3}, slaves=2)
    totals = RunTotals(
        TICKS_PER_SECOND, (link,), (PlcTotals("press1", {"M8184": 1, "M8185": 0}, 0, None, None),)
    )
    lines = lines_of(record_of(totals, Collector()))
    assert lines["1 (press2)"] == "1 (press2) 3 0 ON"
    assert lines["2 (press3)"] == "2 (press3) 0 0 off"
    assert lines["no complete"] == "no complete link scan"
    assert lines["refresh gap"].startswith("refresh gap 1000.000 ms, still open at the end (press1->press2,")


def test_a_link_without_a_master() -> None:
    link = replace(LINK, slaves=None, mode=None, retries=None, attempts=None, timeout=None)
    record = record_of(RunTotals(TICKS_PER_SECOND, (link,), ()), Collector(), name="[bold]odd[/bold]")
    assert shown(record).splitlines() == [
        "[bold]odd[/bold]: 1 s simulated, seed 7",
        "",
        "link: 3 stations, no working master: no link scans",
        "",
        "verdict",
        "  link has no working master (station number 0), so there was no link scan.",
    ]


def test_codes_are_said_in_words() -> None:
    text = shown(Fake().run())
    assert "  codes            01: no reply within the timeout" in text

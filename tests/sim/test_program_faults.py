"""Programs that stop or meet errors: reported with when, where and how often, once for each code."""

from __future__ import annotations

from functools import cache

import pytest

from bussim.results.collector import Collector
from bussim.scenario.loader import loads
from bussim.sim.runner import simulate
from bussim.trace.records import NoteRecord, RunTotals

SCENARIO = """\
schema: 1
name: faults
duration: 3 s
buses:
  - {{name: link, nn: true}}
plcs:
  - name: press3
    scan: 10 ms
    phase: {phase}
    program: |
{lines}
    inputs: {{X1: {{times: [1 s]}}, X2: {{times: [2.99 s]}}}}
{faults}"""


@cache
def met(program: str, phase: str = "8 ms", faults: str = "") -> tuple[RunTotals, list[NoteRecord]]:
    lines = "\n".join(f"      {line}" for line in program.split(" / "))
    collector = Collector()
    totals = simulate(loads(SCENARIO.format(lines=lines, phase=phase, faults=faults)), collector)
    return totals, collector.notes


def reported(totals: RunTotals) -> list[str]:
    """What is warned of beside the bus without nodes."""
    return [text for text in totals.warnings if text.startswith("press3's program")]


def test_an_endless_loop_is_reported_with_its_watchdog() -> None:
    totals, notes = met("P1 / LD M8000 / CJ P1 / END")
    (warning,) = reported(totals)
    assert warning.startswith(
        "press3's program stopped at 0.200 s: its scan exceeds the watchdog (D8000 = 200 ms), "
        "M8061 on, D8061 = 6105; "
    )
    assert "its link and ports go on" in warning
    (note,) = (note for note in notes if note.kind == "program_stopped")
    assert (note.where, note.detail) == ("press3", {"code": 6105})


def test_the_scan_that_never_ended_is_the_longest() -> None:
    """8 ms from RUN to the first END would be by its phase, and 200 ms of instructions more."""
    (plc,) = met("P1 / LD M8000 / CJ P1 / END")[0].plcs
    assert plc.scan_max is not None
    assert plc.scan_max == pytest.approx(208 * 72_000, rel=1e-3)
    assert met("LD M8000 / OUT Y0 / END")[0].plcs[0].scan_max == pytest.approx(10 * 72_000, rel=1e-3)


def test_a_loop_that_begins_late_is_reported_when_it_does() -> None:
    """The END at 0.998 s sees X1 off, that at 1.008 s on: the watchdog expires 200 ms after it."""
    (warning,) = reported(met("P1 / LD X1 / CJ P1 / END")[0])
    assert "stopped at 1.208 s" in warning


def test_a_watchdog_of_its_own_and_one_that_is_reset() -> None:
    (warning,) = reported(met("LD M8002 / MOV K50 D8000 / P1 / LD X1 / CJ P1 / END")[0])
    assert "(D8000 = 50 ms)" in warning
    assert "stopped at 1.058 s" in warning
    (warning,) = reported(met("P1 / LD X1 / WDT / CJ P1 / END")[0])
    assert "its scan jumps on without end" in warning


def test_it_is_counted_again_after_a_new_run() -> None:
    faults = "faults:\n  - {at: 2 s, for: 100 ms, stop: press3}\n"
    (warning,) = reported(met("P1 / LD X1 / CJ P1 / END", faults=faults)[0])
    assert warning.endswith("; 2 times in all")


def test_the_first_operation_error_of_each_code_is_reported_with_its_position() -> None:
    program = "LD M8000 / DIV D0 D1 D2 / CALL P1 / FEND / P1 / LD M8000 / CALL P1 / SRET / END"
    totals, notes = met(program)
    division, calls = reported(totals)
    assert "D8067 = 6706" in division
    assert "at step 1 (line 2 of the program: DIV D0 D1 D2)" in division
    assert "D8067 = 6702" in calls
    # An error in each scan: in those that are counted, in the one from RUN, in the one under way.
    assert division.endswith(f"; {totals.plcs[0].scans + 2} times in all")
    assert [note.kind for note in notes].count("program_error") == 2


def test_one_error_has_no_count_and_the_time_of_its_scan() -> None:
    (warning,) = reported(met("LDP X1 / MOV K30000 Z0 / MOV K5 D100Z0 / END")[0])
    assert "in the scan up to 1.018 s: M8067 on, D8067 = 6706" in warning
    assert "line 3 of the program: MOV K5 D100Z0" in warning
    assert "in all" not in warning


def test_an_error_of_the_last_scan_is_reported_though_no_end_follows() -> None:
    """Up to 3 s the scan that began at 2.998 s is not over."""
    (warning,) = reported(met("LDP X2 / DIV D0 D1 D2 / END")[0])
    assert "in the scan up to 3.000 s" in warning


def test_a_healthy_program_reports_nothing() -> None:
    totals, notes = met("LD X1 / OUT Y0 / END")
    assert reported(totals) == []
    assert not [note for note in notes if note.kind.startswith("program")]


def test_a_halt_that_the_run_or_stop_forestalls_has_no_instant_after_it() -> None:
    """The watchdog would expire 200 ms after the END that sees X2 on: at 3.198 s, or after STOP at 1.1 s."""
    (warning,) = reported(met("P1 / LD X2 / CJ P1 / END")[0])
    assert warning.startswith("press3's program was at 3.000 s in a scan that it cannot finish: its scan exc")
    faults = "faults:\n  - {at: 1.1 s, for: 1900 ms, stop: press3}\n"
    (warning,) = reported(met("P1 / LD X1 / CJ P1 / END", faults=faults)[0])
    assert warning.startswith("press3's program was at 1.100 s in a scan that it cannot finish")

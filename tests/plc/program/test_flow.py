"""CJ, CALL and SRET, FOR and NEXT, FEND, and the watchdog that ends what would never end."""

from __future__ import annotations

import pytest

from bussim.errors import ProgramError
from bussim.plc.program.instruction_times import InstructionTimes
from tests.plc.program.rigs import Rig


def test_cj_leaves_out_what_lies_before_its_label() -> None:
    rig = Rig("LD X0 / CJ P0 / LD X1 / OUT Y0 / P0 / LD X1 / OUT Y1").scan(X1=1)
    assert rig.bits("Y0", "Y1") == [1, 1]
    # What is left out keeps its state.
    assert rig.scan(X0=1, X1=0).bits("Y0", "Y1") == [1, 0]


def test_cjp_jumps_once_per_edge() -> None:
    rig = Rig("LD X0 / CJP P0 / LD M8000 / INC D0 / P0").scan(3, X0=1)
    assert rig.word("D0") == 2


def test_a_count_of_for_that_no_word_holds_is_refused() -> None:
    with pytest.raises(ProgramError, match=r"K40000, allowed K-32768…K32767 \(below 1 it counts as 1\)"):
        Rig("FOR K40000 / NEXT")


def test_p63_is_the_end() -> None:
    assert Rig("LD X0 / CJ P63 / LD M8000 / INC D0").scan(2, X0=1).scan(X0=0).word("D0") == 1


def test_a_rung_may_go_on_behind_a_jump() -> None:
    rig = Rig("LDI X0 / CJ P0 / OUT Y0 / AND X1 / OUT Y1 / P0").scan(X0=1, X1=1, Y0=1)
    assert rig.bits("Y0", "Y1") == [0, 0]
    assert rig.scan(X0=0).bits("Y0", "Y1") == [0, 0]


def test_a_jump_backwards_is_a_loop() -> None:
    rig = Rig("LD M8000 / MOV K0 D0 / P1 / LD M8000 / INC D0 / LD< D0 K10 / CJ P1").scan()
    assert rig.word("D0") == 10


def test_subroutines_nest_and_return() -> None:
    text = (
        "LD X0 / CALL P1 / LD M8000 / INC D0 / FEND / "
        "P1 / LD M8000 / INC D1 / CALL P2 / LD M8000 / INC D3 / SRET / "
        "P2 / LD M8000 / INC D2 / SRET"
    )
    rig = Rig(text).scan()
    assert [rig.word(f"D{n}") for n in range(4)] == [1, 0, 0, 0]
    rig.scan(2, X0=1)
    assert [rig.word(f"D{n}") for n in range(4)] == [3, 2, 2, 2]


def test_callp_calls_once_per_edge() -> None:
    rig = Rig("LD X0 / CALLP P1 / FEND / P1 / LD M8000 / INC D1 / SRET").scan(3, X0=1)
    assert rig.word("D1") == 1


def test_a_sixth_call_is_an_error() -> None:
    rig = Rig("LD X0 / CALL P1 / LD M8000 / INC D0 / FEND / P1 / LD M8000 / INC D1 / CALL P1 / SRET").scan(
        X0=1
    )
    assert (rig.error(), rig.word("D1"), rig.word("D0")) == (6702, 5, 1)


@pytest.mark.parametrize(("count", "times"), [("K3", 3), ("K1", 1), ("K0", 1), ("K-5", 1), ("D9", 4)])
def test_for_repeats_to_its_next(count: str, times: int) -> None:
    rig = Rig(f"FOR {count} / LD M8000 / INC D0 / NEXT / LD M8000 / INC D1").put(D9=4).scan(2)
    assert (rig.word("D0"), rig.word("D1")) == (2 * times, 2)


def test_loops_nest() -> None:
    rig = Rig("FOR K3 / FOR K4 / LD M8000 / INC D0 / NEXT / LD M8000 / INC D1 / NEXT").scan()
    assert (rig.word("D0"), rig.word("D1")) == (12, 3)


def test_a_jump_out_of_a_loop() -> None:
    rig = Rig("FOR K9 / LD M8000 / INC D0 / LD= D0 K4 / CJ P0 / NEXT / P0 / LD M8000 / INC D1").scan()
    assert (rig.word("D0"), rig.word("D1")) == (4, 1)


def test_an_endless_loop_trips_the_watchdog() -> None:
    rig = Rig("LD M8000 / OUT Y0 / P0 / LD M8000 / INC D0 / CJ P0").scan()
    assert rig.run.halted == 6105
    assert (rig.bit("M8061"), rig.word("D8061"), rig.bit("Y0")) == (1, 6105, 0)
    count = rig.word("D0")
    # It stands still until RUN.
    assert rig.scan().word("D0") == count
    rig.run.run(0)
    assert (rig.run.halted, rig.bit("M8061"), rig.word("D8061")) == (0, 0, 0)


def test_the_watchdog_reads_d8000() -> None:
    slow = InstructionTimes(move=1_000_000)  # 1 ms
    loop = "LD M8002 / MOV K{} D8000 / FOR K50 / LD M8000 / MOV D0 D1 / NEXT"
    assert Rig(loop.format(40), times=slow).scan().run.halted == 6105
    assert Rig(loop.format(60), times=slow).scan().run.halted == 0


def test_wdt_lets_a_long_scan_live() -> None:
    slow = InstructionTimes(move=1_000_000)
    loop = "FOR K500 / LD M8000 / MOV D0 D1 / {} / NEXT"
    assert Rig(loop.format("NOP"), times=slow).scan().run.halted == 6105
    assert Rig(loop.format("WDT"), times=slow).scan().run.halted == 0
    assert Rig(loop.format("WDTP"), times=slow).scan().run.halted == 6105


def test_an_endless_loop_that_serves_the_watchdog_is_cut_all_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("bussim.plc.program.execution.MAX_BLOCKS", 1000)
    assert Rig("P0 / LD M8000 / WDT / CJ P0").scan().run.halted == 6105


def test_the_longest_time_without_wdt_is_reported() -> None:
    times = InstructionTimes(basic=0, idle=0, move=1000)
    rig = Rig("LD M8000 / MOV D0 D1 / MOV D0 D1 / WDT / LD M8000 / MOV D0 D1", times=times).scan()
    assert rig.run.unwatched == 2000
    assert Rig("LD M8000 / MOV D0 D1", times=times).scan().run.unwatched == 1000

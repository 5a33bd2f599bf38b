"""The longest scan of a program: never below what one takes, and no number where the text determines none."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bussim.plc.memory import Device, Memory
from bussim.plc.program.execution import ProgramRun
from bussim.plc.program.instruction_times import DEFAULT_TIMES, InstructionTimes, ticks_of
from bussim.plc.program.longest import longest_scan
from bussim.plc.program.program import Program

BODY = """\
LD X0
MOV D0 D1
BMOV D0 D40 D50
LD X1
ZRST D100 D149
DADD D0 D2 D4
LD X2
CJ P1
LDP X3
SFTL M0 M100 K16 K1
LD X4
OUT T0 K5
P1
LD X5
FMOV K0 D200 K9
MEAN D0 D9 D51
END
"""


@given(st.integers(0, 63), st.integers(1, 512), st.integers(1, 64))
def test_no_scan_takes_longer(inputs: int, moved: int, averaged: int) -> None:
    program, memory = Program.parse(BODY, "p"), Memory()
    most = longest_scan(program, DEFAULT_TIMES)
    run = ProgramRun(program, memory)
    run.run(0)
    memory.set(Device("D", 50), moved)
    memory.set(Device("D", 51), averaged)
    for now in range(3):
        for number in range(6):
            memory.set(Device("X", number), inputs >> number & 1)
        assert most is not None
        assert 0 < run.scan(now) <= most


def test_it_is_reached_where_nothing_is_open() -> None:
    program, memory = (
        Program.parse("LD M8000\nMOV D0 D1\nBMOV D0 D40 K8\nADD D0 D1 D2\nOUT Y0\nEND\n", "p"),
        Memory(),
    )
    times = InstructionTimes()
    run = ProgramRun(program, memory)
    run.run(0)
    wanted = ticks_of(
        2 * times.basic + times.move + times.block + 8 * times.each + times.arithmetic + times.basic
    )
    assert longest_scan(program, times) == run.scan(0) == wanted


@pytest.mark.parametrize(
    "text",
    ["FOR K3\nLD X0\nOUT Y0\nNEXT\nEND\n", "LD X0\nCALL P1\nFEND\nP1\nLD X1\nOUT Y0\nSRET\nEND\n", "P1\nLD X0\nWDT\nCJ P1\nEND\n"],
)  # fmt: skip
def test_loops_subroutines_and_jumps_back_have_none(text: str) -> None:
    assert longest_scan(Program.parse(text, "p"), DEFAULT_TIMES) is None

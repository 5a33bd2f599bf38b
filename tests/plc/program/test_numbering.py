"""Printed step numbers: the first that the instructions in front of it do not make is warned of."""

from __future__ import annotations

import pytest

from bussim.plc.memory import Family
from bussim.plc.program.program import Program
from bussim.plc.program.text.exports import listing

#: With their steps: LD 1, OUT Y 1, OUT T 3, MOV 5, DMOV 9, LD= 5, SET S 2, RST D 3, a label 1, LDP 2.
RIGHT = """0 LD X0
1 OUT T0 K50
4 LD T0
5 MOV K1 D0
10 DMOV D0 D2
19 LD= D0 K5
24 OUT Y0
25 LDP X1
27 RST D9
30 CJ P1
33 LD X2
34 OUT Y2
35 P1
36 END"""


def warned(text: str, family: Family = Family.FX2N, *, skips: bool = False) -> list[tuple[int, str]]:
    program = Program.parse(text, "p", family=family, skips=skips)
    return [(each.line, each.message.split(" from")[0]) for each in program.warnings]


def test_a_list_as_it_was_printed_has_nothing_to_warn_of() -> None:
    assert not warned(RIGHT)
    assert not warned("\n".join(line.partition(" ")[2] for line in RIGHT.splitlines()))


@pytest.mark.parametrize(
    ("line", "instead", "found"),
    [
        (1, "OUT Y5", "step 4 is printed where step 2 follows"),
        (3, "OUT Y5", "step 10 is printed where step 6 follows"),
        (4, "MOV D0 D2", "step 19 is printed where step 15 follows"),
        (5, "LD X7", "step 24 is printed where step 20 follows"),
        (7, "LD X1", "step 27 is printed where step 26 follows"),
        (8, "RST M9", "step 30 is printed where step 28 follows"),
    ],
)
def test_an_instruction_of_another_length_is_told_by_the_number_behind_it(
    line: int, instead: str, found: str
) -> None:
    lines = RIGHT.splitlines()
    lines[line] = f"{lines[line].split()[0]} {instead}"
    assert warned("\n".join(lines)) == [(line + 2, found)]


def test_rungs_that_are_lost_or_moved() -> None:
    lines = RIGHT.splitlines()
    assert warned("\n".join(lines[:10] + lines[12:])) == [(11, "step 35 is printed where step 33 follows")]
    assert warned("\n".join(lines[2:])) == [(1, "step 4 is printed where step 0 follows")]
    moved = "\n".join([*lines[5:7], *lines[:5], *lines[7:]])
    assert warned(moved) == [(1, "step 19 is printed where step 0 follows")]


def test_numbers_of_lines_are_no_steps() -> None:
    bare = [line.partition(" ")[2] for line in RIGHT.splitlines()]
    for first, apart in ((0, 1), (1, 1), (10, 10)):
        assert not warned("\n".join(f"{first + apart * at} {line}" for at, line in enumerate(bare)))


def test_behind_steps_that_are_assumed_the_count_begins_anew() -> None:
    text = "0 LD D0.3\n7 OUT Y0\n8 LD X0\n{} OUT Y1\n10 END"
    assert not warned(text.format(9), Family.FX3U)
    assert warned(text.format(12), Family.FX3U) == [(4, "step 12 is printed where step 9 follows")]
    skipped = "0 LD X0\n1 PLSV K1000 Y0 Y3\n99 LD X1\n100 OUT Y1\n101 END"
    assert [line for line, _ in warned(skipped, skips=True)] == [2]


def test_an_export_that_lost_a_row() -> None:
    rows = ["Step No.\tInstruction\tI/O(Device)", "0\tLD\tX000", "1\tOUT\tY000", "2\tLD\tX001"]
    rows += ["3\tMOV\tK5", "\t\tD0", "8\tLD\tX002", "9\tOUT\tY002", "10\tEND\t"]
    assert not warned(listing("\n".join(rows)).text)
    del rows[2:4]  # OUT Y000 and LD X001: X000 now drives what X001 drove
    found = listing("\n".join(rows)).text
    assert warned(found) == [(3, "step 3 is printed where step 1 follows")]

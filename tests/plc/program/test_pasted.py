"""Lists as they are pasted from forums and other makes: texts without a comment's mark, names from elsewhere."""

from __future__ import annotations

import pytest

from bussim.errors import ProgramError
from bussim.plc.program.program import Program
from tests.plc.program.rigs import problems

FORUM = """星三角启动
* main circuit
LD   X000   启动按钮
OR   Y000   自锁 KM1
ANI  X002   （热继电器）
OUT  Y000   【主接触器】
OUT  T0  K50  モータ 待ち
LD   T0     시작
OUT  Y002
END
"""


def test_a_text_in_east_asian_letters_is_a_comment_without_its_mark() -> None:
    marked = "LD X0\nOR Y0\nANI X2\nOUT Y0\nOUT T0 K50\nLD T0\nOUT Y2\nEND"
    found = [
        (at.name, [str(operand.device) for operand in at.operands])
        for at in Program.parse(FORUM, "p").instructions
    ]
    assert found == [
        (at.name, [str(operand.device) for operand in at.operands])
        for at in Program.parse(marked, "p").instructions
    ]


def test_nothing_behind_such_a_text_is_lost() -> None:
    (found,) = [each for each in problems("LD X0 启动 OUT Y0\nEND") if "启动" in str(each)]
    assert "is no device or constant" in str(found)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("TMR T0 K10", "did you mean OUT?"),
        ("LDN X0", "did you mean LDI?"),
        ("A X0", "did you mean AND?"),
        ("JMP P0", "did you mean CJ?"),
        ("LD SM400", "it is one of an FX5 or Q series"),
        ("MOV K1 ZR100", "it is one of an FX5 or Q series"),
        ("OUT T0 5", "did you mean K5?"),
        ("TON T0 K5", "did you mean OUT?"),
    ],
)
def test_what_other_makes_and_series_call_it(text: str, says: str) -> None:
    assert says in str(problems(f"LD X0\n{text}\nEND"))


@pytest.mark.parametrize(
    ("line", "operands"),
    [
        ("OUT Y000   KM1主接触器", "Y0"),
        ("OUT T0 K5（0.5秒）", "T0 K5"),
        ("OUT T0 SP K5 0.5秒", "T0 K5"),
        ("OUT Y0【灯】", "Y0"),
        ("OUT Y0<灯>", "Y0"),
        ("OUT Y0 KM1(主接触器)", "Y0"),
        ("OUT Y0 motor 1 主接触器", "Y0"),
        ("OUT Y0 Y0灯", "Y0"),
        ("MOV K1 D0计数", "K1 D0"),
        ("OUT C0 K3 C0计数器", "C0 K3"),
        ("AND< D0 K1 D0过小", "D0 K1"),
        ("AND < D0 K1 D0过小", "D0 K1"),
        ("OUT Y0 (램프)", "Y0"),
    ],
)
def test_a_text_in_east_asian_letters_is_a_comment_wherever_it_begins(line: str, operands: str) -> None:
    program = Program.parse(f"LD X0启动\n{line}\nOUT Y7\nEND程序结束", "p")
    found = program.instructions[1].operands
    assert [str(each.device) if each.kind != "K" else each.text for each in found] == (operands.split())
    assert [each.name for each in program.instructions[2:]] == ["OUT", "END"]


@pytest.mark.parametrize("line", ["OUT Y0 main contactor", "OUT Y0 KM1", "OUT T0 K5(0.5s)", "OUT Y0 X1"])
def test_other_texts_are_asked_for_their_mark(line: str) -> None:
    with pytest.raises(ProgramError, match="put ; in front of a comment"):
        Program.parse(f"LD X0\n{line}\nEND", "p")
    with pytest.raises(ProgramError) as caught:
        Program.parse("LD X0\nMOV K1 D99999\nEND", "p")
    assert "comment" not in str(caught.value)


@pytest.mark.parametrize(
    "line", ["OUT T0 SP K5", "OUT T 0\nSP K 5", "3 OUT T0\n  SP K5", "OUT SP T 0 SP K 5"]
)
def test_the_key_sp_of_a_handheld_programmer_stands_for_a_blank(line: str) -> None:
    program = Program.parse(f"LD X0\n{line}\nMOV SP K5 SP D0\nEND", "p")
    assert [[each.text for each in at.operands] for at in program.instructions[1:3]] == [
        ["T0", "K5"],
        ["K5", "D0"],
    ]


@pytest.mark.parametrize(("text", "value"), [("H FF", 0xFF), ("H 0C81", 0x0C81), ("h 5", 5), ("H A5", 0xA5)])
def test_between_h_and_its_digits_may_be_a_blank(text: str, value: int) -> None:
    program = Program.parse(f"LD X0\nMOV {text} D 1\nEND", "p")
    assert [each.address for each in program.instructions[1].operands] == [value, 1]

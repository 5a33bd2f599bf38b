"""Lists as they are pasted from forums and other makes: texts without a comment's mark, names from elsewhere."""

from __future__ import annotations

import pytest

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
    ],
)
def test_what_other_makes_and_series_call_it(text: str, says: str) -> None:
    assert says in str(problems(f"LD X0\n{text}\nEND"))

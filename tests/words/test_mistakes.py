"""What is wrong or odd in a scenario, in Chinese."""

import pytest

from bussim.errors import Problem
from bussim.scenario.loader import examine_text
from bussim.words.language import say, shown, use_language
from tests.words.chinese import english_in, watched

_LINE = """schema: 1
name: line
duration: 1 s
buses: [{name: link, nn: true}]
plcs:
  - {name: press1, profile: pw10, scan: 8 ms, nn: {bus: link, station: 0, slaves: 1}}
  - {name: press2, profile: pw10, scan: 8 ms, nn: {bus: link, station: 1}}
"""
_PROGRAM = """  - name: press2
    profile: pw10
    scan: 8 ms
    nn: {bus: link, station: 1}
    program: |
      LD X0
      OUT Y0
      LD X1
      OUT Y0
      END
"""


@pytest.mark.parametrize(
    ("right", "wrong", "english", "chinese"),
    [
        ("duration: 1 s", "durration: 1 s", "did you mean duration?", "是不是指 duration？"),
        ("duration: 1 s", "duration: 1 sec", "has the unit 'sec'", "单位是 'sec'；允许"),
        ("scan: 8 ms", "scan: 8", "scan is 8, a time without a unit", "scan：是 8，没有单位的时间"),
        ("station: 0", "station: 9", "nn.station is 9, allowed 0..7", "nn.station：是 9，允许 0..7"),
        ("station: 0", "station: [1]", "is a list, expected a whole number", "是 列表，应为整数 0..7"),
        ("duration: 1 s", "", "duration is missing", "duration：缺少"),
        ("link, station: 1", "lin, station: 1", "which is no bus; did you", "不是总线；是不是指 link？"),
        ("name: press2", "name: press1", "is used already (in line 6)", "已经用过（第 6 行）"),
        ("station: 0", "station: 0, timeout: 5 s", "(profile pw10)", "（机型 pw10）"),
        ("name: line", "name: [line", "a [ is never closed; write ] here", "有一个 [ 没有闭合；请在这里写 ]"),
        ("plcs:", "plcs", "plcs has no colon; write plcs:", "plcs 没有冒号；请写 plcs:"),
        ("name: line", "name: @line", "begins with a sign of YAML", "以 YAML 的符号开头"),
    ],
)
def test_a_mistake_is_said_in_both_languages(right: str, wrong: str, english: str, chinese: str) -> None:
    found = examine_text(_LINE.replace(right, wrong, 1)).errors
    assert any(english in each.message for each in found), found
    with use_language("zh"):
        said = shown(found)
    assert any(chinese in each.message for each in said), said
    places = [[(each.line, each.column, each.path) for each in texts] for texts in (found, said)]
    assert places[0] == places[1]


def test_lines_that_a_message_about_a_program_names_are_those_of_the_file_in_chinese_too() -> None:
    lines = _LINE.splitlines(keepends=True)
    found = examine_text("".join(lines[:-1]) + _PROGRAM)
    (warning,) = found.warnings
    assert warning.message == "press2: Y0 is driven at line 13 too; the last one executed wins"
    with use_language("zh"):
        assert shown(warning.message) == "press2：Y0 在第 13 行也被驱动；最后执行的有效"
        assert shown(found.get().warnings) == ["press2：Y0 在程序第 2 行也被驱动；最后执行的有效"]


def test_the_watch_over_the_mistakes_of_other_tests_sees_english(monkeypatch: pytest.MonkeyPatch) -> None:
    found = say("form_empty")
    assert english_in(say("form_expected", found=found, expected="a line of text")) == ["line of text"]
    assert english_in(say("form_expected", found=found, expected=say("form_text"))) == []
    monkeypatch.setenv("PYTEST_CURRENT_TEST", "tests/scenario/test_x.py::test_y")
    inside = {"__name__": "bussim.x", "Problem": Problem, "say": say}
    with watched():
        with pytest.raises(AssertionError, match="without a key"):
            exec("Problem('a.yaml', 1, 1, 'is wrong')", inside)  # noqa: S102
        exec("Problem('a.yaml', 1, 1, say('form_empty'))", inside)  # noqa: S102

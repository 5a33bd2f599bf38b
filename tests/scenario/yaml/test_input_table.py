"""Tables of times that drive an input."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bussim.scenario.yaml.input_table import read_times
from bussim.scenario.yaml.source_map import Report, SourceMap
from bussim.units import TICKS_PER_SECOND as S


def read(text: str) -> tuple[tuple[int, ...] | None, list[str]]:
    report = Report(SourceMap("x.yaml"))
    return read_times(text, "e.csv", ("plcs", 0, "inputs", "X0", "csv"), report), [
        str(problem) for problem in report.errors
    ]


@pytest.mark.parametrize(
    ("text", "times"),
    [
        ("1\n2.5\n", (S, S * 5 // 2)),
        ("time_s\n1\n", (S,)),
        ("time (s)\r\n1\r\n", (S,)),
        ("\n# from the door\n\nt\n.5\n1e1\n", (S // 2, 10 * S)),
        ('"seconds"\n"1"\n', (S,)),
        ("0\n1\n", (0, S)),
        # Each row sets the level; equal ones in a row are no change.
        ("time,level\n1,1\n2,1\n3,0\n4,0\n5,1\n", (S, 3 * S, 5 * S)),
        ("time;X0\n0;0\n1;1\n", (S,)),
        ("1\t1\n2\t0\n", (S, 2 * S)),
    ],
)
def test_a_table(text: str, times: tuple[int, ...]) -> None:
    assert read(text) == (times, [])


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1\n1\nx\n3\n", ["2:1: 1 s is not later than the time before; times must rise", "3:1: is 'x', expected a time in seconds such as 1.25"]),
        # A first line that is no time is a heading only if it looks like one.
        ("1.5x\n2\n", ["1:1: is '1.5x', expected a time in seconds such as 1.25"]),
        ("nan\n2\n", ["1:1: is 'nan', expected a time in seconds such as 1.25"]),
        ("inf\n2\n", ["1:1: is 'inf', expected a time in seconds such as 1.25"]),
        ("1e400\n2\n", ["1:1: is '1e400', expected a time in seconds such as 1.25"]),
        ("-1\n2\n", ["1:1: is '-1', expected a time in seconds such as 1.25"]),
        ("t1.5\n2\n", ["1:1: is 't1.5', expected a time in seconds such as 1.25"]),
        ("time,5\n2,1\n", ["1:1: is 'time', expected a time in seconds such as 1.25", "1:1: the level is '5', allowed 0, 1"]),
        ("time\nlevel\n2\n", ["2:1: is 'level', expected a time in seconds such as 1.25"]),
        ("1,5\n", ["1:1: the level is '5', allowed 0, 1"]),
        ("1,5;1\n", ["1:1: is '1,5', expected a time in seconds such as 1.25; write 1.5"]),
        ("1,\n", ["1:1: the level is empty, allowed 0, 1"]),
        (",1\n", ["1:1: the time is empty, expected seconds such as 1.25"]),
        ("1,1,door\n", ["1:1: has 3 columns, allowed are a time and a level (0 or 1)"]),
        ("time,level,what\n1,1\n", ["1:1: has 3 columns, allowed are a time and a level (0 or 1)"]),
        ("1,1\n2\n", ["2:1: has no level, but line 1 is with one"]),
        ("time\n2,1\n", ["2:1: has a level, but line 1 is without one"]),
        ("", ["1:1: has no times: nothing but empty lines and comments"]),
        ("\n# 1\n", ["1:1: has no times: nothing but empty lines and comments"]),
        ("\nseconds\n", ["2:1: has no times: nothing follows the heading"]),
        ("1,0\n2,0\n", ["1:1: has no changes: the level is 0 in every row, as it is before the first"]),
    ],
)  # fmt: skip
def test_a_mistake_has_its_line(text: str, expected: list[str]) -> None:
    assert read(text) == (None, [f"e.csv:{message}" for message in expected])


def test_sizes_are_bounded() -> None:
    assert read("".join(f"{n}\n" for n in range(10_001))) == (
        None,
        ["e.csv:10001:1: more than 10000 changes"],
    )
    level = "".join(f"{n},1\n" for n in range(20_000))
    assert read(level) == ((0,), [])
    assert len(read("1\nx\n" * 500)[1]) == 20


@given(st.lists(st.tuples(st.integers(1, 50), st.booleans()), min_size=1, max_size=30))
def test_the_level_after_each_row_is_what_the_row_says(rows: list[tuple[int, bool]]) -> None:
    now, lines, expected = 0, [], []
    for gap, level in rows:
        now += gap
        lines.append(f"{now},{int(level)}")
        expected.append((now * S, int(level)))
    times, errors = read("\n".join(lines))
    if not any(level for _, level in rows):
        assert times is None
        return
    assert not errors
    assert times is not None
    for tick, level in expected:
        assert sum(change <= tick for change in times) % 2 == level


@given(st.text(alphabet='0123456789.,;\t\n#ex "-+nat', max_size=60))
def test_no_table_is_an_exception(text: str) -> None:
    times, errors = read(text)
    assert (times is None) == bool(errors)

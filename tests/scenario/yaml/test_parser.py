"""Plain data and places from YAML: the core schema of YAML 1.2, anchors, merge keys."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bussim.scenario.yaml import parser as yaml
from bussim.wording import RawFloat, RawInt


def _value(text: str) -> object:
    data, _, problems = yaml.read(f"x: {text}\n", "test")
    assert problems == []
    assert isinstance(data, dict)
    return data["x"]


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("12", 12),
        ("+12", 12),
        ("-3", -3),
        ("010", 10),  # not octal in YAML 1.2
        ("0o17", 15),
        ("0x16", 22),
        ("1.5", 1.5),
        ("1e-6", 1e-6),
        ("1.0e-6", 1e-6),
        (".5", 0.5),
        ("7E1", 70.0),
        ("-.inf", -math.inf),
        ("true", True),
        ("False", False),
        ("yes", "yes"),
        ("on", "on"),
        ("1_000", "1_000"),
        ("12:30", "12:30"),
        ("8 ms", "8 ms"),
        ("'7'", "7"),
        ('"true"', "true"),
        ("~", None),
        ("", None),
        ("2001-01-01", "2001-01-01"),
        ("C:\\scenarios\\x", "C:\\scenarios\\x"),
        ("COM7", "COM7"),
    ],
)
def test_plain_scalars_follow_the_core_schema(text: str, value: object) -> None:
    found = _value(text)
    assert found == value
    assert type(found) in (type(value), RawInt, RawFloat)


@pytest.mark.parametrize("text", ["7E1", "8E1", "0x16", "1.50", "007"])
def test_a_number_remembers_its_text(text: str) -> None:
    found = _value(text)
    assert isinstance(found, RawInt | RawFloat)
    assert found.raw == text


def test_positions_of_keys_and_values() -> None:
    _, source_map, _ = yaml.read("a: 1\nb:\n  - {c: 2}\n  -   d\n", "test")
    assert source_map.keys == {("a",): (1, 1), ("b",): (2, 1), ("b", 0, "c"): (3, 6)}
    assert source_map.values == {
        (): (1, 1),
        ("a",): (1, 4),
        ("b",): (3, 3),
        ("b", 0): (3, 5),
        ("b", 0, "c"): (3, 9),
        ("b", 1): (4, 7),
    }


def test_an_alias_is_a_copy_of_its_anchor() -> None:
    assert _value("&here [1, {a: 2}]\ny: [*here, *here]") == [1, {"a": 2}]
    data, _, problems = yaml.read("a: &a {n: 1}\nb: *a\n", "test")
    assert problems == []
    assert data == {"a": {"n": 1}, "b": {"n": 1}}


def test_merge_keys_give_what_the_mapping_itself_does_not() -> None:
    text = "base: &base {a: 1, b: 2}\nmore: &more {b: 3, c: 4}\nx: {b: 9, <<: [*base, *more], d: 5}\n"
    data, source_map, problems = yaml.read(text, "test")
    assert problems == []
    assert isinstance(data, dict)
    assert data["x"] == {"b": 9, "d": 5, "a": 1, "c": 4}
    assert source_map.values["x", "a"] == (1, 17)  # where it is written


def test_a_quoted_merge_key_is_an_ordinary_key() -> None:
    assert _value('{"<<": 1}') == {"<<": 1}


def test_a_merge_key_of_something_else() -> None:
    _, _, problems = yaml.read("x: {<<: 5, a: 1}\n", "test")
    assert [str(problem) for problem in problems] == ["test:1:9: << takes a mapping or a list of mappings"]


_PLAIN = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(10**9), 10**9)
    | st.text("abcxyz :#-{}[],'\"&*!%@\n\t", max_size=12),
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.text("abc ", max_size=4), inner, max_size=4)
    ),
    max_leaves=15,
)


@settings(deadline=None)
@given(_PLAIN)
def test_what_another_writer_writes_is_read_back(data: object) -> None:
    import json

    # JSON is YAML: the same data come back.
    found, _, problems = yaml.read(json.dumps({"x": data}), "test")
    assert problems == []
    assert found == {"x": data}


SOURCE = """\
schema: 1
plcs:
  - {name: a, scan: 8 ms, 'quoted': [1, "two\\n", ~]}  # a comment, 中文
  - &b
    name: b
    program: |
      LD X0
       OUT Y0
    other: >-
      folded
      text
  - {<<: *b, name: c: d}
"""


@given(st.data())
def test_both_parsers_of_the_library_read_the_same(data: st.DataObject) -> None:
    """Whatever a few strokes make of a text: where the parser in Python reads it, libyaml gives the same.

    libyaml reads a little more (YAML 1.2 allows a ``?`` inside a word in braces), and looks less far ahead, so that
    of several mistakes another may be named.
    """
    text = SOURCE
    for _ in range(data.draw(st.integers(0, 3))):
        at, length = data.draw(st.integers(0, len(text))), data.draw(st.integers(0, 3))
        text = text[:at] + data.draw(st.text("a:-,[]{}&*#|>'\"%@!? \n0中", max_size=2)) + text[at + length :]

    def outcome() -> object:
        found, marks, problems = yaml.read(text, "test")
        return None if problems else (found, marks.values, marks.keys)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("yaml.__with_libyaml__", False)
        expected = outcome()
    assert expected is None or repr(outcome()) == repr(expected)

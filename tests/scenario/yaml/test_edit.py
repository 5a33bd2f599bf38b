"""Values changed in a scenario's text: what was asked for says the new value, every other line is the same."""

from __future__ import annotations

from collections.abc import Iterator
from difflib import SequenceMatcher

import pytest

import bussim
from bussim.errors import ScenarioError, UsageError
from bussim.scenario import builtin
from bussim.scenario.yaml.parser import read

TEXT = """\
schema: 1   # always
name: line
buses:
  - {name: link, nn: true}  # one
plcs:
  # the master
  - name: press
    scan: 8 ms              # by D8012
    nn:
      bus: link
      station: 0
      retries: 0x3
  - {name: feeder, nn: {bus: link, station: 1}}
noise: []
comment:
"""


def changed_lines(old: str, new: str) -> list[tuple[str, str]]:
    """Lines of the old text beside those that stand there in the new one."""
    one, two = old.splitlines(keepends=True), new.splitlines(keepends=True)
    return [
        ("".join(one[a:b]), "".join(two[c:d]))
        for kind, a, b, c, d in SequenceMatcher(None, one, two, autojunk=False).get_opcodes()
        if kind != "equal"
    ]


@pytest.mark.parametrize(
    ("path", "value", "expected"),
    [
        ("name", "press line", [("name: line\n", "name: press line\n")]),
        ("name", "yes: no", [("name: line\n", "name: 'yes: no'\n")]),
        ("plcs.press.nn.retries", 5, [("      retries: 0x3\n", "      retries: 5\n")]),
        ("plcs.press.nn.retries", 3, []),
        (
            "plcs.0.scan",
            "9ms",
            [("    scan: 8 ms              # by D8012\n", "    scan: 9ms              # by D8012\n")],
        ),
        (
            "plcs.press.scan.jitter",
            "1 ms",
            [
                (
                    "    scan: 8 ms              # by D8012\n",
                    "    scan: {mean: 8 ms, jitter: 1 ms}              # by D8012\n",
                )
            ],
        ),
        ("plcs.press.nn.timeout", "60 ms", [("", "      timeout: 60 ms\n")]),
        ("plcs.press.scan_end", True, [("", "    scan_end: true\n")]),
        (
            "plcs.feeder.nn.mode",
            2,
            [
                (
                    "  - {name: feeder, nn: {bus: link, station: 1}}\n",
                    "  - {name: feeder, nn: {bus: link, station: 1, mode: 2}}\n",
                )
            ],
        ),
        ("noise", [{"bus": "link", "ber": 1e-6}], [("noise: []\n", "noise: [{bus: link, ber: 1.0e-06}]\n")]),
        ("comment", "new", [("comment:\n", "comment: new\n")]),
        ("seed", 7, [("", "seed: 7\n")]),
    ],
)
@pytest.mark.parametrize("ends", ["\n", "\r\n"])
@pytest.mark.parametrize("mark", ["", "\ufeff"], ids=["plain", "byte order mark"])
def test_only_what_is_asked_for_changes(
    path: str, value: object, expected: list[tuple[str, str]], ends: str, mark: str
) -> None:
    text = TEXT.replace("\n", ends)
    lines = [(old.replace("\n", ends), new.replace("\n", ends)) for old, new in expected]
    new = bussim.edit(mark + text, {path: value})
    assert new.startswith(mark)
    assert changed_lines(text, new.removeprefix(mark)) == lines


def scalars(data: object, path: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    if isinstance(data, dict):
        for key, value in data.items():
            yield from scalars(value, (*path, key))
    elif isinstance(data, list):
        for number, value in enumerate(data):
            yield from scalars(value, (*path, number))
    else:
        yield path


def at(data: object, path: tuple[str | int, ...]) -> object:
    for part in path:
        data = data[part]  # type: ignore[index]
    return data


@pytest.mark.parametrize("most", [pytest.param(1000, marks=pytest.mark.slow), 8])
@pytest.mark.parametrize("name", builtin.names())
def test_each_value_of_each_scenario_can_be_changed(name: str, most: int) -> None:
    """A text in the place of any value: no other line changes, and what is read differs in that value only."""
    text = builtin.read(name)
    before = read(text, name)[0]
    paths = list(scalars(before))
    for path in paths[:: len(paths) // most + 1]:
        if any("." in str(part) for part in path):
            continue  # a key that no path can name
        new = bussim.edit(text, {".".join(map(str, path)): "other: value, [}"})
        after = read(new, name)[0]
        assert at(after, path) == "other: value, [}"
        old_lines = changed_lines(text, new)
        assert len(old_lines) == 1
        if "\n" not in str(at(before, path)):
            assert old_lines[0][0].count("\n") == old_lines[0][1].count("\n") == 1
        holder = at(after, path[:-1])
        holder[path[-1]] = at(before, path)  # type: ignore[index]
        assert after == before


def test_what_is_used_twice_is_not_changed_by_itself() -> None:
    text = "schema: 1\nplcs:\n  - &one {name: a, scan: 8 ms}\n  - {<<: *one, name: b}\n  - *one\n"
    with pytest.raises(UsageError, match=r"changing plcs\.b\.scan: it cannot be changed by itself"):
        bussim.edit(text, {"plcs.b.scan": "9 ms"})
    with pytest.raises(UsageError, match="by itself"):
        bussim.edit(text, {"plcs.0.scan": "9 ms"})


@pytest.mark.parametrize(
    "text", ["", "- 1\n", "schema: 1\nname: a: b\n", "a: !!python/name:os.system\n", "{"]
)
def test_a_text_that_is_no_scenario(text: str) -> None:
    with pytest.raises(ScenarioError):
        bussim.edit(text, {"seed": 1})


def test_a_path_that_leads_nowhere() -> None:
    with pytest.raises(UsageError, match="did you mean press"):
        bussim.edit(TEXT, {"plcs.pres.scan": "9 ms"})


def test_what_was_measured_is_not_once_it_is_set() -> None:
    """``measured`` names the values that a recording gave."""
    text = "schema: 1\nplcs:\n  - {name: a, scan: 8 ms, measured: {scan: s.csv, nn: s.csv}}\n"
    new = bussim.edit(text, {"plcs.a.scan": "9 ms"})
    assert new == "schema: 1\nplcs:\n  - {name: a, scan: 9 ms, measured: {nn: s.csv}}\n"
    block = "schema: 1\nline:\n  rate: 5\n  measured:\n    rate: s.csv\n    other: s.csv\n"
    assert (
        bussim.edit(block, {"line.rate": 6}) == "schema: 1\nline:\n  rate: 6\n  measured:\n    other: s.csv\n"
    )


@pytest.mark.parametrize(
    "text",
    [
        "schema: 1\nplcs:\n  - name: a   # first\n    scan: 5 ms\n  - {name: b}  # second\n\n# behind\nname: x\n",
        "schema: 1\nplcs:\n- name: a\n- name: b\n",
        "schema: 1\r\nplcs:\r\n  - name: a\r\n  - name: b\r\nname: x\r\n",
        "schema: 1\nplcs: [{name: a}, {name: b}]  # both\n",
        "schema: 1\nplcs: [\n  {name: a},  # first\n  {name: b},\n]\n",
    ],
)
def test_a_list_grows_and_shrinks_at_its_end(text: str) -> None:
    data = read(text, "x")[0]
    assert isinstance(data, dict)
    more = [*data["plcs"], {"name": "c", "nn": {"station": 2}}, {"name": "d"}]
    grown = bussim.edit(text, {"plcs": more})
    assert read(grown, "x")[0] == {**data, "plcs": more}
    assert bussim.edit(grown, {"plcs": data["plcs"]}) == text
    one = bussim.edit(text, {"plcs": data["plcs"][:1]})
    assert read(one, "x")[0] == {**data, "plcs": data["plcs"][:1]}

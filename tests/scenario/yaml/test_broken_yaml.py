"""Documents that are not a mapping of the right sections, or no YAML: each mistake with its place and its message."""

from __future__ import annotations

import pytest

from bussim.scenario.yaml import parser
from tests.scenario.samples import BASE, added, changed, mistakes

CASES: dict[str, tuple[str, list[str]]] = {
    "no plcs": (
        BASE.split("plcs:")[0] + "plcs: []\n",
        ["x.yaml:6:7: plcs has 0 entries, allowed 1..64"],
    ),
    "plcs missing": (
        BASE.split("plcs:")[0],
        ["x.yaml:1:1: plcs is missing"],
    ),
    "buses text": (
        changed("buses:\n  - {name: link, nn: true}", "buses: link"),
        ["x.yaml:4:8: buses is 'link', expected a list, each entry with a dash: - {name: link, nn: true}"],
    ),
    "root list": (
        "- 1\n- 2\n",
        [
            "x.yaml:1:1: a scenario is a mapping with keys such as schema: 1, name: …, duration: 60 s; this is a list"
        ],
    ),
    "root text": (
        "hello\n",
        [
            "x.yaml:1:1: a scenario is a mapping with keys such as schema: 1, name: …, duration: 60 s; this is 'hello'"
        ],
    ),
    "tag2": (
        added("seed: !env X\n"),
        [
            "x.yaml:12:7: seed is 'X', expected a whole number 0..9223372036854775807",
            "x.yaml:12:7: the tag !env is not allowed; write plain text and numbers",
        ],
    ),
    "dup key": (
        changed("scan: 8 ms", "scan: 8 ms\n    scan: 9 ms"),
        ["x.yaml:9:5: scan is given twice, first in line 8"],
    ),
    "dup key nested": (
        changed("station: 2", "station: 2, station: 3"),
        ["x.yaml:11:72: nn.station is given twice, first in line 11"],
    ),
    "syntax": (
        changed("{name: link, nn: true}", "{name: link, nn: true"),
        ["x.yaml:5:26: a { is never closed; write } here"],
    ),
    "listing": (
        changed(
            "    scan: 8 ms",
            "    scan: 8 ms\n    program: |\n         0 LD X0\n      10 OUT Y0\n      12 END",
        ),
        ["x.yaml:9:15: its lines begin deeper than they go on: indent them evenly, or write program: |2"],
    ),
    "after an even listing": (
        changed("    scan: 8 ms", "    program: |\n      LD X0\n\n        OUT Y0\n      END\n   scan: 8 ms"),
        ["x.yaml:13:4: the line begins in column 4; expected column 5, as a line above it"],
    ),
    "tab": (
        changed("    scan: 8 ms", "\tscan: 8 ms"),
        ["x.yaml:8:1: a tab indents the line; YAML takes blanks only"],
    ),
    "tabs in a program": (
        changed("    scan: 8 ms", "    scan: 8 ms\n    program: |\n\tLD X0\n\tOUT Y0\n\tEND"),
        [f"x.yaml:{line}:1: a tab indents the line; YAML takes blanks only" for line in (10, 11, 12)],
    ),
    "tabs behind a dash": (
        BASE.replace("\n    ", "\n\t"),
        [f"x.yaml:{line}:1: a tab indents the line; YAML takes blanks only" for line in (8, 9)],
    ),
    "two docs": (
        added("---\nname: x\n"),
        ["x.yaml:12:1: a second document begins here; a scenario is one document"],
    ),
    "alias": (
        added("seed: *nothing\n"),
        ["x.yaml:12:7: the alias *nothing has no anchor &nothing before it"],
    ),
    "recursive": (
        "a: &a [*a]\n",
        ["x.yaml:1:8: the alias *a stands inside its own anchor"],
    ),
    "deep": (
        "[" * 100000,
        ["x.yaml:1:31: nested deeper than 30 levels"],
    ),
    "deep block": (
        "".join(" " * i + "a:\n" for i in range(40)),
        ["x.yaml:31:31: nested deeper than 30 levels"],
    ),
    "nul": (
        "name: \0\n",
        ["x.yaml:1:7: the character U+0000 does not belong in text; is it a binary file?"],
    ),
    "empty": (
        "",
        ["x.yaml: is empty; a scenario begins with schema: 1"],
    ),
    "comment": (
        "# nothing\n",
        ["x.yaml: is empty; a scenario begins with schema: 1"],
    ),
    "null": (
        "~\n",
        ["x.yaml: is empty; a scenario begins with schema: 1"],
    ),
    "complex key": (
        added("? [a, b]\n: 1\n"),
        ["x.yaml:12:3: a key must be text, not a list or mapping"],
    ),
    "int key": (
        added("1: 2\n"),
        [
            "x.yaml:12:1: 1 is not a key here; allowed are schema, name, duration, seed, buses, plcs, devices, noise, faults, observe, latency, warnings, allow_unsimulated"
        ],
    ),
    "big number": (
        added("seed: " + "9" * 200 + "\n"),
        [
            "x.yaml:12:7: a number of more than 100 digits",
            "x.yaml:12:7: seed is '9999999999999999999999999999999999999999999999999999999999…, expected a whole number 0..9223372036854775807",
        ],
    ),
}


@pytest.mark.parametrize(("text", "expected"), CASES.values(), ids=CASES.keys())
def test_the_message_says_what_where_and_what_is_allowed(text: str, expected: list[str]) -> None:
    assert mistakes(text) == expected


@pytest.mark.parametrize(("first", "second"), [("\t-", "\t  "), ("\t-", "\t\t"), ("\t\t-", "\t\t\t")])
def test_lines_that_tabs_indent_are_mended_together(
    first: str, second: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each was mended by itself, in several readings of the whole: a long text took minutes."""
    readings = []
    monkeypatch.setattr(parser, "_stopped", lambda *given, real=parser._stopped, **more: readings.append(0) or real(*given, **more))  # fmt: skip
    text = "plcs:\n" + "".join(f"{first} name: plc{n}\n{second}scan: 8 ms\n" for n in range(20))
    data, _, problems = parser.read(f"schema: 1\n{text}", "x.yaml")
    assert data == {"schema": 1, "plcs": [{"name": f"plc{n}", "scan": "8 ms"} for n in range(20)]}
    assert [(each.line, each.column) for each in problems] == [(line, 1) for line in range(3, 43)]
    assert len(readings) <= 20

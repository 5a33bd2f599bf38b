"""How texts show numbers with their nouns."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import bussim
from bussim.wording import counted

#: What follows a number: a plural noun, with at most two words before it.
PLURAL = re.compile(r" (?:[a-z-]+ ){0,2}[a-z-]+[^s\W]s(?![\w'])")
#: What looks like a plural noun and is none.
VERBS = re.compile(r" (is|was|has|ends|gives|ms|bps|times less|one after)\b")


#: Numbers that are never 1 where they are printed, mostly because they are too great.
NEVER_ONE = {
    "command.py": {"bits", "words"},
    "engine.py": {"data"},
    "fields.py": {"data"},
    "input_table.py": {"cells"},
    "line.py": {"rate", "sound_characters"},  # a sound frame has several
    "load.py": {"size"},
    "overrides.py": {"parts"},
    "packing.py": {"words"},
    "page.py": {"sources"},
    "pdu.py": {"data"},
    "plc_probe.py": {"count"},
    "report.py": {"runs"},
    "run.py": {"gaps"},
    "session.py": {"attempts"},
    "show.py": {"stations"},
    "sigrok.py": {"file_size", "lanes", "length", "rate"},
    "source.py": {"text"},
    "style.py": {"runs"},
    "timeline.py": {"frames"},
    "turnaround_sums.py": {"_kinds"},
    "unmet_goals.py": {"stations"},
    "vary.py": {"repeat"},
    "watch.py": {"found"},
}


def test_a_number_has_its_noun() -> None:
    assert counted(1, "fault") == "1 fault"
    assert counted(0, "fault") == "0 faults"
    assert counted(2_000, "link scan") == "2,000 link scans"
    assert [counted(number, "retry") for number in (1, 3)] == ["1 retry", "3 retries"]
    assert [counted(number, "address") for number in (1, 3)] == ["1 address", "3 addresses"]
    assert counted(2, "byte") == "2 bytes"
    assert counted(2, "turn a day") == "2 turn a days"  # the noun stands last
    assert counted(0.5, "false station error") == "0.5 false station errors"


def plain_counts(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """The places where an f-string puts a plural after a number that it has counted."""
    for text in (node for node in ast.walk(tree) if isinstance(node, ast.JoinedStr)):
        for number, after in zip(text.values, text.values[1:], strict=False):
            if not isinstance(number, ast.FormattedValue) or not isinstance(after, ast.Constant):
                continue
            shown = ast.unparse(number.value)
            thousands = number.format_spec is not None and ast.unparse(number.format_spec) == "f','"
            limit = re.fullmatch(r"_?[A-Z_]+", shown)
            noun = str(after.value)
            if ("len(" in shown or thousands) and not limit and PLURAL.match(noun) and not VERBS.match(noun):
                yield text.lineno, f"{{{shown}}}{noun[:30]}"


@pytest.mark.slow
def test_no_text_says_one_faults() -> None:
    found = {
        f"{path.name}:{line}": text
        for path in Path(bussim.__file__).parent.rglob("*.py")
        for line, text in plain_counts(ast.parse(path.read_text(encoding="utf-8")))
        if not set(re.findall(r"\w+", text)) & NEVER_ONE.get(path.name, set())
    }
    assert found == {}

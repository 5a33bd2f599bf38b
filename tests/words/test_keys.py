"""Each key of the tables is used, and each key that is used is there."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from string import Formatter

import pytest

import bussim
from bussim.report.settings import SETTINGS
from bussim.results.plots.style import FRAMES
from bussim.scenario.provenance import FIGURES, link_inputs
from bussim.words.tables import PAGES, TABLES, entries, keys_of, read_table

_ROOT = Path(bussim.__file__).parent
#: Keys that a code or a name completes, and texts that a summary or a trace has in English.
_BY_CODE = (
    *("code_", "exception_", "port_error_", "reason_", "outcome_"),
    *("note_state_", "input_", "kind_", "message_word_"),
    *("yaml_says_", "example_", "file_kind_of_", "slot_", "unit_", "char_"),
)


def _said() -> Iterator[str]:
    """Keys that are named where a text is said."""
    for path in (*_ROOT.rglob("*.py"), *_ROOT.rglob("*.jinja")):
        text = path.read_text(encoding="utf-8")
        yield from re.findall(r'\b(?:say|said_text|render)\(\s*"([\w.]+)"', text)
        yield from re.findall(r'\b(?:say|said_text|render)\(\s*"[\w.]+" if [^()]*? else "([\w.]+)"', text)


def test_each_entry_is_read_alone_as_in_its_whole_table() -> None:
    whole: dict[str, list[str]] = {}
    for name in (*TABLES, *PAGES):
        start = f"{name}." if name in PAGES else ""
        table = read_table("bussim.words", f"{name}.yaml")
        whole |= {start + key: texts for key, texts in table.items()}
    assert {**entries()} == whole


def test_each_key_that_is_said_is_there() -> None:
    assert {*_said()} <= entries().keys()


def test_each_name_that_completes_a_key_has_one() -> None:
    scenario = bussim.load("press_line")
    assert link_inputs(scenario, "link").keys() <= keys_of("input_").keys()
    assert {f"figure_{key.removesuffix('_ms')}" for key in FIGURES} <= entries().keys()
    assert {f"kind_{kind}" for kind in FRAMES} <= entries().keys()
    assert {f"setting_{register}" for register in SETTINGS} <= entries().keys()


@pytest.mark.slow
def test_each_key_is_used() -> None:
    named, made = {*_said()}, set()
    for path in _ROOT.rglob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                named.add(node.value)
            elif isinstance(node, ast.JoinedStr):
                parts = [
                    re.escape(each.value) if isinstance(each, ast.Constant) else r"\w+"
                    for each in node.values
                ]
                if sum(isinstance(each, ast.Constant) and len(each.value) > 2 for each in node.values):
                    made.add(re.compile("".join(parts)))
    for path in _ROOT.rglob("*.yaml"):  # tables beside their modules
        if path.parent.name != "words":
            named |= {*re.findall(r"\w+", path.read_text(encoding="utf-8"))}
    unused = [key for key in entries() if key not in named and not any(each.fullmatch(key) for each in made)]
    # A page's script puts its keys together from parts.
    for path in (*_ROOT.rglob("*.js"), *_ROOT.rglob("*.jinja")):
        named |= {*re.findall(r"\w+", path.read_text(encoding="utf-8"))}
    pages = [key for key in unused if key.partition(".")[0] in PAGES]
    assert [key for key in unused if key not in pages and not key.startswith(_BY_CODE)] == []
    assert [key for key in pages if not {part.rstrip("012") for part in key.split(".")[1:]} <= named] == []


@pytest.mark.slow
def test_each_text_gets_the_values_that_it_shows() -> None:
    for path in _ROOT.rglob("*.py"):
        for call in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(call, ast.Call) or getattr(call.func, "id", "") not in ("say", "said_text"):
                continue
            given = {each.arg for each in call.keywords}
            key = call.args[0].value if call.args and isinstance(call.args[0], ast.Constant) else None
            if key in entries() and None not in given:
                shown = {
                    re.split(r"[.\[]", name)[0]
                    for _, name, *_ in Formatter().parse(entries()[key][0])
                    if name
                }
                assert given == shown, (path.name, call.lineno, key)

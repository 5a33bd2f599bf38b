"""Every command that the output of a command advises can be given, over all built-in scenarios."""

from __future__ import annotations

import html
import re
import shlex
from pathlib import Path

import pytest

from bussim.cli import COMMANDS, main
from bussim.report import scene
from bussim.scenario.builtin import names, read
from tests.undrawn import undrawn

#: A command in a sentence or a line of its own. Where it has an ellipsis it is a form, not a command.
_COMMAND = re.compile(rf"\bbussim (?:{'|'.join(COMMANDS)})(?= )[^\n;<…]*(?![^\n;<]*…)")
#: An option of the same command, with what it is for.
_OPTION = re.compile(r"^ *(--[a-z-]+): ", re.MULTILINE)
#: What a page has beside its text.
_CODE = re.compile(r"<(style|script)\b.*?</\1>", re.DOTALL)


def advised(text: str, given: list[str]) -> list[list[str]]:
    """The words of every command that a text advises; ``given`` is the command that printed it."""
    commands = [
        shlex.split(found.group().removeprefix("bussim ").rstrip(" .)")) for found in _COMMAND.finditer(text)
    ]
    commands += [[*given, option] for option in _OPTION.findall(text)]
    return [words for words in commands if words != given]


@pytest.mark.slow
@pytest.mark.parametrize("name", names())
def test_what_is_advised_can_be_done(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    # So that each page leaves its timeline to a command.
    monkeypatch.setattr(scene, "MOST_SHAPES", 0)
    text = re.sub(r"^duration: .*", "duration: 12 s", read(name), flags=re.MULTILINE)
    Path("scenario.yaml").write_text(text, encoding="utf-8")
    found: list[list[str]] = []
    with undrawn():
        for command in (
            ["check", name],
            ["exact", name],
            ["size", name],
            ["run", name, "--duration", "12s", "--out", "two words/plain"],
            ["run", name, "--duration", "12s", "--trace", "--out", "two words/traced"],
            ["report", "two words/plain"],
            ["report", "two words/traced"],
            ["timeline", "two words/plain"],
            ["export", "two words/plain", "--to", "pcapng"],
        ):
            main(command)
            printed = "\n".join(capsys.readouterr())
            page = Path(printed.strip()) if command[0] == "report" else None
            if page is not None and page.is_file():
                printed += html.unescape(_CODE.sub("", page.read_text(encoding="utf-8")))
            found += [words for words in advised(printed, command) if words not in found]
        assert ["run", "scenario.yaml", "--trace", "--out", "again"] in found
        for number, words in enumerate(found):
            assert main([word.replace("NEW_DIR", f"new {number}") for word in words]) == 0, words


def test_commands_are_found_in_sentences() -> None:
    given = ["exact", "press_line"]
    assert advised('To get one: bussim run "a b/scenario.yaml" --trace --out NEW_DIR\n', given) == [
        ["run", "a b/scenario.yaml", "--trace", "--out", "NEW_DIR"]
    ]
    assert advised("draw it with bussim timeline runs/x --worst.", given) == [
        ["timeline", "runs/x", "--worst"]
    ]
    assert advised("needs a trace (bussim run … --trace)", given) == []
    assert advised("--ignore-faults: one law for the whole run\n", given) == [[*given, "--ignore-faults"]]
    assert advised("bussim 0.1.0, seed 1; # this page: bussim report x", ["report", "x"]) == []

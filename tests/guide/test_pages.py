"""The form of README and guide: what stands where, commands and options that exist, two languages alike."""

from __future__ import annotations

import re
from pathlib import Path

import click
import pytest

from bussim.cli import COMMANDS, cli
from tests.guide.pages import (
    EVERY,
    PAGES,
    README,
    README_ZH,
    TRANSLATED,
    blocks,
    commands,
    name,
    page,
    quoted,
    read,
    table,
    without_blocks,
)

INSTALL = "python3 -m venv .venv && .venv/bin/pip install . && .venv/bin/bussim run\n"
TEST = 'python3 -m venv .venv && .venv/bin/pip install -e ".[test]" && .venv/bin/python -m pytest\n'
#: The options and arguments of a command, where click reads them without carrying anything out.
CONTEXT = click.Context(cli)


def command_of(word: str) -> click.Command:
    found = cli.get_command(CONTEXT, word)
    assert found is not None, f"there is no command {word}"
    return found


def options_of(command: click.Command) -> set[str]:
    return {option for parameter in command.params for option in (*parameter.opts, *parameter.secondary_opts)}


@pytest.mark.parametrize("path", [README, README_ZH], ids=name)
def test_the_first_two_commands_install_and_test(path: Path) -> None:
    """On a machine that has Python 3.11 and this checkout, and nothing else."""
    text = read(path)
    assert blocks(text, "console")[:2] == [INSTALL, TEST]
    windows = blocks(text, "bat")[0].splitlines()
    for posix, line in zip((INSTALL, TEST), windows, strict=True):
        assert line == posix.strip().replace("python3 ", "py ").replace("/bin/", "\\").replace(
            ".venv\\", ".venv\\Scripts\\"
        )
    # Right below, before anything else that is typed.
    assert text.index("```bat") < text.index("```console", text.index(TEST))


@pytest.mark.parametrize("path", [README, README_ZH], ids=name)
def test_a_readme_is_short(path: Path) -> None:
    assert len(read(path).splitlines()) <= 150


def test_the_readmes_lead_to_each_other_and_to_every_page() -> None:
    english, chinese = read(README), read(README_ZH)
    assert "(README.zh-CN.md)" in english
    assert "(README.md)" in chinese
    for path in (*PAGES, *(path for path in TRANSLATED if path != README_ZH)):
        assert f"({name(path)})" in english
        assert f"({name(path)})" in chinese


@pytest.mark.parametrize("path", EVERY, ids=name)
def test_links_lead_to_files(path: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", read(path)):
        if "://" not in target:
            assert (path.parent / target).exists(), target


@pytest.mark.parametrize("path", [README, README_ZH, page], ids=["README", "README.zh-CN", "commands"])
def test_every_command_is_listed(path: Path) -> None:
    text = page("commands") if path is page else read(path)
    listed = [quoted(line)[0].split()[1] for line in text.splitlines() if line.startswith("| `bussim ")]
    assert sorted(listed) == sorted(COMMANDS)


@pytest.mark.parametrize("path", EVERY, ids=name)
def test_every_command_that_is_shown_exists_with_its_options(path: Path) -> None:
    for words in commands(read(path)):
        if words[0] in ("COMMAND", "--version"):
            continue
        command = command_of(words[0])
        arguments = words[1 : words.index("…") if "…" in words else None]
        # What the parser refuses: options that do not exist, or that lack their value.
        command.make_parser(click.Context(command)).parse_args(arguments)


def test_every_option_of_a_commands_row_is_one_of_the_command() -> None:
    for shown, text in table(page("commands"), "command"):
        known = options_of(command_of(quoted(shown)[0].split()[1]))
        for option in re.findall(r"(?<![\w-])--?[a-zA-Z][\w-]*", " ".join(quoted(text))):
            assert option in known, (shown, option)


@pytest.mark.parametrize("chinese", TRANSLATED, ids=name)
def test_a_translated_page_has_the_parts_of_the_english_one(chinese: Path) -> None:
    """The same headings, tables, commands and pictures, whatever is said about them."""
    shapes = []
    for path in (chinese, TRANSLATED[chinese]):
        text = read(path)
        prose = without_blocks(text)
        shapes.append(
            {
                "headings": [len(marks) for marks in re.findall(r"^(#+) ", prose, re.MULTILINE)],
                "tables": [line.count("|") for line in re.findall(r"^\|(?:-+\|)+$", prose, re.MULTILINE)],
                "commands": blocks(text, "console"),
                "pictures": [Path(target).name for target in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", text)],
                "outputs": re.findall(r"<!-- output: (.*) -->", text),
            }
        )
    assert shapes[0] == shapes[1]


@pytest.mark.parametrize("chinese", [path for path in TRANSLATED if path != README_ZH], ids=name)
def test_a_translated_table_has_as_many_rows(chinese: Path) -> None:
    rows = [
        [line.count("|") for line in without_blocks(read(path)).splitlines() if line.startswith("|")]
        for path in (chinese, TRANSLATED[chinese])
    ]
    assert rows[0] == rows[1]

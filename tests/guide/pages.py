"""The README and the pages of the guide, in both languages, and what stands in them."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

ROOT = Path(__file__).parents[2]
_FOLDER = ROOT / "bussim" / "guide"
README = ROOT / "README.md"
README_ZH = ROOT / "README.zh-CN.md"
PAGES = sorted(_FOLDER.glob("*.md"))
#: Each page in Chinese with the English one that it translates.
TRANSLATED = {path: _FOLDER / path.name for path in sorted((_FOLDER / "zh").glob("*.md"))} | {
    README_ZH: README
}
EVERY = [README, README_ZH, *PAGES, *(path for path in TRANSLATED if path != README_ZH)]


def name(path: Path) -> str:
    """The path of a page from the root, as test identifier."""
    return path.relative_to(ROOT).as_posix()


def read(path: Path) -> str:
    """The text of a page."""
    return path.read_text(encoding="utf-8")


def page(topic: str) -> str:
    """The text of an English page of the guide."""
    return read(_FOLDER / f"{topic}.md")


def blocks(text: str, language: str) -> list[str]:
    """The fenced code blocks in a language."""
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


def without_blocks(text: str) -> str:
    """A page's prose and tables."""
    return re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)


def table(text: str, first: str) -> list[list[str]]:
    """The rows of the table whose first heading begins with ``first``, as lists of cells."""
    lines = text.split(f"\n| {first}")[1].split("\n\n")[0].split("\n")[2:]
    return [
        [cell.strip() for cell in re.split(r"(?<!\\)\|", line.strip("|"))] for line in lines if "|" in line
    ]


def quoted(cell: str) -> list[str]:
    """The contents of backquotes in a cell."""
    return re.findall(r"`([^`]+)`", cell)


def commands(text: str) -> list[list[str]]:
    """Every ``bussim`` command of the console blocks and between backquotes, as words after ``bussim``."""
    lines = [line for block in blocks(text, "console") for line in block.splitlines()]
    spans = [span.replace("\\|", "|") for span in quoted(without_blocks(text))]
    return [
        [word for word in shlex.split(line, comments=True)[1:] if word != "&"]
        for line in [*lines, *spans]
        if line.startswith("bussim ")
    ]

"""Names from scenarios made safe: as file names on every system, and as cells of a spreadsheet."""

import re
from collections.abc import Iterable
from unicodedata import normalize

# What Windows forbids in a file name, and white space, which no command line likes.
_UNSAFE = re.compile(r'[<>:"/\\|?*\s\x00-\x1f\x7f]+')
_RESERVED = re.compile(r"(con|prn|aux|nul|com[0-9¹²³]|lpt[0-9¹²³])(\..*)?", re.IGNORECASE)
_LONGEST = 60

# A spreadsheet takes a cell that begins so for a formula.
_FORMULA = re.compile(r"'*[=+\-@\t\r]")


def file_name(name: str) -> str:
    """A name that is a file's or a folder's on Windows, macOS and Linux, never empty.

    Spaces and forbidden characters become underscores; letters of any script stay.
    """
    # Composed, for macOS takes é and e with an accent for the same name.
    safe = _UNSAFE.sub("_", normalize("NFC", name))[:_LONGEST].strip("._")
    if not safe:
        return "_"
    return f"_{safe}" if _RESERVED.fullmatch(safe) else safe


def file_names(names: Iterable[str]) -> dict[str, str]:
    """A safe file name for each name, different also where capitals and small letters are the same."""
    taken: set[str] = set()
    safe: dict[str, str] = {}
    for name in names:
        stem = candidate = file_name(name)
        number = 1
        while candidate.casefold() in taken:
            number += 1
            candidate = f"{stem}-{number}"
        taken.add(candidate.casefold())
        safe[name] = candidate
    return safe


def cell(text: str) -> str:
    """A text as a cell that no spreadsheet takes for a formula: an apostrophe before = + - @."""
    return f"'{text}" if _FORMULA.match(text) else text


def from_cell(text: str) -> str:
    """The text of :func:`cell`."""
    return text[1:] if text.startswith("'") and _FORMULA.match(text) else text

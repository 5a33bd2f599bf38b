"""The tables of texts by key, and texts that know their key and values."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from importlib.resources import files
from string import Formatter
from typing import Any

#: The languages, in the order of the tables' columns: English and Chinese (zh-Hans).
LANGUAGES = ("en", "zh")
#: The tables, and those of pages, whose keys begin with the table's name: their scripts have them without it.
TABLES = (
    *("verdict", "solver", "run", "pictures", "report_parts"),
    *("mistakes", "mistakes_rules", "mistakes_program"),
)
PAGES = ("sizing", "report", "ui")
#: A text of fewer letters than this besides its values, or of one word, may be that of something else.
_LEAST_LETTERS = 8
#: An entry of a table: its key, and its texts beside it or on the lines that follow.
_ENTRY = re.compile(r'^"?([\w.]+)"?:(.*(?:\n[ -].*)*)', re.MULTILINE)


class Said(str):
    """A text in English that knows its key and its values, and so can be shown in each language."""

    __slots__ = ("key", "values")
    key: str
    values: Mapping[str, Any]

    def __new__(cls, text: str, key: str, values: Mapping[str, Any]) -> Said:
        """The text of a key with these values."""
        self = super().__new__(cls, text)
        self.key, self.values = key, values
        return self

    def __getnewargs__(self) -> tuple[str, str, Mapping[str, Any]]:  # type: ignore[override]
        return str(self), self.key, self.values


def read_table(package: str, name: str) -> Any:
    """A table of YAML that stands beside the modules of a package, as plain data."""
    return _loaded(files(package).joinpath(name).read_text(encoding="utf-8"))


def _loaded(text: str) -> Any:
    import yaml

    return yaml.load(text, yaml.CSafeLoader if yaml.__with_libyaml__ else yaml.SafeLoader)  # noqa: S506 (safe)


class _Entries(Mapping[str, list[str]]):
    """The entries of all tables, each read when it is asked for: a command says a few of two thousand."""

    def __init__(self) -> None:
        self._lines: dict[str, str] = {}
        self._read: dict[str, list[str]] = {}
        for name in (*TABLES, *PAGES):
            text = files(__package__).joinpath(f"{name}.yaml").read_text(encoding="utf-8")
            for found, lines in _ENTRY.findall(text):
                key = f"{name}.{found}" if name in PAGES else found
                if self._lines.setdefault(key, lines) is not lines:
                    raise ValueError(f"{name}.yaml has a key that there is already: {key}")

    def __getitem__(self, key: str) -> list[str]:
        if key not in self._read:
            self._read[key] = _loaded(self._lines[key])
        return self._read[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._lines)

    def __len__(self) -> int:
        return len(self._lines)


@cache
def entries() -> Mapping[str, list[str]]:
    """Every key with its texts in the order of :data:`LANGUAGES`, and then perhaps a mark."""
    return _Entries()


def changed(text: str, change: Callable[[str], str]) -> str:
    """A text with each of its values changed, in every language; without a key the text itself."""
    if not isinstance(text, Said):
        return change(text)
    values = {
        name: value if isinstance(value, int | float | list) else changed(_as_text(value), change)
        for name, value in text.values.items()
    }
    return Said(change(text), text.key, values)


def _as_text(value: object) -> str:
    return value if isinstance(value, str) else str(value)


@cache
def keys_of(start: str) -> Mapping[str, str]:
    """The keys that begin so, by their English texts."""
    return {entries()[key][0]: key for key in entries() if key.startswith(start)}


@cache
def page_words(page: str, lang: str) -> dict[str, str]:
    """The texts of a page's table in one language, by its script's keys; ``{names}`` are filled in."""
    column, start = LANGUAGES.index(lang), f"{page}."
    return {key.removeprefix(start): entries()[key][column] for key in entries() if key.startswith(start)}


def recognised(text: str, start: str = "") -> str:
    """A text that a file kept in English, with its key and values as far as the tables have them.

    With ``start`` it is known to be one of those whose keys begin so; else a text that has hardly a word of
    its own is not taken for one of them. The values are texts then. What is in no table stays as it is.
    """
    if isinstance(text, Said):
        return text
    for key, names, pattern in _patterns(start):
        if match := pattern.fullmatch(text):
            values = zip(names, match.groups(), strict=True)
            return Said(text, key, {name: recognised(value) for name, value in values})
    return text


@cache
def _patterns(start: str) -> list[tuple[str, list[str], re.Pattern[str]]]:
    """What each English text looks like, those with the most letters of their own first."""
    found = []
    for key in filter(lambda key: key.startswith(start), entries()):
        parts = [(literal, name) for literal, name, _, _ in Formatter().parse(entries()[key][0])]
        letters = "".join(literal for literal, _ in parts).strip()
        own = sum(map(str.isalpha, letters))
        told = start or (own >= _LEAST_LETTERS and " " in letters)
        names = [name for _, name in parts if name]
        if told and len(set(names)) == len(names):
            pattern = "".join(re.escape(literal) + ("(.+?)" if name else "") for literal, name in parts)
            found.append((own, key, names, re.compile(pattern, re.DOTALL)))
    found.sort(key=lambda each: -each[0])
    return [(key, names, pattern) for _, key, names, pattern in found]

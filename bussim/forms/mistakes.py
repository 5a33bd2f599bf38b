"""Where mistakes in a scenario file are reported, as forms and device models see it."""

from typing import Protocol

#: Keys and list positions from the top of a scenario down to a value.
Path = tuple[str | int, ...]


class Reporter(Protocol):
    """Takes mistakes and warnings about the values of one file."""

    def error(self, path: Path, predicate: str, *, key: bool = False) -> None:
        """The value at ``path`` (its key: ``key``) is wrong: ``predicate`` follows its name."""

    def mistake(self, path: Path, text: str, *, key: bool = False) -> None:
        """Something at ``path`` is wrong; ``text`` is a sentence that names what it is about."""

    def warn(self, path: Path, text: str, *, key: bool = False) -> None:
        """Something at ``path`` is odd but possible; ``text`` is a sentence that names what it is about."""

    def where(self, path: Path) -> str:
        """The position of a value, for a message about another one: its line, or its path."""


class EntryView(Protocol):
    """One entry of a section as it could be read."""

    @property
    def path(self) -> Path:
        """Where it stands."""

    def lost(self, *keys: str) -> bool:
        """Whether something below one of these keys was wrong, so that nothing follows from its absence."""

"""Where every key and value of a scenario stands, and how messages name it."""

from collections.abc import Iterable
from dataclasses import dataclass, field

from bussim.errors import Problem
from bussim.forms.mistakes import Path
from bussim.wording import shorten
from bussim.words.language import say

__all__ = ["Mark", "Path", "Report", "SourceMap"]

#: Line and column, counted from 1.
Mark = tuple[int, int]


@dataclass(slots=True)
class SourceMap:
    """The marks of one input.

    ``keys`` and ``values`` hold the mark of each key and of each value by path; both are empty for
    data that were built in Python. ``labels`` names what came from somewhere else than the file
    (``--set``), by path. ``blocks`` are texts written as a block (``|``): the line of each one's first
    line and its indentation. ``data`` is the input itself, for the names of list elements.
    """

    file: str
    keys: dict[Path, Mark] = field(default_factory=dict)
    values: dict[Path, Mark] = field(default_factory=dict)
    labels: dict[Path, str] = field(default_factory=dict)
    blocks: dict[Path, tuple[int, int]] = field(default_factory=dict)
    data: object = None

    def problem(self, path: Path, predicate: str, *, key: bool = False) -> Problem:
        """A problem with the value at ``path`` (with its key: ``key``): its name, then ``predicate``.

        Where the path itself has no mark, the nearest enclosing value's position is given.
        """
        subject = self.short_name(path) if self._locate(path, key=key)[1] else self.full_name(path)
        text = say("form_about", subject=subject, predicate=predicate) if subject else predicate
        return self.remark(path, text, key=key)

    def remark(self, path: Path, text: str, *, key: bool = False) -> Problem:
        """A complete sentence about the value at ``path``."""
        return Problem(*self._locate(path, key=key), text, self.full_name(path))

    def where(self, path: Path) -> str:
        """The position of a value, for a message about another one: its line, or its path."""
        _, line, _ = self._locate(path, key=False)
        return say("form_in_line", line=line) if line else ".".join(map(str, path))

    def short_name(self, path: Path) -> str:
        """The name of a value without the list element that it is in, which line and column show."""
        if len(path) > 2 and isinstance(path[1], int):
            path = path[2:]
        return ".".join(shorten(str(part)) for part in path)

    def full_name(self, path: Path) -> str:
        """The name of a value as ``--set`` takes it: list elements by their name, else by position."""
        parts: list[str] = []
        value = self.data
        for part in path:
            around, value = value, _child(value, part)
            name = _name(value) if isinstance(part, int) else None
            unique = isinstance(around, list) and [_name(item) for item in around].count(name) == 1
            parts.append(shorten(name if name and unique else str(part)))
        return ".".join(parts)

    def _locate(self, path: Path, *, key: bool) -> tuple[str, int, int]:
        """File, line and column; no line for what has no mark."""
        for end in range(len(path), -1, -1):
            part = path[:end]
            if part in self.labels:
                return self.labels[part], 0, 0
            marks = self.keys if key and end == len(path) else self.values
            if part in marks:
                return self.file, *marks[part]
        return self.file, 0, 0


def _child(value: object, part: str | int) -> object:
    if isinstance(value, dict):
        return value.get(part)
    if isinstance(value, list) and isinstance(part, int) and 0 <= part < len(value):
        return value[part]
    return None


def _name(value: object) -> str | None:
    name = value.get("name") if isinstance(value, dict) else None
    return name if isinstance(name, str) else None


class Report:
    """The mistakes and the warnings found so far in one input."""

    def __init__(self, source_map: SourceMap, errors: Iterable[Problem] = ()) -> None:
        self.source_map = source_map
        self.errors: list[Problem] = list(errors)
        self.warnings: list[Problem] = []
        #: Those of the mistakes that are keys which do not exist.
        self.unknown: list[Problem] = []
        #: What a run says in place of a warning whose message names lines of the file; "": nothing.
        self.plain: dict[Problem, str] = {}
        self._seen: set[tuple[bool, Problem]] = set()

    def error(self, path: Path, predicate: str, *, key: bool = False) -> None:
        """The value at ``path`` is wrong: ``predicate`` follows its name."""
        self.add(self.source_map.problem(path, predicate, key=key), fatal=True)

    def unknown_key(self, path: Path, predicate: str) -> None:
        """There is no such key as the last of ``path``."""
        self.unknown.append(self.source_map.problem(path, predicate, key=True))
        self.add(self.unknown[-1], fatal=True)

    def mistake(self, path: Path, text: str, *, key: bool = False) -> None:
        """Something at ``path`` is wrong; ``text`` is a sentence that names what it is about."""
        self.add(self.source_map.remark(path, text, key=key), fatal=True)

    def warn(self, path: Path, text: str, *, key: bool = False) -> None:
        """Something at ``path`` is odd but possible; ``text`` is a sentence that names what it is about."""
        self.add(self.source_map.remark(path, text, key=key), fatal=False)

    def where(self, path: Path) -> str:
        """The position of a value, for a message about another one: its line, or its path."""
        return self.source_map.where(path)

    def add(self, problem: Problem, *, fatal: bool) -> None:
        """Any problem, such as one of a file that the scenario names; the same one counts once."""
        if (fatal, problem) not in self._seen:
            self._seen.add((fatal, problem))
            (self.errors if fatal else self.warnings).append(problem)

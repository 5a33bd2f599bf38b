"""YAML as plain data with the place of every key and value: no tags, no code, bounded in every way.

The parser's events are turned into data here, because that is where nesting and the expansion of
aliases can be bounded before either costs anything. Plain scalars are read by the core schema of
YAML 1.2 (``yes`` and ``on`` are text); numbers keep the text that they had in the file.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from bussim.errors import Problem
from bussim.scenario.yaml.source_map import Mark, Path, SourceMap
from bussim.wording import RawFloat, RawInt, shorten

if TYPE_CHECKING:
    from ruamel.yaml.events import CollectionStartEvent, Event, ScalarEvent

#: Bounds on one file: its size in bytes, its nesting, and its keys and values with aliases expanded.
MAX_BYTES = 1 << 19
MAX_DEPTH = 30
MAX_VALUES = 50_000
#: Digits that a number may have.
_MAX_DIGITS = 100

_INT = re.compile(r"[-+]?[0-9]+")
_OCTAL = re.compile(r"0o[0-7]+")
_HEX = re.compile(r"0x[0-9a-fA-F]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_INF = re.compile(r"[-+]?\.(inf|Inf|INF)")
_NAN = re.compile(r"\.(nan|NaN|NAN)")
_WORDS: dict[str, bool | None] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL")),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
}
#: What ends a line to the parser.
_LINE_END = re.compile("\r\n|[\n\r\x85\u2028\u2029]")
#: The beginning of a program's text, whose first line shows its indentation.
_PROGRAM = re.compile(r"[ -]*(?P<key>program) *: *[|>][+-]? *(#.*)?$")
#: What YAML allows in a text (YAML 1.2.2, section 5.1), turned round.
_UNPRINTABLE = re.compile("[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")

Scalar = str | int | float | bool | None


class _Stop(Exception):  # noqa: N818 - not an error of the program but the end of reading
    """Reading cannot go on after this problem."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        super().__init__(str(problem))


@dataclass(slots=True)
class _Node:
    """A value of the document. ``size`` counts it and all that is in it, ``height`` its levels."""

    mark: Mark
    text: str | None = None  # of a scalar, as written
    scalar: Scalar = None
    items: list[_Node] | None = None
    entries: dict[str, tuple[Mark, _Node]] | None = None
    size: int = 1
    height: int = 0
    block: tuple[int, int] | None = None  # of a text with |: its first line, its indentation


@dataclass(slots=True)
class _Open:
    """A list or mapping whose end has not come yet."""

    node: _Node
    anchor: str | None
    key: tuple[str | None, Mark, bool] | None = None  # of a mapping: text, place, whether it merges
    merged: list[_Node] = field(default_factory=list)


def _text(source: bytes | str, file: str) -> str:
    """The text of a file: UTF-8, with or without a byte order mark."""
    if len(source) > MAX_BYTES:
        raise _Stop(Problem(file, 0, 0, f"is larger than {MAX_BYTES >> 10} KiB, too much for a scenario"))
    if isinstance(source, str):
        return source.removeprefix("\ufeff")
    raw = source
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise _Stop(Problem(file, 1, 1, "is UTF-16 text; save the file as UTF-8"))
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before = raw[: error.start].decode("utf-8-sig", errors="replace")
        line, column = _mark_at(before, len(before))
        byte = raw[error.start]
        message = f"the byte 0x{byte:02X} is not UTF-8 text; is this a scenario file, saved as UTF-8?"
        raise _Stop(Problem(file, line, column, message)) from None


def read(source: bytes | str, file: str) -> tuple[object, SourceMap, list[Problem]]:
    """The data of a YAML document, their marks, and the mistakes found.

    ``file`` is the name for messages. After a mistake that ends the reading the data are None, as
    for an empty document. Other mistakes (a tag, a repeated key) leave usable data beside them.
    """
    source_map = SourceMap(file)
    builder = _Builder(file)
    try:
        text = _text(source, file)
        builder.text = text
        root = builder.build(_events(text, file))
    except _Stop as stop:
        return None, source_map, [*builder.problems, stop.problem]
    source_map.data = None if root is None else _plain(root, (), source_map)
    return source_map.data, source_map, builder.problems


def _mark_at(text: str, position: int) -> Mark:
    before = text[:position].replace("\r\n", "\n").replace("\r", "\n")
    return before.count("\n") + 1, position - (text[:position].replace("\r", "\n").rfind("\n") + 1) + 1


def _events(text: str, file: str) -> Iterable[Event]:
    """The parser's events, with its complaints turned into ours."""
    strange = _UNPRINTABLE.search(text)
    if strange is not None:
        line, column = _mark_at(text, strange.start())
        message = f"the character U+{ord(strange.group()):04X} does not belong in text; is it a binary file?"
        raise _Stop(Problem(file, line, column, message))

    from ruamel.yaml import YAML
    from ruamel.yaml.error import MarkedYAMLError

    try:
        yield from YAML(typ="safe", pure=True).parse(text)
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line, column = (mark.line + 1, mark.column + 1) if mark is not None else (0, 0)
        raise _Stop(
            Problem(file, line, column, f"is not YAML: {_complaint(error)}{_uneven(text, line)}")
        ) from None
    except _Stop:
        raise
    except Exception as error:  # the parser has more ways to fail on garbage than it documents
        raise _Stop(Problem(file, 0, 0, f"is not YAML ({type(error).__name__})")) from None


def _uneven(text: str, line: int) -> str:
    """A hint if a mistake at a line (1…) is that a program's text begins deeper than it goes on."""
    lines = text.splitlines()[:line]
    for number in range(len(lines) - 1, -1, -1):
        found = _PROGRAM.match(lines[number])
        if found is None:
            continue
        depths = [len(each) - len(each.lstrip(" ")) for each in lines[number + 1 :] if each.strip()]
        key = found.start("key")
        if depths and min(depths) > key and min(depths) < depths[0]:
            return (
                f"; the text of program at line {number + 1} begins deeper than it goes on: indent its lines "
                f"evenly, write `program: |{min(min(depths) - key, 9)}`, or keep it in a file"
            )
        return ""
    return ""


def _complaint(error: object) -> str:
    problem = str(getattr(error, "problem", None) or "cannot be read")
    if "'\\t'" in problem:
        return "a tab where YAML wants spaces"
    context = getattr(error, "context", None)
    text = f"{context}, {problem}" if context else problem
    return " ".join(text.split())[:200]


class _Builder:
    """Makes nodes of events, without recursion, within the bounds."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.problems: list[Problem] = []
        self._open: list[_Open] = []
        self._anchors: dict[str, _Node | None] = {}  # None: still being read
        self._count = 0
        self._root: _Node | None = None
        #: What is read, for the marks of texts with |.
        self.text = ""
        self._lines: list[str] | None = None

    def build(self, events: Iterable[Event]) -> _Node | None:
        """The root node of the only document, None if there is none."""
        from ruamel.yaml import events as kinds

        documents = 0
        for event in events:
            mark = (event.start_mark.line + 1, event.start_mark.column + 1)
            if isinstance(event, kinds.DocumentStartEvent):
                documents += 1
                if documents > 1:
                    raise self._stop(mark, "a second document begins here; a scenario is one document")
            elif isinstance(event, kinds.AliasEvent):
                self._attach(self._alias(event.anchor, mark), merge=False)
            elif isinstance(event, kinds.ScalarEvent):
                self._scalar(event, mark)
            elif isinstance(event, kinds.SequenceStartEvent | kinds.MappingStartEvent):
                self._begin(event, mark, mapping=isinstance(event, kinds.MappingStartEvent))
            elif isinstance(event, kinds.SequenceEndEvent | kinds.MappingEndEvent):
                self._end()
        return self._root

    def _stop(self, mark: Mark, message: str) -> _Stop:
        return _Stop(Problem(self.file, *mark, message))

    def _complain(self, mark: Mark, message: str) -> None:
        self.problems.append(Problem(self.file, *mark, message))

    def _add(self, mark: Mark, count: int) -> None:
        self._count += count
        if self._count > MAX_VALUES:
            message = f"more than {MAX_VALUES} keys and values, aliases expanded; too much for a scenario"
            raise self._stop(mark, message)

    def _check_tag(self, event: CollectionStartEvent | ScalarEvent, mark: Mark) -> None:
        tag = event.tag
        if tag is not None:
            shown = str(tag).replace("tag:yaml.org,2002:", "!!")
            self._complain(mark, f"the tag {shorten(shown)} is not allowed; write plain text and numbers")

    def _alias(self, name: str, mark: Mark) -> _Node:
        if name not in self._anchors:
            raise self._stop(mark, f"the alias *{shorten(name)} has no anchor &{shorten(name)} before it")
        node = self._anchors[name]
        if node is None:
            raise self._stop(mark, f"the alias *{shorten(name)} stands inside its own anchor")
        self._add(mark, node.size)
        self._check_depth(mark, node.height)
        return node

    def _check_depth(self, mark: Mark, height: int) -> None:
        if len(self._open) + height > MAX_DEPTH:
            raise self._stop(mark, f"nested deeper than {MAX_DEPTH} levels")

    def _scalar(self, event: ScalarEvent, mark: Mark) -> None:
        self._check_tag(event, mark)
        self._add(mark, 1)
        text: str = event.value
        plain = event.style is None
        node = _Node(mark, text, text)
        if plain:
            try:
                node.scalar = _resolve(text)
            except ValueError as error:
                self._complain(mark, str(error))
        if event.style == "|":
            node.block = self._block(event.start_mark.line + 1, text)
        if event.anchor is not None:
            self._anchors[event.anchor] = node
        self._attach(node, merge=plain and text == "<<")

    def _block(self, line: int, text: str) -> tuple[int, int] | None:
        """First line (from 1) and indentation of a text whose lines begin at ``line`` (from 0)."""
        if self._lines is None:
            self._lines = _LINE_END.split(self.text)
        for source, own in zip(self._lines[line:], text.split("\n"), strict=False):
            if own.strip():
                return line + 1, len(source) - len(source.lstrip(" ")) - (len(own) - len(own.lstrip(" ")))
        return None

    def _begin(self, event: CollectionStartEvent, mark: Mark, *, mapping: bool) -> None:
        self._check_tag(event, mark)
        self._add(mark, 1)
        self._check_depth(mark, 1)
        node = _Node(mark, entries={}) if mapping else _Node(mark, items=[])
        if event.anchor is not None:
            self._anchors[event.anchor] = None
        self._open.append(_Open(node, event.anchor))

    def _end(self) -> None:
        done = self._open.pop()
        node = done.node
        if node.entries is not None:
            for source in done.merged:
                for key, entry in (source.entries or {}).items():
                    node.entries.setdefault(key, entry)
            children = [child for _, child in node.entries.values()]
            node.size += len(children)
        else:
            children = node.items or []
        node.size += sum(child.size for child in children)
        node.height = 1 + max((child.height for child in children), default=0)
        if done.anchor is not None:
            self._anchors[done.anchor] = node
        self._attach(node, merge=False)

    def _attach(self, node: _Node, *, merge: bool) -> None:
        if not self._open:
            self._root = node
            return
        parent = self._open[-1]
        if parent.node.items is not None:
            parent.node.items.append(node)
        elif parent.key is None:
            self._key(parent, node, merge=merge)
        else:
            self._value(parent, node)

    def _key(self, parent: _Open, node: _Node, *, merge: bool) -> None:
        text = node.text
        if text is None:
            self._complain(node.mark, "a key must be text, not a list or mapping")
        parent.key = (text, node.mark, merge)

    def _value(self, parent: _Open, node: _Node) -> None:
        entries = parent.node.entries
        if parent.key is None or entries is None:
            raise AssertionError("a value without its key")
        (key, mark, merge), parent.key = parent.key, None
        if node.text == "":
            node.mark = mark  # of nothing, the parser's place is that of whatever comes next
        if key is None:
            return
        if merge:
            sources = node.items if node.items is not None else [node]
            if any(source.entries is None for source in sources):
                self._complain(node.mark, "<< takes a mapping or a list of mappings")
            parent.merged.extend(source for source in sources if source.entries is not None)
        elif key in entries:
            first = entries[key][0][0]
            name = SourceMap(self.file).short_name((*self._path(), key))
            self._complain(mark, f"{name} is given twice, first in line {first}")
        else:
            entries[key] = (mark, node)

    def _path(self) -> Path:
        """Where the innermost open mapping stands."""
        path: list[str | int] = []
        for frame in self._open[:-1]:
            if frame.node.items is not None:
                path.append(len(frame.node.items))
            else:
                path.append((frame.key[0] if frame.key is not None else None) or "")
        return tuple(path)


def _resolve(text: str) -> Scalar:
    """A plain scalar by the core schema (YAML 1.2.2, section 10.3.2)."""
    if text in _WORDS:
        return _WORDS[text]
    if len(text) > _MAX_DIGITS:
        if _FLOAT.fullmatch(text) or _HEX.fullmatch(text) or _OCTAL.fullmatch(text):
            raise ValueError(f"a number of more than {_MAX_DIGITS} digits")
        return text
    if _INT.fullmatch(text):
        return RawInt(int(text), text)
    if _OCTAL.fullmatch(text):
        return RawInt(int(text[2:], 8), text)
    if _HEX.fullmatch(text):
        return RawInt(int(text[2:], 16), text)
    if _FLOAT.fullmatch(text):
        return RawFloat(float(text), text)
    if _INF.fullmatch(text) or _NAN.fullmatch(text):
        return RawFloat(float(text.lower().replace(".", "")), text)
    return text


def _plain(node: _Node, path: Path, source_map: SourceMap) -> object:
    """The data of a node; enters the marks of all that is in it."""
    source_map.values[path] = node.mark
    if node.block is not None:
        source_map.blocks[path] = node.block
    if node.entries is not None:
        result: dict[str, object] = {}
        for key, (mark, child) in node.entries.items():
            source_map.keys[(*path, key)] = mark
            result[key] = _plain(child, (*path, key), source_map)
        return result
    if node.items is not None:
        return [_plain(child, (*path, i), source_map) for i, child in enumerate(node.items)]
    return node.scalar

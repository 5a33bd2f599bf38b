"""YAML as plain data with the position of every key and value: no tags, no code, bounded in every way.

The parser's events are turned into data here, because that is where nesting and the expansion of
aliases can be bounded before either costs anything. Plain scalars are read by the core schema of
YAML 1.2 (``yes`` and ``on`` are text); numbers keep the text that they had in the file.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from itertools import islice, takewhile
from typing import TYPE_CHECKING, Any

from bussim.errors import Problem
from bussim.scenario.yaml.repair import LINE_END, Mark, Mended, Trouble
from bussim.scenario.yaml.source_map import Path, SourceMap
from bussim.wording import RawFloat, RawInt, shorten
from bussim.words.language import say
from bussim.words.tables import recognised

if TYPE_CHECKING:
    from yaml.events import Event, ScalarEvent

#: Bounds on one file: its size in bytes, its nesting, and its keys and values with aliases expanded.
MAX_BYTES = 1 << 19
MAX_DEPTH = 30
MAX_VALUES = 50_000
#: Longest complaint of the library that is repeated whole.
_MOST_SAID = 200
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
#: A key that may stand without a value in braces; any other one has something missing.
_BARE_KEY = re.compile(r"[^\W\d][\w.-]*")
#: Where a scenario begins.
_SCHEMA = re.compile(r"^[{\s\"]*schema[\"\s]*[:：=]", re.MULTILINE)
#: What begins a document that is meant as keys with their values.
_KEY_IN_TEXT = re.compile(r"[A-Za-z_]+ *[:：=]")
#: What YAML allows in a text (YAML 1.2.2, section 5.1), turned round.
_UNPRINTABLE = "[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]"

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
    block: tuple[int, int] | None = None  # of a text with |: its first line, its indentation
    size: int = 1
    height: int = 0

    def __post_init__(self) -> None:
        if self.text is None:
            entries = self.entries or {}
            children = self.items or [child for _, child in entries.values()]
            self.size += len(entries) + sum(child.size for child in children)
            self.height = 1 + max((child.height for child in children), default=0)


def _text(source: bytes | str, file: str) -> str:
    """The text of a file: UTF-8, with or without a byte order mark."""
    if len(source) > MAX_BYTES:
        raise _Stop(Problem(file, 0, 0, say("yaml_large", most=MAX_BYTES >> 10)))
    if isinstance(source, str):
        return source.removeprefix("\ufeff")
    raw = source
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")) or raw[:8].count(0) > 2:
        raise _Stop(Problem(file, 1, 1, say("yaml_utf16")))
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before = raw[: error.start].decode("utf-8-sig", errors="replace")
        line, column = _mark_at(before, len(before))
        byte = raw[error.start]
        message = say("yaml_no_utf8", byte=byte, codings=say("form_codings"))
        raise _Stop(Problem(file, line, column, message)) from None


def read(source: bytes | str, file: str) -> tuple[object, SourceMap, list[Problem]]:
    """The data of a YAML document, their marks, and the mistakes found.

    ``file`` is the name for messages. After a mistake that ends the reading the data are None, as
    for an empty document. Other mistakes (a tag, a repeated key) leave usable data beside them.
    """
    source_map = SourceMap(file)
    problems: list[Problem] = []
    try:
        root = _document(_text(source, file), file, problems)
    except _Stop as stop:
        return None, source_map, [*problems, stop.problem]
    source_map.data = None if root is None else _plain(root, (), source_map)
    return source_map.data, source_map, problems


def _document(text: str, file: str, problems: list[Problem]) -> _Node | None:
    """The root node of a text, repaired where it is no YAML; ``problems`` takes the mistakes found."""
    mended, error, root = Mended(text), None, None
    while True:
        found: list[Problem] = []
        try:
            error, root = None, _Reader(file, mended, found).document()
        except Trouble as stop:
            error = _stopped(mended.text) or stop
        if error is None or not mended.mend(error, partial(_stopped, worded=False)):
            break
    if error is None or _SCHEMA.search(mended.text):  # else it is some other text, and its repairs guesswork
        problems += [Problem(file, *mark, message) for mark, message in mended.mistakes]
    problems += found
    if error is not None:
        raise _Stop(Problem(file, *mended.original(error.mark), error.message))
    return root


def _stopped(text: str, *, again: bool = True, worded: bool = True) -> Trouble | None:
    """What stops the reading of a text, None for nothing; where it is not worded, in a tenth of the time."""
    try:
        _Reader("", Mended(text), [], worded=worded).document()
    except Trouble as found:
        if again and found.mark[0] > 1:
            # The parser looks ahead: its complaint may hide one of the lines before.
            starts = [0, *(match.end() for match in LINE_END.finditer(text))]
            start = starts[min(found.mark[0], len(starts)) - 1]
            earlier = _stopped(text[:start], again=False, worded=worded)
            if earlier is not None and "stream" not in earlier.message:
                return earlier
        return found
    except _Stop:
        pass
    return None


def _mark_at(text: str, position: int) -> Mark:
    before = text[:position].replace("\r\n", "\n").replace("\r", "\n")
    return before.count("\n") + 1, position - (text[:position].replace("\r", "\n").rfind("\n") + 1) + 1


def _events(text: str, file: str, *, worded: bool) -> Iterator[Event]:
    """The parser's events, with its complaints turned into ours."""
    plain = text.replace("\n", "").isprintable()  # to compile such a pattern takes 5 ms
    if not plain and (strange := re.search(_UNPRINTABLE, text)):
        line, column = _mark_at(text, strange.start())
        message = say("yaml_character", code=ord(strange.group()))
        raise _Stop(Problem(file, line, column, message))

    import yaml

    given = 0
    try:
        # libyaml, where it is there, takes a tenth of the time; the other parser, which refuses more tabs,
        # words what is refused.
        if yaml.__with_libyaml__ and "\t" not in text:
            try:
                for event in yaml.parse(text, Loader=yaml.CSafeLoader):
                    given += 1
                    yield event
            except yaml.YAMLError:
                if not worded:
                    raise
            else:
                return
        yield from islice(yaml.parse(text, Loader=yaml.SafeLoader), given, None)
    except yaml.MarkedYAMLError as error:
        begun, mark = error.context_mark or error.problem_mark, error.problem_mark or error.context_mark
        if str(error.context).startswith("while scanning a") or "<stream end>" in str(error.problem):
            mark = begun  # what is begun so is what cannot be read; it may go on for lines
        raise Trouble(_mark(mark), say("yaml_not", complaint=_complaint(error)), _mark(begun)) from None
    except (_Stop, Trouble):
        raise
    except Exception as error:  # the parser has more ways to fail on garbage than it documents
        raise _Stop(Problem(file, 0, 0, say("yaml_not_why", name=type(error).__name__))) from None


def _mark(mark: Any) -> Mark:
    return mark.line + 1, mark.column + 1


def _complaint(error: object) -> str:
    found = (getattr(error, name, None) for name in ("context", "problem"))
    parts = [" ".join(str(part).split()) for part in found if part] or [say("yaml_unreadable")]
    if "'\\t'" in parts[-1]:
        return say("yaml_tab")
    text = ", ".join(parts)
    if len(text) > _MOST_SAID:
        return text[:_MOST_SAID]
    return say("yaml_says", parts=[recognised(part, "yaml_says_") for part in parts])


class _Reader:
    """Makes nodes of the parser's events, within the bounds; ``problems`` takes the mistakes found."""

    def __init__(self, file: str, mended: Mended, problems: list[Problem], *, worded: bool = True) -> None:
        self._file = file
        self._mended = mended
        self._lines = LINE_END.split(mended.text)
        self._problems = problems
        self._events = _events(mended.text, file, worded=worded)
        self._anchors: dict[str | None, _Node | None] = {}  # None: still being read
        self._count = 0
        self._flow = 0  # braces and brackets that are open

    def document(self) -> _Node | None:
        """The root node of the only document, None if there is none."""
        from yaml.events import DocumentStartEvent

        root: _Node | None = None
        for event in self._events:
            if isinstance(event, DocumentStartEvent):
                if root is not None:
                    message = say("yaml_second")
                    raise self._stop(self._mark(event), message)
                root = self._node(next(self._events, None), ())
        return root

    def _node(self, event: Any, path: Path) -> _Node:
        """The value at ``path`` that begins with an event."""
        from yaml.events import AliasEvent, MappingStartEvent, ScalarEvent

        if not hasattr(
            event, "anchor"
        ):  # it begins no value, where the parsers disagree on what comes before a mistake
            at = (1, 1) if event is None else _mark(event.start_mark)
            raise Trouble(at, say("yaml_value_missing"), at)
        mark = self._mark(event)
        if isinstance(event, AliasEvent):
            return self._alias(str(event.anchor), mark, path)
        if event.tag is not None:
            shown = shorten(str(event.tag).replace("tag:yaml.org,2002:", "!!"))
            self._complain(mark, say("yaml_tag", shown=shown))
        self._add(mark, 1)
        if isinstance(event, ScalarEvent):
            node = self._scalar(event, mark, path)
        else:
            self._check_depth(mark, path, 1)
            self._anchors[event.anchor] = None
            self._flow += bool(event.flow_style)
            node = (self._mapping if isinstance(event, MappingStartEvent) else self._list)(mark, path)
            self._flow -= bool(event.flow_style)
        self._anchors[event.anchor] = node
        return node

    def _mark(self, event: Event) -> Mark:
        return self._mended.original(_mark(event.start_mark))

    def _stop(self, mark: Mark, message: str) -> _Stop:
        return _Stop(Problem(self._file, *mark, message))

    def _complain(self, mark: Mark, message: str) -> None:
        self._problems.append(Problem(self._file, *mark, message))

    def _add(self, mark: Mark, count: int) -> None:
        self._count += count
        if self._count > MAX_VALUES:
            message = say("yaml_many_expanded", max_values=MAX_VALUES)
            raise self._stop(mark, message)

    def _check_depth(self, mark: Mark, path: Path, height: int) -> None:
        if len(path) + height > MAX_DEPTH:
            raise self._stop(mark, say("yaml_nested", max_depth=MAX_DEPTH))

    def _alias(self, name: str, mark: Mark, path: Path) -> _Node:
        if name not in self._anchors:
            raise self._stop(mark, say("yaml_no_anchor", name=shorten(name)))
        node = self._anchors[name]
        if node is None:
            raise self._stop(mark, say("yaml_own_anchor", name=shorten(name)))
        self._add(mark, node.size)
        self._check_depth(mark, path, node.height)
        return node

    def _scalar(self, event: ScalarEvent, mark: Mark, path: Path) -> _Node:
        text: str = event.value
        node = _Node(mark, text, text)
        if not event.style:
            if not path and _KEY_IN_TEXT.match(text):
                raise Trouble(_mark(event.start_mark), say("yaml_text"), (1, 1))
            try:
                node.scalar = core_scalar(text)
            except ValueError as error:
                self._complain(mark, error.args[0])
        elif event.style == "|":
            node.block = self._block(_mark(event.start_mark)[0], text)
        return node

    def _block(self, line: int, text: str) -> tuple[int, int] | None:
        """First line (from 1) and indentation of a text whose lines begin at ``line`` (from 0)."""
        for source, own in zip(self._lines[line:], text.split("\n"), strict=False):
            if own.strip():
                return line + 1, len(source) - len(source.lstrip(" ")) - (len(own) - len(own.lstrip(" ")))
        return None

    def _parts(self) -> Iterator[Event]:
        """The events that begin the parts of the list or mapping that was begun last."""
        from yaml.events import CollectionEndEvent

        return takewhile(lambda event: not isinstance(event, CollectionEndEvent), self._events)

    def _list(self, mark: Mark, path: Path) -> _Node:
        return _Node(mark, items=[self._node(event, (*path, n)) for n, event in enumerate(self._parts())])

    def _mapping(self, mark: Mark, path: Path) -> _Node:
        entries: dict[str, tuple[Mark, _Node]] = {}
        merged: list[_Node] = []
        for event in self._parts():
            key = self._node(event, (*path, ""))
            if key.text is None:
                self._complain(key.mark, say("yaml_key_text"))
            plain = not getattr(event, "style", ">")
            node = self._node(next(self._events, None), (*path, key.text or ""))
            if node.text == "":
                node.mark = key.mark  # of nothing, the parser's position is that of whatever comes next
                if self._flow and plain and not _BARE_KEY.fullmatch(key.text or ""):
                    message = say("yaml_bare_key", name=shorten(key.text or ""))
                    raise Trouble(_mark(event.start_mark), message, _mark(event.start_mark))
            if key.text == "<<" and plain:
                sources = [node] if node.items is None else node.items
                if any(source.entries is None for source in sources):
                    self._complain(node.mark, say("yaml_merge"))
                merged += sources
            elif key.text in entries:
                name = SourceMap(self._file).short_name((*path, key.text))
                message = say("yaml_twice", name=name, line=entries[key.text][0][0])
                if not self._flow and path and isinstance(path[-1], int) and key.text == next(iter(entries)):
                    raise Trouble(_mark(event.start_mark), message, _mark(event.start_mark))
                self._complain(key.mark, message)
            elif key.text is not None:
                entries[key.text] = (key.mark, node)
        for source in merged:
            entries = {**entries, **(source.entries or {}), **entries}  # its own first, and they win
        return _Node(mark, entries=entries)


def core_scalar(text: str) -> Scalar:
    """A plain scalar by the core schema (YAML 1.2.2, section 10.3.2)."""
    if text in _WORDS:
        return _WORDS[text]
    if len(text) > _MAX_DIGITS:
        if _FLOAT.fullmatch(text) or _HEX.fullmatch(text) or _OCTAL.fullmatch(text):
            raise ValueError(say("yaml_digits", max_digits=_MAX_DIGITS))
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

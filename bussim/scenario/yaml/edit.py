"""Single values changed in the text of a scenario, at their places: every other character stays."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from bussim.errors import Problem, ScenarioError, UsageError
from bussim.scenario.yaml.dump import dumped_inline
from bussim.scenario.yaml.overrides import Override, apply_overrides
from bussim.scenario.yaml.parser import read
from bussim.scenario.yaml.plain import copied
from bussim.scenario.yaml.source_map import SourceMap
from bussim.words.language import say

if TYPE_CHECKING:
    from yaml import MappingNode, Node, SequenceNode

#: The characters from the first index up to the second one are replaced.
_Change = tuple[int, int, str]


def edit(text: str, changes: Mapping[str, object]) -> str:
    """The text of a scenario with values changed; comments, order and spacing stay as they are.

    ``changes`` maps paths as ``--set`` takes them (``"plcs.press1.nn.retries"``) to plain values: numbers,
    text such as ``"8ms"``, true, false, None, lists and dicts. A key that is missing is written behind the
    last one of its mapping, what a list has more behind its last entry; what is equal already is left as it
    is written. Raises ScenarioError for a text that is no scenario's YAML, UsageError for a path that leads
    nowhere and for a value that cannot be changed by itself, as one that others use (an anchor).
    """
    mark = "\ufeff" if text.startswith("\ufeff") else ""  # of the byte order
    text = text.removeprefix(mark)
    for path, value in changes.items():
        text = _edited(text, path, value)
    return mark + text


def _edited(text: str, path: str, value: object) -> str:
    label = say("edit_changing", path=path)
    data, source_map = _read(text)
    before = copied(data, label)
    override = Override(path, dumped_inline(copied(value, label)), label)
    after = apply_overrides(data, source_map, [override])
    if _same(before, after):
        return text
    import yaml

    root = yaml.compose(text, Loader=yaml.CSafeLoader if yaml.__with_libyaml__ else yaml.SafeLoader)
    assert root is not None  # noqa: S101 - for the types: it has keys
    changed = text
    for start, end, new in sorted(_Places(text).changes(root, before, after), reverse=True):
        changed = changed[:start] + new + changed[end:]
    # Not every way of writing YAML is known here (anchors, merged keys): what came out is read.
    said, _, problems = read(changed, label)
    if problems or not _same(said, after):
        raise UsageError(say("edit_by_hand", label=label))
    return changed


def _read(text: str) -> tuple[object, SourceMap]:
    data, source_map, problems = read(text, "<text>")
    if not problems and not isinstance(data, dict):
        problems = [Problem("<text>", 1, 1, say("file_no_keys"))]
    if problems:
        raise ScenarioError(problems)
    return data, source_map


def _same(one: object, other: object) -> bool:
    """Whether two plain values are equal, of the same types, in whatever order their keys are."""
    return _compared(one) == _compared(other)


def _compared(value: object) -> str:
    """A value as text that tells 1 from true and 1.0; a number that is none equals itself."""
    if isinstance(value, dict):
        return f"{{{', '.join(f'{key!r}: {_compared(value[key])}' for key in sorted(value))}}}"
    return f"[{', '.join(map(_compared, value))}]" if isinstance(value, list) else repr(value)


class _Places:
    """Where the values of a text stand, and what is to be written there."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._line_end = "\r\n" if "\r\n" in text else "\n"

    def changes(self, node: Node, before: object, after: object) -> Iterator[_Change]:
        """What makes a node that says ``before`` say ``after``."""
        from yaml import MappingNode, SequenceNode

        if _same(before, after):
            return
        if isinstance(node, MappingNode) and isinstance(before, dict) and isinstance(after, dict) and after:
            yield from self._mapping(node, before, after)
        elif (
            isinstance(node, SequenceNode)
            and isinstance(before, list)
            and isinstance(after, list)
            and len(node.value) == len(before)
            and before
            and after
        ):
            for child, old, new in zip(node.value, before, after, strict=False):
                yield from self.changes(child, old, new)
            if len(before) != len(after):
                yield self._resized(node, len(before), after)
        else:
            start, end = node.start_mark.index, self._end(node)
            yield start, end, (" " if start == end else "") + dumped_inline(after)

    def _mapping(
        self, node: MappingNode, before: dict[str, object], after: dict[str, object]
    ) -> Iterator[_Change]:
        names = [str(key.value) for key, _ in node.value]
        for number, (name, (_, child)) in enumerate(zip(names, node.value, strict=True)):
            if name in before and name in after:
                yield from self.changes(child, before[name], after[name])
            elif name in before:
                yield self._removed(node, number)
        added = {name: value for name, value in after.items() if name not in before}
        if not added:
            return
        if node.flow_style:
            at = self._end(node.value[-1][1]) if names else node.start_mark.index + 1
            line = dumped_inline(added)[1:-1]
            yield at, at, f", {line}" if names else line
        else:
            at = self._line(self._end(node))
            begin = self._line_end + " " * node.start_mark.column
            for name, value in added.items():
                yield at, at, begin + dumped_inline({name: value})[1:-1]

    def _resized(self, node: SequenceNode, many: int, after: list[object]) -> _Change:
        """Entries behind the last one of a list of so many, or the last ones gone."""
        ends = [self._end(child) for child in node.value]
        if not node.flow_style:
            ends = [self._line(end) for end in ends]
        if len(after) < many:
            return ends[len(after) - 1], ends[-1], ""
        begin = ", " if node.flow_style else f"{self._line_end}{' ' * node.start_mark.column}- "
        return ends[-1], ends[-1], "".join(begin + dumped_inline(new) for new in after[many:])

    def _removed(self, node: MappingNode, number: int) -> _Change:
        """An entry without its line, or without its part of a line."""
        key, value = node.value[number]
        start, end = key.start_mark.index, self._end(value)
        begin = start - key.start_mark.column
        if number + 1 < len(node.value) and (node.flow_style or self._text[begin:start].strip()):
            return start, node.value[number + 1][0].start_mark.index, ""
        if node.flow_style:
            return (self._end(node.value[number - 1][1]) if number else start), end, ""
        return begin - len(self._line_end), self._line(end), ""

    def _end(self, node: Node) -> int:
        """Behind the last character of a value; the parser's own mark of a block is where the next one is."""
        from yaml import MappingNode, SequenceNode

        if isinstance(node, MappingNode | SequenceNode) and not node.flow_style:
            last = node.value[-1]
            return self._end(last[1] if isinstance(last, tuple) else last)
        begin, end = node.start_mark.index, node.end_mark.index
        return begin + len(self._text[begin:end].rstrip())

    def _line(self, position: int) -> int:
        end = self._text.find("\n", position)
        end = len(self._text) if end < 0 else end
        return end - self._text[:end].endswith("\r")

"""``key.path=value``: single values of a scenario set from outside of its file."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from bussim.errors import UsageError
from bussim.scenario.yaml.parser import MAX_DEPTH, read
from bussim.scenario.yaml.source_map import Path, SourceMap
from bussim.wording import shorten
from bussim.words.language import say
from bussim.words.values import show, suggest

#: Keys whose plain value stands for a mapping, and the key that it stands for.
_SHORTHANDS = {
    "profile": "base",
    "scan": "mean",
    "turnaround": "mean",
    "reply_to": "text",
    "square": "period",
}
_STATION_FAULTS = frozenset({"power_off", "stop", "drop_reply", "jabber", "lose_char", "insert_char"})


@dataclass(frozen=True, slots=True)
class Override:
    """One value to set. ``label`` is what messages call it, as the user wrote it."""

    key: str
    value: str
    label: str

    @classmethod
    def parse(cls, text: str) -> Override:
        """``plcs.press1.nn.retries=2``. Raises UsageError for a text without a key and an =."""
        key, equals, value = text.partition("=")
        if not equals or not key.strip():
            raise UsageError(say("edit_expected", text=shorten(text)))
        return cls(key.strip(), value, f"--set {shorten(text)}")


def apply_overrides(data: object, source_map: SourceMap, overrides: Iterable[str | Override]) -> object:
    """``data`` with the values set, in order; ``source_map`` records where they come from.

    A list element is named by its ``name``, else by its position. Missing mappings on the way are
    made. Raises UsageError for a path that leads nowhere.
    """
    for given in overrides:
        override = Override.parse(given) if isinstance(given, str) else given
        data = _apply(data, source_map, override)
        source_map.data = data
    return data


def _apply(data: object, source_map: SourceMap, override: Override) -> object:
    value = _value(override)
    parts = override.key.split(".")
    if not isinstance(data, dict):
        return data  # not a scenario anyway, which the schema will say
    if len(parts) > MAX_DEPTH:
        raise UsageError(say("edit_deep", label=override.label, parts=len(parts), max_depth=MAX_DEPTH))
    node: Any = data
    path: Path = ()
    made: Path | None = None  # the first key on the way that was not there
    for number, part in enumerate(parts):
        last = number == len(parts) - 1
        if isinstance(node, list):
            step: str | int = _position(node, part, path, source_map, override)
        else:
            step = part
        path = (*path, step)
        if made is None and isinstance(node, dict) and step not in node:
            made = path
        if isinstance(node, dict) and step != "measured" and "measured" in node:
            measured = node.pop("measured")  # what is set from outside was not measured there
            if isinstance(measured, dict):
                node["measured"] = {key: at for key, at in measured.items() if key != step}
        if last:
            node[step] = value
            break
        node = _entered(node, step, part, path, source_map, override)
    _forget(source_map, path)
    source_map.labels[made or path] = override.label
    return data


def _value(override: Override) -> object:
    value, _, problems = read(override.value, override.label)
    if problems:
        raise UsageError(say("edit_problem", label=override.label, what=problems[0].message))
    return value


def _position(node: list[object], part: str, path: Path, source_map: SourceMap, override: Override) -> int:
    known = [item["name"] for item in node if isinstance(item, dict) and isinstance(item.get("name"), str)]
    for index, item in enumerate(node):
        if isinstance(item, dict) and item.get("name") == part:
            return index
    if part.isdecimal() and int(part[:9]) < len(node):
        return int(part[:9])
    where = source_map.full_name(path)
    if known:
        values = {"label": override.label, "where": where, "part": shorten(part)}
        raise UsageError(say("edit_has_no", **values, hint=suggest(part, known)))
    count = say("edit_allowed", last=len(node) - 1) if node else say("edit_empty")
    raise UsageError(say("edit_no_entry", label=override.label, where=where, part=shorten(part), count=count))


def _entered(
    node: Any, step: str | int, part: str, path: Path, source_map: SourceMap, override: Override
) -> Any:
    """The mapping or list at ``step``, made if it is missing or only its shorthand is there."""
    inner = node[step] if isinstance(step, int) else node.get(step)
    if isinstance(inner, dict | list):
        return inner
    shorthand = "station" if part in _STATION_FAULTS else _SHORTHANDS.get(part)
    if inner is None:
        node[step] = {}
    elif shorthand is not None:
        node[step] = {shorthand: inner}
    else:
        raise UsageError(
            say("edit_no_keys", label=override.label, path=source_map.full_name(path), found=show(inner))
        )
    return node[step]


def _forget(source_map: SourceMap, path: Path) -> None:
    """What stood in the file at and below ``path`` has no place any more."""
    marks: dict[Path, Any]
    for marks in (source_map.keys, source_map.values, source_map.labels, source_map.blocks):
        for known in [known for known in marks if known[: len(path)] == path]:
            del marks[known]

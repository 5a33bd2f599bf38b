"""What makes a sweep this sweep and not another one: the content of ``sweep.json``."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from bussim.trace.file import strict_json
from bussim.wording import shorten

#: The file that says what a folder's sweep is.
MANIFEST = "sweep.json"
#: Version of ``sweep.json``; rises when a key changes its meaning.
SCHEMA = 2
_MOST_SHOWN = 5
_NOTHING = object()


def read_manifest(folder: Path) -> dict[str, Any] | None:
    """The content of a folder's ``sweep.json``, None if it has none that can be read."""
    try:
        data = strict_json((folder / MANIFEST).read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError):
        return None
    return data if isinstance(data, dict) and "vary" in data else None


def manifest_text(manifest: Mapping[str, Any]) -> str:
    """The content of ``sweep.json`` as text."""
    return json.dumps(manifest, ensure_ascii=False, allow_nan=False, indent=1) + "\n"


def differences(here: Mapping[str, Any], there: Mapping[str, Any]) -> list[str]:
    """What distinguishes two sweeps, in words, the most important first; empty for the same sweep.

    The order of the axes counts, for it is that of the rows.
    """
    found: list[str] = []
    for key, name in (
        ("bussim", "the version of bussim"),
        ("schema", "the version of sweep.json"),
        ("repeat", "--repeat"),
        ("same_luck", "--same-luck"),
    ):
        if here[key] != there.get(key):
            found.append(f"{name} is {_shown(here[key])} here, {_shown(there.get(key))} there")
    found += _varied(here["vary"], there.get("vary"))
    found += [
        f"{path or 'the scenario'} is {_shown(ours)} here, {_shown(theirs)} there"
        for path, ours, theirs in _unequal(here["source"], there.get("source"), "")
    ]
    if len(found) > _MOST_SHOWN:
        found[_MOST_SHOWN:] = [f"and {len(found) - _MOST_SHOWN} more"]
    return found


def _varied(here: list[dict[str, Any]], there: Any) -> list[str]:
    if here == there:
        return []
    try:
        theirs = {axis["key"]: list(map(str, axis["values"])) for axis in there}
        columns = {axis["key"]: axis["column"] for axis in there}
    except (KeyError, TypeError):
        return ["--vary cannot be read there"]
    found = []
    for axis in here:
        key, values = axis["key"], axis["values"]
        if key not in theirs:
            found.append(f"{key} is varied here, not there")
        elif values != theirs[key]:
            found.append(f"{key} is varied over {_values(values)} here, {_values(theirs[key])} there")
        elif axis["column"] != columns[key]:
            found.append(f"the column of {key} is {axis['column']} here, {columns[key]} there")
    found += [
        f"{key} is varied there, not here" for key in theirs if all(key != axis["key"] for axis in here)
    ]
    return found or ["the order of --vary is another one there"]


def _values(values: list[str]) -> str:
    return ",".join(values) if len(values) < 4 else f"{values[0]},{values[1]},…,{values[-1]} ({len(values)})"


def _unequal(here: Any, there: Any, path: str) -> Iterator[tuple[str, Any, Any]]:
    """The innermost keys at which two scenarios differ, with both values."""
    if isinstance(here, dict) and isinstance(there, dict):
        for key in [*here, *(key for key in there if key not in here)]:
            yield from _unequal(here.get(key, _NOTHING), there.get(key, _NOTHING), f"{path}.{key}".strip("."))
    elif isinstance(here, list) and isinstance(there, list) and len(here) == len(there):
        for index, (ours, theirs) in enumerate(zip(here, there, strict=True)):
            yield from _unequal(ours, theirs, f"{path}.{index}".strip("."))
    elif here != there:
        yield path, here, there


def _shown(value: Any) -> str:
    if value is _NOTHING or value is None:
        return "not given"
    return shorten(json.dumps(value, ensure_ascii=False, allow_nan=False))

"""A scenario file read once, from which scenarios with different values are made."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from bussim.errors import UsageError
from bussim.scenario.loader import Examined, _check
from bussim.scenario.yaml import parser as yaml
from bussim.scenario.yaml.files import Files
from bussim.scenario.yaml.overrides import Override
from bussim.scenario.yaml.source_map import SourceMap
from bussim.scenario.yaml.user_code import Code


class Template:
    """The text of a scenario, with ``name`` for messages, and the files and functions that it names.

    Reading YAML takes most of the time of loading; a sweep does it once a process.
    """

    def __init__(self, text: str, name: str, files: Files | None = None, code: Code | None = None) -> None:
        self._files = files
        self._code = code
        self._data, self._source_map, self._problems = yaml.read(text, name)

    def examine(self, overrides: Iterable[Override]) -> Examined:
        """The scenario with values set, or every mistake in it.

        Raises UsageError for an override whose path leads nowhere, or that another one replaces.
        """
        given = list(overrides)
        source_map = self._copy_of_source_map()
        examined = _check(
            _copied(self._data), source_map, list(self._problems), given, self._code, self._files
        )
        left = set(source_map.labels.values())
        lost = [override for override in given if override.label not in left]
        if lost:
            raise UsageError(f"{lost[0].label}: another option sets the same value")
        return examined

    def _copy_of_source_map(self) -> SourceMap:
        known = self._source_map
        return SourceMap(
            known.file, dict(known.keys), dict(known.values), {}, dict(known.blocks), data=known.data
        )


def _copied(data: Any) -> Any:
    """The same values in new dicts and lists (numbers keep the text that they had in the file)."""
    if isinstance(data, dict):
        return {key: _copied(value) for key, value in data.items()}
    if isinstance(data, list):
        return [_copied(value) for value in data]
    return data

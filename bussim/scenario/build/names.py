"""Names of entries that a scenario leaves without one."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol


class _MayHaveName(Protocol):
    @property
    def name(self) -> str | None: ...


def unique_names(entries: Iterable[_MayHaveName], labels: Iterable[str]) -> list[str]:
    """The names of entries, and for those without one their labels, numbered from the second of its kind on.

    A label has a space, which no given name has. It does not depend on the entry's position, so
    that another entry changes no random stream.
    """
    seen: dict[str, int] = {}
    names = []
    for entry, label in zip(entries, labels, strict=True):
        name = entry.name
        if name is None:
            seen[label] = seen.get(label, 0) + 1
            name = label if seen[label] == 1 else f"{label} #{seen[label]}"
        names.append(name)
    return names

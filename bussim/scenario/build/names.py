"""Names of entries that a scenario leaves without one."""

from collections.abc import Iterable


def unique_names(given: Iterable[str | None], labels: Iterable[str]) -> list[str]:
    """The given names, and for None the entry's label, numbered from the second of its kind on.

    A label has a space, which no given name has. It does not depend on the entry's position, so
    that another entry changes no random stream.
    """
    seen: dict[str, int] = {}
    names = []
    for name, label in zip(given, labels, strict=True):
        if name is None:
            seen[label] = seen.get(label, 0) + 1
            names.append(label if seen[label] == 1 else f"{label} #{seen[label]}")
        else:
            names.append(name)
    return names

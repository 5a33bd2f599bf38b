"""How messages show the user's own text and offer the nearest right name; for every layer."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

#: Longest piece of the user's input that a message repeats.
_SHOWN = 60


def shorten(text: str) -> str:
    """A text cut to a length that fits a message."""
    return text if len(text) <= _SHOWN else text[: _SHOWN - 1] + "…"


def names(options: Iterable[str]) -> str:
    """A list of names for a message, cut after a dozen."""
    listed = [shorten(option) for option in options]
    if len(listed) > 12:
        return ", ".join(listed[:12]) + ", …"
    return ", ".join(listed)


def nearest(name: str, options: Sequence[str], *, cutoff: float = 0.6) -> str | None:
    """The option that is most like ``name``, or None if none is (1: the same, 0: nothing in common)."""
    import difflib  # 5 ms that only a mistake pays

    lower: dict[str, str] = {}
    for option in options:
        lower.setdefault(option.lower(), option)
    found = difflib.get_close_matches(name.lower()[:200], list(lower), n=1, cutoff=cutoff)
    return lower[found[0]] if found else None


def suggest(name: str, options: Sequence[str]) -> str:
    """The end of a message about an unknown name: the nearest right one, or all that there are."""
    near = nearest(name, options)
    if near is not None:
        return f"did you mean {near}?"
    return f"allowed are {names(options)}" if options else "there are none"


def about(value: float) -> str:
    """Two significant digits, with thousands separated: 3,100; 0.12; 1e-7 stays a power."""
    if value == 0:
        return "0"
    if abs(value) < 1e-3 or abs(value) >= 1e9:
        return f"{value:.1e}"
    rounded = float(f"{value:.2g}")
    return f"{rounded:,.0f}" if abs(rounded) >= 10 else f"{rounded:g}"

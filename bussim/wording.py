"""How messages show the user's own text and offer the nearest right name."""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Iterable, Sequence

#: Longest piece of the user's input that a message repeats.
_SHOWN = 60


class RawInt(int):
    """A whole number with the text that it had in the file (``0x16``)."""

    raw: str

    def __new__(cls, value: int, raw: str) -> RawInt:
        """The number ``value``, written as ``raw``."""
        self = super().__new__(cls, value)
        self.raw = raw
        return self


class RawFloat(float):
    """A number with the text that it had in the file: ``7E1`` may be meant as a character format."""

    raw: str

    def __new__(cls, value: float, raw: str) -> RawFloat:
        """The number ``value``, written as ``raw``."""
        self = super().__new__(cls, value)
        self.raw = raw
        return self


def shorten(text: str) -> str:
    """A text cut to a length that fits a message."""
    return text if len(text) <= _SHOWN else text[: _SHOWN - 1] + "…"


def visible(text: str) -> str:
    """A text of someone else's without anything that a terminal would obey: that stands in escapes."""
    if text.isprintable():
        return text
    return "".join(
        char if char.isprintable() else char.encode("unicode_escape").decode("ascii") for char in text
    )


#: Characters that are typed or pasted for an ASCII one, beyond those that Unicode calls compatible with it.
_LOOKALIKES = {
    **dict.fromkeys("“”„‟«»「」『』", '"'),
    **dict.fromkeys("‘’‚‹›", "'"),
    **dict.fromkeys("–—−", "-"),
    "、": ",",
    "【": "[",
    "】": "]",
}


def plain_form(char: str) -> str | None:
    """The ASCII character that another one was typed for, None if it stands for none."""
    if char.isascii():
        return None
    found = _LOOKALIKES.get(char) or unicodedata.normalize("NFKC", char)
    return found if len(found) == 1 and found.isascii() else None


def names(options: Iterable[str]) -> str:
    """A list of names for a message, cut after a dozen."""
    listed = [shorten(option) for option in options]
    return ", ".join(listed[:12]) + ", …" if len(listed) > 12 else ", ".join(listed)


def nearest(name: str, options: Sequence[str], *, cutoff: float = 0.6) -> str | None:
    """The option that is most like ``name``, or None if none is (1: the same, 0: nothing in common).

    One with another first letter must be more like it.
    """
    import difflib  # 5 ms that only a mistake pays

    lower: dict[str, str] = {}
    for option in options:
        lower.setdefault(option.lower(), option)
    wanted = name.lower()[:200]
    found = difflib.get_close_matches(wanted, list(lower), n=1, cutoff=max(cutoff, 0.75))
    found = found or difflib.get_close_matches(
        wanted, [option for option in lower if option[:1] == wanted[:1]], n=1, cutoff=cutoff
    )
    return lower[found[0]] if found else None


def shell_word(word: object) -> str:
    """A word of a command line, in quotes if it needs them in shells."""
    text = str(word)
    return text if re.fullmatch(r"[\w@%+=:,./\\-]+", text) else f'"{text}"'


def about(value: float) -> str:
    """Two significant digits, with thousands separated: 3,100; 0.12; 1e-7 stays a power."""
    if value == 0:
        return "0"
    if abs(value) < 1e-3 or abs(value) >= 1e9:
        return f"{value:.1e}"
    rounded = float(f"{value:.2g}")
    return f"{rounded:,.0f}" if abs(rounded) >= 10 else f"{rounded:g}"


def counted(number: float, what: str) -> str:
    """A number with its noun: ``1 frame``, ``2,000 frames``, ``0 retries``, ``3 addresses``."""
    if number != 1:
        what = f"{what[:-1]}ie" if what.endswith("y") and what[-2] not in "aeiou" else what
        what += "es" if what.endswith("s") else "s"
    return f"{number:,.15g} {what}"


def in_ms(value: float, *, most: bool = False) -> str:
    """Milliseconds for a sentence, with one decimal; from 1000 on seconds with two.

    ``most``: rounded up, for what is said not to be exceeded.
    """
    scaled = value / 10 if value >= 1000 else value * 10
    # Up from the nanoseconds that a summary has, not from what a binary fraction adds to them.
    steps = math.ceil(round(scaled, 7)) if most else round(scaled)
    return f"{steps / 100:,.2f} s" if value >= 1000 else f"{steps / 10:,.1f} ms"

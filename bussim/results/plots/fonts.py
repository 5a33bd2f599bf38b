"""Fonts for names in any script: those of this machine that have what the house's own font lacks."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from contextlib import suppress
from functools import cache
from typing import Any
from unicodedata import name

from matplotlib.font_manager import FontProperties, findfont, findSystemFonts, fontManager, get_font
from matplotlib.text import Text

from bussim.wording import shorten

#: Comes with matplotlib: the same picture everywhere.
FONT = "DejaVu Sans"
#: Families with Chinese, Japanese and Korean characters, the preferred ones first.
_CJK = (
    *("Noto Sans CJK SC", "Noto Sans SC", "Source Han Sans SC", "Microsoft YaHei", "SimHei", "PingFang SC"),
    *("Hiragino Sans GB", "WenQuanYi Micro Hei", "WenQuanYi Zen Hei", "Noto Sans CJK JP", "Arial Unicode MS"),
)
#: How Unicode's names of such characters begin.
_CJK_NAMES = ("CJK", "HIRAGANA", "KATAKANA", "HANGUL", "BOPOMOFO", "IDEOGRAPHIC", "FULLWIDTH", "HALFWIDTH")
#: A font of matplotlib's that has an empty box for every character.
_BOXES = "Last Resort High-Efficiency"


def use_fonts(texts: Iterable[Text]) -> None:
    """Give each text the fonts for all of its characters, as far as this machine has them.

    Characters that no font has are drawn as boxes; a note on standard error says so, once for a script.
    """
    for text in texts:
        wanted = text.get_text()
        if not wanted.isascii():
            families, missing = _families(wanted)
            text.set_fontfamily([FONT, *families])
            if missing:
                _tell(missing, wanted)


@cache
def _families(text: str) -> tuple[tuple[str, ...], frozenset[str]]:
    """The families that a text needs beside :data:`FONT`, and what of it none has."""
    own = get_font(findfont(FontProperties(family=[FONT])))
    missing = {each for each in text if each.isprintable() and not own.get_char_index(ord(each))}
    found: list[str] = []
    for family, path in _others() if missing else ():
        with suppress(OSError, RuntimeError):  # a file that is no sound font
            font = get_font(path)
            if font.scalable and (covered := {each for each in missing if font.get_char_index(ord(each))}):
                found.append(family)
                missing -= covered
        if not missing:
            break
    return tuple(found), frozenset(missing)


@cache
def _others() -> tuple[tuple[str, str], ...]:
    """Family and file of every other font of this machine, those of :data:`_CJK` and upright ones first."""
    known = {font.fname for font in fontManager.ttflist}
    for path in findSystemFonts():  # matplotlib keeps its list where a font is installed later
        if path not in known:
            with suppress(OSError, RuntimeError):
                fontManager.addfont(path)
    ranks = {family: rank for rank, family in enumerate(_CJK)}

    def rank(font: Any) -> tuple[int, bool, bool]:
        return ranks.get(font.name, len(ranks)), font.style != "normal", font.weight != 400

    return tuple(
        (font.name, font.fname)
        for font in sorted(fontManager.ttflist, key=rank)
        if font.name not in (FONT, _BOXES)
    )


_TOLD: set[str] = set()


def _tell(missing: Iterable[str], text: str) -> None:
    """Say, once for a script, that no font has these characters of a text, and which fonts would do."""
    for character in sorted(missing):
        word = name(character, "Symbols").split()[0]
        script = "CJK" if word.startswith(_CJK_NAMES) else word.title()
        if script not in _TOLD:
            would = ", ".join(_CJK) if script == "CJK" else f"Noto Sans {script}"
            sys.stderr.write(
                f"note: no font of this machine has {character} (in {shorten(text)!r}); pictures show a box "
                f"instead. Fonts that would do: {would}\n"
            )
            _TOLD.add(script)

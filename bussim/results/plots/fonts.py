"""Fonts for names in any script: those of this machine that have what the house's own font lacks."""

import sys
from collections.abc import Iterable
from contextlib import suppress
from functools import cache

from matplotlib.font_manager import FontProperties, findfont, findSystemFonts, fontManager, get_font
from matplotlib.text import Text

from bussim.wording import shorten
from bussim.words.language import current_language

#: Comes with matplotlib: the same picture everywhere.
FONT = "DejaVu Sans"
#: Families with Chinese, Japanese and Korean characters, the preferred ones first.
_CJK = (
    *("Noto Sans CJK SC", "Noto Sans SC", "Source Han Sans SC", "Microsoft YaHei", "SimHei", "PingFang SC"),
    *("Hiragino Sans GB", "WenQuanYi Micro Hei", "WenQuanYi Zen Hei", "Noto Sans CJK JP", "Arial Unicode MS"),
)
#: A font of matplotlib's that has an empty box for every character.
_BOXES = "Last Resort High-Efficiency"
_TOLD: list[str] = []


def drawable_language() -> str:
    """The language that is used, as far as a font of this machine has its characters; English else.

    One note on standard error says so.
    """
    lang = current_language()
    if lang == "en" or any(family in _CJK for family, _ in _others()):
        return lang
    if not _TOLD:
        _TOLD.append(lang)
        sys.stderr.write(
            "note: no font for Chinese is known by its name on this machine; pictures are in English. Any of "
            f"these would do: {', '.join(_CJK)}\n"
        )
    return "en"


def use_fonts(texts: Iterable[Text]) -> None:
    """Give each text the fonts for all of its characters, as far as this machine has them.

    Characters that no font has are drawn as boxes; one note on standard error says so.
    """
    for text in texts:
        if not text.get_text().isascii():
            text.set_fontfamily(list(_families(text.get_text())))


@cache
def _families(text: str) -> tuple[str, ...]:
    """The families that a text needs, :data:`FONT` first; says which characters none has."""
    missing = set(filter(str.isprintable, text))
    found = []
    for family, path in (font for fonts in (_own, _others) for font in fonts()):
        with suppress(OSError, RuntimeError):  # a file that is no sound font
            font = get_font(path)
            if font.scalable and (covered := {each for each in missing if font.get_char_index(ord(each))}):
                found.append(family)
                missing -= covered
        if not missing:
            break
    if missing and not _TOLD:
        _TOLD.append(text)
        sys.stderr.write(
            f"note: no font of this machine has {min(missing)} (in {shorten(text)!r}); pictures show boxes "
            "instead. A Noto Sans font of the script would do (https://fonts.google.com/noto); for Chinese, "
            f"Japanese and Korean any of {', '.join(_CJK)}\n"
        )
    return tuple(found) or (FONT,)


def _own() -> list[tuple[str, str]]:
    return [(FONT, findfont(FontProperties(family=[FONT])))]


@cache
def _others() -> list[tuple[str, str]]:
    """Family and file of every other font of this machine, those of :data:`_CJK` and upright ones first."""
    known = {font.fname for font in fontManager.ttflist}
    # matplotlib keeps its list where a font is installed later.
    for path in sorted(set(findSystemFonts()) - known):
        with suppress(OSError, RuntimeError):
            fontManager.addfont(path)
    fonts = [font for font in fontManager.ttflist if font.name not in (FONT, _BOXES)]
    # Stable: the last order counts most.
    fonts.sort(key=lambda font: (font.style != "normal", font.weight != 400))
    fonts.sort(key=lambda font: _CJK.index(font.name) if font.name in _CJK else len(_CJK))
    return [(font.name, font.fname) for font in fonts]

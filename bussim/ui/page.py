"""The page itself, and what it loads from this server: one style and one script."""

from __future__ import annotations

from functools import cache
from importlib.resources import files

from bussim.report.document import environment, html_language, payload_text, text
from bussim.version import __version__
from bussim.words.tables import LANGUAGES, page_words

#: What the page is made of, in this order.
_STYLES = ("vendor/uPlot.min.css", "assets/page.css", "assets/sizing.css")
_SCRIPTS = ("vendor/uPlot.iife.min.js", "assets/charts.js", "assets/page.js", "assets/trade_off.js")


def words(lang: str) -> dict[str, str]:
    """What the page says in one language, by key, with what the report and the sizing page say, too."""
    return page_words("report", lang) | page_words("sizing", lang) | page_words("ui", lang)


def _page(lang: str) -> str:
    """The HTML that the browser gets, with the words of both languages and no figure."""
    payload = {"charts": [], "runs": [], "lang": lang, "words": {each: words(each) for each in LANGUAGES}}
    template = environment().from_string(_own("ui.html.jinja"))
    return template.render(
        lang=html_language(lang),
        words=words(lang),
        payload=payload_text(payload),
        version=__version__,
    )


@cache
def static(name: str, lang: str) -> tuple[str, str] | None:
    """A file that the browser loads, "" for the page itself, and its type; None for all other names."""
    match name:
        case "":
            return _page(lang), "text/html"
        case "page.css":
            return "\n".join([*map(text, _STYLES), _own("ui.css")]), "text/css"
        case "page.js":
            return "\n".join([*map(text, _SCRIPTS), _own("ui.js")]), "text/javascript"
        case _:
            return None


def _own(name: str) -> str:
    return (files("bussim.ui") / "assets" / name).read_text(encoding="utf-8")

"""The sizing page: one HTML file with every setting that its sliders reach, in English and Chinese."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from bussim.report.document import document
from bussim.version import __version__
from bussim.words.language import shown, use_language
from bussim.words.tables import LANGUAGES, Said, page_words


def sizing_page(
    name: str, items: Sequence[Mapping[str, Any]], lang: str, dims: Sequence[Mapping[str, Any]] = ()
) -> str:
    """The page in every language, which opens in ``lang``; ``name`` is "" for a link without one.

    ``items`` are the links and poll lists with their figures. ``dims`` are sliders that choose one of them,
    as ``{"key": …, "values": […]}``, the last one of neighbouring items; without any the items are chosen by
    name.
    """
    each = page_words("sizing", lang)
    dims = dims or [{"key": "name", "values": [item["name"] for item in items]}]
    title = "standard" if len(dims) > 1 else "title"
    said = [sentence for item in items for sentence in _sentences(item)]
    with use_language("zh"):
        sentences = {each: shown(each) for each in said if isinstance(each, Said)}
    payload = {
        "charts": [{"kind": "curve"}, {"kind": "trade"}],
        "lang": lang,
        "name": name,
        "title": title,
        "version": __version__,
        "words": {language: page_words("sizing", language) for language in LANGUAGES},
        "sentences": sentences,
        "dims": list(dims),
        "items": list(items),
    }
    return document(
        "sizing.html.jinja",
        ("trade_off.js", "sizing.js"),
        payload,
        styles=("assets/sizing.css",),
        lang=lang,
        title=each[title].format(name=name or each["link.about"].format(**items[0]["about"])),
        words=each,
    )


def _sentences(item: Mapping[str, Any]) -> Iterable[str]:
    yield from item["notes"]
    yield from (text for goals in item["unmet"] for text in goals)
    yield from (goal["text"] for goal in item.get("goals", ()))
    yield from item.get("beside", ())
    yield from item.get("remedies", ())
    yield item.get("reason", "")
    for assumption in item.get("assumptions", ()):
        yield from assumption["text"]

"""The sizing page: one HTML file with every setting that its sliders reach, in English and Chinese."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from typing import Any

from bussim.report.document import document, text
from bussim.version import __version__

#: The languages that the page is in.
LANGUAGES = ("en", "zh")


def sizing_page(
    name: str, items: Sequence[Mapping[str, Any]], lang: str, dims: Sequence[Mapping[str, Any]] = ()
) -> str:
    """The page, which opens in one of :data:`LANGUAGES` and has both; ``name`` "" for a link without one.

    ``items`` are the links and poll lists with their figures. ``dims`` are sliders that choose one of them,
    as ``{"key": …, "values": […]}``, the last one of neighbouring items; without any the items are chosen by
    name.
    """
    each = words(lang)
    dims = dims or [{"key": "name", "values": [item["name"] for item in items]}]
    title = "standard" if len(dims) > 1 else "title"
    said = [sentence for item in items for sentence in _sentences(item)]
    payload = {
        "charts": [{"kind": "curve"}, {"kind": "trade"}],
        "lang": lang,
        "name": name,
        "title": title,
        "version": __version__,
        "words": {language: words(language) for language in LANGUAGES},
        "sentences": {each: found for each in dict.fromkeys(said) if (found := in_chinese(each))},
        "dims": list(dims),
        "items": list(items),
    }
    return document(
        "sizing.html.jinja",
        "sizing.js",
        payload,
        styles=("assets/sizing.css",),
        lang="zh-Hans" if lang == "zh" else lang,
        title=each[title].format(name=name or each["link.about"].format(**items[0]["about"])),
        words=each,
    )


@cache
def words(lang: str) -> dict[str, str]:
    """What the page says in one language, by key; ``{names}`` are filled in."""
    return {key: pair[LANGUAGES.index(lang)] for key, pair in _read("sizing_words").items()}


def in_chinese(sentence: str) -> str:
    """A sentence of the solver in Chinese with its parts, "" where it is there in English only."""
    for english, chinese in _read("sizing_sentences").items():
        match = re.fullmatch("(.+?)".join(map(re.escape, english.split("{}"))), sentence)
        if match:
            return str(chinese).format(*(in_chinese(part) or part for part in match.groups()))
    return ""


def _sentences(item: Mapping[str, Any]) -> Iterable[str]:
    yield from item["notes"]
    yield from item.get("remedies", ())
    yield item.get("reason", "")
    for assumption in item.get("assumptions", ()):
        yield from assumption["text"]


@cache
def _read(name: str) -> dict[str, Any]:
    import yaml

    found: dict[str, Any] = yaml.safe_load(text(f"assets/{name}.yaml"))
    return found

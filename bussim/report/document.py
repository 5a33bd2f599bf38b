"""One HTML file that needs nothing else: its style, its scripts and what they draw are inside."""

from __future__ import annotations

import base64
import hashlib
import json
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from bussim.version import __version__
from bussim.words.language import said_text, shown

if TYPE_CHECKING:
    from jinja2 import Environment


def document(
    template: str,
    scripts: tuple[str, ...],
    payload: dict[str, Any],
    *,
    styles: tuple[str, ...] = (),
    lang: str = "en",
    **values: object,
) -> str:
    """A page from a template of ``assets``, in the language ``lang``, with the values that it shows.

    ``scripts`` of the same folder draw ``payload``, with uPlot and what all pages draw with; ``styles`` are
    added to that of all pages. The page loads nothing: its policy allows these scripts alone.
    """
    own = (text(f"assets/{name}") for name in ("charts.js", *scripts))
    sources = [text("vendor/uPlot.iife.min.js"), *own]
    return (
        environment()
        .get_template(template)
        .render(
            lang=html_language(lang),
            css=[text(name) for name in ("vendor/uPlot.min.css", "assets/page.css", *styles)],
            scripts=sources,
            hashes=[_hash(each) for each in sources],
            licence=text("vendor/LICENSE.uPlot.txt"),
            payload=payload_text(payload),
            version=__version__,
            **values,
        )
    )


def html_language(lang: str) -> str:
    """What a page calls a language of :data:`~bussim.words.tables.LANGUAGES`."""
    return "zh-Hans" if lang == "zh" else lang


def text(name: str) -> str:
    """The text of a file of this package."""
    return files("bussim.report").joinpath(name).read_text(encoding="utf-8")


@cache
def environment() -> Environment:
    """Templates of the folder ``assets``, and texts that extend them; what they are given is escaped."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    found = Environment(
        loader=PackageLoader("bussim.report", "assets"),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=shown,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    found.globals["say"] = said_text
    return found


def _hash(script: str) -> str:
    digest = hashlib.sha256(script.encode("utf-8")).digest()
    return f"sha256-{base64.b64encode(digest).decode('ascii')}"


def payload_text(data: dict[str, Any]) -> str:
    """JSON that no browser takes for markup, whatever a scenario calls its stations."""
    text = json.dumps(data, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")

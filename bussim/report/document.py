"""One HTML file that needs nothing else: its style, its scripts and what they draw are inside."""

from __future__ import annotations

import base64
import hashlib
import json
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from bussim.version import __version__

if TYPE_CHECKING:
    from jinja2 import Environment


def document(
    template: str,
    script: str,
    payload: dict[str, Any],
    *,
    styles: tuple[str, ...] = (),
    lang: str = "en",
    **values: object,
) -> str:
    """A page from a template of ``assets``, in the language ``lang``, with the values that it shows.

    ``script`` of the same folder draws ``payload``, with uPlot and what all pages draw with; ``styles`` are
    added to that of all pages. The page loads nothing: its policy allows these scripts alone.
    """
    scripts = [text("vendor/uPlot.iife.min.js"), *(text(f"assets/{name}") for name in ("charts.js", script))]
    return (
        _environment()
        .get_template(template)
        .render(
            lang=lang,
            css=[text(name) for name in ("vendor/uPlot.min.css", "assets/page.css", *styles)],
            scripts=scripts,
            hashes=[_hash(each) for each in scripts],
            licence=text("vendor/LICENSE.uPlot.txt"),
            payload=_payload(payload),
            version=__version__,
            **values,
        )
    )


def text(name: str) -> str:
    """The text of a file of this package."""
    return files("bussim.report").joinpath(name).read_text(encoding="utf-8")


@cache
def _environment() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    return Environment(
        loader=PackageLoader("bussim.report", "assets"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def _hash(script: str) -> str:
    digest = hashlib.sha256(script.encode("utf-8")).digest()
    return f"sha256-{base64.b64encode(digest).decode('ascii')}"


def _payload(data: dict[str, Any]) -> str:
    """JSON that no browser takes for markup, whatever a scenario calls its stations."""
    text = json.dumps(data, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")

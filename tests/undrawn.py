"""Runs without the work of drawing, for tests that read everything else of them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from bussim.results.plots.style import Picture


@contextmanager
def undrawn() -> Iterator[None]:
    """Every picture that is written meanwhile is a file of a few bytes."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Picture, "_bytes", lambda *_, **__: b"picture")
        yield

"""Which of many like cases run by themselves, and which only in the slow pass."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def quick(count: int, values: Iterable[Any]) -> list[Any]:
    """The values for ``parametrize``: the first ``count`` run always, all others with ``-m slow``."""
    return [value if number < count else _slow(value) for number, value in enumerate(values)]


def quick_names(names: Iterable[str], values: Iterable[str]) -> list[Any]:
    """The values for ``parametrize``: those with one of the names run always, all others with ``-m slow``."""
    chosen = set(names)
    return [value if value in chosen else _slow(value) for value in values]


def _slow(value: Any) -> Any:
    return pytest.param(*(value if isinstance(value, tuple) else (value,)), marks=pytest.mark.slow)

"""One browser for each module of tests."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from tests.report.browser import chromium


@pytest.fixture(scope="module")
def window() -> Iterator[Any]:
    with chromium() as found:
        yield found

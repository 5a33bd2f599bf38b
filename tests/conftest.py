"""Settings of the whole suite: random examples and worker processes."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest
from hypothesis import settings

# How long an example takes is no test's verdict. Every run draws other examples: fewer at a time keep the
# whole suite short, and `--hypothesis-profile=patient` tries many more. Where CI is set they are always the
# same, so that its verdict is about the change and not about the draw.
settings.register_profile("untimed", deadline=None, max_examples=25, derandomize="CI" in os.environ)
settings.register_profile("patient", deadline=None, max_examples=1000)
settings.load_profile("untimed")


def pytest_xdist_auto_num_workers() -> int | None:
    """One worker more than processors: tests of ports and processes wait for most of their time."""
    if "PYTEST_XDIST_AUTO_NUM_WORKERS" in os.environ:
        return None  # xdist reads it
    return 1 + (len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1)


@pytest.fixture
def pictures_undrawn() -> Iterator[None]:
    """Pictures are files of a few bytes during a test."""
    from tests.undrawn import undrawn

    with undrawn():
        yield

"""Settings of the whole suite: random examples and worker processes."""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator

import pytest
from hypothesis import settings

# How long an example takes is no test's verdict. Every run draws other examples: few at a time keep the whole
# suite short, and `-m "hypothesis and not slow" --hypothesis-profile=patient`, which .ci/run does as well, tries
# many more. Where CI is set they are always the same, so that its verdict is about the change and not about the draw.
settings.register_profile("untimed", deadline=None, max_examples=25, derandomize="CI" in os.environ)
settings.register_profile("patient", settings.get_profile("untimed"), max_examples=200)
settings.load_profile("untimed")


gc.disable()  # nothing of what collecting makes can go


def pytest_collection_finish() -> None:
    """Leave the thousands of collected tests out of every later search for garbage."""
    gc.freeze()
    gc.enable()
    gc.set_threshold(20_000, 20, 50)  # a tenth of all processor time went into searches


def pytest_xdist_auto_num_workers() -> int | None:
    """One worker more than processors: tests of ports and processes wait for most of their time."""
    if "PYTEST_XDIST_AUTO_NUM_WORKERS" in os.environ:
        return None  # xdist reads it
    return 1 + (len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1)


@pytest.fixture(scope="session", autouse=True)
def _mistakes_in_chinese() -> Iterator[None]:
    """What tests find wrong in scenarios can be said in Chinese."""
    from tests.words.chinese import watched

    with watched():
        yield


@pytest.fixture
def pictures_undrawn() -> Iterator[None]:
    """Pictures are files of a few bytes during a test."""
    from tests.undrawn import undrawn

    with undrawn():
        yield

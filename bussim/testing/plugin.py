"""The pytest plugin: fixtures of :mod:`bussim.testing`. Nothing is imported before one is used."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from bussim.testing.served import ServedBus


@pytest.fixture
def modbus_serve() -> Iterator[Callable[..., ServedBus]]:
    """Makes a :class:`bussim.testing.ServedBus` with its arguments; all are closed after the test."""
    from contextlib import ExitStack

    from bussim.testing.served import ServedBus

    with ExitStack() as stack:

        def serve(**settings: Any) -> ServedBus:
            if sys.platform == "win32" and settings.get("url", "pty").startswith("pty"):
                pytest.skip("Windows has no pseudo-terminals")
            return stack.enter_context(ServedBus(**settings))

        yield serve


@pytest.fixture
def modbus_slave(modbus_serve: Callable[..., ServedBus]) -> ServedBus:
    """A Modbus RTU slave, station 1, on a new pseudo-terminal."""
    return modbus_serve()

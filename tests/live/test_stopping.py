"""Ctrl-C as a wish, and as an order."""

from __future__ import annotations

import signal
import threading

import pytest

from bussim.live import stopping
from bussim.live.stopping import Stopping


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Seconds that a test sets."""
    now = [100.0]
    monkeypatch.setattr(stopping.time, "monotonic", lambda: now[0])
    return now


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_first_is_a_wish_and_a_later_one_interrupts(number: int, clock: list[float]) -> None:
    before = signal.getsignal(number)
    with Stopping() as stop:
        assert not stop()
        signal.raise_signal(number)
        assert stop()
        clock[0] += 1
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(number)
    assert signal.getsignal(number) is before


def test_signals_of_one_moment_are_one_wish(clock: list[float]) -> None:
    """``timeout -s INT`` signals the process, then its group: the summary is printed all the same."""
    with Stopping() as stop:
        for _ in range(3):
            signal.raise_signal(signal.SIGINT)
            clock[0] += 0.01
        assert stop()


def test_in_another_thread_it_only_keeps_the_flag() -> None:
    before, found = signal.getsignal(signal.SIGINT), []

    def run() -> None:
        with Stopping() as stop:
            found.append((stop(), signal.getsignal(signal.SIGINT)))

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    assert found == [(False, before)]

"""Ctrl-C as a request: what runs ends its step, and everything is closed and reported in order."""

import signal
import threading
import time
from types import FrameType
from typing import Any, Self

#: Seconds within which signals are one request: ``timeout`` and supervisors signal a process and its group.
_ONE_REQUEST = 0.5


class Stopping:
    """While it is open, the first Ctrl-C (or SIGTERM) only sets :attr:`stopped`; one that follows interrupts.

    Outside the main thread, where signals cannot be taken, it only keeps the flag.
    """

    def __init__(self) -> None:
        self.stopped = False
        self._first_at = 0.0
        self._before: dict[int, Any] = {}

    def __call__(self) -> bool:
        """Whether to stop."""
        return self.stopped

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                self._before[number] = signal.signal(number, self._asked)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _asked(self, number: int, frame: FrameType | None) -> None:
        now = time.monotonic()
        if not self.stopped:
            self._first_at, self.stopped = now, True
        elif now - self._first_at > _ONE_REQUEST:
            raise KeyboardInterrupt

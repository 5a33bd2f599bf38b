"""Processes that this one starts: signals while they are started, and their end with it."""

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from types import FrameType
from typing import Any

#: A started process looks for its parent so often, in seconds.
_WATCH_SECONDS = 0.5


@contextmanager
def signals_later() -> Generator[None]:
    """While it is open, Ctrl-C and SIGTERM wait; the last one is handled at the end. Main thread only.

    What is started meanwhile never gets them: a terminal sends Ctrl-C to the workers as well, which what
    started them ends itself. (Not on Windows, where processes have no mask of signals.)
    """
    numbers = (signal.SIGINT, signal.SIGTERM)
    came: list[tuple[int, FrameType | None]] = []
    before: dict[int, Callable[[int, FrameType | None], Any]] = {}
    if threading.current_thread() is threading.main_thread():
        for number in numbers:
            if callable(handler := signal.getsignal(number)):
                before[number] = handler
                signal.signal(number, lambda *args: came.append(args))
    masked = signal.pthread_sigmask(signal.SIG_BLOCK, numbers) if sys.platform != "win32" else ()
    try:
        yield
    finally:
        if sys.platform != "win32":
            signal.pthread_sigmask(signal.SIG_SETMASK, masked)
        for held, handler in before.items():
            signal.signal(held, handler)
        for last, frame in came[-1:]:
            before[last](last, frame)


def end_with(parent: int) -> None:
    """Let this process end soon after its parent, also if that is killed.

    It would wait for work until it has been idle for long, and keep the terminal or pipe that both
    write to. On Windows the end of a parent cannot be noticed; there only being idle ends it.
    """

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_WATCH_SECONDS)
        os._exit(1)

    if sys.platform != "win32" and os.getpid() != parent:
        threading.Thread(target=watch, name="end with parent", daemon=True).start()

"""The progress of a simulation."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

#: Shorter runs need no progress bar (seconds).
_PATIENCE = 2.0


@contextmanager
def simulating_bar() -> Iterator[Callable[[int, int], None] | None]:
    """A progress bar on stderr, only on a terminal and only for a run that takes its time."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    begun = time.monotonic()
    bar = Progress(console=Console(stderr=True), transient=True)
    task = bar.add_task("simulating", total=None)

    def progress(done: int, total: int) -> None:
        if not bar.live.is_started and time.monotonic() - begun > _PATIENCE:
            bar.start()
        bar.update(task, completed=done, total=total)

    try:
        yield progress
    finally:
        if bar.live.is_started:
            bar.stop()

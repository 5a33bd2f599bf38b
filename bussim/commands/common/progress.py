"""Progress bars, on a terminal only."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.progress import TaskID

#: What is over sooner needs no progress bar (seconds).
_PATIENCE = 2.0


@contextmanager
def progress_bar(*, counted: bool = False) -> Iterator[Callable[[str, int, int], None] | None]:
    """A bar on stderr for what takes its time, called with what is done, how much of it, and of how much.

    With ``counted`` it shows both numbers. None where stderr is no terminal.
    """
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import MofNCompleteColumn, Progress, TextColumn

    *columns, left = Progress.get_default_columns()
    count = [MofNCompleteColumn()] if counted else []
    begun = time.monotonic()
    bar = Progress(*columns, *count, left, TextColumn("left"), console=Console(stderr=True), transient=True)
    tasks: dict[str, TaskID] = {}

    def progress(what: str, done: int, total: int) -> None:
        if what not in tasks:
            # What was there already is no measure of the speed of the rest.
            tasks[what] = bar.add_task(what, completed=done, total=total)
        bar.update(tasks[what], completed=done, total=total)
        if not bar.live.is_started and time.monotonic() - begun > _PATIENCE:
            bar.start()

    try:
        yield progress
    finally:
        if bar.live.is_started:
            bar.stop()


@contextmanager
def simulating_bar() -> Iterator[Callable[[int, int], None] | None]:
    """The bar of a simulation, called with the ticks simulated and those in all."""
    with progress_bar() as progress:
        yield None if progress is None else partial(progress, "simulating")

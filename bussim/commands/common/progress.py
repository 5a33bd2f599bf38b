"""How far a command is: bars on a terminal, elsewhere a line now and then of what takes minutes."""

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from math import ceil
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from rich.progress import TaskID

#: What is over sooner needs no progress bar (seconds).
_PATIENCE = 2.0
#: Where there is no bar: the first line after so many seconds, the next after so many times what went by;
#: time left that is worth a line, and that is given in hours.
_FIRST_LINE, _RARER, WORTH_A_LINE, _HOURS = 5.0, 3, 60.0, 5400.0


@contextmanager
def progress_bar(*, counted: bool = False) -> Iterator[Callable[[str, int, int], None]]:
    """A bar on stderr for what takes its time, called with what is done, how much of it, and of how much.

    With ``counted`` it shows both numbers. Where stderr is no terminal, lines say how long it will take.
    """
    if not sys.stderr.isatty():
        yield _Lines()
        return
    from rich.console import Console
    from rich.progress import MofNCompleteColumn, Progress, TextColumn

    *columns, left = Progress.get_default_columns()
    count = [MofNCompleteColumn()] if counted else []
    bar = Progress(*columns, *count, left, TextColumn("left"), console=Console(stderr=True), transient=True)
    tasks: dict[str, TaskID] = {}
    # What takes its time may not tell more for long: the bar begins by itself.
    begin = threading.Timer(_PATIENCE, bar.start)
    begin.daemon = True

    def progress(what: str, done: int, total: int) -> None:
        if what not in tasks:
            # What was there already is no measure of the speed of the rest.
            tasks[what] = bar.add_task(what, completed=done, total=total)
        bar.update(tasks[what], completed=done, total=total)
        if begin.ident is None:
            begin.start()

    try:
        yield progress
    finally:
        begin.cancel()
        if begin.ident is not None:
            begin.join()
        if bar.live.is_started:
            bar.stop()


class _Lines:
    """Says what takes longer than a minute, after some seconds and then ever less often."""

    def __init__(self) -> None:
        self._what, self._before, self._begun, self._next = "", 0, 0.0, 0.0

    def __call__(self, what: str, done: int, total: int) -> None:
        now = time.monotonic()
        if what != self._what:
            self._what, self._before, self._begun, self._next = what, done, now, now + _FIRST_LINE
        if now < self._next or done <= self._before:
            return
        self._next = now + _RARER * (now - self._begun)
        left = (now - self._begun) * (total - done) / (done - self._before)
        if left > WORTH_A_LINE:
            click.echo(f"{what}: {done / total:.1%} done, about {roughly(left)} left", err=True)


def roughly(seconds: float) -> str:
    """A time in whole minutes, or in hours where it is long."""
    return f"{ceil(seconds / 60):,} min" if seconds < _HOURS else f"{seconds / 3600:,.1f} h"


@contextmanager
def simulating_bar() -> Iterator[Callable[[int, int], None]]:
    """The bar of a simulation, called with the ticks simulated and those in all."""
    with progress_bar() as progress:
        yield partial(progress, "simulating")

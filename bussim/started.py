"""A simulation in a process of its own: it tells how far it is, and it can be stopped.

::

    started = bussim.start("press_line", "runs/line")
    for progress in started.progress():
        print(f"{progress.done:.0%}")
    result = started.result()
"""

from __future__ import annotations

import contextlib
import os
import pickle
import signal
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future, wait
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple, Self

from bussim.api import Result, Source, load, open_run, run
from bussim.errors import BussimError, RunError, UsageError
from bussim.processes import end_with, signals_later
from bussim.scenario.model import Scenario
from bussim.units import TICKS_PER_SECOND

#: Seconds between two reports of progress, and in which a process that has told its outcome ends.
_EVERY, _ENDS = 0.1, 10


class RunProgress(NamedTuple):
    """How far a simulation is: the share that is done (0 to 1), seconds simulated, seconds left to wait."""

    done: float
    simulated_s: float
    left_s: float


class StartedRun:
    """A simulation that :func:`start` has begun. Leaving it as a context stops it if it still runs.

    ``stopped`` is whether it was stopped before its end.
    """

    def __init__(self, scenario: bytes, options: dict[str, Any]) -> None:
        # Unlike multiprocessing's own, its processes do not run the caller's script again.
        from joblib.externals.loky.backend import get_context

        self.stopped = False
        self._latest: RunProgress | None = None
        self._folder: Future[Path] = Future()
        context: Any = get_context("loky")
        told, tells = context.Pipe(duplex=False)
        job = tells, os.getpid(), scenario, options
        self._process = context.Process(target=_simulate, args=job, daemon=True)
        with signals_later():
            self._process.start()
        tells.close()
        threading.Thread(target=self._read, args=(told,), name="progress", daemon=True).start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def progress(self) -> Iterator[RunProgress]:
        """How far it is, at most ten times a second, until it is over. Who is slow gets the newest."""
        shown = None
        while not self._folder.done():
            wait([self._folder], _EVERY)
            if self._latest is not None and self._latest is not shown:
                shown = self._latest
                yield shown

    def stop(self) -> None:
        """End it at once, where it is not over, and wait until it is gone.

        Its folder stays as ``….incomplete`` with what was written; another run to the same place replaces it.
        """
        if not self._folder.done():
            self.stopped = True
            _kill(self._process)
            wait([self._folder])

    def result(self, timeout: float | None = None) -> Result:
        """Wait for its end, and give the result in its folder.

        Raises TimeoutError where that takes more than ``timeout`` seconds; what :func:`bussim.run` raises;
        RunError where it was stopped or its process died.
        """
        return open_run(self._folder.result(timeout))

    def _read(self, told: Connection) -> None:
        try:
            while isinstance(said := told.recv(), RunProgress):
                self._latest = said
            self._process.join(_ENDS)
        except (EOFError, OSError):
            self._process.join()
            said = RunError(self._why())
        told.close()
        if isinstance(said, BussimError):
            self._folder.set_exception(said)
        else:
            self._folder.set_result(said)

    def _why(self) -> str:
        if self.stopped:
            return "the simulation was stopped; what was written is in its folder ….incomplete"
        code = self._process.exitcode or 0
        if code < 0:
            names = {each.value: each.name for each in signal.Signals}
            return (
                f"the simulation's process was killed by {names.get(-code, -code)} (is there enough memory?)"
            )
        return f"the simulation's process ended with code {code} before the simulation did"


def _kill(process: Any) -> None:
    """End a process, whose signals may wait."""
    with contextlib.suppress(ProcessLookupError, PermissionError):  # it has ended just now
        if sys.platform == "win32":
            process.terminate()
        else:
            os.kill(process.pid, signal.SIGKILL)


def start(
    scenario: Scenario | Source,
    out: Source,
    *,
    trace: bool = False,
    rows: bool = True,
    format: str = "csv",  # noqa: A002 (the option's name on the command line)
    force: bool = False,
    numbered: bool = False,
    largest: int | None = None,
) -> StartedRun:
    """Simulate a scenario as :func:`bussim.run` does, in a process of its own, and go on meanwhile.

    ``out`` is the folder to write; all else is as there. The process ends with this one. It must find the
    modules of a user's functions by itself (PYTHONPATH).

    Raises ScenarioError or UsageError for a scenario that cannot be loaded or be handed to another process;
    all else is told by :meth:`StartedRun.result`.
    """
    loaded = scenario if isinstance(scenario, Scenario) else load(scenario)
    try:
        handed = pickle.dumps(loaded)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise UsageError(f"{loaded.name} cannot be handed to another process: {error}") from error
    options = {"trace": trace, "rows": rows, "format": format, "force": force, "numbered": numbered}
    return StartedRun(handed, {**options, "out": Path(out).absolute(), "largest": largest})


def _simulate(tells: Connection, parent: int, scenario: bytes, options: dict[str, Any]) -> None:
    end_with(parent)
    begun = said = time.monotonic()

    def tell(done: int, total: int) -> None:
        nonlocal said
        now = time.monotonic()
        if done and now - said >= _EVERY:
            said = now
            left = (now - begun) * (total - done) / done
            tells.send(RunProgress(done / total, done / TICKS_PER_SECOND, left))

    try:
        tells.send(run(pickle.loads(scenario), progress=tell, **options).folder)  # noqa: S301 - of `start`
    except BussimError as error:
        tells.send(error)
    except MemoryError:
        tells.send(RunError("there is not enough memory for this"))
    except Exception as error:
        tells.send(RunError(f"the simulation failed: {type(error).__name__}: {error}"))

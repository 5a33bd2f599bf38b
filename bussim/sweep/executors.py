"""Where the runs of a sweep are simulated: processes of this machine, or the workers of a Dask cluster."""

import os
import re
import sys
import threading
import warnings
from abc import ABC, abstractmethod
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager
from itertools import islice
from typing import Any, Self

from bussim.errors import RunError, UsageError
from bussim.processes import end_with, signals_later
from bussim.sweep.jobs import Job, Outcome, run_job

#: A worker process without work ends after so many seconds.
_IDLE_SECONDS = 30
#: Seconds in which a scheduler must respond, and in which it must have its first worker.
_CONNECT_SECONDS = 10
_WORKER_SECONDS = 60
#: Jobs that wait at a scheduler: at least so many, and this many for each of its threads.
_LEAST_WAITING = 256
_WAITING_PER_THREAD = 4

_ADDRESS = re.compile(r"(tcp|tls)://([^\s/:]+|\[[0-9A-Fa-f:.]+\]):\d{1,5}")


class WorkerLost(Exception):  # noqa: N818 - what is lost can be run again: no error yet
    """A worker died. The jobs without an outcome can be given to the executor again."""


class Executor(AbstractContextManager["Executor"], ABC):
    """Runs jobs in some order, between entering and leaving it as a context.

    Entering raises UsageError or RunError if it cannot be used.
    """

    def __exit__(self, *_: object) -> None:
        """Let go of everything."""

    @property
    @abstractmethod
    def workers(self) -> int:
        """How many runs are simulated at once."""

    @abstractmethod
    def run(self, jobs: Sequence[Job]) -> Generator[Outcome]:
        """The outcome of every job, as they come.

        Raises WorkerLost if a worker died, RunError if it cannot go on. Closing the generator gives
        up what is not done.
        """


class LocalExecutor(Executor):
    """Processes of this machine, through joblib. ``workers`` None: one for each core.

    They are started with the first jobs, and kept for a while for the next sweep of this program.
    """

    def __init__(self, workers: int | None) -> None:
        if workers is not None and workers < 1:
            raise UsageError(f"--workers is {workers}, allowed is 1 or more")
        self._workers = workers

    @property
    def workers(self) -> int:
        """See :class:`Executor`."""
        import joblib

        return self._workers or joblib.cpu_count()

    def run(self, jobs: Sequence[Job]) -> Generator[Outcome]:
        """See :class:`Executor`."""
        from multiprocessing import resource_tracker

        import joblib
        from joblib.externals.loky.backend import resource_tracker as loky_tracker

        pool = joblib.Parallel(
            n_jobs=min(self.workers, len(jobs)),
            backend="loky",
            return_as="generator_unordered",
            idle_worker_timeout=_IDLE_SECONDS,
            initializer=end_with,
            initargs=(os.getpid(),),
        )
        if sys.platform != "win32":
            # Starting a tracker of resources lets signals through again, so both are started before.
            loky_tracker.ensure_running()
            resource_tracker.ensure_running()
        outcomes: Any = None
        try:
            with signals_later():  # one within would leave a worker half-started, and nothing to close
                outcomes = pool(joblib.delayed(run_job)(job) for job in jobs)
            # Not with yield from, which would close the other generator by itself.
            while (outcome := next(outcomes, None)) is not None:
                yield outcome
        except BrokenProcessPool as error:
            raise WorkerLost("a worker process died (is there enough memory?)") from error
        finally:
            if outcomes is not None:
                _close(outcomes)


def _close(outcomes: Any) -> None:
    """Give up what joblib has not done, without the complaints about it.

    It says that tasks were given up, and its thread may meet one that has just been taken from it.
    """
    hook, threading.excepthook = threading.excepthook, lambda _: None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            outcomes.close()
    finally:
        threading.excepthook = hook


class DaskExecutor(Executor):
    """The workers of a running Dask scheduler at ``address``, such as tcp://10.0.0.5:8786."""

    def __init__(self, address: str) -> None:
        try:
            import distributed  # noqa: F401 (only whether it is there)
        except ImportError as error:
            raise UsageError(
                "--scheduler needs Dask, which is not installed; install bussim with the extra dask "
                "(pip install 'bussim[dask]'), here and on the workers"
            ) from error
        if not _ADDRESS.fullmatch(address):
            raise UsageError(f"--scheduler is {address!r}, expected an address such as tcp://10.0.0.5:8786")
        self._address = address
        self._client: Any = None

    def __enter__(self) -> Self:
        """Connect, and wait for a first worker."""
        import asyncio

        from distributed import Client

        try:
            # A Client that cannot connect complains in ways that cannot be stopped. In a thread of
            # its own, since a notebook has a running event loop.
            with ThreadPoolExecutor(1) as thread:
                thread.submit(asyncio.run, self._knock()).result()
            client: Any = Client(self._address, timeout=_CONNECT_SECONDS, set_as_default=False)  # type: ignore[no-untyped-call] # distributed
        except Exception as error:
            why = str(error) or "it does not speak Dask's protocol"  # its own timeout has no text
            raise UsageError(
                f"--scheduler {self._address}: no Dask scheduler responds there ({why}); start one with "
                "dask scheduler, or leave --scheduler out to use this machine"
            ) from error
        try:
            client.wait_for_workers(1, timeout=_WORKER_SECONDS)
        except TimeoutError as error:
            client.close()
            raise RunError(
                f"the scheduler {self._address} has no workers; start one with dask worker {self._address}"
            ) from error
        self._client = client
        return self

    def __exit__(self, *_: object) -> None:
        """Give up what is not done, and leave the cluster as it was."""
        self._client.close(timeout=_CONNECT_SECONDS)

    @property
    def workers(self) -> int:
        """See :class:`Executor`."""
        return sum(self._client.nthreads().values())

    def run(self, jobs: Sequence[Job]) -> Generator[Outcome]:
        """See :class:`Executor`."""
        from distributed import KilledWorker

        try:
            yield from self._outcomes(iter(jobs))
        except KilledWorker as error:
            # The scheduler itself gives a job to another worker, until it has taken several down.
            raise WorkerLost(f"workers of {self._address} died again and again") from error
        except Exception as error:
            raise RunError(f"{self._address} failed: {type(error).__name__}: {error}") from error

    def _outcomes(self, jobs: Iterator[Job]) -> Generator[Outcome]:
        from distributed import as_completed

        client = self._client

        def submit(count: int) -> list[Any]:
            return [client.submit(run_job, job, pure=False) for job in islice(jobs, count)]

        # Not all at once: a scheduler should not hold a hundred thousand jobs.
        first = submit(max(_LEAST_WAITING, _WAITING_PER_THREAD * self.workers))
        pending: Any = as_completed(first, loop=client.loop)  # type: ignore[no-untyped-call] # distributed
        for future in pending:
            outcome: Outcome = future.result()
            future.release()
            pending.update(submit(1))
            yield outcome

    async def _knock(self) -> None:
        """Raise an exception if nothing at the address speaks Dask's protocol."""
        import asyncio

        from distributed.comm.core import connect

        # Its own timeout does not cover a server of another protocol, which goes on waiting as well.
        knocked: Any = connect(self._address, timeout=_CONNECT_SECONDS)  # type: ignore[no-untyped-call] # distributed
        comm = await asyncio.wait_for(knocked, _CONNECT_SECONDS)
        await comm.close()


def open_executor(workers: int | None, scheduler: str | None) -> Executor:
    """The executor that the options ask for. Raises UsageError if they contradict each other."""
    if scheduler is None:
        return LocalExecutor(workers)
    if workers is not None:
        raise UsageError("--workers counts processes of this machine; with --scheduler the cluster decides")
    return DaskExecutor(scheduler)

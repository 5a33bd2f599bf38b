"""A small scenario with noise to sweep, and ways to run it without other processes."""

from __future__ import annotations

import random
from collections.abc import Generator, Sequence
from pathlib import Path

from bussim.sweep.executors import Executor
from bussim.sweep.jobs import Job, Outcome, run_job

NOISY = """\
schema: 1
name: noisy pair
duration: 400 ms
seed: 3
buses:
  - {name: link, nn: true}
plcs:
  - name: press
    scan: 10 ms
    nn: {bus: link, port: COM4, station: 0, slaves: 1, mode: 2, retries: 3, timeout: 50 ms}
  - {name: feeder, scan: 6 ms, nn: {bus: link, port: COM4, station: 1}}
noise:
  - {bus: link, ber: 1.0e-3}
"""
RETRIES = "plcs.press.nn.retries"
TIMEOUT = "plcs.press.nn.timeout"
BER = "noise.0.ber"
#: The sweep of the tests: 200 runs of 0.4 s, 5 × 4 points with 10 repeats.
VARY = [f"{RETRIES}=0:4:1", f"{BER}=1e-5:1e-2:log4"]
REPEAT = 10


def noisy(folder: Path) -> Path:
    """The scenario in a file."""
    path = folder / "noisy.yaml"
    path.write_text(NOISY)
    return path


def contents(folder: Path) -> dict[str, bytes]:
    """Every file of a folder."""
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


class HereExecutor(Executor):
    """Runs everything in this process, in an order of its own; or invents figures (``real=False``)."""

    def __init__(self, seed: int = 0, *, real: bool = True) -> None:
        self._random = random.Random(seed)
        self._real = real
        self.ran: list[int] = []

    @property
    def workers(self) -> int:
        return 1

    def run(self, jobs: Sequence[Job]) -> Generator[Outcome]:
        shuffled = list(jobs)
        self._random.shuffle(shuffled)
        for job in shuffled:
            self.ran.append(job.run)
            yield run_job(job) if self._real else invented(job)


def invented(job: Job) -> Outcome:
    """An outcome that costs nothing and shows which run it is of."""
    assert job.seed is not None
    figures = {
        "link.scans": 10 + job.run,
        "link.scan_time_mean_ms": job.seed / 2**40,
        "link.scan_time_p99_ms": None,
        "link.scan_time_max_ms": 90.5,
        "link.station_errors": 0,
        "link.refresh_gap_max_ms": 100 + job.run % 2,
    }
    return Outcome(job.run, figures)

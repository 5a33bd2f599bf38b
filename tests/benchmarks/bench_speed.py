"""How fast everything is simulated, as ratios to a lean SimPy loop; what calls and memory it takes.

    python tests/benchmarks/bench_speed.py                 # every ratio, calls, whole processes, memory
    python tests/benchmarks/bench_speed.py --quick         # ratios of few rounds, and calls
    python tests/benchmarks/bench_speed.py --json          # the same as JSON
    python tests/benchmarks/bench_speed.py --only W trace  # some ratios alone
    python tests/benchmarks/bench_speed.py --record        # keep calls and ratios in speed.json

The lean loop does the same number of exchanges (a poll with its reply, or the master's data frame: as many a
link scan as there are stations) in the same process: one event each that is armed again, a random draw,
nothing else. Both run in slices that take turns, in processor time, so that what else the machine does hits
both alike; a ratio is the median of the slices'. A time is no test's verdict: a test holds the calls.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

from bussim.results.collector import Collector
from bussim.results.store.rows import FileRows
from bussim.scenario.build.trace_header import trace_header
from bussim.sim.runner import Simulation
from bussim.units import TICKS_PER_SECOND
from tests.benchmarks.speed_scenarios import TEXTS, lean_loop, scenario

RECORDED = Path(__file__).with_name("speed.json")
#: The ratios to reach.
MARKS = {
    "W": 1.0,
    "no noise": 4.0,
    "ber 1e-6": 0.5,
    "ber 1e-5": 0.1,
    "reply_loss 1e-2": 0.15,
    "sources": 0.3,
    "CSV rows": 0.3,
    "Parquet rows": 0.3,
    "trace": 0.05,
    "two stations": 4.0,
    "programs": 0.02,
    "programs at rest": 0.1,
    "four ports": 0.03,
}
#: Simulated seconds of a slice at first; it grows until it takes long enough.
_SLICE, _LONG_ENOUGH = 10, 0.15
_LEAN_EVENTS = 40_000


class Counting(Collector):
    """What a run keeps, and a count of link scans and transactions."""

    @property
    def transactions(self) -> int:
        """Transactions that were taken over."""
        nodes = self._ports._nodes.values()
        return sum(poll.transactions for node in nodes for poll in node.polls.values())

    @property
    def scans(self) -> int:
        """Link scans that have ended."""
        link = self._link("link")
        link.count()
        return link.scan_times.histogram.count


class Run:
    """One mark's simulation under way; its files go to a folder."""

    def __init__(self, mark: str, folder: Path) -> None:
        spec, traced = scenario(mark), mark == "trace"
        rows = mark.endswith("rows")
        self._files: FileRows | None = None
        if rows or traced:
            fmt = "parquet" if mark.startswith("Parquet") else "csv"
            header = trace_header(spec)
            self._files = FileRows(folder, rows=rows, traced=traced, fmt=fmt, header=header)
        self.sink = Counting(traced=traced, rows=self._files)
        self.simulation = Simulation(spec, self.sink)
        self.stations = len(spec.plcs)

    def go(self, seconds: float) -> None:
        """Simulate so much more."""
        self.simulation.run(self.simulation.now + int(seconds * TICKS_PER_SECOND))

    def close(self) -> None:
        """Close its files."""
        if self._files is not None:
            self._files.close()

    @property
    def ends(self) -> int:
        """ENDs of all PLCs so far."""
        return sum(plc.scans for plc in self.simulation.totals().plcs)


def ratio(mark: str, rounds: int) -> float:
    """The speed of a mark's scenario, as a ratio to the lean loop's."""
    with tempfile.TemporaryDirectory() as folder:
        run, step, ratios = Run(mark, Path(folder)), float(_SLICE), []
        run.go(5)
        lean_loop(_LEAN_EVENTS)
        while len(ratios) < rounds:
            before, begun = run.sink.scans, time.process_time()
            run.go(step)
            taken = time.process_time() - begun
            exchanges = (run.sink.scans - before) * run.stations
            if taken < _LONG_ENOUGH:
                step *= 2
                continue
            ratios.append(lean_loop(_LEAN_EVENTS) / _LEAN_EVENTS * exchanges / taken)
    return statistics.median(ratios)


def python_calls(run: Run, seconds: float) -> int:
    """The calls of Python functions while so much is simulated."""
    calls = 0

    def count(_: object, event: str, __: object) -> None:
        nonlocal calls
        calls += event == "call"

    sys.setprofile(count)
    try:
        run.go(seconds)
    finally:
        sys.setprofile(None)
    return calls


def calls() -> dict[str, float]:
    """Python calls: of a link scan, traced or not, an exchange through the engines, an END, a transaction."""
    found = {}
    for what, mark, seconds in (
        ("link scan", "W", 60),
        ("traced link scan", "trace", 60),
        ("exchange", "replies at END", 5),
        ("END", "programs", 2),
        ("transaction", "four ports", 5),
    ):
        with tempfile.TemporaryDirectory() as folder:
            run = Run(mark, Path(folder))
            run.go(3)
            before = run.sink.scans, run.ends, run.sink.transactions
            made = python_calls(run, seconds)
            scans, ends, transactions = (
                run.sink.scans - before[0],
                run.ends - before[1],
                run.sink.transactions - before[2],
            )
            run.close()
        number = {
            "link scan": scans,
            "traced link scan": scans,
            "exchange": scans * run.stations,
            "END": ends,
            "transaction": transactions,
        }
        found[what] = made / number[what]
    return found


def processor_time(*command: str) -> float:
    """The processor seconds of a process and its children."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, *command], check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def child(mark: str, seconds: int) -> None:
    """Simulate without trace and rows; print processor seconds and this process's largest memory in MB."""
    run = Run(mark, Path())
    run.go(seconds)
    run.simulation.totals()
    print(time.process_time(), largest_memory())


def largest_memory() -> float:
    """This process's largest memory so far, in MB."""
    status = Path("/proc/self/status")
    if status.exists():  # on Linux ru_maxrss is at least what the process had that started this one
        return int(re.findall(r"VmHWM:\s*(\d+) kB", status.read_text())[0]) / 1024
    largest = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return largest / (1024 * 1024 if sys.platform == "darwin" else 1024)


def process(mark: str, seconds: int) -> tuple[float, float]:
    """Processor seconds and peak memory (MB) of a process of its own that simulates so long."""
    command = [sys.executable, __file__, "--child", mark, str(seconds)]
    spent, largest = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    return float(spent), float(largest)


def whole_processes() -> dict[str, float]:
    """Seconds of whole processes, the cost curve and peak memory."""
    found = {"bare Python (s)": processor_time("-c", "pass")}
    with tempfile.TemporaryDirectory() as folder:
        # As it is where it is installed: compiled, whatever this environment says.
        os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
        os.environ["PYTHONPYCACHEPREFIX"] = f"{folder}/compiled"
        processor_time("-m", "bussim", "run", "press_line", "--duration", "1s", "--out", f"{folder}/a")
        for name, more in (("", ()), (" --no-plots", ("--no-plots",))):
            command = [
                *["-m", "bussim", "run", "press_line", "--duration", "1s", "--force", "--out"],
                f"{folder}/a",
            ]
            over = statistics.median(processor_time(*command, *more) for _ in range(3))
            found[f"bussim run of one second{name}, over bare Python (s)"] = over - found["bare Python (s)"]
        path = Path(folder) / "w.yaml"
        path.write_text(TEXTS["W"], encoding="utf-8")
        for workers in (1, 2):
            begun = time.monotonic()
            command = (
                f"-m bussim sweep {path} --vary seed=1:1000:1 --duration 5s --workers {workers} --out".split()
            )
            processor_time(*command, f"{folder}/s{workers}")
            found[f"sweep of 1,000 runs of 5 s, {workers} workers (s, by the clock)"] = (
                time.monotonic() - begun
            )
    for mark, seconds, name in (
        *(
            ("W", seconds, name)
            for seconds, name in ((60, "a minute"), (3600, "an hour"), (36000, "ten hours"))
        ),
        ("W", 360_000, "a hundred hours"),
        ("two stations", 3600, "an hour"),
        ("programs", 3600, "an hour"),
    ):
        found[f"{name} of {mark} (s)"], found[f"{name} of {mark} (MB)"] = process(mark, seconds)
    return found


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--quick", action="store_true", help="few rounds, no whole processes")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("--record", action="store_true", help=f"keep calls and ratios in {RECORDED.name}")
    parser.add_argument(
        "--only", nargs="+", choices=MARKS, metavar="MARK", help=f"some of {', '.join(MARKS)}"
    )
    parser.add_argument("--child", nargs=2, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.child:
        child(given.child[0], int(given.child[1]))
        return
    rounds = 3 if given.quick else 5
    found: dict[str, Any] = {"ratios": {mark: round(ratio(mark, rounds), 4) for mark in given.only or MARKS}}
    if not given.only:
        found["calls"] = {what: round(number, 1) for what, number in calls().items()}
        if not given.quick:
            found["processes"] = {name: round(value, 2) for name, value in whole_processes().items()}
    recorded = json.loads(RECORDED.read_text("utf-8")) if RECORDED.exists() else {}
    if given.record:
        kept = {**recorded, **{key: found[key] for key in ("ratios", "calls")}}
        RECORDED.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    if given.json:
        print(json.dumps(found, indent=1))
        return
    for part, values in found.items():
        for name, value in values.items():
            wanted = f", mark {MARKS[name]}" if part == "ratios" else ""
            was = recorded.get(part, {}).get(name)
            print(f"{part:9} {name}: {value:g}{wanted}{'' if was is None else f', recorded {was:g}'}")


if __name__ == "__main__":
    os.environ.setdefault("PYTHONPATH", str(Path(__file__).parents[2]))
    main()

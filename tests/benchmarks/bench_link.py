"""How fast a link is simulated, as a ratio to a bare SimPy loop, and what memory a run takes.

    python tests/benchmarks/bench_link.py              # speed
    python tests/benchmarks/bench_link.py --memory     # also memory: 1 minute against 1 hour
    python tests/benchmarks/bench_link.py --long       # also memory: 1 minute against 10 hours

Eight stations in mode 2, one reply in a thousand lost, no trace and no rows, shared words that change
once a second. The bare loop does the same number of exchanges (a poll with its reply, or the master's
data frame: eight a link scan) in the same process: one re-armed event each, a random draw, nothing
else. Both run in short slices that take turns, so that whatever else the machine does hits both alike;
the result is the median of the slices' ratios. Nothing is asserted: a time is no test's verdict.
"""

from __future__ import annotations

import argparse
import random
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import simpy

sys.path.insert(0, str(Path(__file__).parents[2]))

from bussim.line.characters import NN_LINE
from bussim.line.protocols import BusProtocol
from bussim.plc.profiles import PROFILES
from bussim.plc.sources import Counter
from bussim.results.collector import Collector
from bussim.scenario import model
from bussim.sim.runner import Simulation
from bussim.trace.records import Record, ScanRecord
from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND

STATIONS = 8
MINUTE, HOUR = 60, 3600
_BARE_TIMES = 20  # the bare loop runs so many times as many exchanges in a slice


class Silent:
    """A sink that only counts link scans."""

    traced = False

    def __init__(self) -> None:
        self.scans = 0

    def take(self, record: Record) -> None:
        self.scans += isinstance(record, ScanRecord)

    def failed(self, bus: str, tick: int, station: int, code: int) -> None:
        """Not wanted."""

    def refreshed(self, bus: str, source: int, tick: int, heard: Sequence[int] | None) -> None:
        """Not wanted."""

    def switched(self, bus: str, position: int, tick: int, fresh: int | None) -> None:
        """Not wanted."""

    def irregular(self, bus: str, node: str, tick: int, what: str) -> None:
        """Not wanted."""


class Summing(Collector):
    """What a run without trace and rows keeps, and a count of link scans."""

    def __init__(self) -> None:
        super().__init__(traced=False)
        self.scans = 0

    def take(self, record: Record) -> None:
        super().take(record)
        self.scans += isinstance(record, ScanRecord)


def scenario(seconds: int, *, changing: bool = False) -> model.Scenario:
    """The link that is measured; ``changing``: every block changes once a second."""
    profile = PROFILES["pw10"]
    plcs = []
    for station in range(STATIONS):
        registers = {"D8176": station, "M8179": 1}
        if station == 0:
            registers |= {"D8177": STATIONS - 1, "D8178": 2, "D8179": 3, "D8180": 10}
        plcs.append(
            model.Plc(
                f"plc{station}",
                profile,
                model.Scan(8 * TICKS_PER_MS, TICKS_PER_MS),
                model.LinkAttachment("link", "COM4"),
                registers,
                {f"D{profile.word_spacing * station}": Counter(TICKS_PER_SECOND)} if changing else {},
            )
        )
    loss = model.Noise("loss", model.Target("link"), model.ReplyLoss(1e-3))
    bus = model.Bus("link", BusProtocol.NN, NN_LINE)
    return model.Scenario("benchmark", seconds * TICKS_PER_SECOND, 1, (bus,), tuple(plcs), (loss,))


class Bare:
    """The bare loop: one event that is armed again for each exchange."""

    def __init__(self) -> None:
        self._env = env = simpy.Environment()
        self._event = event = simpy.Event(env)
        event._ok = True
        event._value = None
        self._callbacks: list[Callable[[simpy.Event], None]] = [self._exchange]
        self._draw = random.Random(1).random
        self._left = 0

    def _exchange(self, event: simpy.Event) -> None:
        event.callbacks = self._callbacks
        self._left -= 1
        if self._left:
            self._env.schedule(event, delay=int(1000 + self._draw() * 100))

    def run(self, exchanges: int) -> None:
        """Do so many exchanges."""
        self._left = exchanges
        self._event.callbacks = self._callbacks
        self._env.schedule(self._event, delay=1)
        self._env.run()


def speed(sink: Silent | Summing, rounds: int, *, changing: bool) -> tuple[float, float, float]:
    """Link scans per second, times real time, and the ratio to the bare loop."""
    simulation, bare = Simulation(scenario(24 * HOUR, changing=changing), sink), Bare()
    step = 10 * TICKS_PER_SECOND
    simulation.run(step)
    bare.run(1000)
    rates, times, ratios = [], [], []
    for _ in range(rounds):
        # Processor time: other processes on the machine do not count. Both slices last about as long.
        before, begun = sink.scans, time.process_time()
        simulation.run(simulation.now + step)
        link = time.process_time() - begun
        scans = sink.scans - before
        begun = time.process_time()
        bare.run(scans * STATIONS * _BARE_TIMES)
        alone = (time.process_time() - begun) / _BARE_TIMES
        rates.append(scans / link)
        times.append(step / TICKS_PER_SECOND / link)
        ratios.append(alone / link)
    return statistics.median(rates), statistics.median(times), statistics.median(ratios)


def peak(seconds: int) -> float:
    """The largest memory, in MB, of a process of its own that simulates so long."""
    done = subprocess.run(
        [sys.executable, __file__, "--child", str(seconds)], capture_output=True, text=True, check=True
    )
    return float(done.stdout)


def child(seconds: int) -> None:
    """Simulate without trace and rows, and print this process's largest memory in MB."""
    import resource

    simulation = Simulation(scenario(seconds), Collector(traced=False))
    simulation.run(seconds * TICKS_PER_SECOND)
    simulation.totals()
    largest = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(largest / (1024 * 1024 if sys.platform == "darwin" else 1024))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--rounds", type=int, default=30, help="slices of 10 simulated seconds (30)")
    parser.add_argument("--memory", action="store_true", help="memory of 1 minute against 1 hour")
    parser.add_argument("--long", action="store_true", help="memory of 1 minute against 10 hours")
    parser.add_argument("--child", type=int, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.child:
        child(arguments.child)
        return
    for name, sink, changing in (
        ("records thrown away", Silent(), False),
        ("records summed up", Summing(), False),
        ("the same, every block changing once a second", Summing(), True),
    ):
        rate, times, ratio = speed(sink, arguments.rounds, changing=changing)
        print(f"{name}: {rate:,.0f} link scans a second, {times:,.0f} times real time, ratio {ratio:.3f}")
    if arguments.memory or arguments.long:
        hours = 10 if arguments.long else 1
        text = f"peak memory: {peak(MINUTE):.1f} MB for 1 minute, {peak(hours * HOUR):.1f} MB for {hours} h"
        print(text)


if __name__ == "__main__":
    main()

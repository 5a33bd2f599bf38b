"""How fast Modbus ports are simulated: times real time, and as a ratio to a bare SimPy loop.

    python tests/benchmarks/bench_ports.py

Four PLCs on an N:N link, each with a Modbus master on a bus of its own (9600 8N1) that polls two
devices, without a pause, every 200 ms and every second; no trace and no rows. The bare loop does as many re-armed events, each with a
random draw, as there are transactions and exchanges of the link, in the same process and in slices
that take turns. Nothing is asserted: a time is no test's verdict.
"""

from __future__ import annotations

import random
import statistics
import sys
import time
from pathlib import Path

import simpy

sys.path.insert(0, str(Path(__file__).parents[2]))

from bussim.results.collector import Collector
from bussim.scenario.loader import loads
from bussim.sim.runner import Simulation
from bussim.trace.records import Record, ScanRecord, TransactionRecord
from bussim.units import TICKS_PER_SECOND

PORTS = 4
SLICES, SECONDS = 8, 30
_BARE_TIMES = 20


class Counting(Collector):
    """What a run keeps, and a count of transactions and link scans."""

    def __init__(self) -> None:
        super().__init__(traced=False)
        self.transactions = self.scans = 0

    def take(self, record: Record) -> None:
        super().take(record)
        self.transactions += isinstance(record, TransactionRecord)
        self.scans += isinstance(record, ScanRecord)


def scenario(every: str) -> str:
    """The scenario that is measured; ``every`` is the period of each poll, "" for none."""
    period = f", every: {every}" if every else ""
    lines = ["schema: 1", "name: four ports", f"duration: {SLICES * SECONDS} s", "buses:"]
    lines += ["  - {name: link, nn: true}", *(f"  - {{name: bus{n}}}" for n in range(PORTS)), "plcs:"]
    for n in range(PORTS):
        master = f", slaves: {PORTS - 1}, mode: 2, retries: 3" if n == 0 else ""
        lines += [
            f"  - name: plc{n}",
            "    scan: {mean: 8 ms, jitter: 1 ms}",
            f"    nn: {{bus: link, port: COM4, station: {n}{master}}}",
            f"    ports: {{COM3: {{bus: bus{n}, protocol: modbus-rtu-master}}}}",
            "    polls:",
            f"      - {{port: COM3, station: 1, function: 3, address: 0, count: 4, to: D{400 + n}{period}}}",
            f"      - {{port: COM3, station: 2, function: 3, address: 0, count: 2, to: D{500 + n}{period}}}",
        ]
    lines.append("devices:")
    for n in range(PORTS):
        lines += [
            f"  - {{name: drive{n}, model: stepper, bus: bus{n}, station: 1}}",
            f"  - {{name: meter{n}, model: v80, bus: bus{n}, station: 2}}",
        ]
    return "\n".join(lines)


def bare(events: int) -> float:
    """Processor seconds of a bare loop of one re-armed event for each of so many events."""
    env = simpy.Environment()
    rng = random.Random(1)
    left = [events]

    def again(event: simpy.Event) -> None:
        left[0] -= 1
        if left[0]:
            event.callbacks = [again]
            env.schedule(event, delay=1 + int(rng.random() * 100))

    event = env.event()
    event._ok, event._value = True, None
    event.callbacks = [again]
    env.schedule(event, delay=1)
    begun = time.process_time()
    env.run()
    return time.process_time() - begun


def main() -> None:
    """Measure and print."""
    for every in ("", "200 ms", "1 s"):
        measure(every)


def measure(every: str) -> None:
    """Measure and print one period."""
    counter = Counting()
    simulation = Simulation(loads(scenario(every)), counter)
    ratios, rates = [], []
    done = 0
    for number in range(1, SLICES + 1):
        begun = time.process_time()
        simulation.run(number * SECONDS * TICKS_PER_SECOND)
        spent = time.process_time() - begun
        exchanges = counter.transactions + PORTS * counter.scans
        fresh, done = exchanges - done, exchanges
        ratios.append(bare(_BARE_TIMES * fresh) / _BARE_TIMES / spent)
        rates.append(SECONDS / spent)
    print(
        f"polls {'every ' + every if every else 'without a pause'}: "
        f"{counter.transactions / SLICES / SECONDS:.0f} transactions a simulated second on {PORTS} ports "
        f"beside a link, {statistics.median(rates):.0f} times real time, "
        f"ratio {statistics.median(ratios):.3f}"
    )


if __name__ == "__main__":
    main()

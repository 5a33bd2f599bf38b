"""What a program's scan costs, as a multiple of a bare SimPy event and of a PLC's scan without program.

    python tests/benchmarks/bench_program.py              # programs of 200 instructions
    python tests/benchmarks/bench_program.py --rounds 50

Also what it costs a whole simulation: a link of a master and a slave, 8 ms scans, the same with the program in
both. Without a program its ENDs are looked up and mostly never carried out; with a device that is
observed they are, as they are with a program.

The bare loop re-arms one SimPy event with a random draw (see bench_speed.py): what an END costs at the
least. "With SimPy": the same loop calls a scan at each event, which is how a simulation carries a
program out. Both run in slices that take turns in one process; the result is the median of the slices'
ratios. Nothing is asserted: a time is no test's verdict.
"""

from __future__ import annotations

import argparse
import random
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path

import simpy

sys.path.insert(0, str(Path(__file__).parents[2]))

from bussim.line.characters import NN_LINE
from bussim.line.protocols import BusProtocol
from bussim.plc.inputs import Square
from bussim.plc.memory import Device, Memory
from bussim.plc.profiles import PROFILES
from bussim.plc.program.execution import ProgramRun
from bussim.plc.program.program import Program
from bussim.results.collector import Collector
from bussim.scenario import model
from bussim.sim.runner import simulate
from bussim.trace.records import DeviceValueRecord, Record
from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND

INSTRUCTIONS = 200
SCANS = 2000


def contacts_and_coils() -> list[str]:
    """Rungs of three contacts and a coil, as most of a machine's program is."""
    lines: list[str] = []
    while len(lines) < INSTRUCTIONS - 1:
        n = len(lines)
        lines += [f"LD X{n % 16:o}", f"ANI M{n}", f"OR M{n + 1}", f"OUT M{n + 1}"]
    return [*lines[: INSTRUCTIONS - 1 - (INSTRUCTIONS - 1) % 4], "END"]


def mixed() -> list[str]:
    """A machine's program: interlocks, branches, timers, counters, words that are moved and compared."""
    block = [
        "",
        "        LD X0",
        "        ORP X1",
        "        ANI X2",
        "        OUT M10",
        "        LD M10",
        "        MPS",
        "        AND X3",
        "        OUT Y0",
        "        MRD",
        "        ANI X4",
        "        OUT T0 K15",
        "        MPP",
        "        SET M20",
        "        LD T0",
        "        RST M20",
        "        OUT Y1",
        "        LD X5",
        "        OUT C0 K10",
        "        LD C0",
        "        AND M10",
        "        RST C0",
        "        LD M8000",
        "        MOV K1X0 K1M100",
        "        MOV D0 D10",
        "        LD> D10 K100",
        "        AND X6",
        "        INC D20",
        "        LDP X7",
        "        ADD D20 D21 D22",
        "        LD M20",
        "        OR Y2",
        "        LD X10",
        "        ORI X11",
        "        ANB",
        "        OUT Y2",
        "        LD M8000",
        "        CMP D0 D1 M30",
        "        LD M30",
        "        OUT Y3",
        "        LD M31",
        "        OUT Y4",
        "    ",
    ]
    block = [line.strip() for line in block if line.strip()]
    lines = block * (INSTRUCTIONS // len(block) + 1)
    while lines[INSTRUCTIONS - 2].split()[0] not in ("OUT", "SET", "RST"):
        lines.insert(0, "NOP")
    return [*lines[: INSTRUCTIONS - 1], "END"]


def words() -> list[str]:
    """Words only, all of them carried out in every scan: the dearest program there is."""
    lines = ["LD M8000"]
    while len(lines) < INSTRUCTIONS - 1:
        n = len(lines)
        lines += [f"MOV D{n} D{n + 1}", f"ADD D{n} K3 D{n + 2}", f"WAND D{n} HFF D{n + 3}", f"INC D{n + 4}"]
    return [*lines[: INSTRUCTIONS - 1], "END"]


class Loop:
    """One event that is armed again, and what is done at it."""

    def __init__(self, work: Callable[[int], object] | None) -> None:
        self._env = env = simpy.Environment()
        self._event = event = simpy.Event(env)
        event._ok = True
        event._value = None
        self._callbacks: list[Callable[[simpy.Event], None]] = [self._end]
        self._draw = random.Random(1).random
        self._left = 0
        self._work = work

    def _end(self, event: simpy.Event) -> None:
        event.callbacks = self._callbacks
        if self._work is not None:
            self._work(self._env.now)
        self._left -= 1
        if self._left:
            self._env.schedule(event, delay=int(8 * TICKS_PER_MS + self._draw() * TICKS_PER_MS))

    def run(self, count: int) -> float:
        """So many events; returns the processor time of one in µs."""
        begun = time.process_time()
        self._left = count
        self._event.callbacks = self._callbacks
        self._env.schedule(self._event, delay=1)
        self._env.run()
        return (time.process_time() - begun) / count * 1e6


def measure(lines: list[str], rounds: int) -> tuple[float, float, float]:
    """µs of a bare event, µs of a scan with SimPy, median ratio of the two."""
    memory = Memory()
    run = ProgramRun(Program.parse("\n".join(lines), "benchmark"), memory)
    run.run(0)
    rng = random.Random(2)

    def scan(now: int) -> None:
        memory.set(Device("X", rng.getrandbits(4)), rng.getrandbits(1))
        run.scan(now)

    bare, full = Loop(None), Loop(scan)
    alone, with_program, ratios = [], [], []
    for _ in range(rounds):
        alone.append(bare.run(SCANS * 10))
        with_program.append(full.run(SCANS))
        ratios.append(with_program[-1] / alone[-1])
    return statistics.median(alone), statistics.median(with_program), statistics.median(ratios)


class Unrecorded(Collector):
    """A sink that keeps next to nothing."""

    def take(self, record: Record) -> None:
        if not isinstance(record, DeviceValueRecord):
            super().take(record)


def simulation(program: Program | None, *, observed: bool) -> Callable[[], float]:
    """The processor time, in ms, that ten seconds of a small link take."""
    plcs = tuple(
        model.Plc(
            f"p{station}",
            PROFILES["pw10"],
            model.Scan(8 * TICKS_PER_MS, TICKS_PER_MS),
            model.LinkAttachment("link", "COM4"),
            registers={"D8176": station, "D8177": 1, "D8178": 2, "M8179": 1},
            program=program,
            inputs={f"X{n}": Square((300 + 70 * n) * TICKS_PER_MS) for n in range(4)} if program else {},
            observed=("M3000",) if observed else (),
        )
        for station in (0, 1)
    )
    bus = model.Bus("link", BusProtocol.NN, NN_LINE)
    scenario = model.Scenario("bench", 10 * TICKS_PER_SECOND, 1, (bus,), plcs)

    def run() -> float:
        begun = time.process_time()
        simulate(scenario, Unrecorded())
        return (time.process_time() - begun) * 1e3

    return run


def compare(lines: list[str], rounds: int) -> str:
    """What a simulation takes without a program, with its ENDs carried out, and with the program."""
    program = Program.parse("\n".join(lines), "benchmark")
    kinds = [
        simulation(None, observed=False),
        simulation(None, observed=True),
        simulation(program, observed=False),
    ]
    times = [[kind() for kind in kinds] for _ in range(max(3, rounds // 4))]
    bare, ends, full = (statistics.median(column) for column in zip(*times, strict=True))
    return (
        f"ten simulated seconds of a link of two: {bare:.0f} ms without program, {ends:.0f} ms with every END "
        f"carried out, {full:.0f} ms with the program: {full / ends:.1f} times, {full / bare:.1f} times"
    )


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--rounds", type=int, default=20, help="slices of 2000 scans (20)")
    arguments = parser.parse_args()
    for name, make in (("contacts and coils", contacts_and_coils), ("mixed", mixed), ("words", words)):
        lines = make()
        alone, scan, ratio = measure(lines, arguments.rounds)
        print(
            f"{name}: {len(lines)} instructions, bare event {alone:.2f} µs, event with scan {scan:.1f} µs "
            f"({(scan - alone) / len(lines):.3f} µs an instruction), ratio {ratio:.1f}"
        )
        print("  " + compare(lines, arguments.rounds))


if __name__ == "__main__":
    main()

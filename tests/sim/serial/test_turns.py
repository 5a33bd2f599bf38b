"""Many turns of a poll list at once: everything is as if each END and transaction was done by itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import cycle
from pathlib import Path
from random import Random

import pytest

import bussim
from bussim.engines.modbus.gaps import GapRule
from bussim.plc.memory import Device
from bussim.plc.sources import Counter
from bussim.scenario import model
from bussim.scenario.loader import loads
from bussim.sim.runner import Simulation
from bussim.sim.serial.turn_path import TurnPath
from tests.benchmarks.speed_scenarios import TEXTS
from tests.benchmarks.speed_scenarios import scenario as speed
from tests.selection import quick
from tests.sim import ladders
from tests.sim.build import MS, SECOND, Done, run, started
from tests.sim.serial import test_transactions as transactions
from tests.sim.test_rest import compare, left, one_by_one

SECONDS = 12


def scenario(seed: int) -> model.Scenario:
    """Random polls of random slaves that nearly all read, into places that are nearly all apart."""
    number, rng = seed * 1000, Random(seed)
    while not (made := transactions.scenario(number)).plcs or not any(plc.polls for plc in made.plcs):
        number += 1

    def reading(poll: model.PollSpec | model.FreeSpec) -> model.PollSpec | model.FreeSpec:
        if not isinstance(poll, model.PollSpec) or rng.random() < 0.05:
            return poll
        count = rng.choice([1, 2, 5, 10])
        device = rng.choice(
            [None, Device("D", 400), Device("D", 402), Device("D", rng.choice([7, 7900, 8210]))]
        )
        return replace(
            poll, function=3, count=count, values=(), device=device, every=rng.choice([0, poll.every])
        )

    plcs = [replace(plc, polls=tuple(reading(poll) for poll in plc.polls)) for plc in made.plcs]
    if rng.random() < 0.2:
        sources = {f"D{rng.choice([20, 404])}": Counter(rng.randint(20, 900) * MS)}
        plcs = [replace(plc, sources=sources) for plc in plcs]
    faults = made.faults[: rng.choice([0, 0, 1, 2])]
    noise = made.noise if rng.random() < 0.3 else ()
    return replace(made, plcs=tuple(plcs), faults=faults, noise=noise, duration=SECONDS * SECOND)


@pytest.fixture
def passed(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """Whether turns were done at once, by END."""
    found: list[bool] = []
    original = TurnPath.pass_turns

    def counted(self: TurnPath, now: int) -> bool:
        found.append(original(self, now))
        return found[-1]

    monkeypatch.setattr(TurnPath, "pass_turns", counted)
    return found


@pytest.mark.parametrize("seed", quick(10, range(400)))
def test_random_polls(seed: int) -> None:
    compare(scenario(seed), traced=False)


@pytest.mark.slow
def test_many_of_them_do_turns_at_once(passed: list[bool]) -> None:
    with_some = 0
    for seed in range(60):
        passed.clear()
        run(scenario(seed), traced=False)
        with_some += any(passed)
    assert with_some > 15


def compare_in_slices(made: model.Scenario, slices: Sequence[int]) -> None:
    """A run that is looked at between slices of so many ticks is the same as one that is not."""
    simulation, record = started(made, traced=False)
    for length in cycle(slices):
        simulation.run(min(made.duration, simulation.now + length))
        if length % 3 == 0:
            simulation.totals()
        if simulation.now == made.duration:
            break
    with one_by_one():
        wanted = left(run(made, traced=False))
    found = left(Done(simulation, record, simulation.totals()))
    assert {key: value for key, value in found.items() if value != wanted[key]} == {}


@pytest.mark.parametrize("seed", quick(3, range(60)))
def test_a_run_may_be_looked_at_and_go_on(seed: int) -> None:
    made, rng = scenario(seed) if seed % 2 else ladders.with_ports(seed), Random(seed)
    compare_in_slices(
        made, [rng.choice([50_000, 5_000_000, 90_000_000]) + rng.randrange(9) for _ in range(50)]
    )


@pytest.mark.parametrize("seed", quick(2, range(80)))
def test_results_are_the_same(seed: int, tmp_path: Path) -> None:
    made = ladders.with_ports(seed)
    bussim.run(made, out=tmp_path / "a", rows=False)
    with one_by_one():
        bussim.run(made, out=tmp_path / "b", rows=False)
    folders = [{path.name: path.read_bytes() for path in (tmp_path / name).iterdir()} for name in "ab"]
    assert folders[0] == folders[1]


def test_four_ports_have_few_ends(passed: list[bool]) -> None:
    made = replace(speed("four ports"), duration=20 * SECOND)
    done = run(made, traced=False)
    assert len(done.record.transactions) > 790
    assert len(passed) < 40
    assert sum(passed) >= 4


@pytest.mark.parametrize("more", ["sources: {D404: {counter: 1 s}}", "inputs: {X0: {square: 300 ms}}"])
def test_what_looks_at_ends_is_shown_each(more: str, passed: list[bool]) -> None:
    text = TEXTS["four ports"].replace("  - name: plc0\n", f"  - name: plc0\n    {more}\n")
    text = text.replace("to: D400,", "to: D404,")
    made = replace(loads(text), duration=5 * SECOND)
    compare(made, traced=False)
    simulation: Simulation = run(made, traced=False).simulation
    assert passed.count(True) >= 3
    assert not simulation.plcs["plc0"].ports_apart or simulation.plcs["plc0"].every_end


WAITING = """\
schema: 1
name: gaps
duration: 6 s
buses: [{name: bus, baud: 9600}]
plcs:
  - name: press
    profile: pw10
    scan: 1 ms
    ports: {COM3: {bus: bus, protocol: modbus-rtu-master}}
    polls:
      - {port: COM3, station: 1, function: 3, address: 0, count: 2, to: D400, every: 200 ms}
      - {port: COM3, station: 2, function: 3, address: 0, count: 2, to: D410, every: 200 ms}
devices:
  - {name: one, model: v80, bus: bus, station: 1}
  - {name: two, model: v80, bus: bus, station: 2}
"""


@pytest.mark.parametrize("gap", [Fraction(4), Fraction(7), Fraction(20)])
def test_who_waits_longer_for_silence_hears_what_it_would(gap: Fraction) -> None:
    made = loads(WAITING)
    one, two = (replace(device, delay=30 * MS) for device in made.devices)
    devices = (one, replace(two, gaps=GapRule(gap)))
    compare(replace(made, devices=devices), traced=False)


def test_replies_that_wait_for_end_follow_its_ports() -> None:
    text = TEXTS["four ports"].replace("profile: pw10", "profile: {base: pw10, reply: end}")
    compare_in_slices(replace(loads(text), duration=8 * SECOND), [410 * MS])


def test_a_poll_may_read_over_the_bits_of_its_port() -> None:
    text, _ = WAITING.split("  - {name: one")
    text = text.replace("station: 2", "station: 1").replace("count: 2, to: D400", "count: 8, to: M2920")
    text = text.replace("function: 3, address: 0, count: 8", "function: 1, address: 0, count: 8")
    items = "coils: [{address: 0, count: 8, value: 1}], registers: [{address: 0, count: 2}]"
    compare(loads(f"{text}  - {{name: one, model: map, bus: bus, station: 1, {items}}}\n"), traced=False)

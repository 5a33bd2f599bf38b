"""ENDs that would change nothing are left out: everything is as if every END had been carried out."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from random import Random
from typing import Any

import pytest

import bussim
from bussim.plc.logic import Logic
from bussim.plc.memory import BIT_RANGES
from bussim.plc.plc import Plc
from bussim.scenario import builtin, model
from bussim.scenario.loader import loads
from bussim.sim.nn.bus import LinkBus
from bussim.sim.runner import Simulation
from bussim.sim.serial.bus import SerialBus
from tests.selection import quick
from tests.sim import chance, ladders
from tests.sim.build import SECOND, Done, run


@contextmanager
def one_by_one() -> Iterator[None]:
    """Every END is carried out, every link scan by itself, and transactions frame by frame."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Simulation, "may_rest", False)
        patch.setattr(LinkBus, "in_blocks", False)
        patch.setattr(SerialBus, "at_once", False)
        yield


def left(done: Done) -> dict[str, Any]:
    """What a run leaves: all its records, totals and memories."""
    found = vars(done.record).copy()
    # Those of several sources come source by source from scans that were done at once.
    found["refreshes"] = sorted(found["refreshes"], key=lambda refresh: refresh[2])
    # So do those of several masters and polls.
    for kind, order in {"transactions": "end", "turns": "end", "cycles": "start"}.items():
        found[kind] = sorted(found[kind], key=lambda each, order=order: (each.master, getattr(each, order)))
    found["exchanges"] = sorted(found["exchanges"], key=lambda each: (each[1], each[3]))
    for name, plc in done.simulation.plcs.items():
        found[name] = [bytes(plc.memory.bits(letter)) for letter in BIT_RANGES]
        found[name] += [plc.memory.words(letter).tolist() for letter in "DRTCVZ"]
    return {**found, "totals": done.totals}


def compare(scenario: model.Scenario, *, traced: bool) -> None:
    found = left(run(scenario, traced=traced))
    with one_by_one():
        wanted = left(run(scenario, traced=traced))
    assert {key: value for key, value in found.items() if value != wanted[key]} == {}


def test_masters_that_wait_for_silence_from_one_tick_on_go_in_turn() -> None:
    """Two masters of one number, of which one hears a damaged frame: their next requests begin at one tick."""
    compare(chance.scenario(100164, 0.5), traced=True)


@pytest.mark.parametrize("seed", quick(12, range(300)))
def test_random_programs(seed: int) -> None:
    compare(ladders.scenario(seed), traced=seed % 3 == 0)


@pytest.mark.parametrize("seed", quick(12, range(300)))
def test_random_ports(seed: int) -> None:
    compare(ladders.with_ports(seed), traced=seed % 4 == 0)


def timed(seed: int) -> model.Scenario:
    """A random scenario with a latency between two of its PLCs, whose every END is told."""
    made, rng = ladders.scenario(seed), Random(seed)
    source, target = rng.choice(made.plcs), rng.choice(made.plcs)
    entry = model.Latency("timed", source.name, "X0", target.name, rng.choice(["M0", "Y0", "D410"]))
    plcs = [
        replace(plc, observed=(*plc.observed, *{"X0", entry.target} - {*plc.observed}))
        if plc in (source, target)
        else plc
        for plc in made.plcs
    ]
    return replace(made, plcs=tuple(plcs), latency=(entry,))


@pytest.mark.parametrize("seed", quick(8, range(300)))
def test_random_latencies(seed: int) -> None:
    compare(timed(seed), traced=seed % 4 == 0)


@pytest.mark.slow
@pytest.mark.parametrize("name", builtin.names())
def test_built_in(name: str, tmp_path: Path) -> None:
    scenario = bussim.load(name, ["duration=12 s"])
    folders = []
    for number in range(2):
        if number:
            with one_by_one():
                bussim.run(scenario, out=tmp_path / "b", trace=True)
        else:
            bussim.run(scenario, out=tmp_path / "a", trace=True)
        folders.append({path.name: path.read_bytes() for path in (tmp_path / "ab"[number]).iterdir()})
    assert folders[0] == folders[1]


def test_most_ends_of_a_latency_scan_no_program(monkeypatch: pytest.MonkeyPatch) -> None:
    scans = 0
    original = Logic.scan

    def counted(self: Logic, now: int) -> int:
        nonlocal scans
        scans += 1
        return original(self, now)

    monkeypatch.setattr(Logic, "scan", counted)
    done = run(replace(loads(builtin.read("interlock")), duration=10 * SECOND), traced=False)
    told = sum(map(len, done.record.all_ends.values()))
    assert told > 3000
    assert scans < 0.2 * told


def test_most_ends_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    carried_out = 0
    original = Plc.end

    def counted(self: Plc, now: int) -> dict[str, int]:
        nonlocal carried_out
        carried_out += 1
        return original(self, now)

    monkeypatch.setattr(Plc, "end", counted)
    ends = sum(
        plc.scans for seed in range(8) for plc in run(ladders.scenario(seed), traced=False).totals.plcs
    )
    assert carried_out < 0.7 * ends

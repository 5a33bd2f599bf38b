"""Every optimisation of the simulation against the plain calculation, over random scenarios.

The optimisations: ordinary link scans are done many at once; frames are heard whole where nothing disturbs
them, and damaged ones ahead of their time as far as they end nothing; a PLC's memory is only brought up to
date when it is read; nothing is recorded that is not needed. None of them may change a result.
"""

from __future__ import annotations

from collections import Counter
from functools import cache
from random import Random
from typing import Any

import pytest

from bussim.plc.memory import BIT_RANGES, WORD_RANGES
from bussim.scenario import fault_kinds
from bussim.sim.nn.bus import LinkBus
from bussim.sim.nn.link_port import LinkPort
from bussim.sim.wire.contract import Listeners
from bussim.trace.records import NoteRecord
from tests.selection import quick
from tests.sim import chance
from tests.sim.build import MS, TURNAROUND, Done, bus_of, data, fault, link, run, started, timeout

SEEDS = range(120)
SECONDS = 0.5


@cache
def ordinary(seed: int) -> Done:
    return run(chance.scenario(seed, SECONDS))


def _notes(done: Done) -> list[NoteRecord]:
    return done.record.notes


def _refreshes(done: Done) -> list[tuple[Any, ...]]:
    # Those of several sources come source by source from scans that were done at once.
    return sorted(done.record.refreshes, key=lambda refresh: refresh[2])


def _memories(done: Done) -> dict[str, Any]:
    return {
        name: (
            [bytes(plc.memory._bits[letter]) for letter in BIT_RANGES],
            [plc.memory._words[letter].tolist() for letter in WORD_RANGES],
        )
        for name, plc in done.simulation.plcs.items()
    }


def assert_same(one: Done, other: Done) -> None:
    assert other.record.scans == one.record.scans
    assert other.record.failures == one.record.failures
    assert _notes(other) == _notes(one)
    assert other.totals == one.totals
    assert _memories(other) == _memories(one)


def assert_same_trace(one: Done, other: Done) -> None:
    assert_same(one, other)
    assert other.record.frames == one.record.frames
    assert other.record.attempts == one.record.attempts
    assert _refreshes(other) == _refreshes(one)


@pytest.mark.parametrize("seed", quick(25, SEEDS))
def test_link_scans_at_once_are_what_they_are_one_by_one(seed: int) -> None:
    scenario = chance.scenario(seed, SECONDS)
    simulation, record = started(scenario)
    bus_of(simulation).in_blocks = False
    simulation.run(scenario.duration)
    assert_same_trace(ordinary(seed), Done(simulation, record, simulation.totals()))


@pytest.mark.parametrize("seed", quick(25, SEEDS))
def test_neither_a_trace_nor_looking_changes_anything(seed: int) -> None:
    scenario = chance.scenario(seed, SECONDS)
    simulation, record = started(scenario, traced=False)
    rng = Random(seed)
    now = 0
    while now < scenario.duration:
        now = min(scenario.duration, now + rng.choice([1, 1000, 100_000, rng.randint(1, 5_000_000)]))
        simulation.run(now)
        if rng.random() < 0.3:
            for plc in simulation.plcs.values():
                plc.sync(simulation.now)
        if rng.random() < 0.1:
            simulation.totals()
    other = Done(simulation, record, simulation.totals())
    assert_same(ordinary(seed), other)
    assert _refreshes(other) == _refreshes(ordinary(seed))
    assert other.record.frames == other.record.attempts == []


def _one_by_one(bus: LinkBus, sender: LinkPort) -> Listeners:
    """All nodes hear character by character."""
    hearers = [
        port
        for port in bus.ports
        if port is not sender and port.engine and not port.driving and bus.connected(port, sender)
    ]
    return (), tuple(hearers)


# A station that jabbers in the middle of a frame keeps the half that it had heard (or not) for later.
@pytest.mark.parametrize(
    "seed",
    quick(
        40,
        (
            seed
            for seed in SEEDS
            if not any(isinstance(fault.kind, fault_kinds.Jabber) for fault in chance.scenario(seed).faults)
        ),
    ),
)
def test_whole_frames_are_what_their_characters_are(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    scenario, one = chance.scenario(seed, SECONDS), ordinary(seed)
    monkeypatch.setattr(LinkBus, "listeners_of", _one_by_one)
    simulation, record = started(scenario)
    bus_of(simulation).in_blocks = False
    simulation.run(scenario.duration)
    other = Done(simulation, record, simulation.totals())
    assert_same(one, other)
    assert other.record.attempts == one.record.attempts
    # Frames of two masters may end at one tick.
    by_end = [sorted(done.record.frames, key=lambda f: (f.end, f.sender)) for done in (one, other)]
    assert by_end[0] == by_end[1]
    # Who heard what, and when: here each by himself.
    heard = []
    for done in (one, other):
        found: Counter[tuple[int, int, int]] = Counter()
        for _, source, tick, plc_names in done.record.refreshes:
            all_others = set(range(len(done.link.plc_names))) - {source}
            found.update(
                (source, tick, position) for position in (all_others if plc_names is None else plc_names)
            )
        heard.append(found)
    assert heard[0] == heard[1]


# Turnaround and data frame that end with the deadline of 50 ms, to the tick.
IN_TIME = timeout(5) - data(0) - TURNAROUND


@pytest.mark.parametrize("extra", [1, IN_TIME - 1, IN_TIME, IN_TIME + 1, timeout(5), 55 * MS])
@pytest.mark.parametrize("retries", [0, 2])
def test_a_reply_counts_up_to_its_deadline_in_every_mode(extra: int, retries: int) -> None:
    scenario = link(3, 0, retries=retries, seconds=1, faults=[fault(fault_kinds.Slow("p1", extra), 0.2, 0.5)])
    traced = run(scenario)
    assert_same(traced, run(scenario, traced=False))
    assert ((1, 1) in traced.codes) is (extra > IN_TIME)


@pytest.mark.slow
def test_the_random_scenarios_leave_nothing_out() -> None:
    runs = [ordinary(seed) for seed in SEEDS]
    codes = Counter(code for done in runs for _, code in done.codes.elements())
    assert set(codes) == {1, 2, 3, 4}
    noted = Counter(note.kind for done in runs for note in done.record.notes)
    stations = Counter(note.detail["code"] for done in runs for note in done.notes("station_error"))
    assert set(stations) >= {1, 2, 4, 0x11, 0x14, 0x21}
    assert {"recovered", "watchdog", "no_parameters", "healthy", "undetected", "refused"} <= set(noted)
    kinds = {type(fault.kind) for seed in SEEDS for fault in chance.scenario(seed).faults}
    assert kinds == set(fault_kinds.FaultKind.__args__)
    assert sum(done.link.collisions for done in runs) > 200
    assert sum(done.link.undetected for done in runs) > 3
    assert sum(any(frame.cut for frame in done.record.frames) for done in runs) > 5
    assert sum(done.link.frames for done in runs) > 5000

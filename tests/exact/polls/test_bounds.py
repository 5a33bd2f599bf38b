"""Poll lists at random: nothing that a run shows exceeds its bound, and the bounds are near what it shows."""

from __future__ import annotations

import random
from dataclasses import replace
from statistics import median

import pytest

import bussim
from bussim.exact.polls.metrics import PollFigures
from bussim.results.meters.ports import PortRecord
from bussim.scenario import fault_kinds, model
from tests.exact.polls.test_polling import ask, only, random_bus, station
from tests.selection import quick
from tests.sim.build import MS, SECOND, fault
from tests.sim.serial import MASTER, hmi, plc, poll, port, serial_bus

#: Lists that are tried, and what the median of maximum over bound must reach.
LISTS, NEAR = 400, 0.9


def random_list(seed: int) -> model.Scenario:
    """A random bus whose polls are due more often, some of them commands, beginning in any phase."""
    rng = random.Random(f"list {seed}")
    scenario = random_bus(1000 + seed)
    periods = rng.choice([[None], [20, 50, 1000], [30], [100, 400], [None, 0, 2000]])

    def changed(polls: tuple[object, ...]) -> tuple[object, ...]:
        found = []
        for number, given in enumerate(polls):
            every = rng.choice(periods)
            poll = given if every is None else replace(given, every=every * MS)  # type: ignore[type-var]
            if number and rng.random() < 0.3:
                at = rng.choice([0, 0, 1])
                due = {"at": at * SECOND, "every": rng.choice([0, 40, 900]) * MS, "times": 3}
                found.append(replace(poll, **due))  # type: ignore[type-var]
            else:
                found.append(poll)
        return tuple(found)

    devices = [
        replace(device, settings=replace(device.settings, polls=changed(device.settings.polls)))
        if hasattr(device.settings, "polls")
        else device
        for device in scenario.devices
    ]
    phases = [None, 0, 1, MS // 10, 3 * MS, 30 * MS]
    plcs = [
        replace(plc, polls=changed(plc.polls), phase=rng.choice(phases)) if plc.polls else plc
        for plc in scenario.plcs
    ]
    return replace(scenario, devices=tuple(devices), plcs=tuple(plcs))


def ran_of(scenario: model.Scenario) -> tuple[PollFigures, PortRecord]:
    """The figures of a scenario's one poll list, and what a run of it shows."""
    found = only(scenario)
    assert found.model.valid, found.model.obstacles
    (ran,) = (each for each in bussim.run(scenario, rows=False).record.ports.values() if each.polls)
    return found, ran


def near(scenario: model.Scenario) -> list[float]:
    """How near each age and cycle of a run comes to its bound, at most."""
    found, ran = ran_of(scenario)
    pairs = []
    if found.cycle is not None:
        longest = max(found.cycle.most, found.first or 0) + (found.command or 0)
        pairs.append((ran.cycles.maximum, longest))
        assert longest <= (found.worst or 0)
    for one in found.polls:
        ages = ran.polls.get(one.poll.name)
        if ages is not None and one.on_arrival is not None:
            pairs.append((ages.on_arrival.maximum, one.on_arrival))
            pairs.append((ages.before_refresh.maximum, one.before_refresh))
    seen = [(value, bound) for value, bound in pairs if value is not None and bound is not None]
    assert [pair for pair in seen if pair[0] > pair[1]] == []
    return [value / bound for value, bound in seen]


@pytest.mark.parametrize("part", quick(1, range(8)))
def test_no_run_exceeds_its_bounds(part: int) -> None:
    count = LISTS // 8 if part else 6
    ratios = [ratio for seed in range(count) for ratio in near(random_list(seed * 8 + part))]
    assert median(ratios) >= NEAR


def oldest(found: PollFigures, ran: PortRecord, name: str) -> tuple[float, float]:
    """The bound of a poll's data age, and the oldest data of the run, in ms."""
    (one,) = (each for each in found.polls if each.poll.name == name)
    return (one.before_refresh or 0) / MS, (ran.polls[name].before_refresh.maximum or 0) / MS


def test_the_age_where_a_turn_is_longer_than_its_period() -> None:
    # fast: a turn of 8 + 3.5 + 45 + 3.5 characters and the interval, 67.5 ms: due again long before.
    polls = (
        poll("fast", count=20, every=20 * MS),
        poll("slow", count=1, every=SECOND),
    )
    found, ran = ran_of(serial_bus([station(), hmi("panel", *polls, interval=5 * MS)], seconds=20))
    bound, seen = oldest(found, ran, "fast")
    assert bound == seen > 140


def test_all_commands_at_once_lengthen_cycles_and_ages() -> None:
    command = {"to": None, "function": 6, "count": 1, "values": (1,), "at": SECOND, "every": SECOND}
    polls = [
        ask("read", count=10),
        ask("start", times=3, **command),
        ask("speed", times=3, **{**command, "address": 1}),
        ask("read2", address=10, count=10, to="D420"),
    ]
    press = plc("press", port("COM3", MASTER), polls=polls, phase=8 * MS)
    found, ran = ran_of(serial_bus([station()], [press], seconds=5))
    assert found.cycle is not None
    assert found.command is not None
    assert ran.cycles.maximum == found.cycle.most + found.command
    assert found.worst is not None
    assert found.worst > found.cycle.most + found.command
    for name in ("read", "read2"):
        bound, seen = oldest(found, ran, name)
        assert bound == seen


@pytest.mark.parametrize(("phase", "least"), [(MS // 10, 229.2), (3 * MS, 229.2), (9 * MS, 219.2)])
def test_the_age_from_a_first_scan_that_is_shorter(phase: int, least: float) -> None:
    press = plc(
        "press", port("COM3", MASTER, timeout=10), polls=[ask(every=200 * MS, retries=1)], scan=10 * MS
    )
    short = replace(press, phase=phase)
    found, ran = ran_of(serial_bus([station(delay=8 * MS)], [short], seconds=20))
    bound, seen = oldest(found, ran, "a")
    assert least <= seen <= bound < seen + 20  # two scans
    # Two attempts, each eleven scans of 10.2 ms for 108.3 ms after a scan of 10 ms: nothing waits before.
    assert found.worst == pytest.approx(2 * (10 + 11 * 10.2) * MS)
    # 4.5 characters more, if at the end of the timeout something else arrives: twelve scans.
    assert found.disturbed == pytest.approx(2 * (10 + 12 * 10.2) * MS)


def test_the_first_cycle_may_be_longer() -> None:
    polls = [ask("a"), ask("b", at=2 * SECOND, to="D420")]
    press = replace(plc("press", port("COM3", MASTER), polls=polls), phase=30 * MS)
    found, ran = ran_of(serial_bus([station()], [press], seconds=20))
    assert found.cycle is not None
    assert found.first is not None
    assert found.cycle.most < (ran.cycles.maximum or 0) <= found.first


def test_three_slaves_dead_and_an_age_with_errors() -> None:
    slaves = [station(f"s{number}", number) for number in (1, 2, 3, 4)]
    polls = [
        ask(f"p{number}", number, retries=number - 1, to=f"D{400 + 10 * number}") for number in (1, 2, 3, 4)
    ]
    scenario = serial_bus(slaves, [plc("press", port("COM3", MASTER, timeout=10), polls=polls)], seconds=20)
    found = only(scenario)
    assert [dead.devices for dead in found.more_dead] == [
        ("s3", "s4"),
        ("s2", "s3", "s4"),
        ("s1", "s2", "s3", "s4"),
    ]
    off = replace(
        scenario, faults=tuple(fault(fault_kinds.PowerOff(name)) for name in found.more_dead[1].devices)
    )
    ran = bussim.run(off, rows=False).record.ports["press.COM3"]
    assert ran.cycles.maximum == found.more_dead[1].cycle.most
    # While the others are dead, what s1 says is older, but not more than at worst.
    (one, *_) = found.polls
    assert (
        (one.before_refresh or 0) < (ran.polls["p1"].before_refresh.maximum or 0) <= (one.worst_refresh or 0)
    )

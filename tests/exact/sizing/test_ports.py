"""Timeout, retries and interval of poll lists, against the simulation and sums by hand."""

from __future__ import annotations

import math
import random
from dataclasses import replace

import pytest

import bussim
from bussim.commands.size.verify_ports import verify_port, with_port_setting
from bussim.devices.contract import MasterSettings
from bussim.devices.lx.model import LxSettings
from bussim.exact.metrics import YEAR
from bussim.exact.polls.from_scenario import poll_lists
from bussim.exact.polls.metrics import poll_figures
from bussim.exact.sizing.goals import Goals
from bussim.exact.sizing.ports.setting import setting_of
from bussim.exact.sizing.ports.size import PortSizing, size_ports
from bussim.scenario import fault_kinds, model
from tests.exact.polls.test_polling import ask, random_bus, station
from tests.sim.build import MS, SECOND, fault
from tests.sim.serial import MASTER, device, hmi, plc, poll, port, serial_bus

NODE = "press.COM3"


def sized(scenario: model.Scenario, *goals: str) -> PortSizing:
    (found,) = size_ports(scenario, Goals().with_texts(goals)).values()
    return found


def meters(count: int = 4, scan: int = 25 * MS) -> model.Scenario:
    slaves = [station(f"s{number}", number) for number in range(1, count + 1)]
    polls = [ask(f"p{number}", number, to=f"D{400 + 10 * number}") for number in range(1, count + 1)]
    press = plc("press", port("COM3", MASTER), polls=polls, scan=scan)
    return serial_bus(slaves, [press], seconds=30)


def test_what_counts_is_the_end_after_the_timeout() -> None:
    # 8 characters and 20, 30 or 40 ms are two scans of 25.2 ms, with 50 and 60 ms three.
    scenario = meters(1)
    model_ = poll_lists(scenario, sized=True)[NODE]
    taken = [
        setting_of(model_, timeout * MS, 0, 5 * MS).figures.dead[0].cycle.most / MS
        for timeout in (20, 30, 40, 50, 60)
    ]
    assert taken == pytest.approx([25 + 50.4] * 3 + [25 + 75.6] * 2)
    # The response takes 12.5 characters, 13.0 ms: 20 ms is the least, 40 ms the top of its step.
    found = sized(scenario)
    assert found.least == 20 * MS
    assert found.recommended is not None
    assert found.recommended.timeout == 40 * MS
    assert "no more than one of 20 ms" in found.margin()


def test_failed_turns_are_those_of_independent_attempts() -> None:
    found = sized(meters(1))
    best = found.recommended
    assert best is not None
    # 17 characters of 10 bits at 1e-5 (the level bad); a cycle takes 25.2 × 1 and 25 ms.
    fails = 1 - (1 - 1e-5) ** 170
    a_year = 365 * 86400 / 0.0502
    assert best.errors == pytest.approx(a_year * fails**best.attempts, rel=1e-3)
    assert best.errors <= 1 < a_year * fails ** (best.attempts - 1)


def test_words_for_the_program_and_for_pymodbus() -> None:
    found = sized(meters(1))
    first, timeout, interval = found.mov_lines()
    assert first.startswith("LD M8002")
    assert timeout == "MOV K4 D7929  ; timeout: 40 ms"
    assert interval == "MOV K50 D7922  ; interval: 5 ms"
    # Its timeout counts from handing the request over: 8 characters more, 8.3 ms.
    assert "baudrate=9600, bytesize=8, parity='N', stopbits=1, timeout=0.049, retries=3" in found.pymodbus()
    form = found.to_json()
    assert form["recommended"]["timeout_ms"] == 40  # type: ignore[index]
    assert form["recommended"]["interval_ms"] == 5  # type: ignore[index]
    assert "4 attempts × 40 ms on 1 poll (p1): 160 ms when s1 is dead" in form["in_words"][0]  # type: ignore[index]


def test_an_interval_is_what_the_slaves_need() -> None:
    # At 115200 a V80 waits for 4.5 characters of its own; a panel that goes on sooner is not understood.
    polls = (poll("a"), poll("b", 2))
    scenario = serial_bus([station(), device("pump", "v80", 2), hmi("panel", *polls, interval=0)])
    best = sized(scenario).recommended
    assert best is not None
    assert best.interval == 5 * MS  # a port's default, unless a goal needs less
    faster = (best.cycle or 0) // MS
    best = sized(scenario, f"cycle<={faster}ms").recommended
    assert best is not None
    assert best.interval == 2 * MS  # 1.04 ms, in whole ms
    ran = bussim.run(with_port_setting(scenario, "panel", best.timeout, 0, best.interval), rows=False)
    assert ran.summary["devices"]["panel"]["timeouts"] == 0


def test_a_pause_that_is_there_on_purpose_is_kept() -> None:
    polls = (poll("a"), poll("b", 2))
    scenario = serial_bus([station(), device("pump", "v80", 2), hmi("panel", *polls, interval=100 * MS)])
    found = sized(scenario)
    assert found.recommended is not None
    assert found.recommended.interval == 100 * MS
    (remedy,) = (each for each in found.remedies if "interval" in each.text)
    assert remedy.text == "interval 5 ms instead of 100 ms, if nothing else needs that pause"
    assert remedy.setting.interval == 5 * MS
    assert (remedy.setting.dead or 0) < (found.recommended.dead or 0)
    # A goal that it stands in the way of ends it.
    best = sized(scenario, "cycle<=100ms").recommended
    assert best is not None
    assert best.interval == 5 * MS
    assert sized(serial_bus([station(), hmi("panel", poll("a"), interval=MS)])).remedies == ()


def test_goals_that_stand_against_each_other_and_what_helps() -> None:
    scenario = meters()
    found = sized(scenario, "dead<=400ms", "errors<=1/y")
    assert found.recommended is None
    (unmet,) = found.unmet
    assert unmet.goals == ("errors", "dead")
    assert "failed turns: at most 1 a year and a cycle of at most 400 ms on average" in unmet.text
    texts = " | ".join(unmet.helps)
    assert "skip_after_failure: 10" in texts
    assert " on average with one device dead instead of 400 ms" in texts
    for remedy in found.remedies:
        assert remedy.setting.errors <= 1 or "failed turns: at most" in remedy.text
        assert (remedy.setting.dead or 0) <= 400 * MS or "with one device dead instead of" in remedy.text
    # What is said of leaving turns out is what a run shows, whichever device is dead.
    (remedy,) = (each for each in found.remedies if "skip_after_failure" in each.text)
    best = remedy.setting
    press = scenario.plcs[0]
    polls = tuple(replace(each, skip_after_failure=10) for each in press.polls)  # type: ignore[call-arg]
    skipping = replace(scenario, plcs=(replace(press, polls=polls),))
    changed = with_port_setting(skipping, NODE, best.timeout, best.retries, best.interval)
    ran = bussim.run(replace(changed, faults=(fault(fault_kinds.PowerOff("s2")),)), rows=False)
    cycles = ran.record.ports[NODE].cycles
    # Of 10 n + 1 cycles n + 1 are long, not n.
    assert (cycles.mean or 0) <= (best.dead or 0) * 1.02 <= 400 * MS
    assert (cycles.maximum or 0) <= (best.dead_longest or 0)


def test_neighbouring_reads_become_one() -> None:
    polls = [ask("a", address=0, count=4), ask("b", address=4, count=4, to="D420"), ask("c", 2, to="D430")]
    slaves = [station(), station("oven", 2)]
    scenario = serial_bus(slaves, [plc("press", port("COM3", MASTER), polls=polls, scan=25 * MS)])
    found = sized(scenario, "cycle<=160ms")
    assert found.recommended is None
    (remedy,) = (each for each in found.remedies if each.text.startswith("one read for a, b"))
    assert remedy.text == "one read for a, b"
    assert remedy.setting.cycle is not None
    merged = [ask("a", address=0, count=8), ask("c", 2, to="D430")]
    scenario = serial_bus(
        slaves, [plc("press", port("COM3", MASTER), polls=merged, scan=25 * MS)], seconds=20
    )
    (figures,) = (poll_figures(each) for each in poll_lists(scenario).values())
    assert figures.cycle is not None
    assert figures.cycle.most == remedy.setting.cycle


def test_where_attempts_depend_on_each_other_the_table_has_no_figure() -> None:
    slow = station(delay=25 * MS, jitter=15 * MS)
    press = plc("press", port("COM3", MASTER, timeout=4), polls=[ask()], scan=3 * MS)
    found = sized(serial_bus([slow], [press]))
    assert found.recommended is not None
    assert found.recommended.timeout > 49 * MS  # 40 ms and 9 characters
    (late,) = {each.reason for each in found.table if each.timeout == 40 * MS}
    assert "a response of feeder that is too late can meet the next request" in late
    lx = device("feeder", "lx", settings=LxSettings(model.Scan(20 * MS, 3 * MS)))
    found = sized(serial_bus([lx], [press]))
    assert any("its wait for END goes on from attempt to attempt" in each.reason for each in found.table)


def test_what_cannot_be_sized_says_why() -> None:
    burst = model.Noise("storm", model.Target("bus"), model.Burst(SECOND, 20 * MS, 0, 1e-2))
    found = sized(replace(meters(), noise=(burst,)))
    assert not found.valid
    assert "storm comes and goes" in found.reasons[0]
    assert found.to_json()["recommended"] is None
    two = serial_bus([station(), hmi("one", poll("a")), hmi("two", poll("a"))])
    assert all("collide" in each.reasons[0] for each in size_ports(two, Goals()).values())


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10))
def test_the_recommended_setting_is_as_it_is_said(seed: int) -> None:
    scenario = random_bus(2000 + seed)
    (node, found), *_ = size_ports(scenario, Goals()).items()
    if found.recommended is None:
        assert found.reasons == ("it has commands only: nothing goes round",)
        return
    assert all(each.agrees for each in verify_port(scenario, node, found))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(30))
def test_the_recommended_setting_meets_all_goals_and_the_next_cheaper_one_does_not(seed: int) -> None:
    # So much noise that a turn with one retry less fails often enough to be seen.
    rng = random.Random(seed)
    noise = model.Noise("line", model.Target("bus"), model.BitErrors(3e-4))
    scenario = replace(random_bus(3000 + seed), noise=(noise,))
    (node, plain), *_ = size_ports(scenario, Goals(errors=math.inf)).items()
    first = plain.recommended
    if first is None:
        assert plain.reasons == ("it has commands only: nothing goes round",)
        return
    timeout, interval = first.timeout, first.interval
    retries = 1 + seed % 2
    cheaper, wanted = (setting_of(plain.model, timeout, each, interval) for each in (retries - 1, retries))
    goals = Goals(
        errors=math.sqrt(cheaper.errors * wanted.errors),
        cycle=None if wanted.cycle is None else round(wanted.cycle * 1.1),
        dead=None if wanted.dead is None else round(wanted.dead * rng.uniform(1.01, 1.5)),
        age=None if wanted.age is None else round(wanted.age * 1.05),
    )
    best = size_ports(scenario, goals)[node].recommended
    assert best is not None
    assert (best.timeout, best.retries, best.interval) == (timeout, retries, interval)
    for failing in ((), *((each,) for each in best.figures.dead)):
        devices = [device.partition(".")[0] for each in failing for device in each.devices]
        changed = with_port_setting(scenario, node, best.timeout, best.retries, best.interval)
        off = replace(changed, noise=(), faults=tuple(fault(fault_kinds.PowerOff(name)) for name in devices))
        ran = bussim.run(replace(off, duration=20 * SECOND), rows=False).record.ports[node]
        limit = goals.dead if failing else goals.cycle
        mean = ran.cycles.mean if failing else ran.cycles.maximum
        assert mean is None or limit is None or mean <= limit * (1.02 if failing else 1)
        if not failing:
            assert sum(each.transactions - each.ok for each in ran.polls.values()) == 0
            ages = [each.before_refresh.maximum for each in ran.polls.values()]
            assert max((age for age in ages if age is not None), default=0) <= (goals.age or 0)
    # As long as it takes to see 40 failed turns with one retry less: of so many the goal allows a few.
    duration = round(40 / cheaper.errors * YEAR)
    allowed = goals.errors * duration / YEAR
    assert allowed < 20
    seen = []
    for each in (cheaper, best):
        changed = with_port_setting(scenario, node, each.timeout, each.retries, each.interval)
        ran = bussim.run(replace(changed, duration=duration), rows=False).record.ports[node]
        seen.append(sum(poll.failed_turns for poll in ran.polls.values()))
    assert seen[1] <= allowed
    # Where polls with a period are among others, how often these have a turn is a bound that no run reaches.
    if len({poll.every > 0 for poll in plain.model.cyclic}) == 1:
        assert seen[0] > allowed


@pytest.mark.slow
def test_no_response_is_late_at_the_recommended_timeout() -> None:
    # A million transactions of slow and jittery slaves, and of one that responds at its END.
    total = 0
    for seed in range(8):
        rng = random.Random(seed)
        slaves = [
            station(f"s{n}", n, delay=rng.randint(0, 9) * MS, jitter=rng.randint(1, 9) * MS) for n in (1, 2)
        ]
        polls = tuple(poll(f"p{n}", n) for n in (1, 2))
        panel = hmi("panel", *polls, interval=0)
        scenario = serial_bus([*slaves, panel], seconds=1, seed=seed)
        best = sized(scenario).recommended
        assert best is not None
        assert isinstance(panel.settings, MasterSettings)
        changed = with_port_setting(scenario, "panel", best.timeout, 0, best.interval)
        ran = bussim.run(replace(changed, duration=4500 * SECOND), rows=False).summary["devices"]["panel"]
        assert ran["ok"] == ran["transactions"]
        total += ran["transactions"]
    assert total > 1_000_000

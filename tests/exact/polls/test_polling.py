"""Poll lists: the closed form against independent sums, and never beaten by the simulation."""

from __future__ import annotations

import math
import random
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bussim.exact.polls.master_timing import Direct, Scans, Span, exactly
from bussim.exact.polls.whole_scans import mean_whole_scans
from bussim.line.protocols import BusProtocol
from bussim.plc.profiles import PROFILES
from bussim.scenario import fault_kinds, model
from tests.exact.polls.poll_buses import (
    ask,
    figures,
    four_polls,
    only,
    random_bus,
    reasons,
    station,
    with_polls,
)
from tests.selection import quick
from tests.sim.build import MS, SECOND, Done, fault, run
from tests.sim.serial import MASTER, PLAIN, hmi, plc, poll, port, serial_bus

#: Standard deviations that a mean of a fixed seed may be off.
SIGMAS = 4.5


#: Random buses.
SEEDS = 40


EXTRA = PROFILES["pw10"].transaction_time


# -- whole scans, against scans drawn one by one ------------------------------------------------------


def walk(
    rng: random.Random, need: int, interval: int, scan: Span, execution: int, others: int
) -> tuple[int, int]:
    """What one transaction takes, END by END: from sending to taking over, and on to sending again."""
    at = 0
    while at < need:
        at += rng.randint(scan.least, scan.most) + execution + rng.randint(0, others)
    taken = at
    while at == taken or at < need + interval:
        at += rng.randint(scan.least, scan.most) + rng.randint(0, others)
    return taken, at


SCANS = st.tuples(st.integers(1, 30), st.integers(0, 12)).map(lambda pair: Span(pair[0], pair[0] + pair[1]))


@given(
    scan=SCANS,
    execution=st.integers(0, 5),
    others=st.integers(0, 5),
    interval=st.integers(0, 90),
    need=st.tuples(st.integers(1, 200), st.integers(0, 40)),
    seed=st.integers(0, 1 << 30),
)
def test_no_walk_leaves_the_bounds(
    scan: Span, execution: int, others: int, interval: int, need: tuple[int, int], seed: int
) -> None:
    rng = random.Random(seed)
    master_timing = Scans(scan, execution, others, interval)
    span = Span(need[0], need[0] + need[1])
    taken, gap, turn, after = (
        master_timing.taken(span),
        master_timing.gap(),
        master_timing.turn(span),
        master_timing.gap(span),
    )
    assert gap.least <= after.least <= after.most <= gap.most
    assert turn.least >= taken.least + gap.least or span.fixed
    assert turn.most <= taken.most + gap.most
    for _ in range(SEEDS):
        over, again = walk(rng, rng.randint(span.least, span.most), interval, scan, execution, others)
        assert taken.least <= over <= taken.most
        assert after.least <= again - over <= after.most
        assert turn.least <= again <= turn.most
        assert over - span.most <= master_timing.late


@given(
    scan=st.integers(1, 50),
    execution=st.integers(0, 9),
    interval=st.integers(0, 200),
    need=st.integers(1, 500),
)
def test_without_jitter_there_is_one_time_and_it_is_that(
    scan: int, execution: int, interval: int, need: int
) -> None:
    master_timing = Scans(exactly(scan), execution, 0, interval)
    taken, again = walk(random.Random(0), need, interval, exactly(scan), execution, 0)
    assert master_timing.taken(exactly(need)) == exactly(taken)
    assert master_timing.turn(exactly(need)) == exactly(again)
    assert master_timing.gap(exactly(need)) == exactly(again - taken)
    assert master_timing.mean(exactly(need)) == (taken, again - taken)


@pytest.mark.parametrize(
    ("need", "scan", "width"), [(25_000, 8_000, 2_000), (5_000, 8_000, 4_000), (90_000, 900, 500)]
)
def test_bounds_are_reached(need: int, scan: int, width: int) -> None:
    # Of all sequences of shortest and longest scans, and of one that hits the need exactly, some reach them.
    master_timing = Scans(Span(scan, scan + width), 0, 0, 0)
    found = master_timing.taken(exactly(need))
    fewest = -(-need // (scan + width))
    assert found.least == max(fewest * scan, need)
    before = (need - 1) // scan
    assert found.most == min(before * (scan + width), need - 1) + scan + width


# -- the mean -----------------------------------------------------------------------------------------


def uniform_sum_below(count: int, x: Fraction) -> Fraction:
    """P(U1 + … + Ucount < x), by the alternating sum, in fractions."""
    if count == 0:
        return Fraction(int(x > 0))
    if x >= count:
        return Fraction(1)
    terms = ((-1) ** k * math.comb(count, k) * (x - k) ** count for k in range(max(0, math.ceil(x))))
    return sum(terms, Fraction(0)) / math.factorial(count)


@pytest.mark.parametrize(
    ("need", "active", "width"),
    [(25 * MS, 7 * MS, 2 * MS), (90 * MS, 8 * MS, MS), (40 * MS, 5 * MS, 9 * MS), (3 * MS, 8 * MS, 2 * MS)],
)
def test_mean_scans_against_the_exact_sum(need: int, active: int, width: int) -> None:
    # E[K] is the sum over k of P(the first k scans are not enough).
    scans, k = Fraction(0), 0
    while k * active < need:
        scans += uniform_sum_below(k, Fraction(need - k * active, width)) if k else 1
        k += 1
    taken, gap = mean_whole_scans(need, 0, active, active, width, 0)
    assert taken == pytest.approx(float(scans * (active + Fraction(width, 2))), abs=width * 2e-4)
    assert gap == active + width / 2


@pytest.mark.parametrize(
    ("need", "spread", "active", "idle", "width", "interval"),
    [
        (25, 0, 7.2, 7, 2, 5),
        (25, 0, 7.2, 7, 2, 30),
        (44, 6, 5.2, 5, 4, 12),
        (44, 6, 5.2, 5, 0, 12),
        (10, 20, 2.2, 2, 0.1, 5),
        (60, 0.05, 1, 1, 3, 5),
        (60, 30, 9, 8, 1, 9),
    ],
)
def test_means_against_draws(
    need: float, spread: float, active: float, idle: float, width: float, interval: float
) -> None:
    rng, draws = np.random.default_rng(5), 200_000
    needed = need + spread * rng.random(draws)
    at = np.zeros(draws)
    taken = np.zeros(draws)
    while (open_ := at < needed).any():
        at = at + np.where(open_, active + width * rng.random(draws), 0)
    taken[:] = at
    at = at + idle + width * rng.random(draws)
    while (open_ := at < needed + interval).any():
        at = at + np.where(open_, idle + width * rng.random(draws), 0)
    ticks = [round(value * MS) for value in (need, spread, active, idle, width, interval)]
    means = mean_whole_scans(*ticks)
    for sample, mean in zip((taken, at - taken), means, strict=True):
        error = float(sample.std()) / math.sqrt(draws)
        assert abs(float(sample.mean()) - mean / MS) < SIGMAS * error + 2e-4


def good(done: Done, node: str, name: str) -> list[tuple[int, int, int, int]]:
    """(asked, replied, served, taken) of a poll's good transactions, from the second on."""
    return [
        (r.asked, r.answer_end, r.served, r.taken)
        for r in done.record.transactions
        if (r.master, r.poll, r.outcome) == (node, name, "ok")
        and None not in (r.asked, r.answer_end, r.served)
    ][1:]  # type: ignore[return-value]


@pytest.mark.parametrize("seed", quick(8, range(SEEDS)))
def test_nothing_simulated_leaves_the_bounds(seed: int) -> None:
    scenario = random_bus(seed)
    found = only(scenario)
    assert found.model.valid, found.model.obstacles
    done = run(scenario)
    node = found.model.node
    assert {r.outcome for r in done.record.transactions} == {"ok"}
    assert not any(r.mismatched for r in done.record.transactions)
    commands = found.command or 0
    cycles = [cycle.duration for cycle in done.record.cycles[1:]]
    if found.cycle is not None:
        assert len(cycles) > 5
        assert found.cycle.least <= min(cycles)
        assert max(cycles) <= found.cycle.most + commands
        assert found.worst is not None
        assert found.cycle.most <= found.worst
        if found.mean is not None:
            assert found.cycle.least <= found.mean <= found.cycle.most
            spread = float(np.std(cycles)) / math.sqrt(len(cycles))
            assert abs(float(np.mean(cycles)) - found.mean) <= SIGMAS * spread + 2 + found.mean * 1e-6
    for one in found.polls:
        rows = good(done, node, one.poll.name)
        for asked, replied, served, taken in rows:
            assert one.response.least <= replied - asked <= one.response.most
            sent = asked - one.poll.request
            assert one.transaction.least <= taken - sent <= one.transaction.most
            if one.on_arrival is not None:
                assert taken - served <= one.on_arrival
        if one.before_refresh is not None:
            ages = [after[3] - before[2] for before, after in pairwise(rows)]
            assert max(ages) <= one.before_refresh


def test_random_buses_are_of_every_kind() -> None:
    kinds = {
        (
            found.cycle is not None,
            found.mean is not None,
            bool(found.model.commands),
            type(found.model.master_timing),
        )
        for found in (only(random_bus(seed)) for seed in range(SEEDS))
    }
    assert len(kinds) > 6
    assert {kind[3] for kind in kinds} == {Direct, Scans}


def test_bounds_are_not_wide_where_they_need_not_be() -> None:
    # 8 + 3.5 + 9 + 3.5 characters at 9600 bps are 25 ms: four scans of 8.2 ms, and one of 8 ms between.
    press = plc("press", port("COM3", MASTER), polls=[ask()])
    found = only(serial_bus([station()], [press]))
    assert found.cycle == exactly(4 * (8 * MS + EXTRA) + 8 * MS)
    assert found.mean == found.cycle.least
    assert found.load == pytest.approx(2 * (17 * PLAIN.character / found.cycle.least,))
    done = run(serial_bus([station()], [press], seconds=3))
    assert {cycle.duration for cycle in done.record.cycles[1:]} == {found.cycle.least}


@pytest.mark.slow
def test_the_bus_load_is_that_of_the_wire() -> None:
    for every in (0, 100 * MS):
        polls = [ask(every=every), ask("b", every=every, count=9, to="D420")]
        press = plc("press", port("COM3", MASTER), polls=polls, jitter=MS)
        scenario = serial_bus([station(jitter=3 * MS)], [press], seconds=200)
        found = only(scenario)
        assert found.load is not None
        done = run(scenario, traced=False)
        load = done.totals.buses[0].busy / scenario.duration
        assert found.load[0] * 0.995 <= load <= found.load[1] * 1.005


@pytest.mark.parametrize("every", [0, 2 * SECOND])
def test_a_dead_slave(every: int) -> None:
    scenario = four_polls(every=every)
    found = only(scenario)
    (dead,) = found.dead
    assert (*dead.devices, [poll.name for poll in dead.polls]) == ("feeder", list("abcd"))
    assert dead.lost == 1600 * MS  # (1 + 3 retries) × 100 ms on 4 polls
    assert found.in_words()[0].startswith(
        "3 retries = 4 attempts × 100 ms on 4 polls (a, b, c, d): 1.6 s when feeder is dead; "
    )
    off = replace(scenario, faults=(fault(fault_kinds.PowerOff("feeder")),))
    done = run(off)
    cycles = [cycle.duration for cycle in done.record.cycles[1:]]
    assert len(cycles) > 10
    assert dead.cycle.least <= min(cycles)
    assert max(cycles) <= dead.cycle.most
    assert dead.lost < dead.cycle.least
    assert dead.cycle.most <= found.worst  # type: ignore[operator]
    # A slave that is off all the time is named, and what it costs is the same.
    named = only(off)
    assert named.dead == found.dead
    assert "feeder" in named.model.off
    assert named.cycle == found.cycle


def test_one_of_two_slaves_dead() -> None:
    polls = [ask("a", retries=1), ask("b", 2, to="D410"), ask("c", 2, to="D420", retries=2)]
    press = plc("press", port("COM3", MASTER, timeout=20), polls=polls)
    scenario = serial_bus([station(), station("oven", 2, delay=3 * MS)], [press], seconds=40)
    found = only(scenario)
    assert [(*dead.devices, dead.lost) for dead in found.dead] == [("feeder", 400 * MS), ("oven", 800 * MS)]
    assert found.all_dead is not None
    assert found.all_dead.lost == 1200 * MS
    for names, dead in (
        (["feeder"], found.dead[0]),
        (["oven"], found.dead[1]),
        (["feeder", "oven"], found.all_dead),
    ):
        done = run(replace(scenario, faults=tuple(fault(fault_kinds.PowerOff(name)) for name in names)))
        # Neither scans nor slaves have any jitter: the closed form is the time itself.
        assert {cycle.duration for cycle in done.record.cycles[1:]} == {dead.cycle.least}
        assert dead.cycle.fixed
    words = found.in_words()
    assert words[1].startswith(
        "0 retries = 1 attempt × 200 ms on 1 poll (b) + 2 retries = 3 attempts × 200 ms on"
    )
    assert "1.2 s when feeder, oven are dead" in words[2]


def disturbances(seed: int, scenario: model.Scenario) -> model.Scenario:
    rng = random.Random(-seed)
    node = only(scenario).model.node
    slave = [*(d.name for d in scenario.devices if d.model != "hmi"), *(p.name for p in scenario.plcs)][0]
    noise = [model.Noise("n", model.Target("bus"), model.BitErrors(rng.choice([1e-4, 3e-3])))]
    noise += [model.Noise("l", model.Target("bus"), model.ReplyLoss(0.3))] if rng.random() < 0.3 else []
    faults = [
        fault(fault_kinds.PowerOff(slave), 5, 4),
        fault(fault_kinds.InsertChar(node, fault_kinds.Direction.RX, 50), 10, 3),
        fault(fault_kinds.LoseChar(node, fault_kinds.Direction.RX, 50), 13, 3),
    ]
    if any(d.name == slave for d in scenario.devices):
        faults.append(fault(fault_kinds.Jabber(slave), 17, 2))
    return replace(scenario, noise=tuple(noise), faults=tuple(faults))


@pytest.mark.parametrize("seed", quick(3, (1, 2, 5, 0, 3, 4, *range(6, 20))))
def test_no_disturbance_makes_a_cycle_longer_than_the_worst_case(seed: int) -> None:
    scenario = random_bus(seed)
    found = only(scenario)
    if found.cycle is None:
        pytest.skip("only commands")
    done = run(disturbances(seed, scenario))
    assert len({r.outcome for r in done.record.transactions}) > 1
    cycles = [cycle.duration for cycle in done.record.cycles[1:]]
    assert max(cycles) <= found.disturbed  # type: ignore[operator]


def test_rubbish_on_the_line_makes_an_attempt_longer_than_its_timeout() -> None:
    # At the end of the timeout something is arriving, and must be over: only then it is decided.
    polls = (poll("a", retries=2), poll("b", retries=1))
    scenario = serial_bus([station(), hmi("panel", *polls, interval=MS)], seconds=8)
    found = only(scenario)
    done = run(replace(scenario, faults=(fault(fault_kinds.Jabber("feeder"), 1),)))
    cycles = [cycle.duration for cycle in done.record.cycles if cycle.start > 2 * SECOND]
    silent = found.dead[0].cycle.most
    assert min(cycles) > silent
    assert max(cycles) <= found.disturbed  # type: ignore[operator]
    assert found.worst == silent
    assert found.disturbed == silent + 5 * PLAIN.characters(Fraction(9, 2))


def test_the_gap_after_a_command_may_be_another() -> None:
    # After 25 ms in 4 scans of 8.2 ms the interval of 30 ms takes 3 scans more; after 31.25 ms, 4.
    command = ask("go", times=20, to=None)
    words = {"interval": 300}
    alone = only(with_polls(ask(count=5), **words))
    scenario = with_polls(ask(count=5), command, **words)
    found = only(scenario)
    assert alone.cycle == exactly(4 * (8 * MS + EXTRA) + 4 * 8 * MS)
    cycles = [cycle.duration for cycle in run(scenario).record.cycles]
    assert min(cycles[1:]) == alone.cycle.least - 8 * MS
    assert found.cycle is not None
    assert found.cycle.least <= min(cycles[1:])


@pytest.mark.parametrize("seed", quick(1, range(4)))
def test_a_master_that_awaits_what_has_begun(seed: int) -> None:
    profile = replace(PROFILES["pw10"], begun_holds=True)
    press = plc("press", port("COM3", MASTER, timeout=3), polls=[ask(retries=1), ask("b")], profile=profile)
    # The response begins within the timeout of 30 ms and ends after it.
    scenario = serial_bus([station(delay=25 * MS)], [press], seconds=20, seed=seed)
    found = only(scenario)
    assert found.model.valid
    assert {record.outcome for record in run(scenario).record.transactions} == {"ok"}
    done = run(disturbances(seed, scenario))
    assert max(cycle.duration for cycle in done.record.cycles[1:]) <= found.disturbed  # type: ignore[operator]
    hasty = replace(scenario, plcs=(replace(press, profile=PROFILES["pw10"]),))
    assert "it never comes in time" in reasons(hasty)


# -- other ports, the link, slow slaves ---------------------------------------------------------------


def test_other_ports_and_the_link_lengthen_scans() -> None:
    polls = [ask(), replace(ask("b", to="D500"), port="COM5")]
    attachment = model.LinkAttachment("link", "COM4")
    press = plc(
        "press",
        port("COM3", MASTER),
        port("COM5", MASTER, "other"),
        polls=polls,
        link=attachment,
        registers={"D8176": 0, "D8177": 1, "D8180": 5, "M8179": 1},
    )
    scenario = serial_bus([station(), station("oven", bus="other")], [press], seconds=20)
    from bussim.line.characters import NN_LINE

    buses = (
        model.Bus("link", BusProtocol.NN, NN_LINE),
        *scenario.buses,
        model.Bus("other", BusProtocol.SERIAL, PLAIN),
    )
    scenario = replace(scenario, buses=buses)
    found = figures(scenario)
    assert list(found) == ["press.COM3", "press.COM5"]
    scan = 8 * MS * 11 // 10
    first = found["press.COM3"]
    assert first.mean is None
    assert "other ports" in first.model.notes[0]
    assert first.cycle is not None
    assert first.cycle.least == 3 * (scan + EXTRA) + scan
    assert first.cycle.most == 3 * (scan + 2 * EXTRA) + scan + EXTRA
    done = run(scenario)
    for node, one in found.items():
        cycles = [c.duration for c in done.record.cycles if c.master == node][1:]
        assert one.cycle is not None
        assert one.cycle.least <= min(cycles) <= max(cycles) <= one.cycle.most


def test_a_slow_slave_is_as_slow_as_its_fault() -> None:
    press = plc("press", port("COM3", MASTER), polls=[ask()])
    scenario = serial_bus([station()], [press], seconds=5)
    plain = only(scenario)
    always = only(replace(scenario, faults=(fault(fault_kinds.Slow("feeder", 20 * MS)),)))
    for_a_time = only(replace(scenario, faults=(fault(fault_kinds.Slow("feeder", 20 * MS), 1, 2),)))
    assert always.polls[0].response.least == plain.polls[0].response.least + 20 * MS
    assert for_a_time.polls[0].response == Span(plain.polls[0].response.least, always.polls[0].response.most)


def test_a_broadcast_waits_its_turnaround_and_cannot_fail() -> None:
    write = ask("all", 0, function=6, count=1, values=(7,), to=None, retries=2)
    press = plc("press", port("COM3", MASTER), polls=[write, ask()])
    scenario = serial_bus([station()], [press], seconds=10)
    found = only(scenario)
    first = found.polls[0]
    assert first.response == exactly(100 * MS)
    assert first.poll.device == ""
    assert [poll.name for poll in found.dead[0].polls] == ["a"]
    done = run(scenario)
    assert {cycle.duration for cycle in done.record.cycles[1:]} == {found.cycle.least}  # type: ignore[union-attr]

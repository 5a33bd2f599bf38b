"""How often polls fail, against the simulation; and turns that are left out after a failure."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import pytest

import bussim
from bussim.devices.contract import BusDevice
from bussim.devices.lx.model import LxSettings
from bussim.exact.metrics import YEAR
from bussim.exact.polls.metrics import PollFigures
from bussim.plc.ports.spec import PollSpec
from bussim.scenario import fault_kinds, model
from tests.exact.polls.test_polling import ask, only, station
from tests.selection import quick
from tests.sim.build import MS, SECOND, fault
from tests.sim.serial import MASTER, device, hmi, plc, poll, port, serial_bus

#: Standard deviations that a count may be off.
SIGMAS = 4.0
BUS = model.Target("bus")
RX, TX = fault_kinds.Direction.RX, fault_kinds.Direction.TX
NOISE = {
    "bits": [(BUS, model.BitErrors(2e-4))],
    "lost replies": [(BUS, model.ReplyLoss(0.1)), (model.Target("bus", "feeder"), model.ReplyLoss(0.05))],
    "one receiver": [(model.Target("bus", "feeder", RX), model.BitErrors(1e-3))],
    "one sender": [(model.Target("bus", "feeder", TX), model.BitErrors(1e-3))],
    "the master": [
        (model.Target("bus", "press.COM3", RX), model.BitErrors(5e-4)),
        (model.Target("bus", "press.COM3", TX), model.BitErrors(1e-4)),
    ],
}


def line(
    *polls: PollSpec, slave: BusDevice | None = None, seconds: int = 600, **words: int
) -> model.Scenario:
    press = plc("press", port("COM3", MASTER, **words), polls=polls, jitter=MS)
    return serial_bus([slave or station(delay=2 * MS, jitter=3 * MS)], [press], seconds=seconds, seed=4)


def with_noise(scenario: model.Scenario, kind: str) -> model.Scenario:
    return replace(
        scenario,
        noise=tuple(model.Noise(f"n{i}", target, what) for i, (target, what) in enumerate(NOISE[kind])),
    )


def off_by(count: int, among: int, chance: float) -> float:
    """By how many standard deviations a count differs from a chance."""
    return abs(count - among * chance) / math.sqrt(among * chance * (1 - chance))


@pytest.mark.parametrize("kind", quick(1, NOISE))
def test_attempts_and_turns_fail_as_often_as_they_should(kind: str) -> None:
    polls = (ask("a", count=8, retries=1), ask("b", function=6, count=1, values=(7,), to=None))
    scenario = with_noise(line(*polls, timeout=6), kind)
    found = only(scenario)
    ran = bussim.run(scenario, rows=False).record.ports["press.COM3"]
    for one in found.polls:
        seen, law = ran.polls[one.poll.name], one.failures
        assert law is not None
        assert off_by(seen.transactions - seen.ok, seen.transactions, law.attempt) < SIGMAS
        assert off_by(seen.failed_turns, seen.turns, law.turn) < SIGMAS
        assert seen.turns * YEAR / scenario.duration <= law.a_year
    assert found.failed_a_year == pytest.approx(sum(one.failures.failed_a_year for one in found.polls))


@pytest.mark.parametrize("every", [(0, 0, 0, 0, 1000), (50, 50, 50, 50, 1000), (0, 20, 50, 50, 400)])
def test_polls_that_are_always_due_have_a_turn_between_those_of_another(every: tuple[int, ...]) -> None:
    polls = (ask(f"q{n}", count=8, every=period * MS) for n, period in enumerate(every))
    scenario = line(*polls, seconds=60)
    ran = bussim.run(scenario, rows=False).record.ports["press.COM3"]
    for one in only(scenario).polls:
        assert one.failures is not None
        bound = one.failures.a_year * scenario.duration / YEAR
        assert 0.6 * bound < ran.polls[one.poll.name].turns <= bound + 1


def test_where_attempts_depend_on_each_other_there_is_no_figure() -> None:
    burst = model.Noise("storm", BUS, model.Burst(SECOND, 20 * MS, 0, 1e-2))
    found = only(replace(line(ask()), noise=(burst,)))
    assert found.failed_a_year is None
    (one,) = found.polls
    assert one.failures is not None
    assert "storm comes and goes" in one.failures.reason
    assert one.to_json()["failures"]["turn_fails"] is None  # type: ignore[index]
    bits = model.Noise("late", BUS, model.BitErrors(1e-4), model.Window(SECOND))
    assert only(replace(line(ask()), noise=(bits,))).failed_a_year is None
    assert only(line(ask())).failed_a_year is None  # no noise at all: not a figure, but nothing to fail


def test_response_times_are_spread_evenly_where_a_delay_is() -> None:
    scenario = line(ask(count=8), seconds=300)
    (one,) = only(scenario).polls
    seen = bussim.run(scenario, rows=False).record.ports["press.COM3"].polls["a"].responses
    form = one.to_json()["response_quantiles_ms"]
    assert isinstance(form, dict)
    for part in (50, 95, 99):
        assert form[f"p{part}"] == pytest.approx((seen.quantile(10 * part) or 0) / MS, abs=0.15)
    at_end = device("feeder", "lx", settings=LxSettings(model.Scan(5 * MS, MS)))
    assert only(line(ask(), slave=at_end)).polls[0].to_json()["response_quantiles_ms"]["p50"] is None  # type: ignore[index]


def both(*polls: PollSpec, plc_: bool) -> model.Scenario:
    slaves = [station(), station("oven", 2)]
    if plc_:
        press = plc("press", port("COM3", MASTER, timeout=10), polls=polls, jitter=MS)
        return serial_bus(slaves, [press], seconds=60)
    asked = (replace(each, port="", device=None) for each in polls)
    return serial_bus([*slaves, hmi("panel", *asked, timeout=100 * MS)], seconds=60)


@pytest.mark.parametrize("plc_", [True, False])
@pytest.mark.parametrize("every", [0, 150 * MS])
def test_a_dead_slave_that_is_asked_in_every_tenth_turn(every: int, plc_: bool) -> None:
    def scenario(skip: int) -> model.Scenario:
        off = {"retries": 1, "every": every, "skip_after_failure": skip}
        return both(
            ask("a", every=every), ask("b", 2, to="D420", **off), ask("c", 2, to="D430", **off), plc_=plc_
        )

    def cycles(found: PollFigures, off: model.Scenario) -> tuple[float, float, float]:
        ran = bussim.run(off, rows=False).record.ports[found.model.node].cycles
        return ran.minimum or 0, ran.mean or 0, ran.maximum or 0

    plain, found = only(scenario(1)), only(scenario(10))
    (dead,) = (each for each in found.dead if each.devices == ("oven",))
    (without,) = (each for each in plain.dead if each.devices == ("oven",))
    assert dead.cycle.most >= without.cycle.most
    least, mean, most = cycles(found, replace(scenario(10), faults=(fault(fault_kinds.PowerOff("oven")),)))
    assert dead.cycle.least <= least or least < 20 * MS  # the first one has a short first scan
    assert most <= dead.cycle.most
    assert mean <= dead.mean
    assert dead.mean < without.mean / 3
    # The other way round nothing is left out.
    (other,) = (each for each in found.dead if each.devices == ("feeder",))
    assert other.cycle == next(each.cycle for each in plain.dead if each.devices == ("feeder",)) or every


def test_polls_of_an_hmi_are_left_out_on_their_grid() -> None:
    asked = (poll("a", every=100 * MS, skip_after_failure=5),)
    scenario = serial_bus([station(), hmi("panel", *asked, timeout=20 * MS)], seconds=10)
    off = replace(scenario, faults=(fault(fault_kinds.PowerOff("feeder"), 0, 3),))
    sent = bussim.run(off).transactions["sent_s"]
    assert [round(each, 3) for each in sent[:9]] == [0, 0.5, 1, 1.5, 2, 2.5, 3, 3.1, 3.2]


def test_what_cannot_fail_fails_with_0() -> None:
    """And not with -0.0, which whoever reads it takes for a sign."""
    assert "-0.0" not in json.dumps(bussim.exact("hmi_on_com2").to_dict())

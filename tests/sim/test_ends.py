"""Every END of every PLC reaches a traced run's sink, also those that nothing needed."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import pytest

from bussim.line.random_streams import Streams
from bussim.plc.scan import ScanCycle
from bussim.scenario import fault_kinds, model
from bussim.scenario.loader import load
from bussim.sim.runner import simulate
from bussim.units import TICKS_PER_MS as MS
from tests.sim.build import Recorder, link, run


def test_all_of_them_in_order_with_stops() -> None:
    faults = [
        model.Fault("s", fault_kinds.Stop("p1"), model.Window(700 * MS, 300 * MS)),
        model.Fault("o", fault_kinds.PowerOff("p2"), model.Window(400 * MS, 900 * MS)),
    ]
    done = run(link(stations=3, seconds=3.0, faults=faults))
    counted = {plc.name: plc for plc in done.totals.plcs}
    for name, ends in done.record.all_ends.items():
        assert ends == sorted(set(ends))
        runs = 1 + (name != "p0")
        # Scans lie between ENDs; from RUN to the first END is none.
        assert counted[name].scans == len(ends) - runs
        gaps = [after - before for before, after in pairwise(ends)]
        whole = [gap for gap in gaps if gap < 200 * MS]
        assert len(gaps) - len(whole) == runs - 1
        assert max(whole) == counted[name].scan_max
    assert done.record.all_ends.keys() == {"p0", "p1", "p2"}


def test_recording_them_changes_nothing() -> None:
    scenario = load("nn_with_modbus", ["duration=5 s"])
    found = []
    for traced in (False, True):
        record = Recorder(traced=traced)
        totals = simulate(scenario, record)
        found.append((totals, record.scans, record.transactions))
        assert bool(record.all_ends) == traced
    assert found[0] == found[1]


def test_those_of_a_latency_come_as_they_happen() -> None:
    scenario = load("counter_preset", ["duration=3 s"])
    record = Recorder(traced=False)
    simulate(scenario, record)
    assert record.all_ends.keys() == {"line", "packer"}
    again = Recorder(traced=True)
    simulate(scenario, again)
    assert again.all_ends == record.all_ends
    # And the same ones as without any latency.
    plain = Recorder(traced=True)
    simulate(replace(scenario, latency=()), plain)
    assert plain.all_ends == record.all_ends


@pytest.mark.parametrize("jitter", [0, 700])
def test_none_is_lost_however_rarely_they_are_read(jitter: int) -> None:
    def cycle() -> ScanCycle:
        made = ScanCycle(Streams(1).generator("scan", "x"))
        made.keep_ends()
        made.run(0, 1000, jitter, 10)
        return made

    often, rarely = cycle(), cycle()
    every: list[int] = []
    for tick in range(0, 5_000_000, 777):
        often.latest_end(tick)
        if tick % 31 == 0:
            every += often.passed(tick)
    every += often.passed(5_000_000)
    for tick in range(0, 5_000_001, 1_250_000):
        rarely.latest_end(tick)
    assert rarely.passed(5_000_000) == every
    assert len(every) == pytest.approx(5000, rel=0.02)


def test_none_is_lost_when_the_load_changes() -> None:
    cycle = ScanCycle(Streams(1).generator("scan", "x"))
    cycle.keep_ends()
    cycle.run(0, 1000, 200, 10)
    seen, now = [], -1
    for number in range(3000):
        now = cycle.next_end(now + 1, max(now, 0))
        seen.append(now)
        if number % 7 == 0:
            cycle.set_load(now, number % 5 * 100)
    assert cycle.passed(now) == seen
    assert cycle.passed(now) == []

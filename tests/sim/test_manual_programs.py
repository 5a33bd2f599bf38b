"""The two programs of the PW10 board's manual, section 7.6, device by device over time."""

from __future__ import annotations

from bisect import bisect_right
from functools import cache

from bussim.plc.memory import parse_device
from bussim.results.meters.watch import Watch, Watched
from bussim.scenario.loader import load
from bussim.scenario.model import Scenario
from bussim.sim.runner import simulate
from bussim.units import TICKS_PER_MS as MS
from tests.sim.build import Recorder

#: From an input to the other's output: two scans, a link scan, a data frame, two scans (and a bit).
LONGEST = 100 * MS
S = 1000 * MS

DEVICES = [
    "master.X0",
    "master.X1",
    "master.X2",
    "master.X3",
    "master.Y0",
    "master.Y6",
    "master.Y10",
    "master.Y11",
    "master.Y12",
    "master.Y13",
    "master.Y14",
    "master.D1",
    "master.M1070",
    "master.M8184",
    "slave.X0",
    "slave.X1",
    "slave.Y0",
    "slave.Y5",
    "slave.Y10",
    "slave.Y11",
    "slave.Y12",
    "slave.Y13",
    "slave.D1",
    "slave.C1",
    "slave.M8183",
]


def watched(text: str) -> dict[str, Watched]:
    """The scenario ``manual_programs`` with what ``text`` sets, all of DEVICES over its time."""
    from dataclasses import replace

    scenario: Scenario = load("manual_programs", text.split())
    plcs = tuple(
        replace(
            plc, observed=tuple(name.partition(".")[2] for name in DEVICES if name.startswith(f"{plc.name}."))
        )
        for plc in scenario.plcs
    )
    record = Recorder(traced=False)
    simulate(replace(scenario, plcs=plcs), record)
    watch = Watch(
        [Watched(*name.split("."), width=parse_device(name.partition(".")[2]).width) for name in DEVICES]
    )
    for value in record.values:
        watch.take(value)
    return {each.name: each for each in watch.watched}


@cache
def as_printed() -> dict[str, Watched]:
    return watched("")


def follows(source: Watched, target: Watched, begin: int, end: int) -> int:
    """How often the target follows the source between two ticks; it must do so every time."""
    count = 0
    for tick, value in source.between(begin, end):
        at = bisect_right(target.ticks, tick)
        assert target.ticks[at] - tick <= LONGEST, (source.name, tick / MS)
        assert target.values[at] == value
        count += 1
    return count


def test_the_masters_inputs_appear_on_the_slave() -> None:
    seen = as_printed()
    for number, changes in ((0, 50), (1, 25), (2, 12), (3, 6)):
        source, target = seen[f"master.X{number}"], seen[f"slave.Y1{number}"]
        assert follows(source, target, 500 * MS, 13 * S) >= changes - 3
        # And nothing else moves the target.
        assert len(target.between(S, 13 * S)) <= changes + 2


def test_the_slaves_inputs_appear_on_the_master() -> None:
    seen = as_printed()
    assert follows(seen["slave.X0"], seen["master.Y11"], 500 * MS, 13 * S) >= 30
    assert [value for _, value in seen["master.Y12"].between(500 * MS, 13 * S)] == [1, 0]  # X1, at 10 s
    assert follows(seen["slave.X1"], seen["master.Y12"], 500 * MS, 13 * S) == 2
    for output in ("master.Y13", "master.Y14"):  # X2 and X3, which nothing drives
        assert seen[output].values == []


def test_the_masters_own_lamps() -> None:
    seen = as_printed()
    assert seen["master.Y10"].at(2 * S) == 1  # the link runs
    # Y0: station 1 has an error: at first, and while the slave is in STOP.
    assert seen["master.Y0"].at(2 * S) == 0
    assert seen["master.Y0"].at(15 * S) == 1
    assert seen["master.Y0"].at(18 * S) == 0


def test_the_preset_reaches_the_slaves_counter_and_its_contact_comes_back() -> None:
    seen = as_printed()
    preset = seen["slave.D1"]
    assert preset.values == [10, 0, 10]  # a general word: 0 from STOP on, until the master's comes again
    assert preset.ticks[0] < 200 * MS
    assert preset.ticks[1] == 14 * S
    assert 16 * S <= preset.ticks[2] <= 17 * S
    # C1 closes with the tenth rise of X0, to the very scan.
    rises = [
        tick for tick, value in zip(seen["slave.X0"].ticks, seen["slave.X0"].values, strict=True) if value
    ]
    closed = seen["slave.C1"].ticks[0]
    assert closed == rises[9]
    assert seen["slave.Y5"].ticks[0] == closed
    assert 0 < seen["master.M1070"].ticks[0] - closed <= LONGEST
    # Y6 follows M1070 one scan later.
    assert 9 * MS <= seen["master.Y6"].ticks[0] - seen["master.M1070"].ticks[0] <= 13 * MS
    # X1 resets it at 10 s.
    assert seen["slave.C1"].at(9_990 * MS) == 1
    assert seen["slave.C1"].at(10_100 * MS) == 0
    assert seen["master.Y6"].at(10_100 * MS + LONGEST) == 0


def test_m8184_stops_the_masters_copies_while_the_slave_is_off() -> None:
    seen = as_printed()
    flag, output = seen["master.M8184"], seen["master.Y11"]
    on, off = (tick for tick, _ in flag.between(14 * S, 20 * S))
    assert 14 * S < on <= 14 * S + 6 * 60 * MS  # six attempts of 50 ms each
    assert 16 * S < off <= 16 * S + 500 * MS
    assert output.between(on + 25 * MS, off) == []
    # Afterwards they go on.
    assert follows(seen["slave.X0"], output, off + 100 * MS, 19 * S + 800 * MS) >= 4


def test_m8183_stops_the_slaves_copies_while_the_master_is_off() -> None:
    seen = watched("faults.0.stop=master")
    flag = seen["slave.M8183"]
    on, off = (tick for tick, _ in flag.between(14 * S, 20 * S))
    assert 14 * S < on <= 14 * S + 200 * MS  # two timeouts and the longest reply
    assert 16 * S < off <= 16 * S + 200 * MS
    assert seen["slave.Y0"].at(15 * S) == 1
    for number in range(1, 4):  # Y10 shows M8191 again as long as the copies are off
        assert seen[f"slave.Y1{number}"].between(on + 25 * MS, off) == []
    assert follows(seen["master.X0"], seen["slave.Y10"], off + 300 * MS, 19 * S + 800 * MS) >= 5


def test_as_the_manual_prints_the_slaves_gate_it_never_closes() -> None:
    """M8184 is the slave's own flag, which it never sees: with it the copies would go on from a dead master."""
    text = load("manual_programs").plcs[1].program
    assert text is not None
    assert "LDI  M8183" in text.text
    seen = as_printed()
    assert seen["slave.M8183"].between(S, 14 * S) == []

"""Codes 11 and 14: a master that is silent or not understood, as its slaves note it."""

from __future__ import annotations

import pytest

from bussim.engines.nn.events import (
    MasterWatchdog,
    ParametersTaken,
    StationBack,
    StationLost,
)
from bussim.engines.nn.frames import DATA, POLL
from tests.engines.nn.links import (
    BODY,
    DATA_TICKS,
    FIXED,
    SLOT,
    WATCHDOG,
    link,
    noted,
    of,
    slave_of,
)
from tests.engines.wire import (
    CHAR,
    GAP,
    MS,
    PARAMETERS_TICKS,
    POLL_TICKS,
    QUIET,
    TIMEOUT_UNIT,
    Wire,
    master_node,
    slave_node,
)

pytestmark = pytest.mark.parametrize("whole", [True, False], ids=["whole", "characters"])


# -- 11 ----------------------------------------------------------------------------------------------------


def test_11_when_the_master_stops_once_and_the_next_interval_is_not_measured(whole: bool) -> None:
    wire = link(2, whole=whole)
    wire.run_scans(4)
    master, *slaves = wire.nodes
    last = master.sent[-2]  # the data frame that has just begun is cut by the stop
    assert last.frame is not None
    assert last.frame.kind == POLL
    wire.run(wire.now + 1)
    master.stop(wire.now)
    expiry = last.end + WATCHDOG
    wire.run(expiry - 1)
    for node in slaves:
        # the cut frame began with a clean header: that is damage of the master's
        assert node.engine.status.running
        assert not of(node, MasterWatchdog)
    wire.run(expiry)
    for node in slaves:
        status = node.engine.status
        assert of(node, MasterWatchdog) == [MasterWatchdog(expiry, last.end)]
        assert (status.codes[0], status.flags[0], status.running) == (0x11, True, False)
        assert node.engine.deadline() is None
    counts = [node.engine.status.counts[0] for node in slaves]
    measured = [node.engine.status.current for node in slaves]
    wire.run(wire.now + 60_000 * MS)
    for node in slaves:
        assert len(of(node, MasterWatchdog)) == 1
    assert [node.engine.status.counts[0] for node in slaves] == counts
    # The master comes back: the flag goes off at its first frame, the code stays.
    master.start(wire.now)
    begun = wire.now
    wire.run(begun + GAP + PARAMETERS_TICKS)
    for node in slaves:
        status = node.engine.status
        assert (status.codes[0], status.flags[0], status.running) == (0x11, False, False)
        assert node.events[-1] == StationBack(wire.now, 0)
        assert node.engine.deadline() == wire.now + WATCHDOG
    wire.run_scans(1)
    wire.run(wire.now + DATA_TICKS)
    assert [node.engine.status.current for node in slaves] == measured
    assert [node.engine.status.longest for node in slaves] == measured
    wire.run_scans(1)
    for node in slaves:
        assert node.engine.status.running
    wire.run(wire.now + DATA_TICKS)
    assert [node.engine.status.current for node in slaves] == [FIXED + 2 * SLOT] * 2
    assert of(slaves[0], ParametersTaken)[1:] == []


def test_the_interval_over_a_silence_is_not_measured_even_if_its_counters_follow(whole: bool) -> None:
    wire = link(1, whole=whole)
    master, slave = wire.nodes
    wire.run_scans(16)
    wire.run(wire.now + DATA_TICKS + GAP)  # the data frame with counter 15 is heard
    longest = slave.engine.status.longest
    master.stop(wire.now)
    wire.run(wire.now + 2 * WATCHDOG)
    master.start(wire.now)
    wire.run_scans(1)  # counter 0
    wire.run(wire.now + DATA_TICKS)
    assert (slave.engine.status.current, slave.engine.status.longest) == (longest, longest)
    wire.run_scans(2)
    assert slave.engine.status.current == FIXED + SLOT


def test_the_watchdog_follows_every_valid_master_frame(whole: bool) -> None:
    wire = link(2, whole=whole)
    wire.run_scans(3)
    slave = wire.nodes[1]
    frames = [tx for tx in wire.nodes[0].sent if tx.end <= wire.now]
    assert slave.engine.deadline() == frames[-1].end + WATCHDOG
    wire.run(frames[-1].end + 1_000 * MS)
    assert not of(slave, MasterWatchdog)
    assert slave_of(slave).watchdog == WATCHDOG


def test_another_timeout_moves_the_watchdog(whole: bool) -> None:
    wire = Wire(master_node(1, timeout=20), slave_node(1), whole=whole)
    master, slave = wire.nodes
    for node in wire.nodes:
        wire.at(0, lambda node=node: node.start(0))
    wire.run_scans(2)
    wire.run(wire.now + DATA_TICKS)
    assert slave_of(slave).watchdog == WATCHDOG + 2 * 15 * TIMEOUT_UNIT
    heard = wire.now
    assert slave.engine.deadline() == heard + slave_of(slave).watchdog
    # A master with a shorter timeout takes its place, says so and falls silent.
    master.stop(wire.now)
    other = master_node(1)
    other.wire = wire
    wire.nodes = (other, slave)
    other.start(wire.now)
    wire.run(wire.now + GAP + PARAMETERS_TICKS)
    other.stop(wire.now)
    spoken = wire.now
    assert spoken + WATCHDOG < heard + WATCHDOG + 2 * 15 * TIMEOUT_UNIT
    wire.run(spoken + WATCHDOG)  # the driver of this wire learns of the new deadline only by the hint
    assert of(slave, MasterWatchdog) == [MasterWatchdog(spoken + WATCHDOG, spoken)]


# -- 14 ----------------------------------------------------------------------------------------------------


def test_14_counts_once_until_the_next_valid_master_frame(whole: bool) -> None:
    wire = link(1, whole=whole)
    wire.run_scans(2)
    wire.run(wire.now + DATA_TICKS)
    master, slave = wire.nodes
    status = slave.engine.status
    wire.run_scans(1)
    master.stop(wire.now)  # cut at its first tick: nothing was sent
    for number in range(5):
        wire.inject(wire.now + (5 + 5 * number) * MS, b"\x0210")
    wire.run(wire.now + 5 * MS + 3 * CHAR + QUIET - 1)
    assert noted(slave) == {}
    wire.run(wire.now + 1)
    assert noted(slave) == {0: (1, 0x14)}
    assert status.flags[0]
    wire.run(wire.now + 30 * MS)
    assert noted(slave) == {0: (1, 0x14)}
    wire.run(wire.now + 2 * WATCHDOG)
    assert noted(slave) == {0: (2, 0x11)}  # then the watchdog, once as well
    wire.inject(wire.now, b"\x0210")
    wire.run(wire.now + 5 * MS)
    assert noted(slave) == {0: (2, 0x11)}
    master.start(wire.now)
    wire.run_scans(1)
    assert not status.flags[0]
    assert noted(slave) == {0: (2, 0x11)}
    wire.inject(wire.now + DATA_TICKS + 100, b"0")
    wire.run_scans(2)
    assert noted(slave) == {0: (3, 0x14)}
    assert status.running


def test_m8183_is_on_from_the_damage_to_the_next_valid_frame(whole: bool) -> None:
    wire = link(1, whole=whole)
    wire.damage = lambda tx, _node: (
        [BODY] if tx.frame and (tx.frame.kind, tx.frame.station, tx.frame.counter) == (DATA, 0, 2) else []
    )
    wire.run_scans(3)
    data = wire.sent[-1]
    slave = wire.nodes[1]
    # The gap before the poll (0.4175 ms) is shorter than two characters (0.5208 ms): its header ends it.
    assert GAP < QUIET < GAP + CHAR
    wire.run(data.end + GAP + CHAR)
    assert slave.engine.status.flags[0]
    lost = [event for event in slave.events if isinstance(event, StationLost)]
    assert lost == [StationLost(data.end + GAP + CHAR, 0, 0x14, new=True)]
    wire.run(data.end + GAP + POLL_TICKS)
    assert not slave.engine.status.flags[0]
    assert slave.events[-1] == StationBack(data.end + GAP + POLL_TICKS, 0)
    # A scan is measured between data frames of consecutive counters: 1 to 3 is none.
    wire.run_scans(1)
    wire.run(wire.now + DATA_TICKS)
    assert slave.engine.status.current == FIXED + SLOT
    assert wire.nodes[0].engine.status.counts == [0] * 8

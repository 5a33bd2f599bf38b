"""What stands behind the special registers over time: flags, counts, scan times, code 31."""

from __future__ import annotations

import pytest

from bussim.engines.nn.codes import COUNT_LIMIT, MEANINGS
from bussim.engines.nn.events import (
    AllHealthy,
    ParametersTaken,
    PolledWithoutParameters,
    StationBack,
    StationLost,
)
from bussim.engines.nn.frames import DATA, PARAMETERS, POLL, LinkSettings
from bussim.engines.nn.master import Master
from tests.engines.nn.links import (
    DATA_TICKS,
    FIXED,
    HEADER,
    SLOT,
    TIMEOUT,
    WATCHDOG,
    link,
    noted,
    of,
    scans,
    silence,
)
from tests.engines.wire import (
    GAP,
    MS,
    PARAMETERS_TICKS,
    POLL_TICKS,
    TURNAROUND,
    Node,
    Tx,
    Wire,
    master_node,
    slave_node,
)

pytestmark = pytest.mark.parametrize("whole", [True, False], ids=["whole", "characters"])

# -- a healthy link ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("slaves", [1, 2, 7])
def test_a_healthy_scan_takes_what_its_parts_take(slaves: int, whole: bool) -> None:
    wire = link(slaves, whole=whole)
    wire.run_scans(4)
    wire.run(wire.now + DATA_TICKS)
    master = wire.nodes[0]
    first = master.sent[:2]
    assert [tx.frame.kind for tx in first if tx.frame] == [PARAMETERS, DATA]
    assert [tx.start for tx in first] == [GAP, 2 * GAP + PARAMETERS_TICKS]
    assert [(scan.index, scan.duration, scan.attempts) for scan in scans(wire)] == [
        (number, FIXED + slaves * SLOT, slaves) for number in range(3)
    ]
    assert scans(wire)[0].start == first[1].start
    assert not any(scan.failures or scan.in_error or scan.parameters for scan in scans(wire))
    assert of(master, AllHealthy) == [AllHealthy(first[1].end + slaves * SLOT)]
    # The counter counts scans, modulo 16, and a reply carries its poll's.
    wire.run_scans(16)
    data = [tx.frame for node in wire.nodes for tx in node.sent if tx.frame and tx.frame.kind == DATA]
    for station in range(slaves + 1):
        counters = [frame.counter for frame in data if frame.station == station]
        assert counters == [number % 16 for number in range(len(counters))]
        assert len(counters) >= 19


def test_every_station_stores_every_block_and_measures_the_same(whole: bool) -> None:
    wire = link(3, whole=whole)
    wire.run_scans(3)
    wire.run(wire.now + DATA_TICKS)
    for node in wire.nodes:
        own = wire.nodes.index(node)
        latest = {station: data for _, station, data in node.stored}
        assert latest == {k: other.image for k, other in enumerate(wire.nodes) if k != own}
        status = node.engine.status
        assert status.current == status.longest == FIXED + 3 * SLOT
        assert noted(node) == {}
    # In the order of the wire, once each: a slave stores at the end of each frame.
    ends = [tx.end for tx in wire.sent if tx.frame and tx.frame.kind == DATA]
    assert [end for end, _, _ in wire.nodes[3].stored][:3] == ends[:3]


# -- M8191 -------------------------------------------------------------------------------------------------


def test_running_comes_on_with_the_first_data_frame_and_the_first_reply(whole: bool) -> None:
    wire = link(1, whole=whole)
    master, slave = wire.nodes
    start = 2 * GAP + PARAMETERS_TICKS
    replied = start + DATA_TICKS + GAP + POLL_TICKS + TURNAROUND + DATA_TICKS
    wire.run(start - 1)
    assert (master.engine.status.running, slave.engine.status.running) == (False, False)
    wire.run(start)
    assert (master.engine.status.running, slave.engine.status.running) == (True, False)
    wire.run(replied - 1)
    assert not slave.engine.status.running
    wire.run(replied)
    assert slave.engine.status.running
    for node in wire.nodes:
        node.stop(wire.now)
        assert not node.engine.status.running


# -- 31 ----------------------------------------------------------------------------------------------------


def test_31_is_a_slave_s_own_without_count_or_flag(whole: bool) -> None:
    wire = Wire(master_node(2), slave_node(1), slave_node(2), whole=whole)
    master, first, late = wire.nodes
    wire.at(0, lambda: master.start(0))
    wire.at(0, lambda: first.start(0))
    wire.at(10 * MS, lambda: late.start(10 * MS))  # after the parameters
    wire.run_scans(2)
    assert noted(late) == {2: (0, 0x31)}
    assert not any(late.engine.status.flags)
    poll = next(tx for tx in master.sent if tx.frame and tx.frame[:2] == (POLL, 2))
    assert of(late, PolledWithoutParameters) == [PolledWithoutParameters(poll.end)]
    assert late.stored == []
    assert late.sent == []
    # The master has flagged it, so the next scan began with parameters, and now it works.
    wire.run(wire.now + DATA_TICKS)
    assert noted(master) == {2: (1, 0x01)}
    assert noted(first) == {2: (1, 0x21)}
    wire.run_scans(3)
    for node in wire.nodes:
        assert not any(node.engine.status.flags)
    assert noted(late) == {2: (0, 0x31)}  # survives
    assert late.engine.status.running
    assert len(of(master, AllHealthy)) == 1
    assert late.events[1] == ParametersTaken(late.events[1].tick, LinkSettings(2, 0, 0, 5))


def test_a_slave_that_receives_no_poll_of_its_own_sends_nothing(whole: bool) -> None:
    wire = Wire(master_node(2), slave_node(1), slave_node(2), slave_node(3), whole=whole)
    for node in wire.nodes[:3]:
        wire.at(0, lambda node=node: node.start(0))
    late = wire.nodes[3]
    wire.at(10 * MS, lambda: late.start(10 * MS))
    wire.run_scans(5)
    assert noted(late) == {}
    assert late.events == []


# -- counts, probes, attempts --------------------------------------------------------------------------------


@pytest.mark.parametrize("on_edge", [False, True], ids=["per_scan", "on_edge"])
@pytest.mark.parametrize("probe", [False, True], ids=["full", "probe"])
@pytest.mark.parametrize("attempts", [1, 4])
def test_a_dead_station_costs_its_attempts_instead_of_its_slot(
    attempts: int, probe: bool, on_edge: bool, whole: bool
) -> None:
    wire = link(2, attempts=attempts, probe=probe, on_edge=on_edge, whole=whole)
    master, first, dead = wire.nodes
    silence(dead, on=True)
    wire.run_scans(5)
    silence(dead, on=False)
    wire.run_scans(4)
    wire.run(wire.now + DATA_TICKS)
    attempt, healthy = GAP + POLL_TICKS + TIMEOUT, FIXED + 2 * SLOT
    extra = GAP + PARAMETERS_TICKS
    assert round(extra / MS, 3) == 4.063
    again = 1 if probe else attempts
    spent = [attempts, again, again, again]
    durations = [healthy - SLOT + count * attempt + extra for count in spent]
    assert [scan.duration for scan in scans(wire)] == [*durations, *[healthy] * 4]
    assert [scan.attempts for scan in scans(wire)] == [1 + count for count in spent] + [2] * 4
    assert [scan.failures for scan in scans(wire)][:4] == [((2, 0x01),) * count for count in spent]
    assert [scan.in_error for scan in scans(wire)] == [(2,)] * 4 + [()] * 4
    assert [scan.parameters for scan in scans(wire)] == [True] * 4 + [False] * 4
    count = 1 if on_edge else 4
    assert noted(master) == {2: (count, 0x01)}
    assert noted(first) == {2: (count, 0x21)}
    assert noted(dead) == {}
    engine = master.engine
    assert isinstance(engine, Master)
    assert engine.station_errors == {1: 0, 2: 4}  # scans in which it was in error, however they count
    assert engine.failed_attempts == {2: {0x01: sum(spent)}}
    assert engine.polls == 2 * 8
    assert [event.new for event in master.events if isinstance(event, StationLost)] == [
        True,
        False,
        False,
        False,
    ]
    assert engine.status.longest == durations[0]
    assert engine.status.longest_at == scans(wire)[0].start + durations[0]
    assert engine.status.current == healthy
    # A parameter frame goes out at the start and before each scan that begins with a flag on.
    counters = [tx.frame.counter for tx in master.sent if tx.frame and tx.frame.kind == PARAMETERS]
    assert counters == [0, 1, 2, 3, 4]
    assert len(of(first, ParametersTaken)) == 1


def test_the_last_station_that_comes_back_makes_all_healthy_again(whole: bool) -> None:
    wire = link(3, whole=whole)
    master = wire.nodes[0]
    for station in (2, 3):
        silence(wire.nodes[station], on=True)
    wire.run_scans(2)
    assert of(master, AllHealthy) == []  # two have not replied yet
    for station in (3, 2):
        silence(wire.nodes[station], on=False)
        wire.run_scans(1)
    wire.run_scans(1)
    tail = [event for event in master.events if isinstance(event, (StationBack, AllHealthy))]
    ends = [tx.end for station in (3, 2) for tx in wire.nodes[station].sent[:1]]
    assert tail == [StationBack(ends[0], 3), StationBack(ends[1], 2), AllHealthy(ends[1])]


def test_on_edge_counts_every_loss_anew(whole: bool) -> None:
    wire = link(2, on_edge=True, whole=whole)
    master, first, dead = wire.nodes
    for _ in range(3):
        silence(dead, on=True)
        wire.run_scans(3)
        silence(dead, on=False)
        wire.run_scans(3)
    assert noted(master) == {2: (3, 0x01)}
    assert noted(first) == {2: (3, 0x21)}


def test_with_probe_the_first_loss_takes_all_attempts_every_time(whole: bool) -> None:
    wire = link(1, attempts=3, probe=True, whole=whole)
    dead = wire.nodes[1]
    for _ in range(2):
        silence(dead, on=True)
        wire.run_scans(3)
        silence(dead, on=False)
        wire.run_scans(3)
    lost = [scan.attempts for scan in scans(wire) if scan.failures]
    assert lost[0] == 3
    assert lost.count(3) == 2
    assert set(lost) == {1, 3}


def test_counters_stop_at_32767(whole: bool) -> None:
    assert COUNT_LIMIT == 32767
    wire = link(2, whole=whole)
    master, first, dead = wire.nodes
    silence(dead, on=True)
    wire.run_scans(2)
    wire.run(wire.now + DATA_TICKS)  # the slave decides at the end of that data frame
    master.engine.status.counts[2] = COUNT_LIMIT - 2
    first.engine.status.counts[2] = COUNT_LIMIT - 2
    seen = []
    for _ in range(4):
        wire.run_scans(1)
        wire.run(wire.now + DATA_TICKS)
        seen.append((master.engine.status.counts[2], first.engine.status.counts[2]))
    assert seen == [(32766, 32766), (32767, 32767), (32767, 32767), (32767, 32767)]
    first.engine.status.counts[0] = COUNT_LIMIT
    master.stop(wire.now)
    wire.run(wire.now + 2 * WATCHDOG)
    assert noted(first)[0] == (32767, 0x11)


def test_every_code_has_a_meaning(whole: bool) -> None:
    del whole
    assert sorted(MEANINGS) == [0x01, 0x02, 0x03, 0x04, 0x11, 0x14, 0x21, 0x22, 0x23, 0x31]


# -- measuring -----------------------------------------------------------------------------------------------


def test_a_slave_does_not_measure_over_a_data_frame_that_it_missed(whole: bool) -> None:
    wire = link(1, whole=whole)
    wire.damage = _missed
    wire.run_scans(5)
    wire.run(wire.now + DATA_TICKS)
    slave = wire.nodes[1]
    assert slave.engine.status.longest == FIXED + SLOT
    assert noted(slave) == {0: (1, 0x14)}


def _missed(tx: Tx, node: Node) -> list[int]:
    frame = tx.frame
    meant = frame is not None and (frame.kind, frame.station, frame.counter) == (DATA, 0, 2)
    return [HEADER] if meant and node.name != "master" else []

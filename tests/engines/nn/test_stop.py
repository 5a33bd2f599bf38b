"""STOP and RUN, frames that are cut by it, and modes that a family does not have."""

from __future__ import annotations

import pytest

from bussim.engines.nn.events import (
    ParametersRefused,
    StationLost,
)
from bussim.engines.nn.frames import DATA, PARAMETERS, LinkSettings
from bussim.engines.nn.master import Master
from bussim.engines.nn.slave import SlaveState
from tests.engines.nn.links import (
    DATA_TICKS,
    FIXED,
    SLOT,
    link,
    noted,
    scans,
    silence,
    slave_of,
)
from tests.engines.wire import (
    CHAR,
    GAP,
    MS,
    PARAMETERS_TICKS,
    QUIET,
    Wire,
    master_node,
    slave_node,
)

pytestmark = pytest.mark.parametrize("whole", [True, False], ids=["whole", "characters"])


# -- STOP and RUN ------------------------------------------------------------------------------------------


def test_a_slave_in_stop_sends_and_receives_nothing_and_loses_its_parameters(whole: bool) -> None:
    wire = link(2, whole=whole)
    master, first, second = wire.nodes
    silence(first, on=True)
    wire.run_scans(3)
    silence(first, on=False)
    wire.run_scans(2)
    assert noted(second) == {1: (2, 0x21)}
    second.stop(wire.now)
    counts, stored, sent = list(second.engine.status.counts), len(second.stored), len(second.sent)
    assert slave_of(second).settings is None
    assert second.engine.deadline() is None
    wire.run_scans(4)
    assert second.engine.status.counts == counts
    assert (len(second.stored), len(second.sent)) == (stored, sent)
    assert not second.engine.status.running
    assert noted(master)[2][1] == 0x01
    second.start(wire.now)
    status = second.engine.status
    assert (status.counts, status.codes, status.flags) == ([0] * 8, [0] * 8, [False] * 8)
    assert (status.current, status.longest, status.running) == (None, None, False)
    wire.run_scans(4)
    assert not any(master.engine.status.flags)
    assert status.running
    assert status.current == FIXED + 2 * SLOT


def test_a_master_that_starts_again_begins_from_nothing(whole: bool) -> None:
    wire = link(2, whole=whole)
    master, _, second = wire.nodes
    silence(second, on=True)
    wire.run_scans(4)
    master.stop(wire.now)
    # The scan that ended with the data frame just begun is not lost.
    assert [scan.index for scan in scans(wire)] == [0, 1, 2]
    assert master.engine.status.counts[2] == 3
    assert master.engine.status.flags[2]
    wire.run(wire.now + 500 * MS)
    silence(second, on=False)
    begun, before = wire.now, len(master.sent)
    master.start(begun)
    status = master.engine.status
    assert (status.counts, status.codes, status.flags) == ([0] * 8, [0] * 8, [False] * 8)
    assert (status.current, status.longest) == (None, None)
    wire.run_scans(2)
    wire.run(wire.now + DATA_TICKS)
    first, data = master.sent[before : before + 2]
    assert first.frame is not None
    assert (first.frame.kind, first.frame.counter, first.start) == (PARAMETERS, 0, begun + GAP)
    assert data.frame is not None
    assert (data.frame.kind, data.frame.counter) == (DATA, 0)
    assert scans(wire)[-1].index == 0
    assert scans(wire)[-1].duration == FIXED + 2 * SLOT
    engine = master.engine
    assert isinstance(engine, Master)
    assert engine.failed_attempts == {2: {0x01: 3}}  # the run's own count goes on


def test_a_frame_that_is_cut_by_stop_is_damage(whole: bool) -> None:
    wire = link(2, whole=whole)
    wire.run_scans(2)
    master, first, second = wire.nodes
    while not second.sent or second.sent[-1].start < wire.now - DATA_TICKS or second._sending is None:
        wire.run(wire.now + 100)
    wire.run(second.sent[-1].start + 4 * CHAR + 1_000)
    second.stop(wire.now)
    # Begun by a clean STX: fails when the line has been quiet for two characters after the last one heard.
    wire.run_scans(1)
    lost = [event for event in master.events if isinstance(event, StationLost)]
    ends = [event.tick for event in lost]
    assert [event.code for event in lost] == [0x04]
    # 1000 ticks into its fifth character the line goes idle: the rest of that character reads as ones.
    assert ends == [second.sent[-1].start + 5 * CHAR + QUIET]
    assert noted(first) == {}
    wire.run(wire.now + DATA_TICKS)
    assert noted(first) == {2: (1, 0x04)}


# -- modes that a family does not have -----------------------------------------------------------------------


def test_a_slave_refuses_a_mode_that_it_does_not_have(whole: bool) -> None:
    wire = Wire(
        master_node(2, mode=4), slave_node(1, mode=4), slave_node(2, mode=4, modes=(0, 1, 2)), whole=whole
    )
    for node in wire.nodes:
        wire.at(0, lambda node=node: node.start(0))
    wire.run_scans(3)
    master, first, foreign = wire.nodes
    wanted = LinkSettings(2, 4, 0, 5)
    assert foreign.events == [ParametersRefused(GAP + PARAMETERS_TICKS, wanted)]
    assert foreign.engine.state is SlaveState.REFUSING
    assert foreign.sent == []
    assert foreign.stored == []
    assert foreign.engine.deadline() is None
    assert not foreign.engine.status.running
    assert noted(foreign) == {}
    assert noted(master) == {2: (2, 0x01)}
    assert noted(first) == {2: (1, 0x21)}  # the second one falls due with the data frame now on the line


def test_a_reply_that_was_pending_when_the_mode_was_refused_does_not_count_as_an_exchange(
    whole: bool,
) -> None:
    foreign = slave_node(1, 90 * MS, modes=(0,))
    wire = Wire(master_node(1), foreign, whole=whole)
    for node in wire.nodes:
        wire.at(0, lambda node=node: node.start(0))
    wire.run(30 * MS)
    wire.nodes[0].stop(wire.now)
    other = master_node(1, mode=2)
    other.wire = wire
    wire.nodes = (other, foreign)
    other.start(wire.now)
    wire.run(wire.now + 200 * MS)
    assert len(foreign.sent) == 1
    assert foreign.engine.state is SlaveState.REFUSING
    assert not foreign.engine.status.running

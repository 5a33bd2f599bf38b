"""The state tables: nothing happens that is not in them, and everything in them happens."""

from __future__ import annotations

import pytest

from bussim.engines.nn.frames import LinkSettings, encode_data, encode_parameters, encode_poll
from bussim.engines.nn.master import Master, MasterConfig
from bussim.engines.nn.monitor import SlaveConfig
from bussim.engines.nn.slave import Slave
from bussim.engines.nn.states import (
    MASTER,
    SLAVE,
    MasterInput,
    MasterState,
    SlaveInput,
    SlaveState,
)
from tests.engines.diagrams import mermaid
from tests.engines.wire import CHAR, GAP, OVERHEAD, TIMEOUT_UNIT, TURNAROUND

Edge = tuple[MasterState, MasterState] | tuple[SlaveState, SlaveState]


class TracedMaster(Master):
    """Notes every change of state."""

    def __init__(self, config: MasterConfig) -> None:
        self.edges: list[Edge] = []
        super().__init__(config)

    @property
    def state(self) -> MasterState:
        return self._state

    @state.setter
    def state(self, value: MasterState) -> None:
        if hasattr(self, "_state"):
            self.edges.append((self._state, value))
        self._state = value


class TracedSlave(Slave):
    """The same for a slave."""

    def __init__(self, config: SlaveConfig) -> None:
        self.edges: list[Edge] = []
        super().__init__(config)

    @property
    def state(self) -> SlaveState:
        return self._state

    @state.setter
    def state(self, value: SlaveState) -> None:
        if hasattr(self, "_state"):
            self.edges.append((self._state, value))
        self._state = value


SETTINGS = LinkSettings(1, 0, 0, 5)


def traced_master() -> TracedMaster:
    return TracedMaster(MasterConfig(SETTINGS, 2, 5 * TIMEOUT_UNIT, GAP, OVERHEAD))


def traced_slave() -> TracedSlave:
    return TracedSlave(SlaveConfig(1, (0, 1), TIMEOUT_UNIT, TURNAROUND, CHAR))


def send(master: Master) -> None:
    master.image = bytes(8)
    master.begin_transmit(0)
    master.transmit_done(0)


def good_reply(master: Master, counter: int) -> None:
    master.receive_frame(encode_data(1, counter, bytes(8)), 0, 1)


def master_up_to(master: Master, state: MasterState) -> None:
    """From STOP the shortest way to a state."""
    if state is MasterState.STOPPED:
        return
    master.start(0)
    for _ in range(list(MasterState).index(state) - 1):
        send(master)
    assert master.state is state


def test_every_edge_of_the_master_s_table_is_walked_and_no_other() -> None:
    walked: set[Edge] = set()
    master = traced_master()
    master.start(0)  # STOPPED -> PARAMETERS
    send(master)  # -> DATA
    send(master)  # -> POLL
    send(master)  # -> REPLY
    master.on_deadline(1)  # first attempt: -> POLL
    send(master)
    good_reply(master, 0)  # last slave done: -> DATA
    for _ in range(2):
        send(master)
    master.on_deadline(1)
    send(master)
    master.on_deadline(1)  # last attempt failed: -> PARAMETERS
    assert master.state is MasterState.PARAMETERS
    walked.update(master.edges)
    for state in MasterState:
        other = traced_master()
        master_up_to(other, state)
        other.stop(5)
        walked.update(other.edges)
    assert walked == {(state, target) for (state, _), target in MASTER.items()}


def test_every_edge_of_the_slave_s_table_is_walked_and_no_other() -> None:
    parameters = encode_parameters(0, SETTINGS)
    foreign = encode_parameters(0, SETTINGS._replace(mode=4))
    walked: set[Edge] = set()
    ways: list[list[object]] = [
        [],
        ["start"],
        ["start", parameters, parameters],
        ["start", foreign],
        ["start", parameters, foreign],
    ]
    for way in ways:
        slave = traced_slave()
        for step in way:
            if step == "start":
                slave.start(0)
            else:
                slave.receive_frame(step, 0, 1)  # type: ignore[arg-type]
                slave.receive_frame(encode_poll(1, 0), 0, 1)  # no edge anywhere
        slave.stop(5)
        walked.update(slave.edges)
    assert walked == {(state, target) for (state, _), target in SLAVE.items()}


def test_causes_differ_by_where_they_lead() -> None:
    """So that walking every (state, next state) pair is walking every edge."""
    for table in (MASTER, SLAVE):
        pairs = [(state, target) for (state, _), target in table.items()]
        assert len(pairs) == len(set(pairs))


@pytest.mark.parametrize("state", SlaveState)
def test_a_slave_that_refuses_stays_so_until_stop(state: SlaveState) -> None:
    causes = {cause for source, cause in SLAVE if source is state}
    assert SlaveInput.STOP in causes
    if state is SlaveState.REFUSING:
        assert causes == {SlaveInput.STOP}
        slave = traced_slave()
        slave.start(0)
        slave.receive_frame(encode_parameters(0, SETTINGS._replace(mode=4)), 0, 1)
        assert slave.receive_frame(encode_parameters(0, SETTINGS), 0, 1) == 0
        assert slave.receive_frame(encode_poll(1, 0), 0, 1) == 0
        assert slave.status.codes == [0] * 8


def test_every_state_and_input_is_used() -> None:
    assert {state for state, _ in MASTER} == set(MasterState)
    assert {cause for _, cause in MASTER} == set(MasterInput)
    assert {state for state, _ in SLAVE} == set(SlaveState)
    assert {cause for _, cause in SLAVE} == set(SlaveInput)


def test_a_diagram_has_one_line_an_edge() -> None:
    for text, edges in (
        (mermaid(MASTER), [(s, c, t) for (s, c), t in MASTER.items() if c is not MasterInput.STOP]),
        (mermaid(SLAVE), [(s, c, t) for (s, c), t in SLAVE.items() if c is not SlaveInput.STOP]),
    ):
        first, begin, *lines = text.splitlines()
        assert first == "stateDiagram-v2"
        assert begin == "    [*] --> stopped"
        assert sorted(lines) == sorted(f"    {s.value} --> {t.value}: {c.value}" for s, c, t in edges)
        assert len(set(lines)) == len(lines)

"""The finer rules by which a slave listens, frame by frame."""

from __future__ import annotations

import pytest

from bussim.engines.contract import DEADLINE, EVENTS, OPEN, TRANSMIT, Transmit
from bussim.engines.nn.contract import STORED
from bussim.engines.nn.events import ParametersTaken, StationBack, StationLost
from bussim.engines.nn.frames import LinkSettings, encode_data, encode_parameters, encode_poll
from bussim.engines.nn.monitor import NONE_PENDING, SlaveConfig
from bussim.engines.nn.slave import Slave, SlaveState
from tests.engines.nn.links import WATCHDOG
from tests.engines.wire import CHAR, TIMEOUT_UNIT, TURNAROUND

SETTINGS = LinkSettings(3, 0, 0, 5)
IMAGE = bytes(8)


def linked(station: int = 2, counter: int = 4) -> Slave:
    """A slave that has parameters (of the scan with this counter) and whose events are drained."""
    slave = Slave(SlaveConfig(station, (0, 1, 2), TIMEOUT_UNIT, TURNAROUND + 7_200, CHAR))
    slave.start(0)
    assert slave.receive_frame(encode_parameters(counter, SETTINGS), 0, 100) == EVENTS | DEADLINE
    assert slave.poll() == ParametersTaken(100, SETTINGS)
    assert slave.poll() is None
    return slave


def receive_poll(slave: Slave, station: int, counter: int) -> int:
    return slave.receive_frame(encode_poll(station, counter), 200, 300)


def receive_data(slave: Slave, station: int, counter: int) -> int:
    return slave.receive_frame(encode_data(station, counter, IMAGE), 400, 500)


def test_without_a_poll_the_counter_of_the_latest_master_frame_decides() -> None:
    slave = linked(counter=4)
    assert receive_data(slave, 3, 4) == STORED  # of the parameters
    assert receive_data(slave, 3, 3) == 0
    assert receive_data(slave, 3, 5) == 0
    assert receive_data(slave, 0, 5) == STORED  # of the data frame
    assert receive_data(slave, 3, 5) == STORED
    assert receive_data(slave, 3, 4) == 0
    receive_poll(slave, 1, 6)
    assert receive_data(slave, 1, 6) == STORED  # of the poll, and its reply
    assert receive_data(slave, 3, 6) == STORED
    assert slave.status.counts == [0] * 8
    assert slave.poll() is None


def test_without_a_poll_good_data_clear_the_flag() -> None:
    slave = linked()
    slave.status.lost(3, 0x21)
    assert receive_data(slave, 3, 3) == 0
    assert slave.status.flags[3]
    assert receive_data(slave, 3, 4) == STORED | EVENTS
    assert not slave.status.flags[3]
    assert slave.poll() == StationBack(500, 3)


@pytest.mark.parametrize("polled", [None, 1, 2])
def test_what_carries_its_own_number_is_never_stored(polled: int | None) -> None:
    slave = linked(station=2)
    if polled is not None:
        receive_poll(slave, polled, 4)
    before = slave.reception
    assert receive_data(slave, 2, 4) == 0
    assert slave.reception == before  # nor does it reply to any poll


def test_its_own_poll_asks_for_a_reply_and_is_closed_by_it() -> None:
    slave = linked(station=2)
    assert receive_poll(slave, 2, 4) == TRANSMIT
    assert (slave.due, slave.due_counter) == (300, 4)
    assert slave.poll() == Transmit(300, reply=True, counter=4)
    assert slave.reception.pending == 2
    slave.image = IMAGE
    assert slave.begin_transmit(400, 4) == encode_data(2, 4, IMAGE)
    assert not slave.status.running
    assert slave.transmit_done(500) == 0
    assert slave.status.running
    assert slave.reception.pending == ~2
    # The next poll finds nothing to decide.
    assert receive_poll(slave, 3, 4) == 0


def test_no_station_notes_itself() -> None:
    slave = linked(station=2)
    receive_poll(slave, 2, 4)  # its reply is lost
    assert receive_data(slave, 3, 4) == 0
    assert receive_poll(slave, 3, 4) == 0
    assert slave.status.counts == slave.status.codes == [0] * 8


def test_the_master_moves_on_by_another_station_counter_or_its_data_but_not_by_parameters() -> None:
    def checked(step: int) -> bool:
        slave = linked()
        receive_poll(slave, 3, 4)
        if step == 0:
            receive_poll(slave, 1, 4)
        elif step == 1:
            receive_poll(slave, 3, 5)
        elif step == 2:
            receive_data(slave, 0, 5)
        elif step == 3:
            slave.receive_frame(encode_parameters(5, SETTINGS), 400, 500)
        else:
            receive_poll(slave, 3, 4)
        return slave.status.counts[3] == 1

    assert [checked(step) for step in range(5)] == [True, True, True, False, False]


def test_an_exchange_that_had_a_reply_is_good_whatever_follows() -> None:
    slave = linked()
    receive_poll(slave, 3, 4)
    receive_data(slave, 3, 4)
    for disturb in (None, 1, 3):
        receive_poll(slave, 3, 4)  # the master repeats
        if disturb is not None:
            assert receive_data(slave, disturb, 3) == 0  # a wrong station, a wrong counter
    assert receive_poll(slave, 1, 4) == 0
    assert slave.status.counts == [0] * 8
    # The same station with the next counter is another exchange.
    receive_data(slave, 1, 4)
    receive_data(slave, 0, 5)
    receive_poll(slave, 3, 5)
    assert receive_poll(slave, 1, 5) == EVENTS
    assert slave.poll() == StationLost(300, 3, 0x21, new=True)


def test_a_master_that_starts_again_with_the_same_counter_begins_another_exchange() -> None:
    slave = linked(counter=0)
    receive_data(slave, 0, 0)
    receive_poll(slave, 3, 0)
    receive_data(slave, 3, 0)
    slave.receive_frame(encode_parameters(0, SETTINGS), 600, 700)
    assert slave.reception.pending == NONE_PENDING
    receive_data(slave, 0, 0)
    receive_poll(slave, 3, 0)
    receive_data(slave, 0, 1)
    assert slave.status.counts[3] == 1


def test_a_repeated_reply_is_stored_again() -> None:
    slave = linked()
    for _ in range(3):
        receive_poll(slave, 3, 4)
        assert receive_data(slave, 3, 4) == STORED
    assert slave.status.counts == [0] * 8


def test_parameters_of_a_mode_that_it_lacks_end_a_running_link() -> None:
    slave = linked()
    receive_poll(slave, 2, 4)
    slave.begin_transmit(400, 4)
    slave.transmit_done(500)
    hints = slave.receive_frame(encode_parameters(5, SETTINGS._replace(mode=3)), 600, 700)
    assert hints == EVENTS | DEADLINE
    assert slave.state is SlaveState.REFUSING
    assert not slave.status.running
    assert slave.deadline() is None
    assert slave.settings is None
    assert receive_poll(slave, 2, 5) == receive_data(slave, 0, 5) == 0


def test_another_mode_is_taken_over() -> None:
    slave = linked()
    other = SETTINGS._replace(mode=2)
    assert slave.receive_frame(encode_parameters(5, other), 600, 700) == EVENTS | DEADLINE
    assert slave.poll() == ParametersTaken(700, other)
    assert slave.block_size == 24
    assert receive_data(slave, 0, 5) == OPEN  # a frame of the old mode's length is damage now
    assert slave.receive_frame(encode_data(0, 5, bytes(24)), 600, 700) == STORED
    assert slave.watchdog == WATCHDOG + 32 * CHAR
    # The same settings once more are no news.
    assert slave.receive_frame(encode_parameters(6, other), 800, 900) == 0
    assert slave.poll() is None


def test_a_listener_can_go_on_from_another_s_state() -> None:
    one, other = linked(1), linked(2)
    for slave in (one,):
        receive_data(slave, 0, 5)
        receive_poll(slave, 3, 5)
    assert one.steady
    other.resume(one.reception)
    assert other.reception == one.reception
    for slave in (one, other):
        assert receive_data(slave, 3, 5) == STORED
        assert slave.deadline() == 300 + slave.watchdog
    assert one.reception == other.reception
    one.line_idle(600)
    assert one.steady
    one.receive_frame(encode_data(3, 5, bytes(12)), 700, 800)
    assert not one.steady  # half heard
    one.line_idle(900)
    assert not one.steady  # and the master to blame

"""The master: one transaction at a time, how it waits and when it stops waiting."""

from __future__ import annotations

import pytest

from bussim.engines.contract import EVENTS, OPEN, Engine, RxChar, Transmit
from bussim.engines.modbus.adu import Adu, Mode, encode_adu
from bussim.engines.modbus.codes import PortError
from bussim.engines.modbus.events import ForeignFrame, FrameRejected, MasterEvent, TransactionEnded
from bussim.engines.modbus.master import Master, MasterConfig
from bussim.engines.modbus.pdu import (
    Request,
    Response,
    encode_request,
    encode_response,
    write_register,
)
from bussim.engines.modbus.states import MASTER, MasterInput, MasterState
from tests.engines.modbus.benches import ASCII, GOOD, MS, READ, RTU, Bench, both_modes, outcome
from tests.engines.modbus.frames import EXCHANGE_IDS, EXCHANGES, RS2_REQUESTS, Exchange
from tests.engines.modbus.wire import ASCII_LINE, RTU_LINE, drain, receive_by_character


def test_keeps_the_contract() -> None:
    engine: Engine[Adu, MasterEvent] = Master(MasterConfig(RTU, 100 * MS))
    assert engine.deadline() is None


@pytest.mark.parametrize("exchange", EXCHANGES, ids=EXCHANGE_IDS)
@both_modes
@pytest.mark.parametrize("whole", [True, False])
@pytest.mark.parametrize("before", ["nothing", "junk", "another station", "half a frame"])
def test_every_printed_exchange(exchange: Exchange, mode: Mode, before: str, *, whole: bool) -> None:
    bench = Bench(mode, exchange.station, exchange.request)
    master, framing = bench.master, bench.framing
    response = bench.adu(encode_response(exchange.response), exchange.station)
    if mode is Mode.RTU:
        assert response.chars == exchange.response_chars
    noise = {
        "nothing": b"",
        "junk": b"\x00\xff:\x13",
        "another station": bench.adu(encode_response(exchange.response), exchange.station + 1).chars,
        "half a frame": bench.adu(encode_response(exchange.response), 99).chars[: len(response.chars) // 2],
    }[before]
    if noise:
        assert not any(isinstance(event, TransactionEnded) for event in bench.receive(noise))
    start = bench.now
    end = start + bench.line.characters(len(response.chars))
    if whole:
        hints = master.receive_frame(response, start, end)
        decided = end
        if mode is Mode.RTU:
            assert hints & OPEN
            decided = end + framing.quiet
            hints = master.line_idle(decided)
        assert hints & EVENTS
    else:
        receive_by_character(master, response.chars, start, bench.line)
        decided = end
        if mode is Mode.RTU:
            decided = end + framing.quiet
            master.line_idle(decided)
    ended = [event for event in drain(master) if isinstance(event, TransactionEnded)]
    assert ended == [
        TransactionEnded(
            1,
            exchange.station,
            exchange.request,
            0,
            bench.asked,
            start,
            end,
            decided,
            None,
            0,
            exchange.response,
        )
    ]
    assert master.idle
    assert master.deadline() is None
    assert master.heard == response
    assert master.heard_start == start


@pytest.mark.parametrize(("station", "request_", "chars"), RS2_REQUESTS)
def test_rs2_examples_on_the_wire(station: int, request_: Request, chars: bytes) -> None:
    master = Master(MasterConfig(RTU, 100 * MS))
    master.start(0)
    master.submit(station, request_, 0)
    assert master.begin_transmit(0).chars == chars


# -- what does not end the wait --------------------------------------------------------------------


@both_modes
def test_another_stations_reply_before_mine(mode: Mode) -> None:
    bench = Bench(mode)
    foreign = bench.adu(encode_response(GOOD), station=2)
    events = bench.receive(foreign.chars)
    assert [type(event) for event in events] == [ForeignFrame]
    assert events[0].station == 2
    assert outcome(bench.receive(bench.adu(encode_response(GOOD)).chars)) == (None, 0, GOOD)


@both_modes
def test_another_stations_reply_alone_is_no_response(mode: Mode) -> None:
    bench = Bench(mode)
    bench.receive(bench.adu(encode_response(GOOD), station=2).chars)
    assert outcome(bench.until_timeout())[0] is PortError.TIMEOUT


def test_noise_alone_is_named_when_the_time_is_over() -> None:
    bench = Bench()
    events = bench.receive(b"\x42\x42\x42\x42\x42")
    assert [type(event) for event in events] == [FrameRejected]
    assert outcome(bench.until_timeout())[0] is PortError.CHECK
    bench = Bench()
    bench.receive(b"\x42")
    assert outcome(bench.until_timeout())[0] is PortError.LENGTH


def test_a_late_response_to_the_last_request_is_taken() -> None:
    """RTU carries no transaction number: who compares the ticks finds it out, the master cannot."""
    bench = Bench()
    bench.until_timeout()
    master = bench.master
    master.submit(1, Request(3, 0x40, 2), bench.asked + 110 * MS)
    frame = master.begin_transmit(bench.asked + 110 * MS)
    asked = bench.asked + 110 * MS + RTU_LINE.characters(len(frame.chars))
    master.transmit_done(asked)
    bench.now = asked + RTU.quiet
    error, _, response = outcome(bench.receive(bench.adu(encode_response(GOOD)).chars))
    assert error is None
    assert response == Response(3, 0x40, 2, (180, 8))


def test_it_hears_nothing_unless_it_waits() -> None:
    master = Master(MasterConfig(RTU, 100 * MS))
    response = encode_adu(Mode.RTU, 1, encode_response(GOOD))
    assert master.receive_frame(response, 0, 1000) == 0
    master.start(0)
    assert receive_by_character(master, response.chars, 0, RTU_LINE)[0] == 0
    master.submit(1, READ, 0)
    assert receive_by_character(master, response.chars, 0, RTU_LINE)[0] == 0
    master.begin_transmit(0)
    assert receive_by_character(master, response.chars, 0, RTU_LINE)[0] == 0
    assert [type(item) for item in drain(master)] == []


# -- the timeout -----------------------------------------------------------------------------------


def response_ending(bench: Bench, end: int) -> None:
    response = bench.adu(encode_response(GOOD))
    receive_by_character(
        bench.master, response.chars, end - bench.line.characters(len(response.chars)), bench.line
    )


def test_a_response_is_in_time_if_its_last_stop_bit_is() -> None:
    bench = Bench()
    deadline = bench.asked + 100 * MS
    response_ending(bench, deadline)
    assert bench.master.on_deadline(deadline) & OPEN
    assert drain(bench.master) == []
    bench.master.line_idle(deadline + RTU.quiet)
    assert outcome(drain(bench.master)) == (None, 0, GOOD)


def test_a_response_that_goes_on_behind_the_timeout_is_late() -> None:
    bench = Bench()
    deadline = bench.asked + 100 * MS
    response = bench.adu(encode_response(GOOD))
    begin = deadline + 1 - RTU_LINE.characters(len(response.chars))
    _, at = receive_by_character(bench.master, response.chars[:-1], begin, RTU_LINE)
    bench.master.on_deadline(deadline)
    bench.master.receive(RxChar(response.chars[-1]), at, deadline + 1)
    events = drain(bench.master)
    assert outcome(events) == (PortError.TIMEOUT, 0, None)
    assert events[0].end == deadline + 1


def test_ascii_needs_no_silence_and_is_late_at_once() -> None:
    bench = Bench(Mode.ASCII)
    deadline = bench.asked + 100 * MS
    response = bench.adu(encode_response(GOOD))
    receive_by_character(bench.master, response.chars[:-1], deadline - 10 * MS, ASCII_LINE)
    bench.master.on_deadline(deadline)
    assert outcome(drain(bench.master))[0] is PortError.TIMEOUT


@both_modes
def test_begun_holds_waits_for_a_response_that_has_begun(mode: Mode) -> None:
    bench = Bench(mode, begun_holds=True)
    deadline = bench.asked + 100 * MS
    response = bench.adu(encode_response(GOOD))
    _, at = receive_by_character(bench.master, response.chars[:3], deadline - 5 * MS, bench.line)
    assert bench.master.on_deadline(deadline) & OPEN
    bench.now = at
    assert outcome(bench.receive(response.chars[3:])) == (None, 0, GOOD)


def test_begun_holds_does_not_wait_for_silence() -> None:
    bench = Bench(begun_holds=True)
    assert outcome(bench.until_timeout())[0] is PortError.TIMEOUT


@both_modes
def test_begun_holds_ends_with_what_has_begun(mode: Mode) -> None:
    bench = Bench(mode, begun_holds=True)
    bench.now = bench.asked + 100 * MS - 2 * MS
    start = b"\x42\x43" if mode is Mode.RTU else b":4243"
    bench.receive(start, quiet=False)
    bench.master.on_deadline(bench.asked + 100 * MS)
    bench.master.line_idle(bench.now + bench.framing.quiet)
    assert outcome(drain(bench.master))[0] is PortError.LENGTH
    assert bench.master.idle


# -- interval, broadcast, states -------------------------------------------------------------------


def test_the_interval_counts_from_the_end_of_a_transaction() -> None:
    bench = Bench(interval=20 * MS)
    events = bench.receive(bench.adu(encode_response(GOOD)).chars)
    assert bench.master.ready_at == events[-1].end + 20 * MS
    bench.master.submit(1, READ, bench.now + 1 * MS)
    assert drain(bench.master) == [Transmit(events[-1].end + 20 * MS, counter=2)]


def test_default_interval_is_5_ms_and_turnaround_100_ms() -> None:
    config = MasterConfig(RTU, 100 * MS)
    assert (config.interval, config.turnaround) == (5 * MS, 100 * MS)


@both_modes
def test_broadcast_waits_its_turnaround(mode: Mode) -> None:
    bench = Bench(mode, station=0, request=write_register(1, 2), turnaround=150 * MS)
    assert bench.master.state is MasterState.TURNAROUND
    assert bench.master.deadline() == bench.asked + 150 * MS
    assert bench.receive(bench.adu(encode_response(GOOD)).chars) == []  # a broadcast has no response
    bench.master.on_deadline(bench.asked + 150 * MS)
    assert drain(bench.master) == [
        TransactionEnded(
            1, 0, write_register(1, 2), 0, bench.asked, None, None, bench.asked + 150 * MS, None, 0, None
        )
    ]
    assert bench.master.idle


def test_one_transaction_at_a_time() -> None:
    bench = Bench()
    with pytest.raises(RuntimeError, match="the master is reply, a transaction needs it idle"):
        bench.master.submit(1, READ, bench.asked)
    with pytest.raises(RuntimeError, match="the master is stopped"):
        Master(MasterConfig(RTU, 100 * MS)).submit(1, READ, 0)


def test_stop_forgets_everything() -> None:
    bench = Bench()
    bench.receive(b"\x01\x03", quiet=False)
    bench.master.stop(bench.now)
    assert bench.master.deadline() is None
    assert bench.master.line_idle(bench.now + RTU.quiet) == 0
    assert drain(bench.master) == []
    bench.master.start(bench.now + 5)
    assert bench.master.idle


def test_stop_while_sending() -> None:
    master = Master(MasterConfig(RTU, 100 * MS))
    master.start(0)
    master.submit(1, READ, 0)
    master.begin_transmit(0)
    master.stop(10)
    assert master.transmit_done(20) == 0
    assert master.deadline() is None


def test_request_bytes_are_those_of_the_codec() -> None:
    master = Master(MasterConfig(ASCII, 100 * MS))
    master.start(0)
    master.submit(6, Request(3, 107, 3), 0)
    assert master.begin_transmit(0) == encode_adu(Mode.ASCII, 6, encode_request(Request(3, 107, 3)))


def test_table_of_states_is_closed() -> None:
    """Every state can be reached and left, and stopping is possible from everywhere."""
    assert set(MASTER.values()) == set(MasterState)
    assert {state for state, _ in MASTER} == set(MasterState)
    for state in MasterState:
        assert MASTER[state, MasterInput.STOP] is MasterState.STOPPED

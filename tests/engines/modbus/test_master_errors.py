"""The master's errors: each code of D8063 by the event that defines it."""

from __future__ import annotations

import pytest

from bussim.engines.contract import EVENTS, RxChar
from bussim.engines.modbus.adu import Mode
from bussim.engines.modbus.codes import PortError, Rejection
from bussim.engines.modbus.events import FrameRejected, TransactionEnded
from bussim.engines.modbus.master import Master, MasterConfig, refusal
from bussim.engines.modbus.pdu import (
    Request,
    Response,
    encode_exception,
    encode_response,
    write_coil,
    write_coils,
    write_register,
    write_registers,
)
from tests.engines.modbus.benches import ASCII, GOOD, MS, READ, RTU, Bench, both_modes, outcome
from tests.engines.modbus.wire import drain, receive_by_character

# -- each error code by its event ------------------------------------------------------------------


@both_modes
@pytest.mark.parametrize(
    ("code", "error"),
    [
        (1, PortError.FUNCTION),
        (2, PortError.ADDRESS),
        (3, PortError.DATA),
        (4, PortError.DATA),
        (0, PortError.DATA),
    ],
)
def test_exception_responses(mode: Mode, code: int, error: PortError) -> None:
    bench = Bench(mode)
    assert outcome(bench.receive(bench.adu(encode_exception(3, code)).chars)) == (error, code, None)


@both_modes
@pytest.mark.parametrize("values", [(180,), (180, 8, 9)])
def test_1_response_shorter_or_longer(mode: Mode, values: tuple[int, ...]) -> None:
    bench = Bench(mode)
    sound = bench.adu(encode_response(Response(3, 0, len(values), values)))
    assert outcome(bench.receive(sound.chars)) == (PortError.LENGTH, 0, None)


@both_modes
def test_1_response_torn_off(mode: Mode) -> None:
    bench = Bench(mode)
    chars = bench.adu(encode_response(GOOD)).chars
    if mode is Mode.RTU:
        assert outcome(bench.receive(chars[:-1]))[0] is PortError.LENGTH
    else:
        bench.receive(chars[:-2])
        assert bench.master.line_idle(bench.now + ASCII.quiet) & EVENTS
        assert outcome(drain(bench.master))[0] is PortError.LENGTH


def test_1_exception_response_of_a_wrong_length() -> None:
    bench = Bench()
    assert outcome(bench.receive(bench.adu(b"\x83\x02\x00").chars))[0] is PortError.LENGTH
    bench = Bench()
    assert outcome(bench.receive(b"\x01\x83\x02\x00\x00\x00"))[0] is PortError.LENGTH  # and a wrong CRC


def test_1_silence_inside_the_response() -> None:
    bench = Bench()
    chars = bench.adu(encode_response(GOOD)).chars
    bench.receive(chars[:4], quiet=False)
    events = bench.receive(chars[4:], gap=RTU.inner + 1)
    assert outcome(events)[0] is PortError.LENGTH
    assert isinstance(events[0], FrameRejected)
    assert events[0].reason is Rejection.GAP


@both_modes
def test_2_echo_of_another_address(mode: Mode) -> None:
    bench = Bench(mode, request=write_register(5, 7))
    events = bench.receive(bench.adu(encode_response(Response(6, 4, 1, (7,)))).chars)
    assert outcome(events)[0] is PortError.ADDRESS


@both_modes
def test_3_wrong_check(mode: Mode) -> None:
    bench = Bench(mode)
    chars = bytearray(bench.adu(encode_response(GOOD)).chars)
    chars[-4 if mode is Mode.RTU else -6] ^= 1
    assert outcome(bench.receive(bytes(chars))) == (PortError.CHECK, 0, None)


def test_3_exception_response_with_a_wrong_check() -> None:
    bench = Bench()
    assert outcome(bench.receive(b"\x01\x83\x02\x00\x00"))[0] is PortError.CHECK


@both_modes
def test_5_parity_and_8_framing(mode: Mode) -> None:
    for parity_ok, stop_ok, error in [(False, True, PortError.RECEPTION), (True, False, PortError.FRAMING)]:
        bench = Bench(mode)
        chars = bench.adu(encode_response(GOOD)).chars
        _, at = receive_by_character(bench.master, chars[:5], bench.now, bench.line)
        bench.master.receive(RxChar(chars[5], parity_ok, stop_ok), at, at := at + bench.line.characters(1))
        _, bench.now = receive_by_character(bench.master, chars[6:], at, bench.line)
        bench.master.line_idle(bench.now + RTU.quiet)
        assert outcome(drain(bench.master))[0] is error


@both_modes
@pytest.mark.parametrize(
    "response",
    [
        Response(16, 5, 3),  # another quantity
        Response(15, 5, 2),  # another function
    ],
)
def test_6_echo_of_something_else(mode: Mode, response: Response) -> None:
    bench = Bench(mode, request=write_registers(5, (7, 8)))
    assert outcome(bench.receive(bench.adu(encode_response(response)).chars))[0] is PortError.DATA


def test_6_echo_of_another_value() -> None:
    bench = Bench(request=write_coil(5, on=True))
    assert outcome(bench.receive(bench.adu(b"\x05\x00\x05\x00\x00").chars))[0] is PortError.DATA


@both_modes
def test_7_more_than_256_bytes(mode: Mode) -> None:
    bench = Bench(mode)
    stream = b"\x55" * 257 if mode is Mode.RTU else b":" + b"5" * 513
    _, bench.now = receive_by_character(bench.master, stream, bench.now, bench.line)
    assert outcome(drain(bench.master))[0] is PortError.OVERFLOW
    assert bench.master.idle


def test_9_no_response() -> None:
    bench = Bench()
    events = bench.until_timeout()
    assert outcome(events) == (PortError.TIMEOUT, 0, None)
    assert events[0].end == bench.asked + 100 * MS
    assert (events[0].answer_start, events[0].answer_end) == (None, None)


@pytest.mark.parametrize(
    ("station", "request_", "error"),
    [
        (248, READ, PortError.STATION),
        (1, Request(8, 0, 1), PortError.FUNCTION),
        (1, Request(0, 0, 1), PortError.FUNCTION),
        (0, READ, PortError.FUNCTION),  # a read cannot be broadcast
        (1, Request(3, 0, 126), PortError.DATA),
        (1, Request(3, 0, 0), PortError.DATA),
        (1, Request(1, 0, 2001), PortError.DATA),
        (1, write_coils(0, (1,) * 1969), PortError.DATA),
        (1, write_registers(0, (1,) * 124), PortError.DATA),
        (1, Request(3, 0xFFFF, 2), PortError.ADDRESS),
    ],
)
def test_what_rs2_cannot_send(station: int, request_: Request, error: PortError) -> None:
    assert refusal(station, request_) is error
    master = Master(MasterConfig(RTU, 100 * MS))
    master.start(0)
    assert master.submit(station, request_, 7) == EVENTS
    assert drain(master) == [
        TransactionEnded(1, station, request_, None, None, None, None, 7, error, 0, None)
    ]
    assert master.idle


def test_limits_are_allowed() -> None:
    for request in [
        Request(1, 0, 2000),
        Request(4, 0xFFFF, 1),
        write_coils(0, (1,) * 1968),
        write_registers(0, (1,) * 123),
    ]:
        assert refusal(247, request) is None
    assert refusal(0, write_register(0, 1)) is None

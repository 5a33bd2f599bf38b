"""The V80: its functions, limits and broadcast rules."""

from __future__ import annotations

import pytest

from bussim.devices.map.model import MAP_PORT
from bussim.devices.v80.map import V80, V80_PORT
from bussim.engines.modbus.adu import Mode
from bussim.engines.modbus.pdu import (
    Request,
    encode_response,
    write_coil,
    write_coils,
    write_register,
    write_registers,
)
from bussim.engines.modbus.server import Space, serve
from bussim.engines.modbus.slave import Slave
from bussim.line.characters import CharFormat, LineTiming
from tests.devices.ask import ask, code, slave_config
from tests.engines.modbus.frames import ASCII_REQUEST, ASCII_RESPONSE, EXCHANGES
from tests.engines.modbus.wire import ASCII_LINE, RTU_LINE, drain, receive_by_character


@pytest.mark.parametrize("exchange", [e for e in EXCHANGES if e.what.startswith("V80")])
def test_every_example_of_the_manual(exchange: object) -> None:
    device = V80()
    request, response = exchange.request, exchange.response
    space = {1: Space.COILS, 3: Space.HOLDING}.get(request.function)
    if space is not None:
        for number, value in enumerate(response.values):
            device.set(space, request.address + number, value)
    slave = Slave(slave_config(V80_PORT, Mode.RTU, RTU_LINE), {exchange.station: device})
    slave.start(0)
    _, end = receive_by_character(slave, exchange.request_chars, 0, RTU_LINE)
    slave.line_idle(end + slave.quiet)
    assert slave.begin_transmit(end + slave.quiet).chars == exchange.response_chars
    for number, value in enumerate(request.values if request.function != 5 else (1,)):
        space = Space.COILS if request.function in (5, 15) else Space.HOLDING
        assert device.get(space, request.address + number) == value


def test_ascii_example() -> None:
    device = V80()
    for address in range(107, 110):
        device.set(Space.HOLDING, address, 0x63)
    slave = Slave(slave_config(V80_PORT, Mode.ASCII, ASCII_LINE), {6: device})
    slave.start(0)
    receive_by_character(slave, ASCII_REQUEST, 0, ASCII_LINE)
    assert slave.begin_transmit(0).chars == ASCII_RESPONSE


def test_ascii_with_eight_data_bits() -> None:
    line = LineTiming(9600, CharFormat(8, "N", 1))
    slave = Slave(slave_config(V80_PORT, Mode.ASCII, line), {6: V80()})
    slave.start(0)
    receive_by_character(slave, ASCII_REQUEST, 0, line)
    assert slave.begin_transmit(0).chars.startswith(b":060306")


def test_packing_lowest_coil_in_bit_0() -> None:
    device = V80()
    for number in range(8):
        device.set(Space.COILS, number, 0x56 >> number & 1)
    request = Request(1, 1, 3)  # three coils from 0002 on
    assert ask(device, request) == (1, 1, 0)
    assert encode_response(serve(device, request, 0)) == b"\x01\x01\x03"


def test_coil_00127_is_address_126_and_register_40108_is_107() -> None:
    device = V80()
    device.set(Space.COILS, 126, 1)
    assert ask(device, Request(1, 0x7E, 1)) == (1,)
    device.set(Space.HOLDING, 107, 555)
    assert ask(device, Request(3, 0x6B, 1)) == (555,)


def test_all_eight_functions() -> None:
    device = V80()
    device.set(Space.INPUTS, 3, 1)
    device.set(Space.INPUT_REGISTERS, 3, 0x12345)
    assert ask(device, Request(2, 3, 1)) == (1,)
    assert ask(device, Request(4, 3, 1)) == (0x2345,)
    assert code(device, write_coil(0, on=True)) == 0
    assert code(device, write_register(0, 7)) == 0
    assert code(device, write_coils(1, (1, 1))) == 0
    assert code(device, write_registers(1, (8, 9))) == 0
    assert ask(device, Request(1, 0, 4)) == (1, 1, 1, 0)
    assert ask(device, Request(3, 0, 4)) == (7, 8, 9, 0)


@pytest.mark.parametrize(
    ("request_", "expected"),
    [
        (Request(1, 0, 1024), 0),
        (Request(1, 0, 1025), 3),
        (Request(3, 0, 125), 0),
        (Request(3, 0, 126), 3),
        (Request(1, 9998, 1), 0),  # coil 09999
        (Request(1, 9999, 1), 2),
        (Request(3, 9998, 2), 2),
    ],
)
def test_limits(request_: Request, expected: int) -> None:
    assert code(V80(), request_) == expected


@pytest.mark.parametrize("word", [0x0001, 0xFF01, 0x00FF])
def test_another_value_leaves_the_coil_alone(word: int) -> None:
    device = V80()
    device.set(Space.COILS, 5, 1)
    assert code(device, Request(5, 5, 1, (word,))) == 3
    assert device.get(Space.COILS, 5) == 1


def test_broadcast() -> None:
    device = V80()
    config = slave_config(V80_PORT, Mode.ASCII, ASCII_LINE)
    slave = Slave(config, {6: device})
    slave.start(0)
    receive_by_character(slave, config.framing.encode(0, b"\x05\x00\x07\xff\x00").chars, 0, ASCII_LINE)
    assert device.get(Space.COILS, 7) == 1
    assert slave.due == -1
    for read in (b"\x01\x00\x00\x00\x01", b"\x03\x00\x00\x00\x01"):
        drain(slave)
        receive_by_character(slave, config.framing.encode(0, read).chars, 0, ASCII_LINE)
        assert slave.due == -1


def test_a_frame_with_a_pause_of_four_characters_ends_only_after_four_and_a_half() -> None:
    """To a standard slave the same silence ends the frame."""
    frame = EXCHANGES[4].request_chars
    silence = RTU_LINE.characters(4)
    for port, served in [(V80_PORT, False), (MAP_PORT, True)]:
        slave = Slave(slave_config(port, Mode.RTU, RTU_LINE), {6: V80()})
        slave.start(0)
        _, end = receive_by_character(slave, b"\x42\x42", 0, RTU_LINE)
        _, end = receive_by_character(slave, frame, end + silence, RTU_LINE)
        slave.line_idle(end + slave.quiet)
        assert (slave.due >= 0) == served

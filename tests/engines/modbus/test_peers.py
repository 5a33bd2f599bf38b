"""The codec against two of other projects: pymodbus and minimalmodbus, over thousands of random PDUs."""

from __future__ import annotations

import os
import random
from typing import Any

import pytest

from bussim.engines.modbus.adu import Adu, Mode, decode_ascii, decode_rtu, encode_adu
from bussim.engines.modbus.pdu import (
    ExceptionResponse,
    Request,
    Response,
    decode_request,
    decode_response,
    encode_exception,
    encode_request,
    encode_response,
    write_coil,
    write_coils,
    write_register,
    write_registers,
)

COUNT = 3000
both_modes = pytest.mark.parametrize("mode", list(Mode))


def peer(name: str) -> Any:
    """A module that CI must have, and others may lack."""
    if os.environ.get("CI"):
        return __import__(name, fromlist=["*"])
    return pytest.importorskip(name)


def random_request(rng: random.Random) -> Request:
    function = rng.choice([1, 2, 3, 4, 5, 6, 15, 16])
    address = rng.randrange(0x10000)
    small = rng.random() < 0.8  # long ones cost time and show little more
    if function in (1, 2):
        return Request(function, address, rng.randint(1, 40 if small else 2000))
    if function in (3, 4):
        return Request(function, address, rng.randint(1, 10 if small else 125))
    if function == 5:
        return write_coil(address, on=rng.random() < 0.5)
    if function == 6:
        return write_register(address, rng.randrange(0x10000))
    if function == 15:
        return write_coils(address, rng.choices((0, 1), k=rng.randint(1, 40 if small else 1968)))
    return write_registers(
        address, (rng.randrange(0x10000) for _ in range(rng.randint(1, 10 if small else 123)))
    )


def random_response(rng: random.Random, request: Request) -> Response:
    function, address, quantity, values = request
    if function in (1, 2):
        return Response(function, address, quantity, tuple(rng.choices((0, 1), k=quantity)))
    if function in (3, 4):
        return Response(function, address, quantity, tuple(rng.randrange(0x10000) for _ in range(quantity)))
    return Response(function, address, quantity, values if function in (5, 6) else ())


def ours(mode: Mode, chars: bytes) -> Adu:
    adu = decode_rtu(chars) if mode is Mode.RTU else decode_ascii(chars)
    assert isinstance(adu, Adu), (chars, adu)
    return adu


# -- pymodbus --------------------------------------------------------------------------------------


def pymodbus_framer(mode: Mode, *, server: bool) -> Any:
    framer = peer("pymodbus.framer")
    decoder = peer("pymodbus.pdu").DecodePDU(server)
    return (framer.FramerRTU if mode is Mode.RTU else framer.FramerAscii)(decoder)


def to_pymodbus(station: int, item: Request | Response, *, response: bool) -> Any:
    """Their object for what ours means."""
    bits, registers = peer("pymodbus.pdu.bit_message"), peer("pymodbus.pdu.register_message")
    function, address, quantity, values = item
    name = {
        1: "ReadCoils",
        2: "ReadDiscreteInputs",
        3: "ReadHoldingRegisters",
        4: "ReadInputRegisters",
        5: "WriteSingleCoil",
        6: "WriteSingleRegister",
        15: "WriteMultipleCoils",
        16: "WriteMultipleRegisters",
    }[function] + ("Response" if response else "Request")
    kind = getattr(bits if function in (1, 2, 5, 15) else registers, name)
    if function in (1, 2) and response:
        return kind(dev_id=station, bits=[bool(bit) for bit in values])
    if function in (3, 4) and response:
        return kind(dev_id=station, registers=list(values))
    if function in (1, 2, 3, 4) or (response and function in (15, 16)):
        theirs = kind(dev_id=station, address=address)
        theirs.count = quantity
        return theirs
    if function == 5:
        return kind(dev_id=station, address=address, bits=[values[0] == 0xFF00])
    if function == 15:
        return kind(dev_id=station, address=address, bits=[bool(bit) for bit in values])
    return kind(dev_id=station, address=address, registers=list(values))


def from_pymodbus(theirs: Any, asked: Request | None) -> Request | Response:
    """What their object means, as ours."""
    function, address = theirs.function_code, theirs.address
    bits = tuple(int(bit) for bit in theirs.bits)
    words = tuple(theirs.registers)
    kind = Request if asked is None else Response
    if function in (1, 2, 3, 4):
        if asked is None:
            return Request(function, address, theirs.count)
        return Response(function, asked.address, asked.quantity, bits[: asked.quantity] or words)
    if function == 5:
        return kind(function, address, 1, (0xFF00 if bits[0] else 0,))
    if function == 6:
        return kind(function, address, 1, words)
    if asked is not None:
        return Response(function, address, theirs.count)
    return Request(function, address, theirs.count, bits or words)


@both_modes
def test_pymodbus_requests_both_directions(mode: Mode) -> None:
    rng = random.Random(f"requests {mode}")
    framer = pymodbus_framer(mode, server=True)
    for _ in range(COUNT):
        station, request = rng.randint(1, 247), random_request(rng)
        adu = encode_adu(mode, station, encode_request(request))
        assert framer.buildFrame(to_pymodbus(station, request, response=False)) == adu.chars
        used, theirs = framer.handleFrame(adu.chars, 0, 0)
        assert used == len(adu.chars)
        assert (theirs.dev_id, from_pymodbus(theirs, None)) == (station, request)
        assert decode_request(ours(mode, adu.chars).pdu) == request


@both_modes
def test_pymodbus_responses_both_directions(mode: Mode) -> None:
    rng = random.Random(f"responses {mode}")
    framer = pymodbus_framer(mode, server=False)
    for _ in range(COUNT):
        station, request = rng.randint(1, 247), random_request(rng)
        response = random_response(rng, request)
        adu = encode_adu(mode, station, encode_response(response))
        assert framer.buildFrame(to_pymodbus(station, response, response=True)) == adu.chars
        used, theirs = framer.handleFrame(adu.chars, 0, 0)
        assert used == len(adu.chars)
        assert (theirs.dev_id, from_pymodbus(theirs, request)) == (station, response)
        assert decode_response(ours(mode, adu.chars).pdu, request) == response


@both_modes
def test_pymodbus_exceptions_both_directions(mode: Mode) -> None:
    rng = random.Random(f"exceptions {mode}")
    framer = pymodbus_framer(mode, server=False)
    refusal = peer("pymodbus.pdu").ExceptionResponse
    for _ in range(500):
        station, function, code = rng.randint(1, 247), rng.randint(1, 127), rng.randint(1, 255)
        adu = encode_adu(mode, station, encode_exception(function, code))
        assert framer.buildFrame(refusal(function, code, station)) == adu.chars
        _, theirs = framer.handleFrame(adu.chars, 0, 0)
        assert (theirs.dev_id, theirs.function_code, theirs.exception_code) == (station, function | 128, code)
        assert decode_response(ours(mode, adu.chars).pdu) == ExceptionResponse(function, code)


@both_modes
def test_pymodbus_and_we_refuse_the_same_damage(mode: Mode) -> None:
    rng = random.Random(f"damage {mode}")
    framer = pymodbus_framer(mode, server=True)
    for _ in range(1000):
        chars = bytearray(encode_adu(mode, rng.randint(1, 247), encode_request(random_request(rng))).chars)
        # The data, where no framing depends on the character's value.
        index = rng.randrange(7, len(chars) - 4) if mode is Mode.ASCII else rng.randrange(2, 6)
        if mode is Mode.ASCII:
            chars[index] = rng.choice([c for c in b"0123456789ABCDEF" if c != chars[index]])
        else:
            chars[index] ^= 1 << rng.randrange(8)
        _, theirs = framer.handleFrame(bytes(chars), 0, 0)
        decoded = decode_rtu(bytes(chars)) if mode is Mode.RTU else decode_ascii(bytes(chars))
        assert theirs is None
        assert not isinstance(decoded, Adu)


# -- minimalmodbus ---------------------------------------------------------------------------------


def minimalmodbus_payload(mini: Any, request: Request) -> bytes:
    """Their payload of a request."""
    function, address, quantity, values = request
    form = mini._Payloadformat
    formats = {1: form.BITS, 2: form.BITS, 3: form.REGISTERS, 4: form.REGISTERS}
    formats |= {5: form.BIT, 6: form.REGISTER, 15: form.BITS, 16: form.REGISTERS}
    value: Any = None
    if function == 5:
        value = int(values[0] == 0xFF00)
    elif function == 6:
        value = values[0]
    elif function in (15, 16):
        value = list(values)
    bits = function in (1, 2, 5, 15)
    return mini._create_payload(
        function,
        address,
        value,
        0,
        0 if bits else quantity,
        quantity if bits else 0,
        False,
        0,
        formats[function],
    )


@both_modes
def test_minimalmodbus_requests(mode: Mode) -> None:
    mini = peer("minimalmodbus")
    rng = random.Random(f"mini requests {mode}")
    name = mini.MODE_RTU if mode is Mode.RTU else mini.MODE_ASCII
    for _ in range(COUNT):
        station, request = rng.randint(1, 247), random_request(rng)
        payload = minimalmodbus_payload(mini, request)
        theirs = mini._embed_payload(station, name, request.function, payload)
        adu = encode_adu(mode, station, encode_request(request))
        assert theirs == adu.chars
        assert decode_request(ours(mode, theirs).pdu) == request
        assert mini._extract_payload(adu.chars, station, name, request.function) == adu.pdu[1:]


@both_modes
def test_minimalmodbus_responses(mode: Mode) -> None:
    mini = peer("minimalmodbus")
    rng = random.Random(f"mini responses {mode}")
    name = mini.MODE_RTU if mode is Mode.RTU else mini.MODE_ASCII
    form = mini._Payloadformat
    for _ in range(COUNT):
        station, request = rng.randint(1, 247), random_request(rng)
        response = random_response(rng, request)
        adu = encode_adu(mode, station, encode_response(response))
        payload = mini._extract_payload(adu.chars, station, name, request.function)
        assert mini._embed_payload(station, name, request.function, payload) == adu.chars
        assert decode_response(ours(mode, adu.chars).pdu, request) == response
        function, address, quantity, values = request
        if function in (1, 2, 3, 4):
            bits = function < 3
            got = mini._parse_payload(
                payload,
                function,
                address,
                None,
                0,
                0 if bits else quantity,
                quantity if bits else 0,
                False,
                0,
                form.BITS if bits else form.REGISTERS,
            )
            assert tuple(got) == response.values
        elif quantity <= 125:  # their check of an echo must be content; it takes 125 for coils, too
            value = (
                int(values[0] == 0xFF00) if function == 5 else values[0] if function == 6 else list(values)
            )
            mini._check_response_payload(
                payload,
                function,
                address,
                value,
                0,
                quantity if function == 16 else 1,
                quantity if function == 15 else 1,
                False,
                0,
                {5: form.BIT, 6: form.REGISTER, 15: form.BITS, 16: form.REGISTERS}[function],
            )


@both_modes
def test_minimalmodbus_exceptions(mode: Mode) -> None:
    mini = peer("minimalmodbus")
    rng = random.Random(f"mini exceptions {mode}")
    name = mini.MODE_RTU if mode is Mode.RTU else mini.MODE_ASCII
    for _ in range(500):
        station, function = rng.randint(1, 247), rng.choice([1, 2, 3, 4, 5, 6, 15, 16])
        chars = encode_adu(mode, station, encode_exception(function, rng.randint(1, 4))).chars
        with pytest.raises(mini.SlaveReportedException):
            mini._extract_payload(chars, station, name, function)


def test_minimalmodbus_silences() -> None:
    """Their silent period is ours at 8N2 and 8E1, the 11 bits that they assume."""
    from bussim.engines.modbus.gaps import silences
    from bussim.line.characters import BAUDS, CharFormat, LineTiming
    from bussim.units import seconds

    mini = peer("minimalmodbus")
    for baud in BAUDS:
        end = silences(LineTiming(baud, CharFormat(8, "E", 1))).end
        assert mini._calculate_minimum_silent_period(baud) == pytest.approx(seconds(int(end)), rel=1e-3)

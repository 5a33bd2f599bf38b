"""The PDU codec: both directions, limits, and everything that is not a PDU."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bussim.engines.modbus.pdu import (
    FUNCTIONS,
    STANDARD_LIMITS,
    ExceptionResponse,
    Flaw,
    Malformed,
    Request,
    Response,
    decode_request,
    decode_response,
    encode_exception,
    encode_request,
    encode_response,
    pack_bits,
    response_size,
    unpack_bits,
    write_coil,
    write_coils,
    write_register,
    write_registers,
)

words = st.integers(0, 0xFFFF)
reads = st.builds(Request, st.sampled_from([1, 2, 3, 4]), words, words, st.just(()))
writes = st.one_of(
    st.builds(write_coil, words, on=st.booleans()),
    st.builds(write_register, words, words),
    st.builds(write_coils, words, st.lists(st.integers(0, 1), min_size=1, max_size=1968)),
    st.builds(write_registers, words, st.lists(words, min_size=1, max_size=123)),
)


@given(st.one_of(reads, writes))
def test_requests_survive_the_wire(request: Request) -> None:
    assert decode_request(encode_request(request)) == request


@given(st.data(), st.sampled_from([1, 2]), words)
def test_coil_responses_survive_the_wire(data: st.DataObject, function: int, address: int) -> None:
    bits = data.draw(st.lists(st.integers(0, 1), min_size=1, max_size=2000))
    request = Request(function, address, len(bits))
    pdu = encode_response(Response(function, address, len(bits), tuple(bits)))
    assert len(pdu) == response_size(request)
    assert decode_response(pdu, request) == Response(function, address, len(bits), tuple(bits))


@given(st.data(), st.sampled_from([3, 4]), words)
def test_register_responses_survive_the_wire(data: st.DataObject, function: int, address: int) -> None:
    values = tuple(data.draw(st.lists(words, min_size=1, max_size=125)))
    request = Request(function, address, len(values))
    pdu = encode_response(Response(function, address, len(values), values))
    assert len(pdu) == response_size(request)
    assert decode_response(pdu, request) == Response(function, address, len(values), values)
    assert decode_response(pdu) == Response(function, 0, len(values), values)


@given(writes)
def test_write_responses_survive_the_wire(request: Request) -> None:
    echo = request.values if request.function in (5, 6) else ()
    response = Response(request.function, request.address, request.quantity, echo)
    pdu = encode_response(response)
    assert len(pdu) == response_size(request) == 5
    assert decode_response(pdu, request) == response


@given(st.integers(1, 0x7F), st.integers(0, 255))
def test_exceptions_survive_the_wire(function: int, code: int) -> None:
    pdu = encode_exception(function, code)
    assert pdu == bytes((function + 128, code))
    assert decode_response(pdu) == ExceptionResponse(function, code)


@given(st.binary(max_size=300))
def test_any_bytes_are_a_value(pdu: bytes) -> None:
    request = decode_request(pdu)
    if isinstance(request, Request):
        assert encode_request(request)[:5] == pdu[:5]
    else:
        assert isinstance(request, Malformed)
    assert isinstance(decode_response(pdu), Response | ExceptionResponse | Malformed)


@pytest.mark.parametrize(
    ("pdu", "flaw"),
    [
        ("", Flaw.EMPTY),
        ("00 00 00 00 01", Flaw.FUNCTION),
        ("07", Flaw.FUNCTION),
        ("17 00 00 00 01", Flaw.FUNCTION),
        ("83 02", Flaw.REPLY),
        ("03 00 00 00", Flaw.LENGTH),
        ("03 00 00 00 01 00", Flaw.LENGTH),
        ("05 00 00 FF", Flaw.LENGTH),
        ("0F 00 00 00 08", Flaw.LENGTH),
        ("0F 00 00 00 08 02 FF", Flaw.COUNT),  # byte count 2, one byte there
        ("0F 00 00 00 08 01 FF FF", Flaw.COUNT),  # byte count 1, two bytes there
        ("0F 00 00 00 10 02 FF", Flaw.COUNT),
        ("10 00 00 00 02 04 00 01", Flaw.COUNT),
        ("0F 00 00 00 09 01 FF", Flaw.COUNT),  # 9 coils need 2 bytes
        ("10 00 00 00 02 02 00 01", Flaw.COUNT),
        ("10 00 00 00 01 03 00 01 02", Flaw.COUNT),
    ],
)
def test_flaws_of_requests(pdu: str, flaw: Flaw) -> None:
    decoded = decode_request(bytes.fromhex(pdu))
    assert isinstance(decoded, Malformed)
    assert decoded.flaw is flaw


@pytest.mark.parametrize(
    ("pdu", "flaw"),
    [
        ("", Flaw.EMPTY),
        ("83", Flaw.LENGTH),
        ("83 02 00", Flaw.LENGTH),
        ("03", Flaw.LENGTH),
        ("03 04 00 01", Flaw.LENGTH),
        ("03 03 00 01 02", Flaw.COUNT),
        ("06 00 01 00", Flaw.LENGTH),
        ("10 00 01 00 02 00", Flaw.LENGTH),
        ("07 00", Flaw.FUNCTION),
    ],
)
def test_flaws_of_responses(pdu: str, flaw: Flaw) -> None:
    decoded = decode_response(bytes.fromhex(pdu))
    assert isinstance(decoded, Malformed)
    assert decoded.flaw is flaw


def test_a_read_must_carry_what_was_asked() -> None:
    decoded = decode_response(bytes.fromhex("03 02 00 01"), Request(3, 0, 2))
    assert isinstance(decoded, Malformed)
    assert decoded.flaw is Flaw.LENGTH


def test_standard_limits_fill_a_pdu() -> None:
    assert {f: STANDARD_LIMITS.of(f) for f in FUNCTIONS} == {
        1: 2000,
        2: 2000,
        3: 125,
        4: 125,
        5: 1,
        6: 1,
        15: 1968,
        16: 123,
    }
    assert len(encode_response(Response(1, 0, 2000, (1,) * 2000))) == 252
    assert len(encode_request(write_coils(0, (1,) * 1968))) == 252
    assert len(encode_request(write_registers(0, (1,) * 123))) == 252
    with pytest.raises(ValueError, match="254 bytes, at most 253"):
        encode_request(write_registers(0, (1,) * 124))


@pytest.mark.parametrize(
    ("request_", "said"),
    [
        (Request(3, 0x10000, 1), "65536 does not fit into 16 bits"),
        (Request(6, 0, 1, (-1,)), "-1 does not fit into 16 bits"),
        (Request(16, 0, 2, (1,)), "a quantity of 2 has so many values: 1"),
        (Request(8, 0, 1, (1,)), "function 8 is not one of 01, 02, 03, 04, 05, 06, 0F, 10"),
    ],
)
def test_misuse_is_an_exception(request_: Request, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        encode_request(request_)


def test_packing_of_the_v80_manual() -> None:
    coils = [0x56 >> k & 1 for k in range(8)]  # coils 0001 to 0008
    assert pack_bits(coils[1:4]) == b"\x03"  # three from 0002 on
    assert unpack_bits(b"\xcd\x01", 9) == (1, 0, 1, 1, 0, 0, 1, 1, 1)

"""The printed frames of the manuals, as characters: codec, and readers in every way of hearing them."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bussim.engines.contract import RxChar
from bussim.engines.modbus.adu import Adu, Damage, Mode, decode_ascii, decode_rtu, encode_adu
from bussim.engines.modbus.codes import Rejection
from bussim.engines.modbus.framing import Framing
from bussim.engines.modbus.pdu import decode_request, decode_response, encode_request, encode_response
from bussim.line.characters import LineTiming
from tests.engines.modbus.frames import (
    ASCII_REQUEST,
    ASCII_RESPONSE,
    EXCHANGE_IDS,
    EXCHANGES,
    RS2_REQUESTS,
    Exchange,
)
from tests.engines.modbus.wire import ASCII_LINE, RTU_LINE

each_exchange = pytest.mark.parametrize("exchange", EXCHANGES, ids=EXCHANGE_IDS)
RTU = Framing.rtu(RTU_LINE)
ASCII = Framing.ascii()
LINES = {Mode.RTU: (RTU, RTU_LINE), Mode.ASCII: (ASCII, ASCII_LINE)}
both_modes = pytest.mark.parametrize("mode", list(Mode))


@each_exchange
def test_meaning_to_characters(exchange: Exchange) -> None:
    request = encode_adu(Mode.RTU, exchange.station, encode_request(exchange.request))
    response = encode_adu(Mode.RTU, exchange.station, encode_response(exchange.response))
    assert (request.chars, response.chars) == (exchange.request_chars, exchange.response_chars)


@each_exchange
def test_characters_to_meaning(exchange: Exchange) -> None:
    request, response = decode_rtu(exchange.request_chars), decode_rtu(exchange.response_chars)
    assert isinstance(request, Adu)
    assert isinstance(response, Adu)
    assert request.station == response.station == exchange.station
    assert decode_request(request.pdu) == exchange.request
    assert decode_response(response.pdu, exchange.request) == exchange.response


@pytest.mark.parametrize(("station", "request_", "chars"), RS2_REQUESTS)
def test_rs2_examples(station: int, request_: object, chars: bytes) -> None:
    assert encode_adu(Mode.RTU, station, encode_request(request_)).chars == chars


def test_ascii_example_of_the_v80() -> None:
    request, response = EXCHANGES[4].request, EXCHANGES[4].response
    assert encode_adu(Mode.ASCII, 6, encode_request(request)).chars == ASCII_REQUEST
    assert encode_adu(Mode.ASCII, 6, encode_response(response)).chars == ASCII_RESPONSE
    assert decode_ascii(ASCII_REQUEST) == Adu(6, encode_request(request), ASCII_REQUEST)
    assert decode_ascii(ASCII_RESPONSE) == Adu(6, encode_response(response), ASCII_RESPONSE)


@pytest.mark.parametrize(
    ("chars", "reason"),
    [
        (b"\x01\x03\x00", Rejection.LENGTH),
        (b"\x01\x03\x00\x00", Rejection.CHECK),
        (bytes(257), Rejection.OVERFLOW),
    ],
)
def test_what_is_no_rtu_frame(chars: bytes, reason: Rejection) -> None:
    assert decode_rtu(chars) is reason


@pytest.mark.parametrize(
    ("chars", "reason"),
    [
        (b"0603006B000389\r\n", Rejection.UNFINISHED),
        (b":0603006B000389\n", Rejection.UNFINISHED),
        (b":0603006b000389\r\n", Rejection.NOT_HEX),  # the standard's digits are upper case
        (b":0603006B00038\r\n", Rejection.LENGTH),
        (b":06FA\r\n", Rejection.LENGTH),
        (b":0603006B000388\r\n", Rejection.CHECK),
        (b":" + b"00" * 255 + b"\r\n\n", Rejection.OVERFLOW),
    ],
)
def test_what_is_no_ascii_frame(chars: bytes, reason: Rejection) -> None:
    assert decode_ascii(chars) is reason


# -- readers ---------------------------------------------------------------------------------------


def heard(
    framing: Framing, timing: LineTiming, pieces: list[tuple[int, bytes]], *, whole: bool, report: bool
) -> list[Adu | Damage]:
    """What a reader makes of pieces, each so many ticks of silence after the one before.

    ``whole``: pieces that are frames are delivered as such; ``report``: the driver reports silences.
    """
    reader = framing.reader()
    out: list[Adu | Damage | None] = []
    at = 0
    for gap, chars in pieces:
        if report and reader.open and gap >= framing.quiet:
            out.append(reader.silence())
        start = at + gap
        at = start + timing.characters(len(chars))
        adu = decode_rtu(chars) if framing.mode is Mode.RTU else decode_ascii(chars)
        if whole and isinstance(adu, Adu):
            out.append(reader.whole(adu, start, at))
            if reader.immediate:
                out.append(adu)
            continue
        for number, value in enumerate(chars):
            begin, end = (start + timing.characters(number + k) for k in (0, 1))
            out.append(reader.character(RxChar(value), begin, end))
    out.append(reader.silence())
    return [item for item in out if item is not None]


def frames(mode: Mode) -> list[bytes]:
    return [encode_adu(mode, e.station, encode_request(e.request)).chars for e in EXCHANGES] + [
        encode_adu(mode, e.station, encode_response(e.response)).chars for e in EXCHANGES
    ]


@both_modes
@pytest.mark.parametrize("whole", [True, False])
@pytest.mark.parametrize("report", [True, False])
def test_every_frame_whole_and_byte_by_byte(mode: Mode, *, whole: bool, report: bool) -> None:
    framing, timing = LINES[mode]
    pieces = [(framing.quiet if mode is Mode.RTU else 0, chars) for chars in frames(mode)]
    got = heard(framing, timing, pieces, whole=whole, report=report)
    assert [item.chars for item in got] == frames(mode)
    assert all(isinstance(item, Adu) for item in got)


@both_modes
@pytest.mark.parametrize("whole", [True, False])
@pytest.mark.parametrize("junk", [b"\x00", b"\xff\x55\x00\x13", b"\x01\x03\x00", b":06\r", b"::", b"\r\n"])
def test_junk_before_a_frame(mode: Mode, junk: bytes, *, whole: bool) -> None:
    framing, timing = LINES[mode]
    for chars in frames(mode):
        gap = framing.quiet if mode is Mode.RTU else 0  # ASCII frames need no silence in front
        got = heard(framing, timing, [(gap, junk), (gap, chars)], whole=whole, report=False)
        assert isinstance(got[-1], Adu)
        assert got[-1].chars == chars
        assert not any(isinstance(item, Adu) for item in got[:-1])


@both_modes
def test_half_a_frame_does_not_hurt_the_next(mode: Mode) -> None:
    framing, timing = LINES[mode]
    for chars in frames(mode):
        for cut in range(1, len(chars)):
            gap = framing.quiet if mode is Mode.RTU else 0
            got = heard(framing, timing, [(0, chars[:cut]), (gap, chars)], whole=False, report=False)
            assert [type(item) for item in got] == [Damage, Adu], (chars, cut)


def test_rtu_gap_inside_a_frame() -> None:
    chars = EXCHANGES[0].request_chars
    for gap, expected in [
        (RTU.inner, [Adu]),
        (RTU.inner + 1, [Damage]),
        (RTU.quiet - 1, [Damage]),
        (RTU.quiet, [Damage, Damage]),  # two pieces, neither a frame
    ]:
        got = heard(RTU, RTU_LINE, [(0, chars[:3]), (gap, chars[3:])], whole=False, report=False)
        assert [type(item) for item in got] == expected
        if gap in (RTU.inner + 1, RTU.quiet - 1):
            assert got[0].reason is Rejection.GAP


@pytest.mark.parametrize("whole", [True, False])
def test_rtu_frames_without_a_silence_between_are_neither(*, whole: bool) -> None:
    one, other = EXCHANGES[0].request_chars, EXCHANGES[4].request_chars
    for gap, reason in [(0, Rejection.CHECK), (RTU.quiet - 1, Rejection.GAP)]:
        got = heard(RTU, RTU_LINE, [(0, one), (gap, other)], whole=whole, report=False)
        assert [(type(item), item.reason) for item in got] == [(Damage, reason)]
        assert got[0].chars == one + other


@both_modes
@pytest.mark.parametrize(("parity_ok", "stop_ok"), [(False, True), (True, False)])
def test_one_bad_character_damages_one_frame(mode: Mode, *, parity_ok: bool, stop_ok: bool) -> None:
    framing, timing = LINES[mode]
    chars = frames(mode)[0]
    for bad in range(len(chars)):
        reader = framing.reader()
        out = []
        for number, value in enumerate(chars):
            wrong = number == bad
            char = RxChar(value, parity_ok or not wrong, stop_ok or not wrong)
            begin, end = timing.characters(number), timing.characters(number + 1)
            out.append(reader.character(char, begin, end))
        out.append(reader.silence())
        got = [item for item in out if item is not None]
        if mode is Mode.ASCII and bad == 0:
            assert got == []  # without its colon nothing has begun
        else:
            assert [item.reason for item in got] == [Rejection.FRAMING if parity_ok else Rejection.PARITY]


@both_modes
def test_a_frame_that_never_ends_is_cut_and_takes_no_memory(mode: Mode) -> None:
    framing, timing = LINES[mode]
    most = 256 if mode is Mode.RTU else 513
    chars = (b"\x01" if mode is Mode.RTU else b":") + b"0" * 5000
    got = heard(framing, timing, [(0, chars)], whole=False, report=False)
    assert [(item.reason, len(item.chars)) for item in got] == [(Rejection.OVERFLOW, most)]
    longest = encode_adu(mode, 1, bytes(253)).chars
    assert len(longest) == most
    assert heard(framing, timing, [(0, longest)], whole=False, report=False)[0].chars == longest


def test_ascii_waits_a_second_between_characters() -> None:
    for gap, expected in [(ASCII.quiet - 1, [Adu]), (ASCII.quiet, [Damage])]:
        pieces = [(0, ASCII_REQUEST[:5]), (gap, ASCII_REQUEST[5:])]
        got = heard(ASCII, ASCII_LINE, pieces, whole=False, report=False)
        assert [type(item) for item in got] == expected


@given(st.data())
def test_reported_silences_or_not_and_whole_frames_or_not_are_the_same(data: st.DataObject) -> None:
    mode = data.draw(st.sampled_from(list(Mode)))
    framing, timing = LINES[mode]
    alphabet = st.sampled_from(list(b":0123456789ABCDEF\r\n\x01\x03")) | st.integers(0, 255)
    junk = st.lists(alphabet, min_size=1, max_size=12).map(bytes)
    gaps = st.sampled_from([0, 1, framing.inner, framing.inner + 1, framing.quiet - 1, framing.quiet])
    pieces = data.draw(st.lists(st.tuples(gaps, st.sampled_from(frames(mode)) | junk), max_size=6))
    delivered = heard(framing, timing, pieces, whole=False, report=True)
    assert heard(framing, timing, pieces, whole=False, report=False) == delivered
    assert heard(framing, timing, pieces, whole=True, report=True) == delivered
    assert heard(framing, timing, pieces, whole=True, report=False) == delivered

"""The codec: golden frames, lengths, round trips, and what it refuses."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bussim.engines.nn.frames import (
    DATA,
    MODES,
    PARAMETERS,
    POLL,
    Frame,
    LinkSettings,
    data_chars,
    decode,
    encode_data,
    encode_parameters,
    encode_poll,
)

SETTINGS = LinkSettings(slaves=2, mode=1, retries=5, timeout=100)
#: Frames worked out by hand: (frame, characters).
GOLDEN = {
    # sums in hexadecimal: 31 + 30 = 61
    "poll of 1, counter 0": (encode_poll(1, 0), b"\x05" + b"10" + b"61"),
    # 37 + 46 = 7D
    "poll of 7, counter 15": (encode_poll(7, 15), b"\x05" + b"7F" + b"7D"),
    # 18 × 30 + 03 = 363
    "zeros of mode 0": (
        encode_data(0, 0, bytes(8)),
        b"\x02" + b"00" + b"0000000000000000" + b"\x03" + b"63",
    ),
    # 33+41 = 74, 31+32+33+34 = CA, 41+42+43+44 = 10A, 46+45+30+31 = EC, 4 × 30 = C0: 3F4 + 03
    "words high byte first": (
        encode_data(3, 10, bytes.fromhex("1234ABCDFE010000")),
        b"\x02" + b"3A" + b"1234ABCDFE010000" + b"\x03" + b"F7",
    ),
    # 46+36 = 7C, 30+32+30+31+30+35+36+34 = 192: 20E + 03
    "parameters": (
        encode_parameters(6, SETTINGS),
        b"\x01" + b"F6" + b"02010564" + b"\x03" + b"11",
    ),
}


def text_sum(text: bytes) -> int:
    return sum(text[1:-2]) % 256


@pytest.mark.parametrize("name", GOLDEN)
def test_golden_frames_backwards(name: str) -> None:
    frame, chars = GOLDEN[name]
    assert frame.chars == chars
    assert decode(chars) == frame
    assert int(chars[-2:], 16) == text_sum(chars)


def test_golden_frames_mean_what_they_say() -> None:
    assert GOLDEN["poll of 7, counter 15"][0][:3] == (POLL, 7, 15)
    assert GOLDEN["words high byte first"][0][:3] == (DATA, 3, 10)
    assert GOLDEN["words high byte first"][0].data == b"\x12\x34\xab\xcd\xfe\x01\x00\x00"
    parameters = GOLDEN["parameters"][0]
    assert (parameters.kind, parameters.counter, parameters.settings) == (PARAMETERS, 6, SETTINGS)
    assert [frame.kind_name for frame, _ in GOLDEN.values()] == ["poll", "poll", "data", "data", "parameters"]


@pytest.mark.parametrize(
    ("mode", "points", "words", "size", "chars"),
    [(0, 0, 4, 8, 22), (1, 32, 4, 12, 30), (2, 64, 8, 24, 54), (3, 64, 16, 40, 86), (4, 64, 32, 72, 150)],
)
def test_blocks_and_lengths_of_the_five_modes(
    mode: int, points: int, words: int, size: int, chars: int
) -> None:
    block = MODES[mode]
    assert (block.bits, block.words, block.size) == (points, words, size)
    assert data_chars(mode) == chars == 6 + 2 * size
    assert len(encode_data(5, 9, bytes(size)).chars) == chars
    assert len(MODES) == 5


def test_polls_have_5_characters_and_parameters_14() -> None:
    for station in range(1, 8):
        for counter in range(16):
            assert len(encode_poll(station, counter).chars) == 5
    assert len(encode_parameters(15, LinkSettings(7, 4, 10, 255)).chars) == 14


good_settings = st.builds(
    LinkSettings, st.integers(1, 7), st.integers(0, 4), st.integers(0, 10), st.integers(5, 255)
)
frames = st.one_of(
    st.builds(encode_poll, st.integers(1, 7), st.integers(0, 15)),
    st.builds(
        encode_data,
        st.integers(0, 7),
        st.integers(0, 15),
        st.sampled_from(MODES).flatmap(lambda block: st.binary(min_size=block.size, max_size=block.size)),
    ),
    st.builds(encode_parameters, st.integers(0, 15), good_settings),
)


@settings(deadline=None)
@given(frame=frames)
def test_what_is_encoded_decodes_to_the_same(frame: Frame) -> None:
    assert decode(frame.chars) == frame
    assert all(char < 128 for char in frame.chars)
    assert int(frame.chars[-2:], 16) == text_sum(frame.chars)


@settings(deadline=None)
@given(frame=frames, index=st.integers(0, 200), value=st.integers(0, 127))
def test_one_other_character_is_never_the_same_frame(frame: Frame, index: int, value: int) -> None:
    chars = bytearray(frame.chars)
    index %= len(chars)
    if chars[index] == value:
        return
    chars[index] = value
    assert decode(bytes(chars)) is None  # one character changes the sum, or the sum itself


@settings(deadline=None)
@given(frame=frames, cut=st.integers(1, 20))
def test_a_part_of_a_frame_is_no_frame(frame: Frame, cut: int) -> None:
    assert decode(frame.chars[:-cut]) is None
    assert decode(frame.chars[cut:]) is None
    assert decode(frame.chars + b"0" * cut) is None


@settings(deadline=None)
@given(chars=st.binary(max_size=200))
def test_random_bytes_never_raise(chars: bytes) -> None:
    frame = decode(chars)
    assert frame is None or frame.chars == chars


def sealed(header: int, body: bytes) -> bytes:
    return bytes([header]) + body + b"%02X" % (sum(body) % 256)


@pytest.mark.parametrize(
    "chars",
    [
        b"",
        b"\x05",
        sealed(5, b"00"),  # the master is never polled
        sealed(5, b"80"),  # nor a station 8
        sealed(5, b"1a"),  # lower case
        sealed(5, b"1\x03"),
        sealed(5, b"100"),  # too long
        sealed(2, b"80" + b"0" * 16 + b"\x03"),  # no station 8
        sealed(2, b"10" + b"0" * 15 + b"\x03"),  # half a byte
        sealed(2, b"10" + b"0" * 16),  # no terminator
        sealed(2, b"1\x03"),
        sealed(2, b"10" + b"0" * 15 + b"g\x03"),
        sealed(2, b"10" + b"a" * 16 + b"\x03"),
        sealed(3, b"10" + b"0" * 16 + b"\x03"),  # no header
        sealed(1, b"E0" + b"02010564" + b"\x03"),  # to one station only
        sealed(1, b"F0" + b"0201056" + b"\x03"),
        sealed(1, b"F0" + b"00010564" + b"\x03"),  # D8177 = 0
        sealed(1, b"F0" + b"08010564" + b"\x03"),  # D8177 = 8
        sealed(1, b"F0" + b"02050564" + b"\x03"),  # D8178 = 5
        sealed(1, b"F0" + b"02010B64" + b"\x03"),  # D8179 = 11
        sealed(1, b"F0" + b"02010500" + b"\x03"),  # D8180 = 0
        b"\x0510" + b"6\xb1",
        b"\x051061"[:-1] + b"\x31\x31",
    ],
)
def test_what_no_station_sends_is_refused(chars: bytes) -> None:
    assert decode(chars) is None


def test_lower_case_sums_are_refused() -> None:
    chars = encode_poll(7, 15).chars
    assert chars.endswith(b"7D")
    assert decode(chars[:-1] + b"d") is None

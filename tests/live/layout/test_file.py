"""Layouts as values and files: the assumed one is what the engine's codec corresponds to."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bussim.engines.nn.frames import LinkSettings, decode, encode_data, encode_parameters, encode_poll
from bussim.errors import ScenarioError
from bussim.live.layout import file
from bussim.live.layout.file import load_layout, parse_layout, to_text
from bussim.live.layout.sums import KINDS, Number, Sum
from bussim.live.layout.value import ASSUMED, Layout

COUNTERS = st.integers(0, 15)
FRAMES = st.one_of(
    st.builds(encode_data, st.integers(0, 7), COUNTERS, st.binary(max_size=80)),
    st.builds(encode_poll, st.integers(1, 7), COUNTERS),
    st.builds(
        encode_parameters,
        COUNTERS,
        st.builds(
            LinkSettings, st.integers(0, 9), st.integers(0, 6), st.integers(0, 12), st.integers(0, 255)
        ),
    ),
)
#: Places at which a frame is changed, each to one of the characters that matter.
CHANGES = st.lists(st.tuples(st.integers(0, 200), st.sampled_from(b"\x01\x02\x03\x050179AFafG")), max_size=2)


def test_the_file_that_ships_is_the_assumed_layout() -> None:
    assert load_layout(Path(file.__file__).parent / "assumed.yaml") == ASSUMED


@given(FRAMES, CHANGES, st.booleans())
def test_the_assumed_layout_reads_what_the_engines_codec_reads(
    frame: object, changes: list[tuple[int, int]], right_sum: bool
) -> None:
    chars = bytearray(frame.chars)  # type: ignore[attr-defined]
    for at, char in changes:
        chars[at % len(chars)] = char
    if right_sum:
        chars[-2:] = b"%02X" % (sum(chars[1:-2]) & 0xFF)
    assert ASSUMED.decode(bytes(chars)) == decode(bytes(chars))


@pytest.mark.parametrize(
    "layout",
    [
        ASSUMED,
        Layout(
            orders={
                "data": (("station", True), ("any", True), ("data", True), (0x7E, False), ("sum", False)),
                "poll": ((0x05, True), ("station", True), ("sum", False)),
            },
            station=Number("binary", 1),
            counter=None,
            sum=Sum("crc16-modbus", 16, "binary", low_first=True),
            master=1,
            data="binary",
            data_bytes=8,
        ),
    ],
)
def test_a_layout_that_is_written_is_read_as_the_same(layout: Layout) -> None:
    assert parse_layout(to_text(layout, "x"), "x") == layout


#: Sums of "123456789": the check values of the catalogue of CRC algorithms; sums by hand.
PUBLISHED = {
    "crc16-modbus": 0x4B37,
    "crc16-arc": 0xBB3D,
    "crc16-ccitt": 0x29B1,
    "crc16-xmodem": 0x31C3,
    "crc16-kermit": 0x2189,
    "crc16-x25": 0x906E,
    "crc8": 0xF4,
    "crc8-maxim": 0xA1,
    "sum": 0x1DD,
    "negative": 0xFE23,
    "inverted": 0xFE22,
    "xor": 0x31,
}


def test_every_kind_of_sum_gives_its_published_value() -> None:
    assert {kind: Sum(kind, bits[0]).value(b"123456789") for kind, (_, bits) in KINDS.items()} == PUBLISHED


@pytest.mark.parametrize(
    ("text", "messages"),
    [
        (
            "frames: {data: [2, [stations], sum], poll: [5, [station], sum]}\nsum: {kind: crc, bits: 9}\nend: 3",
            [
                "x:1:16: frames.data has 'stations', allowed characters 0x00..0xFF, station, counter, ",
                "did you mean station?",
                "sum.kind is 'crc', allowed sum, ",
                "sum.bits is 9, allowed 7, 8, 16",
                "end is not a key here; allowed are frames, station, counter, data, sum",
            ],
        ),
        (
            "frames: {data: [2, [data], sum], poll: [5, [station, counter, settings], sum]}\nsum: {start: 3, bits: 16, kind: crc16-arc}",
            [
                "frames.data has no station",
                "frames.poll has a counter, but counter is missing",
                "frames.poll has settings, which such a frame does not carry",
                "sum.start is 3, allowed for crc16-arc: 0",
            ],
        ),
        (
            "frames: {data: [2, station, data, sum], poll: [station, station]}",
            ["needs both", "station twice"],
        ),
        ("", ["x: is empty"]),
    ],
)
def test_all_mistakes_of_a_file_are_told_at_once(text: str, messages: list[str]) -> None:
    with pytest.raises(ScenarioError) as error:
        parse_layout(text, "x")
    for message in messages:
        assert message in str(error.value)

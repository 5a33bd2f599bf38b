"""The reader: frames out of characters, however they come, against a second reader."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bussim.engines.nn.frames import (
    Damage,
    Frame,
    FrameReader,
    LinkSettings,
    encode_data,
    encode_parameters,
    encode_poll,
)
from tests.engines.nn import independent
from tests.engines.nn.test_frames import GOLDEN, frames

CHAR = 18_750
Heard = Frame | Damage


def feed(reader: FrameReader, chars: bytes, at: int = 0) -> list[Heard]:
    found = [reader.character((char, True, True), at + CHAR * number) for number, char in enumerate(chars)]
    return [heard for heard in found if heard is not None]


@pytest.mark.parametrize("name", GOLDEN)
def test_golden_frames_character_by_character(name: str) -> None:
    frame, chars = GOLDEN[name]
    reader = FrameReader()
    for number, char in enumerate(chars):
        assert reader.open == reader.in_frame == (number > 0)
        assert reader.header == (chars[0] if number else None)
        heard = reader.character((char, True, True), 500 + CHAR * number)
        assert reader.start == 500
        assert heard == (frame if number == len(chars) - 1 else None)
    assert not reader.open
    assert reader.quiet() is None


@pytest.mark.parametrize("name", GOLDEN)
def test_golden_frames_whole_after_each_other(name: str) -> None:
    frame, chars = GOLDEN[name]
    reader = FrameReader()
    assert feed(reader, chars * 3) == [frame] * 3
    assert reader.quiet() is None


@pytest.mark.parametrize("name", GOLDEN)
@pytest.mark.parametrize("junk", [b"\x03", b"0", b"\x7f\x00", b"\x0512"], ids=repr)
def test_golden_frames_after_junk(name: str, junk: bytes) -> None:
    frame, chars = GOLDEN[name]
    reader = FrameReader()
    header = junk[0] if junk[0] == 5 else None
    assert feed(reader, junk) == []
    assert feed(reader, chars, 99) == [Damage(header, ord("1") if header else None), frame]
    assert reader.start == 99


@pytest.mark.parametrize("name", GOLDEN)
@pytest.mark.parametrize("tail", [b"0", b"\x03\x03", b"GHI"], ids=repr)
def test_golden_frames_with_a_tail(name: str, tail: bytes) -> None:
    frame, chars = GOLDEN[name]
    reader = FrameReader()
    assert feed(reader, chars + tail) == [frame]
    assert reader.open
    assert not reader.in_frame
    assert reader.quiet() == Damage(None, None)
    assert not reader.open


@pytest.mark.parametrize("name", GOLDEN)
def test_a_frame_without_its_end_is_damage_by_quiet_or_by_the_next_header(name: str) -> None:
    frame, chars = GOLDEN[name]
    for length in range(1, len(chars)):
        first = chars[1] if length > 1 else None
        reader = FrameReader()
        assert feed(reader, chars[:length]) == []
        assert reader.in_frame
        assert reader.quiet() == Damage(chars[0], first)
        assert feed(reader, chars[:length] + chars) == [Damage(chars[0], first), frame]


@pytest.mark.parametrize("name", GOLDEN)
@pytest.mark.parametrize("flaw", ["parity", "stop"])
def test_a_damaged_character_damages_the_frame_wherever_it_is(name: str, flaw: str) -> None:
    frame, chars = GOLDEN[name]
    for damaged in range(len(chars)):
        reader = FrameReader()
        for number, char in enumerate(chars):
            bad = number == damaged
            rx = (char, not (bad and flaw == "parity"), not (bad and flaw == "stop"))
            assert reader.character(rx, CHAR * number) is None
            assert reader.in_frame == (number < damaged)
        header = chars[0] if damaged else None
        first = chars[1] if damaged > 1 else None
        assert reader.quiet() == Damage(header, first)
        assert feed(reader, chars) == [frame]


def test_a_known_mode_makes_other_lengths_damage() -> None:
    reader = FrameReader()
    reader.data_size = 8
    short, right = encode_data(1, 2, bytes(8)), encode_data(1, 2, bytes(12))
    assert feed(reader, short.chars) == [short]
    assert feed(reader, right.chars) == []
    assert reader.quiet() == Damage(2, ord("1"))
    # the same, given the whole frame
    reader.reject(right, 77)
    assert (reader.open, reader.in_frame, reader.header, reader.start) == (True, False, 2, 77)
    assert feed(reader, b"0") == []
    assert reader.quiet() == Damage(2, ord("1"))
    assert feed(reader, encode_poll(1, 2).chars) == [encode_poll(1, 2)]


def test_a_terminator_in_the_middle_ends_the_frame_there() -> None:
    reader = FrameReader()
    chars = encode_data(1, 2, bytes(8)).chars
    broken = chars[:9] + b"\x03" + chars[10:]
    assert feed(reader, broken) == []
    assert reader.quiet() == Damage(2, ord("1"))


def test_an_endless_frame_is_given_up() -> None:
    reader = FrameReader()
    assert feed(reader, b"\x02" + b"0" * 149) == []
    assert reader.in_frame
    assert feed(reader, b"0") == []
    assert not reader.in_frame
    assert feed(reader, b"0" * 100_000) == []
    assert len(reader._buffer) <= 151
    assert reader.quiet() == Damage(2, ord("0"))


def test_reset_forgets_what_is_open() -> None:
    reader = FrameReader()
    feed(reader, b"\x0212")
    reader.reset()
    assert not reader.open
    assert reader.quiet() is None
    assert feed(reader, b"34") == []
    assert reader.quiet() == Damage(None, None)


# -- against the second reader ------------------------------------------------------------------------

mutations = st.one_of(
    st.just(lambda text: text),
    st.builds(lambda cut: lambda text: text[:cut], st.integers(0, 30)),
    st.builds(lambda cut: lambda text: text[cut:], st.integers(0, 30)),
    st.builds(
        lambda at, char: lambda text: text[: at % len(text)] + bytes([char]) + text[at % len(text) + 1 :],
        st.integers(0, 200),
        st.sampled_from(b"\x01\x02\x03\x05\x00?018AFaf\x7f"),
    ),
    st.builds(
        lambda at, char: lambda text: text[: at % len(text)] + bytes([char]) + text[at % len(text) :],
        st.integers(0, 200),
        st.sampled_from(b"\x01\x02\x03\x0508F"),
    ),
)
chunks = st.one_of(
    st.builds(lambda frame, mutate: mutate(frame.chars), frames, mutations),
    st.lists(st.sampled_from(b"\x01\x02\x03\x050189AFf\x7f?"), max_size=6).map(bytes),
)


@given(
    stream=st.lists(st.tuples(chunks, st.sampled_from([0, 0, 1, 19, 20, 25])), max_size=6),
    unclean=st.sets(st.integers(0, 120), max_size=3),
    data_size=st.sampled_from([None, 8, 12, 24]),
)
def test_a_second_reader_makes_the_same_of_it(
    stream: list[tuple[bytes, int]], unclean: set[int], data_size: int | None
) -> None:
    """Frames, mutilated and whole, with noise, unclean characters and pauses (in bits) in between."""
    chars: list[independent.Char] = []
    tick = 0
    for text, pause in stream:
        for value in text:
            chars.append((tick, value, len(chars) not in unclean))
            tick += 10
        tick += pause
    reader = FrameReader()
    reader.data_size = data_size
    ours: list[Heard | None] = []
    behind = None
    for number, (first, value, clean) in enumerate(chars):
        if behind is not None and first - behind >= 20:
            ours.append(reader.quiet())
        rx = (value, True, True) if clean else (value, bool(number % 2), not number % 2)
        ours.append(reader.character(rx, first))
        behind = first + 10
    ours.append(reader.quiet())
    assert [verdict(heard) for heard in ours if heard] == independent.verdicts(chars, data_size)


def verdict(heard: Heard) -> independent.Verdict:
    """In the second reader's words."""
    if isinstance(heard, Frame):
        return "frame", heard.chars.decode()
    return "damage", None if heard.header is None else chr(heard.header), heard.first == ord("0")


def test_the_second_decoder_agrees_on_golden_frames() -> None:
    for frame, chars in GOLDEN.values():
        text = chars.decode()
        assert independent.verdicts(independent.characters(independent.receive_by_character(text))) == [
            ("frame", text)
        ]
        if frame == encode_poll(frame.station or 1, frame.counter):
            assert independent.poll_text(frame.station, frame.counter) == text
    assert encode_parameters(6, LinkSettings(2, 1, 5, 100)).chars.decode()[-2:] == independent.checksum(
        "F602010564\x03"
    )


@given(
    sent=st.lists(frames, min_size=1, max_size=3),
    wrong=st.lists(st.tuples(st.integers(0, 60), st.integers(0, 127), st.booleans()), max_size=2),
    size=st.sampled_from([None, 8, 24]),
)
def test_what_is_taken_ends_nothing_and_is_as_if_received(
    sent: list[Frame], wrong: list[tuple[int, int, bool]], size: int | None
) -> None:
    chars = [(value, True, True) for frame in sent for value in frame.chars]
    for at, value, clean in wrong:
        chars[at % len(chars)] = (value, clean, True)
    one, ahead, follower = FrameReader(), FrameReader(), FrameReader()
    one.data_size = size
    numbered = list(enumerate(chars))
    taken = ahead.take(numbered)
    assert [one.character(char, start) for start, char in numbered[:taken]] == [None] * taken
    follower.follow(ahead)
    follower.data_size = size
    for start, char in numbered[taken:]:
        assert follower.character(char, start) == one.character(char, start)
    assert taken > 0

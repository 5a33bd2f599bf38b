from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bussim.export.received import Received, receive, remarks
from bussim.export.selection import Selection, in_order, survey
from bussim.line.characters import CharFormat
from bussim.line.protocols import BusProtocol
from bussim.trace.records import FrameRecord, TraceBus
from tests.export.samples import FEEDER, LINK, OVEN, bits_of, exchanges, frame, link_frames, timing, trace


def heard(*frames: FrameRecord, buses: tuple[TraceBus, ...] = (LINK,)) -> list[Received]:
    selection = Selection(trace(*frames, buses=buses))
    found = survey(selection)
    return list(receive(in_order(selection.frames(), found.lateness), found))


def described(one: Received, bus: TraceBus = LINK) -> str:
    return "; ".join(remarks(one, timing(bus.baud, bus.format)))


def test_undamaged_frames_are_read_as_they_were_sent() -> None:
    frames = link_frames(40)
    found = heard(*frames)
    assert [each.frame for each in found] == frames
    assert [each.chars for each in found] == [each.chars for each in frames]
    assert not any(each.wrong or each.over or described(each) for each in found)


@given(
    fmt=st.sampled_from(["7E1", "7O1", "8N1", "8E1", "8N2", "8O2", "7N2"]),
    data=st.binary(min_size=1, max_size=12),
    choose=st.randoms(use_true_random=False),
)
def test_a_turned_data_bit_turns_one_bit_of_one_character(
    fmt: str, data: bytes, choose: random.Random
) -> None:
    form = CharFormat.parse(fmt)
    bus = TraceBus("b", BusProtocol.SERIAL, 9600, fmt, ("a",), {})
    mask = (1 << form.data_bits) - 1
    sent = bytes(value & mask for value in data)
    index, bit = choose.randrange(len(sent)), choose.randrange(form.data_bits)
    one = frame(bus, 1000, "a", sent, damaged=[index * form.bits + 1 + bit])
    (found,) = heard(one, buses=(bus,))
    expected = bytearray(sent)
    expected[index] ^= 1 << bit
    assert found.chars == bytes(expected)
    assert found.wrong == (() if form.parity == "N" else ((index, "parity"),))
    assert f"bit {index * form.bits + 1 + bit} inverted on the wire" in described(found, bus)
    assert f"sent was {sent.hex(' ').upper()}" in described(found, bus)


def test_a_turned_parity_bit_leaves_the_value_and_is_reported() -> None:
    one = frame(LINK, 0, "press1", b"\x0511A2", damaged=[2 * 10 + 8])
    (found,) = heard(one)
    assert (found.chars, found.wrong) == (b"\x0511A2", ((2, "parity"),))
    assert described(found) == "bit 28 inverted on the wire; parity error in character 3"


def test_a_turned_stop_bit_is_a_framing_error() -> None:
    one = frame(OVEN, 0, "oven1", b"\x55", damaged=[10])
    (found,) = heard(one, buses=(OVEN,))
    assert (found.chars, found.wrong) == (b"\x55", ((0, "framing"),))


@given(one=st.integers(0, 127), other=st.integers(0, 127))
def test_where_two_send_at_once_a_0_wins(one: int, other: int) -> None:
    frames = [
        frame(LINK, 0, name, bytes((value,)), collided=True)
        for name, value in (("press2", one), ("press3", other))
    ]
    first, second = heard(*frames)
    assert (first.over, second.over) == (("press3",), ("press2",))
    levels = [CharFormat.parse("7E1").encode(value) for value in (one, other)]
    wire = [a & b for a, b in zip(*levels, strict=True)]
    # What both sent lies in one place; it belongs to the one recorded last.
    assert first.chars == b""
    assert second.chars == bytes((one & other,))
    assert bool(second.wrong) is (sum(wire[1:9]) % 2 == 1)
    assert "collided with press2" in described(second)


def test_a_late_collision_is_cut_where_the_second_begins() -> None:
    first = frame(LINK, 0, "press2", b"ABCDEFGH", collided=True)
    second = frame(LINK, 4 * 18_750, "press3", b"abcdefgh", collided=True)
    early, late = heard(first, second)
    assert early.chars == b"ABCD"
    assert late.chars == bytes(a & b for a, b in zip(b"EFGH", b"abcd", strict=True)) + b"efgh"


def test_a_frame_that_is_cut_off_ends_there() -> None:
    one = frame(LINK, 0, "press1", b"ABCDEFGH", cut_to=3 * 18_750)
    (found,) = heard(one)
    assert found.chars == b"ABC"
    assert "cut off after 3 of 8 characters" in described(found)


def test_another_format_is_read_as_a_receiver_of_the_bus_reads_it() -> None:
    one = frame(FEEDER, 0, "feeder1", b"\x01\x03", fmt="8E1")
    (found,) = heard(one, buses=(FEEDER,))
    # 8E1 has its parity bit where 8N1 has its stop bit: 01 has odd parity (1), 03 even (0).
    assert found.chars[0] == 0x01
    assert (1, "framing") in found.wrong
    assert "sent at 9600 8E1, the bus has 9600 8N1" in described(found, FEEDER)


def test_a_clock_within_what_a_uart_takes_makes_no_difference() -> None:
    one = frame(LINK, 0, "press1", b"0123456789ABCDEF" * 4, ppm=20_000.0)
    (found,) = heard(one)
    assert (found.chars, described(found)) == (one.chars, "")


def test_damage_in_one_receiver_is_reported_but_not_read() -> None:
    one = frame(LINK, 0, "press1", b"\x0511A2", damaged_at={"press3": (11,)})
    (found,) = heard(one)
    assert (found.chars, found.wrong) == (one.chars, ())
    assert described(found) == "bit 11 inverted at press3 only"


def test_buses_are_read_apart_and_come_out_in_order() -> None:
    chance = random.Random(5)
    rtu = [each for one in exchanges(30, bus=FEEDER) for each in one.frames]
    rtu = [
        each._replace(damaged_bits=(chance.randrange(bits_of(each)),)) if chance.random() < 0.5 else each
        for each in rtu
    ]
    link = link_frames(300, damage=0.3)
    mixed = sorted(link + rtu, key=lambda each: each.end)
    together = heard(*mixed, buses=(LINK, FEEDER))
    assert [each.frame.start for each in together] == sorted(each.start for each in mixed)
    assert [each for each in together if each.frame.bus == "link"] == heard(*link)
    assert [each for each in together if each.frame.bus == "feeder"] == heard(*rtu, buses=(FEEDER,))


@pytest.mark.parametrize("clean", [True, False])
def test_a_station_that_jabbers_without_end_is_read_piece_by_piece(clean: bool) -> None:
    frames, now = [], 0
    for number in range(1500):
        one = frame(LINK, now, "press3", bytes((number % 128,)) * 4, kind="jabber", collided=not clean)
        frames.append(one)
        now = one.end
    assert [each.chars for each in heard(*frames)] == [each.chars for each in frames]

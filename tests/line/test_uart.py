"""The receiver against theory: its tolerance of clocks and formats, and a second receiver written here."""

from __future__ import annotations

from fractions import Fraction
from math import floor

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bussim.line.characters import BAUDS, NN_LINE, CharFormat, LineTiming
from bussim.line.uart import Sampled, Uart
from bussim.line.wave import Wave, clip, low_intervals

FORMATS = [CharFormat(data, parity, stop) for data in (7, 8) for parity in "NEO" for stop in (1, 2)]
BIT = 1875


def heard(timing: LineTiming, wave: Wave, ready: int = 0) -> list[Sampled]:
    """All characters that a receiver finds on a line."""
    uart, found = Uart(timing), []
    while (char := uart.next_character(wave, ready)) is not None:
        found.append(char)
        ready = char.ready
    return found


def values(chars: list[Sampled]) -> bytes:
    return bytes(char.value for char in chars)


def clean(chars: list[Sampled]) -> bool:
    return all(char.parity_ok and char.stop_ok for char in chars)


@pytest.mark.parametrize("baud", BAUDS)
@pytest.mark.parametrize("fmt", FORMATS, ids=str)
def test_back_to_back_characters_are_read_as_sent(baud: int, fmt: CharFormat) -> None:
    timing = LineTiming(baud, fmt)
    sent = bytes(range(1 << fmt.data_bits))
    found = heard(timing, Wave([low_intervals(sent, timing, 1000)]))
    assert values(found) == sent
    assert clean(found)
    width = fmt.bits * timing.bit
    for number, char in enumerate(found):
        assert (char.start, char.end) == (1000 + number * width, 1000 + (number + 1) * width)
        # ready again at the middle of the (first) stop bit, half a tick rounded up
        middle = (fmt.bits - fmt.stop_bits + Fraction(1, 2)) * timing.bit
        assert char.ready == char.start + floor(middle + Fraction(1, 2))


def test_two_characters_at_38400_take_37500_ticks() -> None:
    found = heard(NN_LINE, Wave([low_intervals(b"\x051", NN_LINE, 0)]))
    assert [(char.start, char.end, char.ready) for char in found] == [
        (0, 18_750, 17_813),  # 9.5 × 1875 = 17812.5
        (18_750, 37_500, 36_563),
    ]


@pytest.mark.parametrize(
    "fmt", [CharFormat(7, "E", 1), CharFormat(8, "N", 1), CharFormat(8, "E", 2)], ids=str
)
@pytest.mark.parametrize("ppm", [-20_000, -5_000, -100, 0, 100, 5_000, 20_000])
def test_a_clock_off_by_two_percent_does_no_harm(fmt: CharFormat, ppm: int) -> None:
    sent = bytes(range(1 << fmt.data_bits))
    wave = Wave([low_intervals(sent, LineTiming(38400, fmt), 0)])
    found = heard(LineTiming(38400, fmt, Fraction(ppm)), wave)
    assert values(found) == sent
    assert clean(found)


@pytest.mark.parametrize(
    "fmt", [CharFormat(7, "E", 1), CharFormat(8, "N", 1), CharFormat(8, "E", 1)], ids=str
)
@pytest.mark.parametrize(
    "half_bits", [Fraction(-11, 20), Fraction(-9, 20), Fraction(9, 20), Fraction(11, 20)], ids=str
)
def test_the_tolerance_is_half_a_bit_at_the_stop_bit_s_centre(fmt: CharFormat, half_bits: Fraction) -> None:
    """A receiver that samples the stop bit, its last, up to half a bit too early or late reads all."""
    last = fmt.bits - Fraction(1, 2)
    ratio = (last + half_bits) / last  # of its bit to the sender's
    ppm = (1 / ratio - 1) * 1_000_000
    sent = bytes(range(1 << fmt.data_bits)) * 2
    wave = Wave([low_intervals(sent, LineTiming(4800, fmt), 0)])
    found = heard(LineTiming(4800, fmt, ppm), wave)
    fine = values(found) == sent and clean(found)
    assert fine == (abs(half_bits) < Fraction(1, 2))


@pytest.mark.parametrize("ppm", [-100_000, 100_000])
def test_a_clock_off_by_ten_percent_cannot_read(ppm: int) -> None:
    wave = Wave([low_intervals(b"\x05102" * 10, NN_LINE, 0)])
    found = heard(LineTiming(38400, NN_LINE.format, Fraction(ppm)), wave)
    assert not clean(found)


def test_a_sender_s_clock_error_moves_the_edges() -> None:
    slow = LineTiming(38400, NN_LINE.format, Fraction(-10_000))
    found = heard(NN_LINE, Wave([low_intervals(b"12345", slow, 0)]))
    assert values(found) == b"12345"
    assert [char.start for char in found] == [slow.characters(number) for number in range(5)]


def test_formats_that_differ_in_the_parity_bit() -> None:
    for value in range(128):
        wave = Wave([low_intervals(bytes([value]), NN_LINE, 0)])
        even = value.bit_count() & 1  # the parity bit that 7E1 sends
        read = {
            name: heard(LineTiming(38400, CharFormat.parse(name)), wave)[0]
            for name in ("7O1", "8N1", "7N1", "7E2", "8E1")
        }
        # odd parity: wrong in every character
        assert read["7O1"] == (0, 18_750, 17_813, value, False, True)
        # eight bits without parity: never wrong, the parity bit is bit 7
        assert read["8N1"] == (0, 18_750, 17_813, value | even << 7, True, True)
        # seven bits without parity: the parity bit is taken for the stop bit
        assert read["7N1"] == (0, 16_875, 15_938, value, True, bool(even))
        # a second stop bit is not sampled, and makes the receiver ready no later
        assert read["7E2"] == (0, 20_625, 17_813, value, True, True)
        # eight bits and parity: the stop bit is taken for the parity bit, idle for the stop bit
        byte = value | even << 7
        assert read["8E1"][3:] == (byte, byte.bit_count() & 1 == 1, True)


def test_another_rate_reads_something_else() -> None:
    wave = Wave([low_intervals(b"\x05102", NN_LINE, 0)])
    assert values(heard(LineTiming(19200, NN_LINE.format), wave)) != b"\x05102"
    twice = heard(LineTiming(115200, NN_LINE.format), wave)
    assert len(twice) > 4


@pytest.mark.parametrize("number", range(6))
def test_a_receiver_that_starts_between_characters_reads_the_rest(number: int) -> None:
    sent = b"\x05102AB"
    lows = low_intervals(sent, NN_LINE, 0)
    since = 18_750 * number
    for ready in (max(0, since - BIT // 2), since):
        assert values(heard(NN_LINE, Wave([clip(lows, ready, None)]), ready)) == sent[number:]


@settings(deadline=None)
@given(since=st.integers(0, 6 * 18_750 - 1))
def test_a_receiver_that_starts_in_a_character_begins_with_an_edge(since: int) -> None:
    """Whatever it then makes of the rest, characters begin at falling edges and do not overlap."""
    wave = Wave([low_intervals(b"\x05102AB", NN_LINE, 0)])
    ready = since
    for char in heard(NN_LINE, wave, since):
        assert char.start >= ready
        assert wave.level(char.start) == 0
        assert wave.level(char.start - 1) == 1
        assert char.start % BIT == 0
        ready = char.ready


def test_in_u_after_u_a_late_receiver_stays_out_of_step() -> None:
    # 0x55 with its even parity (0): alternating bits, so that any 0 looks like a start bit.
    wave = Wave([low_intervals(b"UUUU", NN_LINE, 0)])
    in_step = heard(NN_LINE, wave, 0)
    late = heard(NN_LINE, wave, 1)
    assert clean(in_step)
    assert not clean(late)
    assert late[0].start == 2 * BIT


@pytest.mark.parametrize(("width", "characters"), [(1, 0), (937, 0), (938, 0), (939, 1), (1875, 1)])
def test_a_glitch_shorter_than_half_a_bit_is_no_start_bit(width: int, characters: int) -> None:
    """The start bit is sampled at 937.5 ticks, rounded up: 938; low up to there excluded is too short."""
    found = heard(NN_LINE, Wave([[(500, 500 + width)]]))
    assert len(found) == characters
    if found:
        assert found[0][3:] == (0x7F, True, True)  # the idle line: seven ones, parity 1, stop 1


@settings(deadline=None)
@given(before=st.integers(1, 4_000), width=st.integers(1, 900))
def test_one_glitch_before_a_frame_never_costs_it(before: int, width: int) -> None:
    """Either the receiver is ready again in time, or it starts less than half a bit early."""
    sent = low_intervals(b"\x05102", NN_LINE, 5_000)
    found = heard(NN_LINE, Wave([[(5_000 - before, min(5_000, 5_000 - before + width))], sent]))
    assert values(found) == b"\x05102"
    assert clean(found)
    assert found[0].start == (5_000 - before if before < BIT / 2 or width > before else 5_000)


def test_edges_within_a_false_start_bit_are_not_seen() -> None:
    """The receiver waits for the first glitch's bit centre (938); the edge at 500 is none to it."""
    lows = [(0, 100), (500, 600), (1_000, 1_000 + BIT)]
    found = heard(NN_LINE, Wave([lows]))
    assert [char.start for char in found] == [1_000]


def test_a_low_stop_bit_waits_for_the_line_to_rise() -> None:
    # A break of three characters is one character with a framing error, then the next edge counts.
    found = heard(NN_LINE, Wave([[(0, 30 * BIT)], low_intervals(b"1", NN_LINE, 40 * BIT)]))
    assert [(char.start, char.value, char.stop_ok) for char in found] == [
        (0, 0, False),
        (40 * BIT, ord("1"), True),
    ]


def test_the_next_start_bit_may_come_half_a_bit_early() -> None:
    first = low_intervals(b"1", NN_LINE, 0)
    early = 10 * BIT - BIT // 2  # 17813, just when the receiver is ready
    assert values(heard(NN_LINE, Wave([first, low_intervals(b"2", NN_LINE, early)]))) == b"12"
    found = heard(NN_LINE, Wave([first, low_intervals(b"2", NN_LINE, early - 1)]))
    assert values(found) != b"12"


# -- a second receiver, from the specification: on a list of falling edges and exact fractions --------


def second_receiver(
    lows: list[tuple[int, int]], bit: Fraction, fmt: CharFormat, ready: Fraction | int
) -> list[tuple[int, int, bool, bool]]:
    covered: set[int] = set()
    for a, b in lows:
        covered.update(range(a, b))
    edges = sorted(tick for tick in covered if tick - 1 not in covered)

    def at(start: int, bits: Fraction) -> int:
        tick = floor(start + bit * bits + Fraction(1, 2))
        return 0 if tick in covered else 1

    found = []
    for edge in edges:
        if edge < ready:
            continue
        if at(edge, Fraction(1, 2)) == 1:  # a false start
            ready = floor(edge + bit / 2 + Fraction(1, 2))
            continue
        data = [at(edge, Fraction(3, 2) + number) for number in range(fmt.data_bits)]
        position = Fraction(3, 2) + fmt.data_bits
        parity_ok = True
        if fmt.parity != "N":
            parity_ok = (sum(data) + at(edge, position)) % 2 == (0 if fmt.parity == "E" else 1)
            position += 1
        value = sum(level << number for number, level in enumerate(data))
        found.append((edge, value, parity_ok, at(edge, position) == 1))
        ready = floor(edge + bit * position + Fraction(1, 2))
    return found


@settings(deadline=None)
@given(
    lows=st.lists(
        st.tuples(st.integers(0, 400), st.sampled_from([1, 2, 3, 5, 9, 11, 20, 40])).map(
            lambda pair: (pair[0], pair[0] + pair[1])
        ),
        max_size=40,
    ),
    fmt=st.sampled_from(FORMATS),
    ppm=st.integers(-50_000, 50_000),
    ready=st.integers(0, 800),
)
def test_any_line_is_read_alike_by_a_second_receiver(
    lows: list[tuple[int, int]], fmt: CharFormat, ppm: int, ready: int
) -> None:
    # A rate at which a bit is 20 ticks keeps the line's ticks countable.
    timing = LineTiming(3_600_000, fmt, Fraction(ppm))
    ours = [(c.start, c.value, c.parity_ok, c.stop_ok) for c in heard(timing, Wave([lows]), ready)]
    assert ours == second_receiver(lows, timing.bit, fmt, ready)

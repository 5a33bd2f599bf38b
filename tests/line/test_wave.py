"""The level of a line, against one computed bit by bit and tick by tick."""

from __future__ import annotations

from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bussim.line.characters import NN_LINE, CharFormat, LineTiming
from bussim.line.wave import Wave, clip, edge_of, encode_bits, low_intervals, paused, paused_by

ODD = LineTiming(115200, CharFormat(8, "O", 2), Fraction(-7_300))

intervals = st.lists(
    st.tuples(st.integers(0, 60), st.integers(1, 20)).map(lambda pair: (pair[0], pair[0] + pair[1])),
    max_size=8,
)


def test_characters_follow_each_other_without_a_gap() -> None:
    bits = encode_bits(b"\x05U", CharFormat(7, "E", 1))
    assert bits == [0, 1, 0, 1, 0, 0, 0, 0, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1]


def test_the_intervals_of_an_enquiry() -> None:
    bit = 1875
    assert low_intervals(b"\x05", NN_LINE, 1000) == [
        (1000, 1000 + bit),
        (1000 + 2 * bit, 1000 + 3 * bit),
        (1000 + 4 * bit, 1000 + 9 * bit),
    ]


@pytest.mark.parametrize("timing", [NN_LINE, ODD], ids=["38400 7E1", "115200 8O2 slow"])
@settings(deadline=None)
@given(
    chars=st.binary(max_size=12),
    start=st.integers(0, 10**9),
    flips=st.sets(st.integers(0, 150), max_size=6),
)
def test_the_line_is_low_in_the_bits_that_are_0(
    timing: LineTiming, chars: bytes, start: int, flips: set[int]
) -> None:
    bits = encode_bits(chars, timing.format)
    for number in flips:
        if number < len(bits):
            bits[number] ^= 1
    wave = Wave([low_intervals(chars, timing, start, flips)])
    assert wave.level(start - 1) == 1
    for number, bit in enumerate(bits):
        first, behind = start + timing.bits(number), start + timing.bits(number + 1)
        assert {wave.level(first), wave.level((first + behind) // 2), wave.level(behind - 1)} == {bit}
    assert wave.level(start + timing.bits(len(bits))) == 1


@settings(deadline=None)
@given(parts=st.lists(intervals, max_size=4))
def test_where_drivers_overlap_a_0_wins(parts: list[list[tuple[int, int]]]) -> None:
    wave = Wave(parts)
    low = [any(a <= tick < b for part in parts for a, b in part) for tick in range(90)]
    assert [wave.level(tick) == 0 for tick in range(90)] == low
    falls = [tick for tick in range(90) if low[tick] and not (tick and low[tick - 1])]
    for tick in range(90):
        assert wave.next_fall(tick) == next((fall for fall in falls if fall >= tick), None)


@settings(deadline=None)
@given(part=intervals, since=st.integers(0, 90), until=st.none() | st.integers(0, 90))
def test_clipping_leaves_what_lies_between(
    part: list[tuple[int, int]], since: int, until: int | None
) -> None:
    end = 200 if until is None else until
    whole, clipped = Wave([part]), Wave([clip(part, since, until)])
    for tick in range(90):
        assert clipped.level(tick) == (whole.level(tick) if since <= tick < end else 1)


@pytest.mark.parametrize("timing", [NN_LINE, ODD], ids=["38400 7E1", "115200 8O2 slow"])
@settings(deadline=None)
@given(
    chars=st.binary(min_size=1, max_size=12),
    start=st.integers(0, 10**9),
    flips=st.sets(st.integers(0, 150), max_size=6),
    pauses=st.dictionaries(st.integers(0, 14), st.integers(1, 100_000), max_size=4),
)
def test_a_pause_moves_what_comes_after_it(
    timing: LineTiming, chars: bytes, start: int, flips: set[int], pauses: dict[int, int]
) -> None:
    given = tuple(pauses.items())
    found = Wave([low_intervals(chars, timing, start, flips, given)])
    width = timing.format.bits
    bits = encode_bits(chars, timing.format)
    for number in flips:
        if number < len(bits):
            bits[number] ^= 1
    over = 0
    for index in range(len(chars)):
        edge = start + over + timing.bits(index * width)
        assert (edge_of(index, timing, start, given), paused(given, index)) == (edge, over)
        assert paused_by(edge, timing, start, given) == over
        for number, bit in enumerate(bits[index * width : (index + 1) * width], index * width):
            first, behind = start + over + timing.bits(number), start + over + timing.bits(number + 1)
            assert {found.level(first), found.level((first + behind) // 2), found.level(behind - 1)} == {bit}
        if index in pauses and index < len(chars) - 1:
            behind = start + over + timing.bits((index + 1) * width)
            assert {found.level(behind), found.level(behind + pauses[index] - 1)} == {1}
            assert paused_by(behind + pauses[index] - 1, timing, start, given) == over
            over += pauses[index]

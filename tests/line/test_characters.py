"""Character formats and the exact times of bits and characters."""

from __future__ import annotations

from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bussim.line.characters import BAUDS, NN_LINE, CharFormat, LineTiming
from bussim.units import TICKS_PER_SECOND, round_half_up

FORMATS = [CharFormat(data, parity, stop) for data in (7, 8) for parity in "NEO" for stop in (1, 2)]


@pytest.mark.parametrize("fmt", FORMATS, ids=str)
def test_a_character_is_start_data_parity_and_stop_bits(fmt: CharFormat) -> None:
    for value in range(1 << fmt.data_bits):
        bits = fmt.encode(value)
        assert len(bits) == fmt.bits
        assert bits[0] == 0
        data = bits[1 : 1 + fmt.data_bits]
        assert sum(bit << index for index, bit in enumerate(data)) == value
        assert bits[-fmt.stop_bits :] == (1,) * fmt.stop_bits
        checked = bits[1 : len(bits) - fmt.stop_bits]
        if fmt.parity == "N":
            assert checked == data
        else:
            assert len(checked) == len(data) + 1
            assert sum(checked) % 2 == (0 if fmt.parity == "E" else 1)


def test_only_the_data_bits_of_a_value_are_sent() -> None:
    assert CharFormat(7, "E", 1).encode(0xB0) == CharFormat(7, "E", 1).encode(0x30)


@pytest.mark.parametrize(
    ("text", "shown", "bits"),
    [("7E1", "7E1", 10), ("8n1", "8N1", 10), ("8-O-2", "8O2", 12), (" 7 - n - 2 ", "7N2", 10)],
)
def test_formats_are_read_as_people_write_them(text: str, shown: str, bits: int) -> None:
    fmt = CharFormat.parse(text)
    assert str(fmt) == shown
    assert fmt.bits == bits
    assert CharFormat.parse(shown) == fmt


@pytest.mark.parametrize("text", ["", "7E", "9N1", "6E1", "7X1", "8N3", "8N0", "7E1x", "E71"])
def test_other_formats_are_refused_by_name(text: str) -> None:
    with pytest.raises(ValueError, match="not a character format") as caught:
        CharFormat.parse(text)
    assert repr(text) in str(caught.value)


@pytest.mark.parametrize(
    ("baud", "ticks"),
    [(4800, 15000), (9600, 7500), (19200, 3750), (38400, 1875), (57600, 1250), (115200, 625)],
)
def test_a_bit_at_every_rate_is_a_whole_number_of_ticks(baud: int, ticks: int) -> None:
    assert baud in BAUDS
    assert LineTiming(baud, CharFormat(8, "N", 1)).bit == ticks


def test_the_link_runs_at_38400_7e1() -> None:
    assert (NN_LINE.baud, str(NN_LINE.format), NN_LINE.format.bits) == (38400, "7E1", 10)
    assert NN_LINE.characters(1) == 18_750  # 260.4 µs
    assert NN_LINE.characters(2) == 37_500
    assert NN_LINE.characters(14) == 262_500


@pytest.mark.parametrize(
    ("timing", "count", "ticks"),
    [
        # 4.5 characters of 11 bits at 115200: 30937.5 ticks, a half goes up
        (LineTiming(115200, CharFormat(8, "E", 1)), Fraction(9, 2), 30_938),
        (LineTiming(9600, CharFormat(8, "E", 1)), Fraction(7, 2), 288_750),
        (LineTiming(19200, CharFormat(8, "N", 2)), Fraction(3, 2), 61_875),
        # a clock 100 ppm fast: 18750 / 1.0001 = 18748.125…
        (LineTiming(38400, CharFormat(7, "E", 1), Fraction(100)), 1, 18_748),
        (LineTiming(38400, CharFormat(7, "E", 1), Fraction(-100)), 1, 18_752),
    ],
)
def test_what_is_not_whole_is_rounded_half_up(timing: LineTiming, count: Fraction, ticks: int) -> None:
    assert timing.characters(count) == ticks


@settings(deadline=None)
@given(
    baud=st.sampled_from(BAUDS),
    fmt=st.sampled_from(FORMATS),
    ppm=st.integers(-20_000, 20_000),
    count=st.integers(0, 5_000),
)
def test_times_are_rounded_once_and_never_added_up(baud: int, fmt: CharFormat, ppm: int, count: int) -> None:
    timing = LineTiming(baud, fmt, Fraction(ppm))
    bit = Fraction(TICKS_PER_SECOND, baud) * Fraction(1_000_000, 1_000_000 + ppm)
    assert timing.bits(count) == round_half_up(bit * count)
    assert abs(timing.bits(count) - bit * count) <= Fraction(1, 2)
    assert timing.characters(count) == timing.bits(count * fmt.bits)


def test_a_long_frame_of_a_fast_clock_does_not_drift() -> None:
    timing = LineTiming(38400, CharFormat(7, "E", 1), Fraction(100))
    added_up = 150 * timing.characters(1)
    assert timing.characters(150) == added_up + 19  # 150 × 0.125…


@pytest.mark.parametrize(
    ("text", "meant"), [("80", "8E1"), ("80.0", "8E1"), ("700", "7E2"), ("70", "7E1"), ("81", None)]
)
def test_a_format_that_became_a_number_is_recognised(text: str, meant: str | None) -> None:
    """8E1 is 8·10¹ to programs that write a scenario anew."""
    with pytest.raises(ValueError, match="not a character format" if meant is None else f'quotes: "{meant}"'):
        CharFormat.parse(text)

"""Times as text and back."""

from __future__ import annotations

import contextlib
from decimal import Decimal
from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bussim.units import TICKS_PER_SECOND, UNIT_TICKS, format_time, parse_time, round_half_up

TEN_YEARS = 10 * 365 * 86400 * TICKS_PER_SECOND


@settings(deadline=None)
@given(st.integers(-TEN_YEARS, TEN_YEARS))
def test_a_written_time_is_read_back_to_the_tick(ticks: int) -> None:
    assert parse_time(format_time(ticks)) == ticks


@settings(deadline=None)
@given(st.integers(0, TEN_YEARS))
def test_a_time_is_written_in_whole_units_few_decimals_or_microseconds(ticks: int) -> None:
    number, unit = format_time(ticks).split(" ")
    assert unit in ("s", "ms", "us")
    assert len(number.partition(".")[2]) <= 4 or unit == "us"


@settings(deadline=None)
@given(
    st.decimals(0, 1000, places=6),
    st.sampled_from(sorted(UNIT_TICKS)),
    st.sampled_from(["", " ", "  "]),
)
def test_a_time_is_rounded_once_a_half_upwards(number: Decimal, unit: str, space: str) -> None:
    exact = Fraction(number) * UNIT_TICKS[unit]
    ticks = parse_time(f"{number}{space}{unit}")
    assert -Fraction(1, 2) <= exact - ticks < Fraction(1, 2)


@pytest.mark.parametrize(
    ("text", "ticks"),
    [
        ("8 ms", 576_000),
        ("50ms", 3_600_000),
        ("2 s", 144_000_000),
        ("100 us", 7_200),
        ("100 µs", 7_200),
        ("100 μs", 7_200),  # the Greek letter, which keyboards give instead of the micro sign
        ("0.4175 ms", 30_060),
        ("1e-3 s", 72_000),
        (".5 ms", 36_000),
        ("5. ms", 360_000),
        ("+1 ns", 0),
        ("7 ns", 1),
        ("-1 us", -72),
        ("1 min", 4_320_000_000),
        ("1 h", 259_200_000_000),
        ("1 d", 86400 * TICKS_PER_SECOND),
        ("10 y", TEN_YEARS),
    ],
)
def test_times(text: str, ticks: int) -> None:
    assert parse_time(text) == ticks


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("50", "is 50, a time without a unit; write one of ns, us, ms, s, min, h, d, y, such as 50 ms"),
        ("5 sec", "has the unit 'sec'; allowed are ns, us, ms, s, min, h, d, y"),
        ("5 MS", "has the unit 'MS'; allowed are"),
        ("soon", "is 'soon', not a time"),
        ("", "is '', not a time"),
        ("1 ms 2 us", "is '1 ms 2 us', not a time"),
        ("1,5 ms", "is '1,5 ms', not a time"),
        ("ms", "is 'ms', not a time"),
        ("1e999 s", "is '1e999 s', not a time"),
        ("nan s", "is 'nan s', not a time"),
    ],
)
def test_what_is_not_a_time(text: str, message: str) -> None:
    with pytest.raises(ValueError) as caught:  # noqa: PT011 - the message is compared below
        parse_time(text)
    assert str(caught.value).startswith(message)


@settings(deadline=None)
@given(st.text(max_size=20))
def test_any_text_is_a_time_or_a_value_error(text: str) -> None:
    with contextlib.suppress(ValueError):
        assert isinstance(parse_time(text), int)


@settings(deadline=None)
@given(st.fractions())
def test_rounding(value: Fraction) -> None:
    assert -Fraction(1, 2) <= value - round_half_up(value) < Fraction(1, 2)


@pytest.mark.parametrize(
    ("ticks", "text"),
    [
        (7_999_900 * 72, "7.9999 s"),
        (100_000 * 72_000, "100 s"),
        (1500 * 72_000, "1500 ms"),
        (12_500 * 72, "12.5 ms"),
        (500 * 72, "500 us"),
        (60_000 * TICKS_PER_SECOND, "60000 s"),
        (0, "0 s"),
        (-12_500 * 72, "-12.5 ms"),
    ],
)
def test_a_time_is_shown_with_few_digits(ticks: int, text: str) -> None:
    assert format_time(ticks) == text
    assert parse_time(text) == ticks

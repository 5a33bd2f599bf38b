from __future__ import annotations

from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bussim.plc.sources import Constant, Counter, Ramp, Source, Toggle

TICKS = st.integers(0, 5000)
SOURCES = st.one_of(
    st.builds(Toggle, st.integers(1, 900)),
    st.builds(Counter, st.integers(1, 900)),
    st.builds(Constant, st.integers(-32768, 65535)),
    st.builds(Ramp, st.integers(-300, 300), st.integers(-300, 300), st.integers(1, 4000)),
)


@given(SOURCES, TICKS)
def test_next_change_is_the_first_tick_with_another_value(source: Source, tick: int) -> None:
    value, found = source.value(tick), source.next_change(tick)
    later = next((t for t in range(tick + 1, tick + 5000) if source.value(t) != value), None)
    if found is None or found >= tick + 5000:
        assert later is None
    else:
        assert found == later


@given(SOURCES, TICKS)
def test_values_are_words(source: Source, tick: int) -> None:
    assert 0 <= source.value(tick) <= 65535


def test_toggle_and_counter_begin_with_zero() -> None:
    assert [Toggle(10).value(t) for t in (0, 9, 10, 19, 20)] == [0, 0, 1, 1, 0]
    assert [Counter(10).value(t) for t in (0, 9, 10, 655_359, 655_360)] == [0, 0, 1, 65_535, 0]


@pytest.mark.parametrize(("start", "stop"), [(0, 1000), (1000, 0), (-5, 5), (7, 7)])
def test_a_ramp_is_the_straight_line_rounded_towards_its_start(start: int, stop: int) -> None:
    ramp = Ramp(start, stop, 3000)
    for tick in range(0, 4000, 7):
        line = start + Fraction(stop - start) * Fraction(min(tick, 3000), 3000)
        value = ramp.value(tick)
        value -= 65536 if value > 32767 else 0
        assert abs(value - line) < 1
        assert abs(value - start) <= abs(line - start)
    assert ramp.value(3000) == ramp.value(10**9) == stop % 65536

"""Lines on which several drivers are on, against their definition tick by tick."""

from __future__ import annotations

from fractions import Fraction
from math import floor, sqrt

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bussim.line.characters import CharFormat, LineTiming
from bussim.line.contention import Contention, Driver, disputed_level, line_lows
from bussim.line.wave import Wave, clip, low_intervals
from bussim.units import TICKS_PER_SECOND

#: 10 ticks a bit; 10 2/7; 26; so that a test can go through every tick.
FORMATS = [
    LineTiming(TICKS_PER_SECOND // 10, CharFormat(7, "E", 1)),
    LineTiming(7_000_000, CharFormat(8, "N", 1)),
    LineTiming(TICKS_PER_SECOND // 26, CharFormat(8, "O", 2), Fraction(311)),
]
SPAN = 1400


@st.composite
def drivers(draw: st.DrawFn) -> list[Driver]:
    """Up to four drivers, each on for a frame with pauses and for some time after it."""
    found = []
    for number in range(draw(st.integers(1, 4))):
        timing, start = draw(st.sampled_from(FORMATS)), draw(st.integers(0, 200))
        chars = draw(st.binary(min_size=1, max_size=3))
        pauses = tuple(draw(st.dictionaries(st.integers(0, 1), st.integers(1, 60))).items())
        lows = low_intervals(chars, timing, start, draw(st.sets(st.integers(0, 30))), pauses)
        since = start + draw(st.sampled_from([0, 0, 25]))
        until = max(since + 1, lows[-1][1] if lows else 0) + draw(st.integers(0, 300))
        found.append(Driver((start, f"n{number}"), since, until, clip(lows, since, until), timing, pauses))
    return found


def edges(driver: Driver) -> list[int]:
    """The edges of all bits of a frame, and of those that would follow; after a pause they begin anew."""
    found: set[int] = set()
    (start, _), timing, over, begin = driver.begun, driver.timing, 0, driver.begun[0]
    for after, ticks in (*sorted(driver.pauses), (SPAN, 0)):
        end = start + timing.characters(after + 1) + over + ticks
        numbers = range(int((min(end, SPAN) - start - over) / timing.bit) + 2)
        grid = (start + over + floor(timing.bit * number + Fraction(1, 2)) for number in numbers)
        found.update(edge for edge in grid if begin <= edge < min(end, SPAN))
        begin, over = end, over + ticks
    return sorted(found)


def test_a_bit_begins_at_an_edge_and_ends_at_the_next() -> None:
    for timing in FORMATS:
        for pauses in ((), ((1, 33),)):
            driver = Driver((17, "a"), 17, SPAN, [], timing, pauses)
            found = edges(driver)
            for tick in range(17, 900):
                edge, following = driver.bit_at(tick)
                assert edge == max(each for each in found if each <= tick)
                assert pauses or following == min(each for each in found if each > tick)


@given(several=drivers(), seed=st.integers(0, 2**63 - 1), order=st.randoms(use_true_random=False))
def test_every_tick_is_as_defined(several: list[Driver], seed: int, order: object) -> None:
    level = disputed_level(Contention.UNDEFINED, seed, "link")
    assert level is not None
    shuffled = list(several)
    order.shuffle(shuffled)  # type: ignore[attr-defined] # a random.Random
    wave, zero = Wave([line_lows(shuffled, level)]), Wave([line_lows(shuffled, None)])
    every = {driver.begun: edges(driver) for driver in several}
    for tick in range(SPAN):
        on = [driver for driver in several if driver.since <= tick < driver.until]
        each = [0 if any(a <= tick < b for a, b in driver.lows) else 1 for driver in on]
        assert zero.level(tick) == min(each, default=1)
        if len(set(each)) < 2:
            assert wave.level(tick) == min(each, default=1)
            continue
        later = max(on, key=lambda driver: driver.begun)
        assert wave.level(tick) == level(max(edge for edge in every[later.begun] if edge <= tick))


@given(several=drivers(), gone=st.integers(0, SPAN))
def test_what_went_off_plays_no_part_any_more(several: list[Driver], gone: int) -> None:
    """A receiver may forget it, and one that began to listen later never saw it."""
    level = disputed_level(Contention.UNDEFINED, 3, "link")
    whole = Wave([line_lows(several, level)])
    left = Wave([line_lows([driver for driver in several if driver.until > gone], level)])
    late = [
        driver._replace(since=max(gone, driver.since), lows=clip(driver.lows, gone, None))
        for driver in several
        if driver.until > gone
    ]
    heard = Wave([line_lows(late, level)])
    for tick in range(gone, SPAN):
        assert left.level(tick) == whole.level(tick) == heard.level(tick)


def test_an_idle_driver_that_is_on_damages_the_zeros_of_a_frame_and_no_ones() -> None:
    timing = FORMATS[0]
    chars = bytes(range(1, 100))
    lows = low_intervals(chars, timing, 1000)
    end = 1000 + timing.characters(len(chars))
    frame = Driver((1000, "later"), 1000, end, lows, timing)
    tail = Driver((900, "tail"), 990, end, [], timing)
    clean = Wave([lows])
    heard = Wave([line_lows([tail, frame], disputed_level(Contention.UNDEFINED, 1, "b"))])
    zeros = [tick for tick in range(1005, end, 10) if clean.level(tick) == 0]
    lost = sum(heard.level(tick) for tick in zeros)
    assert all(heard.level(tick) for tick in range(1005, end, 10) if clean.level(tick))
    # Each zero is a coin of its own: 4 standard deviations of a binomial.
    assert abs(lost - len(zeros) / 2) < 4 * sqrt(len(zeros)) / 2
    assert [low for low in line_lows([tail, frame], None) if low not in lows] == []


@pytest.mark.parametrize("step", [1, 1875, 7500])
def test_bits_are_decided_at_random_and_each_for_itself(step: int) -> None:
    level = disputed_level(Contention.UNDEFINED, 12, "link")
    assert level is not None
    number = 20_000
    found = [level(10**9 + step * place) for place in range(number)]
    assert abs(sum(found) - number / 2) < 4 * sqrt(number) / 2
    for distance in (1, 2, 3, 8, 10):
        pairs = zip(found, found[distance:], strict=False)
        alike = sum(one == other for one, other in pairs)
        assert abs(alike - (number - distance) / 2) < 4 * sqrt(number) / 2


def test_the_decision_is_that_of_the_seed_the_bus_and_the_tick_for_ever() -> None:
    def text(seed: int, bus: str) -> str:
        level = disputed_level(Contention.UNDEFINED, seed, bus)
        assert level is not None
        return "".join(str(level(tick)) for tick in range(0, 24 * 1875, 1875))

    # As recorded: a trace of an earlier run must be read with the levels of that run.
    assert text(1, "link") == "001111111011011100010100"
    assert len({text(1, "link"), text(2, "link"), text(1, "line")}) == 3
    assert disputed_level(Contention.ZERO_WINS, 1, "link") is None

"""Kinematics against an independent closed form and a numerical integration."""

from __future__ import annotations

from fractions import Fraction
from math import sqrt

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bussim.devices.stepper.motion import Drive, run, travel
from bussim.units import TICKS_PER_SECOND

S = TICKS_PER_SECOND


def drive(start: int, top: int | Fraction, acceleration: int) -> Drive:
    return Drive(Fraction(start), Fraction(top), Fraction(acceleration))


def closed_form(start: float, top: float, slope: float, pulses: float) -> float:
    """Seconds of a way, by the textbook."""
    if slope <= 0 or top <= start:
        return pulses / top
    ramp = (top**2 - start**2) / (2 * slope)
    if 2 * ramp <= pulses:
        return 2 * (top - start) / slope + (pulses - 2 * ramp) / top
    return 2 * (sqrt(start**2 + slope * pulses) - start) / slope


def integrated(start: float, top: float, slope: float, pulses: float, seconds: float) -> float:
    """Pulses after some seconds: the rate is summed up over small steps of time.

    The rate at any moment is the least of what was reached by accelerating, the top, and what can
    still be braked to the start rate over the rest of the way.
    """
    steps = 20_000
    dt = seconds / steps
    done = 0.0
    for number in range(steps):
        middle = (number + 0.5) * dt
        rate = top
        if slope > 0 and top > start:
            rate = min(top, start + slope * middle)
            left = max(pulses - done - rate * dt / 2, 0.0)
            rate = min(rate, sqrt(start**2 + 2 * slope * left))
        done += rate * dt
    return done


WAYS = [
    # start, top, acceleration, pulses
    (500, 1600, 2000, 64_000),  # trapezoid
    (500, 1600, 2000, 100),  # triangle
    (500, 1600, 2000, 1155),  # just a triangle: the ramps need 1155 pulses
    (500, 1600, 2000, 1156),
    (0, 5000, 1000, 3000),  # from standstill
    (500, 400, 2000, 1000),  # top below start
    (500, 1600, 0, 1000),  # no ramp
    (1, 200_000, 50_000, 10_000_000),
]


@pytest.mark.parametrize(("start", "top", "slope", "pulses"), WAYS)
def test_end_by_the_textbook(start: int, top: int, slope: int, pulses: int) -> None:
    motion = travel(drive(start, top, slope), pulses, 1000, 1)
    expected = closed_form(start, top, slope, pulses) * S
    assert motion.end - 1000 == pytest.approx(expected, abs=1.5, rel=1e-12)
    assert motion.pulses(motion.end) == motion.length == pulses
    assert motion.pulses(motion.end - 1) <= pulses
    assert motion.pulses(1000) == 0


@pytest.mark.parametrize(("start", "top", "slope", "pulses"), WAYS[:-1])
@pytest.mark.parametrize("part", [0.05, 0.3, 0.5, 0.7, 0.95])
def test_position_in_between_by_integration(
    start: int, top: int, slope: int, pulses: int, part: float
) -> None:
    motion = travel(drive(start, top, slope), pulses, 0, 1)
    tick = int(motion.end * part)
    # Half a pulse for the counter's whole steps, and what the integration itself may be off.
    error = 1 + pulses * 1e-3
    assert motion.pulses(tick) == pytest.approx(integrated(start, top, slope, pulses, tick / S), abs=error)


drives = st.builds(drive, st.integers(0, 5000), st.integers(1, 50_000), st.integers(0, 100_000))
pulse_counts = st.integers(0, 1_000_000)


@given(drives, pulse_counts, st.lists(st.floats(0, 1.1), min_size=2, max_size=10))
def test_the_counter_never_goes_back_and_ends_at_the_way(one: Drive, pulses: int, parts: list[float]) -> None:
    motion = travel(one, pulses, 5, 1)
    ticks = sorted(5 + int((motion.end - 5) * part) for part in parts)
    counts = [motion.pulses(tick) for tick in ticks]
    assert counts == sorted(counts)
    assert all(0 <= count <= pulses for count in counts)
    expected = closed_form(float(one.start), float(one.top), float(one.acceleration), pulses)
    assert motion.end - 5 == pytest.approx(expected * S, abs=2, rel=1e-9)


@given(drives, st.integers(1, 100_000), st.data())
def test_reaches_is_the_first_tick_with_so_many(one: Drive, pulses: int, data: st.DataObject) -> None:
    motion = travel(one, pulses, 0, 1)
    mark = data.draw(st.integers(1, pulses))
    tick = motion.reaches(mark)
    assert motion.pulses(tick) >= mark
    assert motion.pulses(tick - 1) < mark
    assert motion.reaches(pulses + 1) is None
    assert motion.reaches(0) == 0


@given(drives, st.integers(0, 100 * S))
def test_an_endless_run_is_the_beginning_of_a_long_way(one: Drive, tick: int) -> None:
    assert run(one, 0, 1).pulses(tick) == travel(one, 10**10, 0, 1).pulses(tick)


@given(drives, pulse_counts, st.floats(0, 1))
def test_slowing_down_goes_on_smoothly_and_stays_within_the_way(one: Drive, pulses: int, part: float) -> None:
    motion = travel(one, pulses, 0, 1)
    tick = int(motion.end * part)
    slowed = motion.slowed(tick)
    assert slowed.pulses(tick) == motion.pulses(tick)
    assert tick <= slowed.end <= motion.end + 1
    assert motion.pulses(tick) <= slowed.length <= pulses
    rate = motion._phase(Fraction(tick)).rate_at(Fraction(tick))
    if slowed is not motion and one.ramps and tick < motion.end and rate > one.start:
        seconds = (rate - one.start) / one.acceleration
        assert slowed.end - tick == pytest.approx(float(seconds) * S, abs=1)
        way = (rate**2 - one.start**2) / (2 * one.acceleration)
        assert slowed.length - motion.pulses(tick) == pytest.approx(float(way), abs=1)


def test_slowing_down_an_endless_run() -> None:
    motion = run(drive(500, 1600, 2000), 0, 1).slowed(10 * S)
    assert motion.end == 10 * S + Fraction(1600 - 500, 2000) * S
    # 10 s less the ramp at 1600 Hz, the ramp up and the ramp down.
    ramp = Fraction(1600**2 - 500**2, 2 * 2000)
    assert motion.length == int(2 * ramp + (10 - Fraction(1100, 2000)) * 1600)


def test_a_cut_stops_dead() -> None:
    motion = travel(drive(500, 1600, 2000), 10_000, 0, 1)
    cut = motion.cut(2 * S)
    assert cut.end == 2 * S
    assert cut.length == motion.pulses(2 * S) == cut.pulses(3 * S)
    assert motion.cut(motion.end) is motion


def test_no_speed_no_motion() -> None:
    for call in (lambda: travel(drive(5, 0, 1), 1, 0, 1), lambda: run(drive(5, 0, 1), 0, 1)):
        with pytest.raises(ValueError, match="a motor without a speed does not move"):
            call()

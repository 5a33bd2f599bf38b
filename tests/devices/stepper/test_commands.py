"""What the stepper's commands do, and when they are over."""

from __future__ import annotations

from fractions import Fraction

import pytest

from bussim.devices.stepper.map import Stepper
from bussim.units import TICKS_PER_SECOND
from tests.devices.ask import registers
from tests.devices.stepper.steppers import (
    LOW,
    PER_UNIT,
    SLOPE,
    TOP,
    CommandRefused,
    Job,
    MotorStarted,
    MotorStopped,
    StopReason,
    command,
    events,
    next_change,
    position,
    run_to_end,
    seconds_for,
    set_,
)

S = TICKS_PER_SECOND


# -- single runs ------------------------------------------------------------------------------------


def test_a_run_of_200_units_ends_where_and_when_the_kinematics_say() -> None:
    device = Stepper()
    set_(device, distance=20000)
    now = 7 * S
    assert command(device, "run_once", now) == 0
    pulses = 64_000
    end = now + round(seconds_for(pulses) * S)
    assert next_change(device) == device.alike_until(now) == end
    assert (device.value("running", now), device.value("arrived", now)) == (1, 0)
    assert device.value("running", end - 1) == 1
    assert position(device, end - 1) < 20000 or device.value("arrived", end - 1) == 0
    assert (device.value("running", end), device.value("arrived", end)) == (0, 1)
    assert position(device, end) == 20000
    assert registers(device, 0x0C, now=end) == (1,)
    assert events(device) == [
        MotorStarted(now, Job.RUN_ONCE, 1, 20000),
        MotorStopped(end, Job.RUN_ONCE, StopReason.ARRIVED, 20000),
    ]


def test_the_counter_in_between() -> None:
    device = Stepper()
    set_(device, distance=20000)
    command(device, "run_once", 0)
    for tick in range(0, 2 * S, S // 50):
        seconds = Fraction(tick, S)
        ramp = Fraction(TOP - LOW, SLOPE)
        if seconds <= ramp:
            pulses = LOW * seconds + SLOPE * seconds**2 / 2
        else:
            pulses = Fraction(TOP**2 - LOW**2, 2 * SLOPE) + TOP * (seconds - ramp)
        assert abs(position(device, tick) - pulses / PER_UNIT) <= 1, tick


def test_reading_does_not_disturb() -> None:
    read, unread = Stepper(), Stepper()
    for device in (read, unread):
        set_(device, distance=20000)
        command(device, "run_once", 0)
    for tick in range(0, 45 * S, S // 3):
        position(read, tick)
    assert position(read, 50 * S) == position(unread, 50 * S)
    assert events(read) == events(unread)


def test_a_short_run_is_a_triangle() -> None:
    device = Stepper()
    set_(device, distance=100)  # 320 pulses; the ramps alone would need 1155
    command(device, "run_once", 0)
    peak = (LOW**2 + SLOPE * 320) ** 0.5
    assert next_change(device) == pytest.approx(2 * (peak - LOW) / SLOPE * S, abs=2)
    assert position(device, run_to_end(device)) == 100


def test_reverse_and_negative_distances() -> None:
    for values, expected in [
        ({"distance": 500, "direction": 1}, -500),
        ({"distance": 0x1_0000_0000 - 500}, -500),
        ({"distance": 0x1_0000_0000 - 500, "direction": 1}, 500),
    ]:
        device = Stepper()
        set_(device, **values)
        command(device, "run_once", 0)
        assert position(device, run_to_end(device)) == expected


def test_absolute_runs_go_to_a_position() -> None:
    device = Stepper()
    set_(device, absolute=1, distance=1000, direction=1)  # the direction does not matter
    command(device, "run_once", 0)
    now = run_to_end(device)
    assert position(device, now) == 1000
    set_(device, now, distance=0x1_0000_0000 - 250)
    command(device, "run_once", now)
    now = run_to_end(device)
    assert position(device, now) == -250
    command(device, "run_once", now)  # it is there already
    assert (device.value("running", now), device.value("arrived", now)) == (0, 1)


def test_relative_runs_add_up_without_drift() -> None:
    device = Stepper()
    set_(device, pitch=700, distance=100)  # 1600/7 pulses a unit: no whole number
    now = 0
    for _ in range(20):
        command(device, "run_once", now)
        now = run_to_end(device)
    pulses = 20 * round(Fraction(1600, 700) * 100)
    assert position(device, now) == round(pulses / Fraction(1600, 700))


def test_round_trips_go_there_and_back() -> None:
    device = Stepper()
    set_(device, distance=1000, round_trips=3)
    command(device, "run_once", 0)
    end = 6 * next_change(device)
    assert device.value("arrived", end - 1) == 0
    assert run_to_end(device) == end
    assert position(device, end) == 0
    assert device.value("arrived", end) == 1
    stops = [event.position for event in events(device) if isinstance(event, MotorStopped)]
    assert stops == [1000, 0, 1000, 0, 1000, 0]


def test_round_trips_keep_the_speed_they_began_with() -> None:
    device = Stepper()
    set_(device, distance=1000, round_trips=2)
    command(device, "run_once", 0)
    one = next_change(device)
    set_(device, one // 2, speed=0)
    assert run_to_end(device) == 4 * one
    assert command(device, "run_once", 5 * one) == 4  # now it has none


def test_return_to_zero_and_clearing_the_position() -> None:
    device = Stepper()
    set_(device, distance=1000)
    command(device, "run_once", 0)
    now = run_to_end(device)
    assert command(device, "to_zero", now) == 0
    assert device.value("running", now) == 1
    now = run_to_end(device)
    assert position(device, now) == 0
    assert device.value("arrived", now) == 1  # of the single run, whose flag stays
    command(device, "run_once", now)
    now = run_to_end(device)
    assert command(device, "clear_position", now) == 0
    assert position(device, now) == 0
    command(device, "to_zero", now)
    assert device.value("running", now) == 0


def test_arrived_is_of_the_latest_single_run_alone() -> None:
    device = Stepper()
    set_(device, distance=1000)
    command(device, "run_once", 0)
    now = run_to_end(device)
    command(device, "run_once", now)
    assert device.value("arrived", now) == 0
    command(device, "stop", now + S // 10)
    run_to_end(device)
    assert device.value("arrived", now + S) == 0


# -- stopping ---------------------------------------------------------------------------------------


def test_stop_ramps_down_or_stands_at_once() -> None:
    ends = []
    for mode in (0, 1):
        device = Stepper()
        set_(device, distance=20000, stop_mode=mode)
        command(device, "run_once", 0)
        now = 5 * S  # at top speed
        before = position(device, now)
        assert command(device, "stop", now) == 0
        end = next_change(device)
        if mode:
            assert (end, device.value("running", now)) == (None, 0)
            assert position(device, 10 * S) == before
        else:
            assert end - now == Fraction(TOP - LOW, SLOPE) * S
            run_to_end(device)
            way = Fraction(TOP**2 - LOW**2, 2 * SLOPE) / PER_UNIT
            assert abs(position(device, 10 * S) - before - way) <= 1
        stopped = [event for event in events(device) if isinstance(event, MotorStopped)]
        assert [event.reason for event in stopped] == [StopReason.COMMAND]
        ends.append(stopped[0].tick)
    assert ends[1] == 5 * S < ends[0]


def test_stop_while_it_ramps_down_to_its_goal_lets_it_arrive() -> None:
    device = Stepper()
    set_(device, distance=20000)
    command(device, "run_once", 0)
    end = next_change(device)
    command(device, "stop", end - S // 10)
    assert next_change(device) == end
    assert (device.value("arrived", end), position(device, end)) == (1, 20000)


def test_a_second_stop_changes_nothing() -> None:
    device = Stepper()
    set_(device, distance=20000)
    command(device, "run_once", 0)
    command(device, "stop", 5 * S)
    end = next_change(device)
    command(device, "stop", 5 * S + S // 4)
    assert next_change(device) == end


def test_stop_without_motion_is_fine() -> None:
    assert command(Stepper(), "stop", 0) == 0


# -- jogs -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "sign"), [("jog_forward", 1), ("jog_reverse", -1)])
def test_jog_runs_until_it_goes_off(name: str, sign: int) -> None:
    device = Stepper()
    assert command(device, name, 0) == 0
    assert next_change(device) is None
    assert command(device, name, S) == 0  # on again: nothing new
    released = 10 * S
    assert command(device, name, released, on=False) == 0
    end = next_change(device)
    assert end - released == Fraction(TOP - LOW, SLOPE) * S
    run_to_end(device)
    ramp = Fraction(TOP**2 - LOW**2, 2 * SLOPE)
    pulses = 2 * ramp + (10 - Fraction(TOP - LOW, SLOPE)) * TOP
    assert abs(position(device, end) * sign - pulses / PER_UNIT) <= 1
    assert [event.reason for event in events(device) if isinstance(event, MotorStopped)] == [
        StopReason.RELEASED
    ]


def test_the_other_jog_does_not_release() -> None:
    device = Stepper()
    command(device, "jog_forward", 0)
    assert command(device, "jog_reverse", S, on=False) == 0
    assert device.value("running", S) == 1
    assert command(device, "jog_reverse", S) == 4  # the motor runs


# -- refusals ---------------------------------------------------------------------------------------


MOVES = ["run_once", "to_zero", "jog_forward", "jog_reverse", "home", "start_project"]


@pytest.mark.parametrize("name", MOVES)
def test_nothing_starts_while_the_motor_runs(name: str) -> None:
    device = Stepper()
    set_(device, distance=20000)
    command(device, "run_once", 0)
    events(device)
    assert command(device, name, S) == 4
    assert [type(event) for event in events(device)] == [CommandRefused]


@pytest.mark.parametrize("name", MOVES)
def test_nothing_starts_while_disabled(name: str) -> None:
    device = Stepper()
    set_(device, distance=20000, disabled=1)
    assert command(device, name, 0) == 4
    set_(device, disabled=0)
    assert command(device, name, 0) == 0


@pytest.mark.parametrize("register", ["speed", "step_angle", "microsteps", "pitch"])
def test_a_run_that_cannot_be_computed(register: str) -> None:
    device = Stepper()
    set_(device, distance=100, **{register: 0})
    assert command(device, "run_once", 0) == 4
    assert command(device, "jog_forward", 0) == (0 if register == "pitch" else 4)


@pytest.mark.parametrize("name", ["read_project", "clear_project", "reset_basic"])
def test_parameters_are_not_exchanged_under_a_running_motor(name: str) -> None:
    device = Stepper()
    set_(device, distance=20000)
    command(device, "run_once", 0)
    assert command(device, name, S) == 4
    assert command(device, "save", S) == 0


def test_disabling_stands_at_once() -> None:
    device = Stepper()
    set_(device, distance=20000)
    command(device, "run_once", 0)
    set_(device, 5 * S, disabled=1)
    assert device.value("running", 5 * S) == 0
    assert [event.reason for event in events(device) if isinstance(event, MotorStopped)] == [
        StopReason.DISABLED
    ]

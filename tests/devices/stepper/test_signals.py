"""Switches, signals, outputs and power of the stepper."""

from __future__ import annotations

from fractions import Fraction
from math import ceil

import pytest

from bussim.devices.stepper.axis import Switch
from bussim.devices.stepper.map import Stepper
from bussim.units import TICKS_PER_SECOND
from tests.devices.stepper.steppers import (
    LOW,
    PER_UNIT,
    SLOPE,
    TOP,
    Job,
    MotorStopped,
    OutputChanged,
    PoweredOn,
    StopReason,
    command,
    events,
    next_change,
    output,
    position,
    run_to_end,
    set_,
    set_input,
)

S = TICKS_PER_SECOND


# -- switches and signals ---------------------------------------------------------------------------


def test_homing_runs_back_to_the_mechanical_zero() -> None:
    device = Stepper(switches=[Switch(1, high=-3000)])
    set_(device, home_input=1)
    assert command(device, "home", 0) == 0
    end = run_to_end(device)
    assert position(device, end) == -3000
    pulses = 9600
    ramp = Fraction(TOP**2 - LOW**2, 2 * SLOPE)
    assert end == pytest.approx(float(Fraction(TOP - LOW, SLOPE) + (pulses - ramp) / TOP) * S, abs=2)
    assert events(device)[-1] == MotorStopped(end, Job.HOME, StopReason.HOME, -3000)
    assert device.value("input_1", end) == 1
    assert command(device, "home", end) == 0  # it is there
    assert device.value("running", end) == 0
    command(device, "clear_position", end)
    assert position(device, end) == 0


def test_homing_without_a_signal_goes_on_until_stopped() -> None:
    device = Stepper()
    command(device, "home", 0)
    assert next_change(device) is None
    command(device, "stop", 100 * S)
    assert position(device, 200 * S) < -40_000


@pytest.mark.parametrize(("direction", "register"), [(0, "forward_limit_input"), (1, "reverse_limit_input")])
def test_limits_stop_at_once_and_bar_the_way(direction: int, register: str) -> None:
    sign = -1 if direction else 1
    switch = Switch(2, high=-500) if direction else Switch(2, low=500)
    device = Stepper(switches=[switch])
    set_(device, distance=2000, direction=direction, **{register: 2})
    command(device, "run_once", 0)
    end = run_to_end(device)
    assert position(device, end) == sign * 500
    assert events(device)[-1].reason is StopReason.LIMIT
    assert device.value("arrived", end) == 0
    assert command(device, "run_once", end) == 4
    set_(device, end, direction=1 - direction)
    assert command(device, "run_once", end) == 0  # away from it


@pytest.mark.parametrize("reverse", [False, True])
def test_a_switch_is_on_within_its_range_only(*, reverse: bool) -> None:
    sign = -1 if reverse else 1
    low, high = sorted((200 * sign, 300 * sign))
    device = Stepper(switches=[Switch(3, low, high)])
    set_(device, distance=1000, direction=int(reverse))
    command(device, "run_once", 0)
    changes: list[int] = []
    while (at := next_change(device)) is not None:
        axis = device.controller.axis
        if device.value("running", at):
            changes.append(axis.pulses(at))
            inside = low * PER_UNIT <= axis.pulses(at) <= high * PER_UNIT
            before = low * PER_UNIT <= axis.pulses(at - 1) <= high * PER_UNIT
            assert (device.value("input_3", at), inside != before) == (int(inside), True)
    assert changes == [640 * sign, 961 * sign]  # 3.2 pulses a hundredth: on at 640, off behind 960
    assert device.value("input_3", at or 10**10) == 0


def test_without_units_no_switch_is_on() -> None:
    device = Stepper(switches=[Switch(3, -100, 100)])
    assert device.value("input_3", 0) == 1
    set_(device, pitch=0)
    assert device.value("input_3", 0) == 0
    assert position(device, 0) == 0


@pytest.mark.parametrize("mode", [0, 1, 2])
def test_start_signals(mode: int) -> None:
    device = Stepper()
    set_(device, distance=1000, signal_mode=mode, forward_input=4, reverse_input=5)
    set_input(device, 5, S, on=True)
    assert device.value("running", S) == 1
    set_input(device, 5, 2 * S, on=False)
    if mode == 0:
        assert position(device, run_to_end(device)) == -1000
        assert device.value("arrived", 100 * S) == 0  # that flag is for the command alone
    elif mode == 1:
        assert next_change(device) is None
        command(device, "stop", 3 * S)
        run_to_end(device)
    else:
        assert next_change(device) == 2 * S + Fraction(TOP - LOW, SLOPE) * S
        run_to_end(device)
    now = 100 * S
    before = position(device, now)
    set_input(device, 4, now, on=True)
    assert position(device, now + S) > before


def test_a_signal_that_was_on_before_starts_nothing() -> None:
    device = Stepper()
    set_input(device, 4, 0, on=True)
    set_(device, distance=1000, forward_input=4)
    assert device.value("running", S) == 0


def test_outputs_by_coil() -> None:
    device = Stepper()
    for number, register in [(1, "output_1"), (2, "output_2"), (3, "output_3")]:
        assert command(device, f"output_{number}_on", number) == 0
        assert device.value(register, number) == 1
        assert output(device, number, number)
    for number, register in [(1, "output_1"), (2, "output_2"), (3, "output_3")]:
        assert command(device, f"output_{number}_off", 10 + number) == 0
        assert device.value(register, 10 + number) == 0
    found = events(device)
    assert found == [OutputChanged(k, k, on=True) for k in (1, 2, 3)] + [
        OutputChanged(10 + k, k, on=False) for k in (1, 2, 3)
    ]


def test_power_off_stands_at_once_and_forgets() -> None:
    device = Stepper()
    set_(device, distance=20000)
    command(device, "run_once", 0)
    command(device, "output_2_on", S)
    device.power_off(5 * S)
    assert next_change(device) is None
    set_input(device, 1, 6 * S, on=True)
    device.power_on(8 * S)
    assert (position(device, 8 * S), device.value("output_2", 8 * S)) == (0, 0)
    assert device.value("distance", 8 * S) == 0  # it was not saved
    assert device.value("input_1", 8 * S) == 1
    found = events(device)
    assert MotorStopped in {type(event) for event in found}
    assert found[-1] == PoweredOn(8 * S, 1, 9600)


@pytest.mark.parametrize("asked", [False, True])
def test_units_that_change_under_way_move_the_switches(*, asked: bool) -> None:
    device = Stepper(switches=[Switch(2, low=10000)])
    set_(device, distance=60000, forward_limit_input=2)
    command(device, "run_once", 0)
    # 10 units a turn instead of 5: the switch at 100.00 units is half as many pulses away.
    set_(device, 5 * S, pitch=1000)
    if asked:
        for tick in range(5 * S, 60 * S, S // 10):
            position(device, tick)
    device.advance(100 * S)
    stopped = events(device)[-1]
    assert (stopped.reason, stopped.position) == (StopReason.LIMIT, 10000)
    ramp = Fraction(TOP**2 - LOW**2, 2 * SLOPE)
    assert stopped.tick == ceil((Fraction(TOP - LOW, SLOPE) + (16_000 - ramp) / TOP) * S)

"""The choices that the stepper's manual leaves open, each made the other way."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import pytest

from bussim.devices.stepper.axis import Switch
from bussim.devices.stepper.map import Stepper
from bussim.devices.stepper.profile import STEPPER_PROFILE, StepOutput, StepperProfile
from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND
from tests.devices.ask import coil
from tests.devices.stepper.steppers import (
    LOW,
    PER_UNIT,
    SLOPE,
    TOP,
    CommandRefused,
    OutputChanged,
    command,
    events,
    next_change,
    position,
    run_to_end,
    set_,
)

S = TICKS_PER_SECOND


def stepper(*switches: Switch, **choices: object) -> Stepper:
    return Stepper(switches=switches, profile=replace(STEPPER_PROFILE, **choices))


def test_defaults() -> None:
    assert StepperProfile(1, Fraction(1), False, 4, StepOutput.DELAY, True) == STEPPER_PROFILE


def test_the_save_coil_elsewhere() -> None:
    device = stepper(save_coil=20)
    assert coil(device, 0) == 2
    set_(device, station=9)
    assert coil(device, 19) == 0
    device.power_off(0)
    device.power_on(0)
    assert device.station == 9
    with pytest.raises(ValueError, match=r"save_coil \(=8\) is run_once"):
        stepper(save_coil=8)


def test_acceleration_in_another_unit() -> None:
    device = stepper(acceleration_unit=Fraction(10))
    set_(device, distance=20000, acceleration=SLOPE // 10)
    command(device, "run_once", 0)
    end = 2 * Fraction(TOP - LOW, SLOPE) + (64_000 - Fraction(TOP**2 - LOW**2, SLOPE)) / TOP
    assert next_change(device) == round(end * S)


def test_homing_zeroes() -> None:
    device = stepper(Switch(1, high=-3000), homing_zeroes=True)
    set_(device, home_input=1)
    command(device, "home", 0)
    assert position(device, run_to_end(device)) == 0
    assert events(device)[-1].position == 0
    assert device.controller.axis.pulses(100 * S) == -3000 * PER_UNIT


def test_refused_commands_are_echoed() -> None:
    device = stepper(refused_command=0)
    set_(device, distance=20000)
    command(device, "run_once", 0)
    end = next_change(device)
    assert command(device, "to_zero", S) == 0
    assert next_change(device) == end
    assert any(isinstance(event, CommandRefused) for event in events(device))


def test_outputs_during_the_whole_step() -> None:
    device = stepper(step_output=StepOutput.STEP)
    set_(device, step_distance=1000, step_speed=60, step_output=1, step_delay=500)
    command(device, "start_project", 0)
    end = run_to_end(device)
    switched = [event for event in events(device) if isinstance(event, OutputChanged)]
    assert [(event.tick, event.on) for event in switched] == [(0, True), (end, False)]
    assert end > 500 * TICKS_PER_MS


def test_zero_repetitions_are_one() -> None:
    device = stepper(zero_is_endless=False)
    set_(device, project_loops=0, step_delay=10)
    command(device, "start_project", 0)
    assert run_to_end(device) == 10 * TICKS_PER_MS
    assert device.value("work_count", S) == 1

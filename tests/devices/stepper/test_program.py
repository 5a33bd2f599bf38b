"""Projects of the stepper: order of the steps, loops, signals, delays, outputs."""

from __future__ import annotations

from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bussim.devices.stepper.map import Stepper
from bussim.devices.stepper.project import Cursor, Plan, following
from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND
from tests.devices.stepper.steppers import (
    MotorStopped,
    OutputChanged,
    ProjectEnded,
    StepEntered,
    StopReason,
    command,
    events,
    next_change,
    position,
    run_to_end,
    set_,
    set_input,
)

S, MS = TICKS_PER_SECOND, TICKS_PER_MS


def order(plan: Plan, most: int = 10_000) -> list[int]:
    cursor: Cursor | None = Cursor()
    steps = []
    while cursor is not None and len(steps) < most:
        steps.append(cursor.step)
        cursor = following(plan, cursor)
    return steps


def test_orders() -> None:
    assert order(Plan(3)) == [1, 2, 3]
    assert order(Plan(3, repeats=2)) == [1, 2, 3, 1, 2, 3]
    assert order(Plan(4, 2, 3, 3)) == [1, 2, 3, 2, 3, 2, 3, 4]
    assert order(Plan(3, 2, 2, 4)) == [1, 2, 2, 2, 2, 3]
    assert order(Plan(3, 1, 3, 2, 2)) == [1, 2, 3, 1, 2, 3] * 2
    assert order(Plan(3, 2, 3, 1)) == order(Plan(3, 3, 2, 5)) == order(Plan(3, 2, 4, 5)) == [1, 2, 3]
    assert order(Plan(2, repeats=0), 7) == [1, 2, 1, 2, 1, 2, 1]  # without end


@given(st.integers(1, 33), st.integers(0, 34), st.integers(0, 34), st.integers(0, 5), st.integers(1, 4))
def test_order_is_the_nested_loops(total: int, first: int, last: int, count: int, repeats: int) -> None:
    expected = []
    for _ in range(repeats):
        for step in range(1, total + 1):
            expected.append(step)
            if step == last and 1 <= first <= last <= total:
                expected += list(range(first, last + 1)) * (max(count, 1) - 1)
    assert order(Plan(total, first, last, count, repeats)) == expected


def step(device: Stepper, number: int, **values: int) -> None:
    set_(device, step_number=number)
    defaults = {"start_frequency": 500, "acceleration": 2000, "speed": 60}
    set_(device, **{f"step_{name}": value for name, value in (defaults | values).items()})


def test_steps_run_one_after_the_other_with_their_own_settings() -> None:
    device = Stepper()
    set_(device, total_steps=3)
    step(device, 1, distance=1000)
    step(device, 2, distance=400, direction=1, speed=30, delay=250, output=2)
    step(device, 3, delay=100)
    assert command(device, "start_project", 0) == 0
    assert device.value("running_step", 0) == 1
    end = run_to_end(device)
    assert position(device, end) == 600
    assert (device.value("running_step", end), device.value("running", end)) == (0, 0)
    assert device.value("work_count", end) == 1
    found = events(device)
    entered = [event for event in found if isinstance(event, StepEntered)]
    assert [event.step for event in entered] == [1, 2, 3]
    # Step 1: 3200 pulses up to 1600 Hz. Step 2: 1280 pulses up to 800 Hz, then 250 ms. Step 3: 100 ms.
    first = Fraction(2 * 1100, 2000) + (3200 - Fraction(1600**2 - 500**2, 2000)) / 1600
    second = Fraction(2 * 300, 2000) + (1280 - Fraction(800**2 - 500**2, 2000)) / 800
    assert entered[1].tick == pytest.approx(float(first) * S, abs=1)
    moved = entered[1].tick + float(second) * S
    assert entered[2].tick == pytest.approx(moved + 250 * MS, abs=2)
    assert end == entered[2].tick + 100 * MS
    outputs = [event for event in found if isinstance(event, OutputChanged)]
    assert [(event.output, event.on) for event in outputs] == [(2, True), (2, False)]
    assert outputs[1].tick - outputs[0].tick == 250 * MS
    assert found[-1] == ProjectEnded(end, complete=True)
    assert device.value("arrived", end) == 0  # that is for the single run


def test_loops_and_repeats() -> None:
    device = Stepper()
    set_(device, total_steps=3, loop_first=2, loop_last=3, loop_count=2, project_loops=2)
    for number in (1, 2, 3):
        step(device, number, distance=100 * number)
    command(device, "start_project", 0)
    end = run_to_end(device)
    assert [event.step for event in events(device) if isinstance(event, StepEntered)] == [1, 2, 3, 2, 3] * 2
    assert position(device, end) == 2 * (100 + 2 * (200 + 300))
    assert device.value("work_count", end) == 2


def test_without_end_until_stopped() -> None:
    device = Stepper()
    set_(device, total_steps=1, project_loops=0)
    step(device, 1, distance=100, delay=1000)
    command(device, "start_project", 0)
    device.advance(100 * S)
    count = device.value("work_count", 100 * S)
    assert 50 < count < 100
    command(device, "stop", 100 * S)
    run_to_end(device)
    assert device.value("work_count", 200 * S) == count
    assert ProjectEnded(100 * S, complete=False) in events(device)


def test_a_project_that_does_nothing_takes_time() -> None:
    device = Stepper()
    set_(device, total_steps=2, project_loops=0)
    command(device, "start_project", 0)
    device.advance(S)
    assert device.value("work_count", S) == 500  # a millisecond a step


def test_steps_wait_for_their_start_signal() -> None:
    device = Stepper()
    set_(device, total_steps=2)
    step(device, 1, distance=100)
    step(device, 2, distance=100, start_input=3)
    command(device, "start_project", 0)
    run_to_end(device)
    assert (device.value("running_step", 10 * S), device.value("running", 10 * S)) == (2, 0)
    set_input(device, 3, 20 * S, on=True)
    assert device.value("running", 20 * S) == 1
    end = run_to_end(device)
    assert position(device, end) == 200
    # A signal that is on already is enough.
    command(device, "start_project", end)
    assert position(device, run_to_end(device)) == 400


def test_the_stop_signal_of_a_step_ends_its_motion_and_the_project_goes_on() -> None:
    device = Stepper()
    set_(device, total_steps=2, stop_mode=1)
    step(device, 1, distance=20000, stop_input=1)
    step(device, 2, distance=100)
    command(device, "start_project", 0)
    set_input(device, 1, 5 * S, on=True)
    stopped = position(device, 5 * S)
    end = run_to_end(device)
    assert position(device, end) == stopped + 100
    reasons = [event.reason for event in events(device) if isinstance(event, MotorStopped)]
    assert reasons == [StopReason.STEP_SIGNAL, StopReason.ARRIVED]
    # On from the beginning: the step does not move at all.
    command(device, "start_project", end)
    assert position(device, run_to_end(device)) == stopped + 200


def test_stop_ends_the_project_and_ramps_down() -> None:
    device = Stepper()
    set_(device, total_steps=2)
    step(device, 1, distance=20000)
    step(device, 2, distance=100)
    command(device, "start_project", 0)
    command(device, "stop", 5 * S)
    assert device.value("running_step", 5 * S) == 0
    assert device.value("running", 5 * S) == 1
    run_to_end(device)
    entered = [event.step for event in events(device) if isinstance(event, StepEntered)]
    assert entered == [1]


def test_stop_during_a_delay_switches_its_output_off() -> None:
    device = Stepper()
    step(device, 1, delay=5000, output=1)
    command(device, "start_project", 0)
    assert device.value("output_1", S) == 1
    command(device, "stop", S)
    assert device.value("output_1", S) == 0
    assert next_change(device) is None


def test_outputs_that_do_not_exist_do_nothing() -> None:
    device = Stepper()
    step(device, 1, delay=100, output=8)
    command(device, "start_project", 0)
    run_to_end(device)
    assert not any(isinstance(event, OutputChanged) for event in events(device))


def test_project_start_and_stop_signals() -> None:
    device = Stepper()
    set_(device, project_start_input=1, project_stop_input=2, stop_mode=1)
    step(device, 1, distance=20000)
    set_input(device, 1, S, on=True)
    assert device.value("running_step", S) == 1
    set_input(device, 1, 2 * S, on=False)
    assert device.value("running_step", 2 * S) == 1
    set_input(device, 2, 3 * S, on=True)
    assert (device.value("running_step", 3 * S), device.value("running", 3 * S)) == (0, 0)
    set_input(device, 1, 4 * S, on=True)
    assert device.value("running_step", 4 * S) == 1  # the stop signal is an edge, too


def test_commands_are_refused_while_a_project_waits() -> None:
    device = Stepper()
    step(device, 1, delay=5000)
    command(device, "start_project", 0)
    assert command(device, "jog_forward", S) == 4
    assert command(device, "start_project", S) == 4
    assert command(device, "clear_project", S) == 4


def test_a_limit_ends_the_project() -> None:
    device = Stepper()
    set_(device, total_steps=2, forward_limit_input=1)
    step(device, 1, distance=20000)
    step(device, 2, distance=100)
    command(device, "start_project", 0)
    set_input(device, 1, 2 * S, on=True)
    assert (device.value("running_step", 2 * S), device.value("running", 2 * S)) == (0, 0)
    assert events(device)[-1].reason is StopReason.LIMIT


def test_all_33_steps() -> None:
    device = Stepper()
    set_(device, total_steps=33)
    for number in range(1, 34):
        step(device, number, distance=number)
    command(device, "start_project", 0)
    end = run_to_end(device)
    per_step = [round(Fraction(16, 5) * number) for number in range(1, 34)]
    assert position(device, end) == round(sum(per_step) / Fraction(16, 5))

"""A stepper controller's program in a scenario: from its entry to the axis that it moves."""

from __future__ import annotations

import pytest

from bussim import api
from bussim.devices.stepper.model import StepperSettings
from bussim.errors import ScenarioError
from bussim.scenario.loader import loads
from bussim.scenario.yaml.dump import dumps

# The panel starts the project (coil 00009) once.
TEXT = """\
schema: 1
name: steps
duration: 20 s
plcs: []
buses: [{name: line, baud: 9600}]
devices:
  - name: drive
    model: stepper
    bus: line
    steps:
      - {step_speed: 300, step_distance: 1000, step_start_frequency: 500, step_acceleration: 4000}
      - {step_speed: 200, step_distance: -400, step_start_frequency: 500, step_delay: 100}
      - {step_speed: 300, step_distance: 2000, step_start_frequency: 500, step_acceleration: 4000}
  - name: panel
    model: hmi
    bus: line
    polls: [{station: 1, function: 5, address: 8, values: [1], times: 1}]
"""


def settings(text: str) -> StepperSettings:
    found = loads(text).devices[0].settings
    assert isinstance(found, StepperSettings)
    return found


def changed(old: str, new: str) -> str:
    assert old in TEXT
    return TEXT.replace(old, new)


@pytest.mark.parametrize(
    ("registers", "position"),
    [
        ("", 1000 - 400 + 2000),
        ("registers: {total_steps: 2}", 1000 - 400),
        # Steps 2 and 3 run three times.
        ("registers: {loop_first: 2, loop_last: 3, loop_count: 3}", 1000 + 3 * (2000 - 400)),
    ],
)
def test_the_axis_goes_the_way_of_all_steps(registers: str, position: int) -> None:
    scenario = loads(changed("    steps:\n", f"    {registers}\n    steps:\n"))
    totals = api.run(scenario).totals
    assert totals is not None
    drive = next(device for device in totals.devices if device.name == "drive")
    assert drive.state["position"] == position
    assert not drive.state["running"]


def test_there_are_as_many_steps_as_are_written() -> None:
    found = settings(TEXT)
    assert found.registers == {"total_steps": 3}
    assert found.steps[1] == {
        "step_speed": 200,
        "step_distance": 0x1_0000_0000 - 400,
        "step_start_frequency": 500,
        "step_delay": 100,
    }
    assert settings(changed("    steps:\n", "    registers: {total_steps: 9}\n    steps:\n")).registers == {
        "total_steps": 9
    }


def test_written_down_it_is_the_same() -> None:
    scenario = loads(TEXT)
    assert loads(dumps(scenario)).devices == scenario.devices


def test_a_step_can_be_set_from_outside() -> None:
    found = loads(TEXT, "x.yaml", ["devices.drive.steps.1.step_distance=500"]).devices[0].settings
    assert isinstance(found, StepperSettings)
    assert found.steps[1]["step_distance"] == 500


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "step_delay: 100",
            "step_delay: -1",
            "12:87: steps.1.step_delay is -1, allowed 0..4294967295 (40035)",
        ),
        (
            "step_delay: 100",
            "step_dely: 1",
            "12:75: steps.1.step_dely is no register; did you mean step_delay?",
        ),
        (
            "step_speed: 200",
            "pitch: 200",
            "12:10: steps.1.pitch belongs to no step; allowed are step_start_input",
        ),
        (
            "    steps:\n",
            "    registers: {step_speed: 5}\n    steps:\n",
            "10:17: registers.step_speed excludes steps, which are all steps of the program",
        ),
        (
            "      - {step_speed: 200",
            "      - {}\n" * 31 + "      - {step_speed: 200",
            "steps has 34 entries",
        ),
    ],
)
def test_mistakes(old: str, new: str, message: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        loads(changed(old, new), "x.yaml")
    assert message in str(caught.value)

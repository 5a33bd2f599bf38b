"""A project of the stepper controller while it runs: which step, and what the step waits for."""

from __future__ import annotations

from enum import StrEnum

from bussim.devices.stepper.parameters import Parameters
from bussim.devices.stepper.profile import StepperProfile
from bussim.devices.stepper.program import Cursor, Plan, following
from bussim.devices.stepper.registers import DELAY_UNIT


class Waiting(StrEnum):
    """What a running step waits for."""

    START = "its start signal"
    MOTION = "the end of its motion"
    DELAY = "the end of its delay"


class Project:
    """One run of the project: parameters are those of its beginning (40026, 40037–40039, 40050)."""

    def __init__(self, parameters: Parameters, profile: StepperProfile) -> None:
        repeats = parameters["project_loops"]
        self._parameters = parameters
        self.plan = Plan(
            parameters["total_steps"],
            parameters["loop_first"],
            parameters["loop_last"],
            parameters["loop_count"],
            repeats if repeats or profile.zero_is_endless else 1,
        )
        self.cursor = Cursor()
        self.waiting = Waiting.START
        #: End of the delay, None unless it waits for that.
        self.until: int | None = None
        self._entered = 0

    @property
    def step(self) -> int:
        """The step that runs, 1–33."""
        return self.cursor.step

    @property
    def values(self) -> dict[str, int]:
        """The registers of the step that runs."""
        return self._parameters.step(self.cursor.step)

    def enter(self, tick: int) -> None:
        """A step begins: first it waits for its start signal."""
        self._entered = tick
        self.waiting = Waiting.START
        self.until = None

    def delay(self, tick: int) -> None:
        """The step's motion is done: its delay begins.

        A step that neither moved nor waits takes a millisecond (assumed), so that a project without
        any motion takes time.
        """
        delay = self.values["step_delay"] * DELAY_UNIT
        self.waiting = Waiting.DELAY
        self.until = tick + delay if delay or tick > self._entered else tick + DELAY_UNIT

    def advance(self) -> tuple[bool, bool]:
        """The step is over: on to the next one. Returns whether there is one, and whether a pass ended."""
        passes = self.cursor.passes
        after = following(self.plan, self.cursor)
        if after is None:
            return False, True
        self.cursor = after
        return True, after.passes > passes

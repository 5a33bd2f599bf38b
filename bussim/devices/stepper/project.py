"""A project of the stepper controller: the order of its steps, and what a running step waits for."""

from enum import StrEnum
from typing import NamedTuple

from bussim.devices.stepper.parameters import Parameters
from bussim.devices.stepper.profile import StepperProfile
from bussim.devices.stepper.registers import DELAY_UNIT


class Plan(NamedTuple):
    """The registers that give the order: 40026, 40037–40039, 40050.

    Steps ``loop_first`` … ``loop_last`` run ``loop_count`` times, if that is over 1 and they are steps of
    the project in order. The whole runs ``repeats`` times, 0 without end.
    """

    total: int
    loop_first: int = 0
    loop_last: int = 0
    loop_count: int = 0
    repeats: int = 1

    @property
    def loops(self) -> bool:
        """Whether there is a segment loop."""
        return 1 <= self.loop_first <= self.loop_last <= self.total and self.loop_count > 1


class Cursor(NamedTuple):
    """Where a project is: its step (from 1), and how often segment and whole were completed."""

    step: int = 1
    segment: int = 0
    passes: int = 0


def following(plan: Plan, cursor: Cursor) -> Cursor | None:
    """What comes after a step; None when the project is over."""
    step, segment, passes = cursor
    if plan.loops and step == plan.loop_last:
        if segment + 1 < plan.loop_count:
            return Cursor(plan.loop_first, segment + 1, passes)
        segment = 0
    if step < plan.total:
        return Cursor(step + 1, segment, passes)
    passes += 1
    return None if plan.repeats and passes >= plan.repeats else Cursor(1, 0, passes)


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

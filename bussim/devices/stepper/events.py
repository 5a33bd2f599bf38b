"""Everything that the stepper controller reports. Frozen values; times are ticks."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Job(StrEnum):
    """What the motor runs for."""

    RUN_ONCE = "run once"
    JOG = "jog"
    TO_ZERO = "return to zero"
    HOME = "homing"
    STEP = "program step"
    SIGNAL = "start signal"  # a single run, or on until stopped
    SIGNAL_JOG = "jog by signal"


class Stop(StrEnum):
    """Why the motor stopped."""

    ARRIVED = "arrived"
    COMMAND = "stop"
    RELEASED = "jog released"
    LIMIT = "limit"
    HOME = "mechanical zero"
    STEP_SIGNAL = "stop signal of the step"
    DISABLED = "disabled"
    POWER = "power off"


@dataclass(frozen=True, slots=True)
class MotorStarted:
    """The motor starts."""

    tick: int
    job: Job
    direction: int  # +1 forward, -1 reverse
    target: int | None  # the position it will stop at, in hundredths of a unit; None: open


@dataclass(frozen=True, slots=True)
class MotorStopped:
    """The motor stands."""

    tick: int
    job: Job
    reason: Stop
    position: int  # hundredths of a unit


@dataclass(frozen=True, slots=True)
class OutputChanged:
    """An output was switched."""

    tick: int
    output: int  # 1–3
    on: bool


@dataclass(frozen=True, slots=True)
class StepEntered:
    """A project goes to a step."""

    tick: int
    step: int


@dataclass(frozen=True, slots=True)
class ProjectEnded:
    """A project is over; ``complete``: every step was done, as often as it should."""

    tick: int
    complete: bool


@dataclass(frozen=True, slots=True)
class CommandRefused:
    """A command could not be carried out."""

    tick: int
    command: str
    why: str


@dataclass(frozen=True, slots=True)
class PoweredOn:
    """The controller came up with this station number and rate."""

    tick: int
    station: int
    baud: int


StepperEvent = (
    MotorStarted | MotorStopped | OutputChanged | StepEntered | ProjectEnded | CommandRefused | PoweredOn
)


def in_words(event: StepperEvent) -> str:
    """An event as a phrase, positions in units."""
    match event:
        case MotorStarted(_, job, direction, target):
            way = "forward" if direction > 0 else "reverse"
            aim = "" if target is None else f" to {target / 100:.2f}"
            return f"starts {way}{aim} ({job.value})"
        case MotorStopped(_, job, reason, position):
            return f"stands at {position / 100:.2f} ({job.value}: {reason.value})"
        case OutputChanged(_, output, on):
            return f"output {output} {'on' if on else 'off'}"
        case PoweredOn(_, station, baud):
            return f"is on as station {station} at {baud} bps"
        case StepEntered(_, step):
            return f"step {step}"
        case ProjectEnded(_, complete):
            return "project done" if complete else "project broken off"
        case CommandRefused(_, command, why):
            return f"{command} refused: {why}"

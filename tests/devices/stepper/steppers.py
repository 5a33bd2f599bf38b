"""The stepper as its tests handle it: registers and commands by name, and what to expect."""

from __future__ import annotations

import re
from dataclasses import dataclass
from fractions import Fraction

from bussim.devices.stepper.axis import Switch
from bussim.devices.stepper.map import Stepper
from bussim.devices.stepper.motion import Job, StopReason
from bussim.devices.stepper.registers import BY_NAME, COILS
from bussim.units import TICKS_PER_SECOND
from tests.devices.ask import coil, put, registers

S = TICKS_PER_SECOND
ADDRESS = {name: number - 1 for number, name in COILS.items()}

# 1.8°, 8 microsteps: 1600 pulses a turn; pitch 5.00: 3.2 pulses a hundredth; 60 rpm: 1600 Hz.
TOP, LOW, SLOPE, PER_UNIT = 1600, 500, 2000, Fraction(16, 5)


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
    reason: StopReason
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


def set_(device: Stepper, now: int = 0, **values: int) -> None:
    for name, value in values.items():
        register = BY_NAME[name]
        words = [value >> 16 * word & 0xFFFF for word in range(register.words)]
        assert put(device, register.address, *words, now=now) == 0, name


def command(device: Stepper, name: str, now: int, *, on: bool = True) -> int:
    return coil(device, ADDRESS[name], on=on, now=now)


def position(device: Stepper, now: int) -> int:
    low, high = registers(device, 0x16, 2, now)
    value = high << 16 | low
    return value - (1 << 32) if value >> 31 else value


def events(device: Stepper) -> list[object]:
    """What the controller reports, read from its phrases."""
    found = []
    while (event := device.poll()) is not None:
        found.append(_event(*event))
    return found


def _event(tick: int, text: str) -> object:
    if match := re.fullmatch(r"starts (forward|reverse)(?: to (-?[\d.]+))? \((.*)\)", text):
        target = None if match[2] is None else round(100 * float(match[2]))
        return MotorStarted(tick, Job(match[3]), 1 if match[1] == "forward" else -1, target)
    if match := re.fullmatch(r"stands at (-?[\d.]+) \((.*): (.*)\)", text):
        return MotorStopped(tick, Job(match[2]), StopReason(match[3]), round(100 * float(match[1])))
    if match := re.fullmatch(r"output ([123]) (on|off)", text):
        return OutputChanged(tick, int(match[1]), match[2] == "on")
    if match := re.fullmatch(r"is on as station (\d+) at (\d+) bps", text):
        return PoweredOn(tick, int(match[1]), int(match[2]))
    if match := re.fullmatch(r"step (\d+)", text):
        return StepEntered(tick, int(match[1]))
    if match := re.fullmatch(r"project (done|broken off)", text):
        return ProjectEnded(tick, match[1] == "done")
    match = re.fullmatch(r"(.*) refused: (.*)", text)
    assert match, text
    return CommandRefused(tick, match[1], match[2])


def seconds_for(pulses: int) -> Fraction:
    """A trapezoid of the settings above, by the textbook."""
    ramp = Fraction(TOP**2 - LOW**2, 2 * SLOPE)
    assert 2 * ramp <= pulses
    return 2 * Fraction(TOP - LOW, SLOPE) + (pulses - 2 * ramp) / TOP


def next_change(device: Stepper) -> int | None:
    """The next tick at which something happens on its own, None for never."""
    return device.controller.next_change() if device.powered else None


def set_input(device: Stepper, number: int, now: int, *, on: bool) -> None:
    """A signal from elsewhere: as of a switch that is on wherever the axis is."""
    device.advance(now)
    axis, signal = device.controller.axis, Switch(number)
    axis._switches = (*(switch for switch in axis._switches if switch != signal), *[signal] * on)
    axis.replan(now)
    if device.powered:
        device.controller.inputs_changed(now)


def output(device: Stepper, number: int, now: int) -> bool:
    device.advance(now)
    return device.controller.outputs[number]


def run_to_end(device: Stepper) -> int:
    """Let everything happen; returns the tick of the last change."""
    last = 0
    for _ in range(1000):
        at = next_change(device)
        if at is None:
            return last
        assert at >= last
        last = at
        device.advance(at)
    raise AssertionError("it goes on for ever")

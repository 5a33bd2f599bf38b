"""Kinematics of a stepper motor as pure functions of ticks; positions are whole pulses.

The pulse rate jumps to the start frequency, grows linearly to the top, and comes down the same way:
a trapezoid, or a triangle where the distance is too short. Rates are exact fractions of Hz.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from dataclasses import dataclass, replace
from enum import StrEnum
from fractions import Fraction
from math import isqrt
from typing import NamedTuple

from bussim.units import TICKS_PER_SECOND, round_half_up

# A triangle's peak rate is a square root, taken to a billionth of a Hz.
_ROOT_SCALE = 10**9


class Job(StrEnum):
    """What the motor runs for."""

    RUN_ONCE = "run once"
    JOG = "jog"
    TO_ZERO = "return to zero"
    HOME = "homing"
    STEP = "program step"
    SIGNAL = "start signal"  # a single run, or on until stopped
    SIGNAL_JOG = "jog by signal"


class StopReason(StrEnum):
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
class Drive:
    """How a motor is driven: start rate and top rate in Hz, acceleration in Hz per second.

    A top at or below the start rate, or an acceleration of 0 (assumed), means the top rate throughout.
    """

    start: Fraction
    top: Fraction
    acceleration: Fraction

    @property
    def ramps(self) -> bool:
        """Whether it accelerates at all."""
        return self.acceleration > 0 and self.top > self.start

    @property
    def can_move(self) -> bool:
        """Whether there is a rate to move with."""
        return self.top > 0


class Phase(NamedTuple):
    """A phase of constant acceleration."""

    begin: Fraction  # ticks from the motion's start
    pulses: Fraction  # done by then
    rate: Fraction  # Hz at its begin
    slope: Fraction  # Hz per second

    def done(self, ticks: Fraction) -> Fraction:
        """Pulses done by a moment of this phase, in ticks from the motion's start."""
        seconds = (ticks - self.begin) / TICKS_PER_SECOND
        return self.pulses + self.rate * seconds + self.slope * seconds * seconds / 2

    def rate_at(self, ticks: Fraction) -> Fraction:
        """The rate in Hz at a moment of this phase."""
        return self.rate + self.slope * (ticks - self.begin) / TICKS_PER_SECOND


@dataclass(frozen=True, slots=True)
class Motion:
    """One motion from ``start`` on, ``direction`` +1 or -1.

    ``end`` is the tick at which it stops, having done ``length`` pulses; both are None for a motion
    that goes on until it is slowed or cut.
    """

    start: int
    direction: int
    drive: Drive
    phases: tuple[Phase, ...]
    end: int | None
    length: int | None

    def pulses(self, tick: int) -> int:
        """Pulses given by a tick: 0…``length``."""
        if tick <= self.start:
            return 0
        if self.end is not None and self.length is not None and tick >= self.end:
            return self.length
        ticks = Fraction(tick - self.start)
        done = int(self._phase(ticks).done(ticks))
        return done if self.length is None else min(done, self.length)

    def _phase(self, ticks: Fraction) -> Phase:
        return self.phases[bisect_right(self.phases, ticks, key=lambda phase: phase.begin) - 1]

    def reaches(self, pulses: int) -> int | None:
        """The first tick by which so many pulses were given; None if they never are."""
        if pulses <= 0:
            return self.start
        if self.length is not None and pulses > self.length:
            return None
        low, step = self.start, TICKS_PER_SECOND
        while self.pulses(low + step) < pulses:
            low += step
            step *= 2
        return bisect_left(range(low + step), pulses, low + 1, key=self.pulses)

    def slowed(self, tick: int) -> Motion:
        """The same motion that ramps down from ``tick`` on and stops at the start rate.

        One that is ramping down anyway is unchanged; without a ramp it is cut.
        """
        ticks = Fraction(max(tick - self.start, 0))
        phase = self._phase(ticks)
        if phase.slope < 0:
            return self
        drive, rate = self.drive, phase.rate_at(ticks)
        if not drive.ramps or rate <= drive.start:
            return self.cut(tick)
        seconds = (rate - drive.start) / drive.acceleration
        down = Phase(ticks, phase.done(ticks), rate, -drive.acceleration)
        end = ticks + seconds * TICKS_PER_SECOND
        kept = tuple(one for one in self.phases if one.begin < ticks)
        phases = (*kept, down)
        return replace(self, phases=phases, end=self.start + round_half_up(end), length=int(down.done(end)))

    def cut(self, tick: int) -> Motion:
        """The same motion that stops dead at ``tick``."""
        tick = max(tick, self.start)
        if self.end is not None and tick >= self.end:
            return self
        return replace(self, end=tick, length=self.pulses(tick))


def travel(drive: Drive, pulses: int, start: int, direction: int) -> Motion:
    """A motion over so many pulses (≥ 0). Raises ValueError if the drive cannot move."""
    _check(drive)
    zero = Fraction(0)
    if not drive.ramps:
        end = Fraction(pulses) / drive.top
        return _motion(start, direction, drive, [Phase(zero, zero, drive.top, zero)], end, pulses)
    low, peak, slope = drive.start, drive.top, drive.acceleration
    ramp = (peak * peak - low * low) / (2 * slope)  # pulses from start to top rate
    if 2 * ramp > pulses:
        peak, ramp = _root(low * low + slope * pulses), Fraction(pulses, 2)
    rising, cruising = (peak - low) / slope, (pulses - 2 * ramp) / drive.top
    phases = [
        Phase(zero, zero, low, slope),
        Phase(rising * TICKS_PER_SECOND, ramp, peak, zero),
        Phase((rising + cruising) * TICKS_PER_SECOND, pulses - ramp, peak, -slope),
    ]
    return _motion(start, direction, drive, phases, 2 * rising + cruising, pulses)


def run(drive: Drive, start: int, direction: int) -> Motion:
    """A motion without an end. Raises ValueError if the drive cannot move."""
    _check(drive)
    zero = Fraction(0)
    if not drive.ramps:
        return Motion(start, direction, drive, (Phase(zero, zero, drive.top, zero),), None, None)
    low, high, slope = drive.start, drive.top, drive.acceleration
    phases = (
        Phase(zero, zero, low, slope),
        Phase((high - low) / slope * TICKS_PER_SECOND, (high * high - low * low) / (2 * slope), high, zero),
    )
    return Motion(start, direction, drive, phases, None, None)


def _check(drive: Drive) -> None:
    if not drive.can_move:
        raise ValueError("a motor without a speed does not move")


def _motion(
    start: int, direction: int, drive: Drive, phases: list[Phase], seconds: Fraction, pulses: int
) -> Motion:
    end = start + round_half_up(seconds * TICKS_PER_SECOND)
    return Motion(start, direction, drive, tuple(phases), end, pulses)


def _root(square: Fraction) -> Fraction:
    scaled = square * _ROOT_SCALE * _ROOT_SCALE
    return Fraction(isqrt(scaled.numerator // scaled.denominator), _ROOT_SCALE)

"""The stepper controller's axis: where it is, what it is doing, and its inputs, the switches along it."""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import ceil, floor

from bussim.devices.stepper.motion import Drive, Motion
from bussim.devices.stepper.parameters import Parameters
from bussim.devices.stepper.registers import INPUTS, signed
from bussim.units import round_half_up


@dataclass(frozen=True, slots=True)
class Switch:
    """A switch on the machine: its input (1–5) is on while the axis is between ``low`` and ``high``.

    Both in hundredths of a unit from where the axis was at the beginning, None for without end.
    """

    input: int
    low: int | None = None
    high: int | None = None


def pulses_per_turn(parameters: Parameters) -> Fraction | None:
    """360° / step angle × microsteps (40001, 40002); None if one of them is 0."""
    angle, microsteps = parameters["step_angle"], parameters["microsteps"]
    return Fraction(36000, angle) * microsteps if angle and microsteps else None


def pulses_per_unit(parameters: Parameters) -> Fraction | None:
    """Pulses of a hundredth of a unit; None if a parameter it needs (40001, 40002, 40005) is 0."""
    turn, pitch = pulses_per_turn(parameters), parameters["pitch"]
    return turn / pitch if turn and pitch else None


def drive_for(parameters: Parameters, start: int, speed: int, acceleration: Fraction) -> Drive:
    """A drive from a start rate in Hz, a speed in turns a minute and an acceleration in Hz per second.

    The top rate is 0 where the pulses of a turn are unknown.
    """
    top = (pulses_per_turn(parameters) or Fraction(0)) * speed / 60
    return Drive(Fraction(start), top, acceleration)


def pulses_of(parameters: Parameters, distance: int, *, reverse: int) -> int:
    """Signed pulses of a distance (32 bits, two's complement); 0 where they are unknown."""
    per_unit = pulses_per_unit(parameters)
    if per_unit is None:
        return 0
    return round_half_up(signed(distance) * per_unit) * (-1 if reverse else 1)


class Axis:
    """Position in pulses, from where the axis was at the beginning, and the motion in progress."""

    def __init__(self, parameters: Parameters, switches: Sequence[Switch] = ()) -> None:
        self._parameters = parameters
        self._switches = tuple(switches)
        self._base = 0  # where the motion in progress began, or where it stands
        self._origin = 0  # where the coordinate is 0
        self._crossings: list[int] = []  # ticks at which a switch changes, latest first
        self.motion: Motion | None = None

    def pulses(self, tick: int) -> int:
        """Pulses forward of where it was at the beginning."""
        motion = self.motion
        return self._base if motion is None else self._base + motion.direction * motion.pulses(tick)

    def position(self, tick: int) -> int:
        """The coordinate (40023/40024) in hundredths of a unit; 0 where it is unknown."""
        return self._units(self.pulses(tick) - self._origin)

    def _units(self, pulses: int) -> int:
        per_unit = pulses_per_unit(self._parameters)
        return 0 if per_unit is None else round_half_up(pulses / per_unit)

    def target(self) -> int | None:
        """The coordinate at which the motion in progress will end."""
        motion = self.motion
        if motion is None or motion.length is None:
            return None
        return self._units(self._base + motion.direction * motion.length - self._origin)

    def pulses_to(self, position: int, tick: int) -> int:
        """Signed pulses from where it is to a coordinate."""
        per_unit = pulses_per_unit(self._parameters)
        return (
            0 if per_unit is None else self._origin + round_half_up(position * per_unit) - self.pulses(tick)
        )

    def set_origin(self, tick: int) -> None:
        """The coordinate is 0 here."""
        self._origin = self.pulses(tick)

    # -- motion --------------------------------------------------------------------------------

    def move(self, motion: Motion, tick: int) -> None:
        """Begin a motion, or go on with another form of the one under way."""
        self.motion = motion
        self.replan(tick)

    def replan(self, tick: int) -> None:
        """Work out when the motion in progress passes switches: where they lie may be new."""
        motion = self.motion
        if motion is None:
            return
        marks = {abs(mark - self._base) for mark in self._marks(motion.direction) if self._ahead(mark)}
        ticks = {motion.reaches(mark) for mark in marks}
        self._crossings = sorted((at for at in ticks if at is not None and at > tick), reverse=True)

    def settle(self, tick: int) -> None:
        """The motion is over."""
        self._base = self.pulses(tick)
        self.motion = None
        self._crossings = []

    def _ahead(self, mark: int) -> bool:
        motion = self.motion
        return motion is not None and (mark - self._base) * motion.direction > 0

    def _marks(self, direction: int) -> list[int]:
        """The pulses at which switches change for a motion from below (+1) or above (-1)."""
        marks: list[int] = []
        for switch in self._switches:
            low, high = self._bounds(switch)
            if low is not None:
                marks.append(low if direction > 0 else low - 1)
            if high is not None:
                marks.append(high + 1 if direction > 0 else high)
        return marks

    def _bounds(self, switch: Switch) -> tuple[int | None, int | None]:
        per_unit = pulses_per_unit(self._parameters)
        if per_unit is None:
            return None, None
        return (
            None if switch.low is None else ceil(switch.low * per_unit),
            None if switch.high is None else floor(switch.high * per_unit),
        )

    def next_change(self) -> int | None:
        """When the motion ends or a switch changes."""
        end = None if self.motion is None else self.motion.end
        return min((at for at in (*self._crossings[-1:], end) if at is not None), default=None)

    def passed(self, tick: int) -> None:
        """Forget the crossings up to a tick."""
        while self._crossings and self._crossings[-1] <= tick:
            self._crossings.pop()

    def switched_on(self, number: int, tick: int) -> bool:
        """Whether some switch turns an input on at a tick; none does where units are unknown."""
        if pulses_per_unit(self._parameters) is None:
            return False
        at = self.pulses(tick)
        for switch in self._switches:
            if switch.input == number:
                low, high = self._bounds(switch)
                if (low is None or at >= low) and (high is None or at <= high):
                    return True
        return False


class Inputs:
    """Levels by input number, 1–5; number 0 (a register that names no input) is always off."""

    def __init__(self, parameters: Parameters, axis: Axis) -> None:
        self._parameters = parameters
        self._axis = axis
        self._levels = [False] * (INPUTS + 1)

    def refresh(self, now: int) -> frozenset[int]:
        """Read all inputs; returns the numbers of those that have come on."""
        before = self._levels
        self._levels = [False, *(self._axis.switched_on(number, now) for number in range(1, INPUTS + 1))]
        return frozenset(number for number, on in enumerate(self._levels) if on and not before[number])

    def level(self, number: int) -> bool:
        """Whether an input was on when they were last read."""
        return self._levels[number]

    def on(self, register: str) -> bool:
        """Whether the input is on that a register names."""
        return self._levels[self._parameters[register]]

"""The stepper as its tests handle it: registers and commands by name, and what to expect."""

from __future__ import annotations

from fractions import Fraction

from bussim.devices.stepper.map import Stepper
from bussim.devices.stepper.registers import BY_NAME, COILS
from bussim.units import TICKS_PER_SECOND
from tests.devices.ask import coil, put, registers

S = TICKS_PER_SECOND
ADDRESS = {c.name: c.address for c in COILS}

# 1.8°, 8 microsteps: 1600 pulses a turn; pitch 5.00: 3.2 pulses a hundredth; 60 rpm: 1600 Hz.
TOP, LOW, SLOPE, PER_UNIT = 1600, 500, 2000, Fraction(16, 5)


def set_(device: Stepper, now: int = 0, **values: int) -> None:
    for name, value in values.items():
        register = BY_NAME[name]
        words = [value >> 16 * place & 0xFFFF for place in range(register.words)]
        assert put(device, register.address, *words, now=now) == 0, name


def command(device: Stepper, name: str, now: int, *, on: bool = True) -> int:
    return coil(device, ADDRESS[name], on=on, now=now)


def position(device: Stepper, now: int) -> int:
    low, high = registers(device, 0x16, 2, now)
    value = high << 16 | low
    return value - (1 << 32) if value >> 31 else value


def events(device: Stepper) -> list[object]:
    found = []
    while (event := device.poll()) is not None:
        found.append(event)
    return found


def seconds_for(pulses: int) -> Fraction:
    """A trapezoid of the settings above, by the textbook."""
    ramp = Fraction(TOP**2 - LOW**2, 2 * SLOPE)
    assert 2 * ramp <= pulses
    return 2 * Fraction(TOP - LOW, SLOPE) + (pulses - 2 * ramp) / TOP


def run_to_end(device: Stepper) -> int:
    """Let everything happen; returns the tick of the last change."""
    last = 0
    for _ in range(1000):
        at = device.next_change()
        if at is None:
            return last
        assert at >= last
        last = at
        device.advance(at)
    raise AssertionError("it goes on for ever")

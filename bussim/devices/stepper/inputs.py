"""The stepper controller's five inputs: wires from outside and switches on the axis."""

from __future__ import annotations

from bussim.devices.stepper.axis import Axis
from bussim.devices.stepper.parameters import Parameters
from bussim.devices.stepper.registers import INPUTS


class Inputs:
    """Levels by input number, 1–5; number 0 (a register that names no input) is always off."""

    def __init__(self, parameters: Parameters, axis: Axis) -> None:
        self._parameters = parameters
        self._axis = axis
        self._wires = [False] * (INPUTS + 1)
        self._levels = [False] * (INPUTS + 1)

    def set_wire(self, number: int, *, on: bool) -> None:
        """A wire is switched from outside; :meth:`refresh` makes it felt."""
        self._wires[number] = on

    def refresh(self, now: int) -> frozenset[int]:
        """Read all inputs; returns the numbers of those that have come on."""
        before = self._levels
        self._levels = [
            number > 0 and (self._wires[number] or self._axis.switched_on(number, now))
            for number in range(INPUTS + 1)
        ]
        return frozenset(number for number, on in enumerate(self._levels) if on and not before[number])

    def level(self, number: int) -> bool:
        """Whether an input was on when they were last read."""
        return self._levels[number]

    def on(self, register: str) -> bool:
        """Whether the input is on that a register names."""
        return self._levels[self._parameters[register]]

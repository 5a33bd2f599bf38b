"""What the stepper controller's registers hold, working and saved."""

from collections.abc import Mapping, Sequence

from bussim.devices.stepper.registers import BY_NAME, MAX_STEPS, REGISTERS, Group, Register

_SAVED = (Group.BASIC, Group.PROJECT)


def _defaults(*groups: Group) -> dict[str, int]:
    return {register.name: register.default for register in REGISTERS if register.group in groups}


class Parameters:
    """Values by register name; two-register values are one number of 32 bits.

    Step registers have a value for each of the 33 steps; by name they mean the step that
    ``step_number`` (40040) chooses. Status registers are not kept here.
    """

    def __init__(self) -> None:
        self._values = _defaults(Group.BASIC, Group.PROJECT, Group.VOLATILE, Group.SPARE)
        self._steps = [_defaults(Group.STEP) for _ in range(MAX_STEPS)]
        self.save()

    def __getitem__(self, name: str) -> int:
        if BY_NAME[name].group is Group.STEP:
            return self._steps[self._values["step_number"] - 1][name]
        return self._values[name]

    def __setitem__(self, name: str, value: int) -> None:
        if BY_NAME[name].group is Group.STEP:
            self._steps[self._values["step_number"] - 1][name] = value
        else:
            self._values[name] = value

    def step(self, number: int) -> dict[str, int]:
        """The registers of a program step (1–33) by name."""
        return self._steps[number - 1]

    def preset(self, values: Mapping[str, int], steps: Sequence[Mapping[str, int]] = ()) -> None:
        """Save values by name, and those of the first program steps. Raises KeyError for what is none."""
        for name, value in values.items():
            self[name] = value
        for number, step in enumerate(steps, 1):
            self.step(number).update(step)
        self.save()

    def save(self) -> None:
        """Keep what survives a power cycle: basic and project parameters and the steps."""
        self._saved = {r.name: self._values[r.name] for r in REGISTERS if r.group in _SAVED}
        self._saved_steps = [dict(step) for step in self._steps]

    def power_on(self) -> None:
        """What was saved comes back; the rest is as delivered."""
        self._values = _defaults(Group.VOLATILE, Group.SPARE) | self._saved
        self._steps = [dict(step) for step in self._saved_steps]

    def read_project(self) -> None:
        """The saved project comes back."""
        for name in _defaults(Group.PROJECT):
            self._values[name] = self._saved[name]
        self._steps = [dict(step) for step in self._saved_steps]

    def clear_project(self) -> None:
        """The project's parameters and all steps are as delivered (until saved: only for now)."""
        self._values |= _defaults(Group.PROJECT)
        self._steps = [_defaults(Group.STEP) for _ in range(MAX_STEPS)]

    def reset_basic(self) -> None:
        """The basic parameters, station and rate among them, are as delivered (until saved: only for now)."""
        self._values |= _defaults(Group.BASIC)


def with_words(register: Register, value: int, offset: int, words: tuple[int, ...]) -> int:
    """A register's value with some of its words (from ``offset`` on, low word first) replaced."""
    for index, word in enumerate(words, offset):
        value = value & ~(0xFFFF << 16 * index) | word << 16 * index
    return value & ((1 << 16 * register.words) - 1)

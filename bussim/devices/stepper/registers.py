"""The stepper controller's registers and coils, as its manual's tables 5 and 6 list them."""

from collections.abc import Iterator
from enum import StrEnum
from typing import Final, NamedTuple

from bussim.units import TICKS_PER_SECOND

MAX_STEPS: Final = 33
INPUTS: Final = 5
OUTPUTS: Final = 3


class Group(StrEnum):
    """What a register belongs to."""

    BASIC = "basic"  # coil 00037 sets these to what the controller is delivered with
    PROJECT = "project"  # coil 00003 clears these, coil 00002 reads them back
    STEP = "step"  # the same, one value for each of the 33 program steps; 40040 chooses which is seen
    VOLATILE = "volatile"  # not saved
    STATUS = "status"  # the controller writes it
    SPARE = "spare"  # memory without a meaning


class Register(NamedTuple):
    """One register, or two that hold 32 bits (low word first): ``number`` as in the manual.

    ``low`` … ``high`` are the values that can be written; ``default`` is what it is delivered with
    (the manual gives few of them; the others are assumed).
    """

    number: int  # 40001…
    name: str
    group: Group
    low: int = 0
    high: int = 0xFFFF
    default: int = 0
    words: int = 1

    @property
    def address(self) -> int:
        """The protocol address of its first word."""
        return self.number - 40001

    @property
    def writable(self) -> bool:
        """Whether Modbus may write it."""
        return self.group is not Group.STATUS


_LONG: Final = 0xFFFF_FFFF


def _spare(number: int) -> Register:
    return Register(number, f"spare_{number}", Group.SPARE)


def _status(first: int, prefix: str, count: int) -> Iterator[Register]:
    return (Register(first + k, f"{prefix}_{k + 1}", Group.STATUS) for k in range(count))


REGISTERS: Final[tuple[Register, ...]] = (
    Register(40001, "step_angle", Group.BASIC, default=180),  # degrees × 100
    Register(40002, "microsteps", Group.BASIC, default=8),
    Register(40003, "start_frequency", Group.BASIC, default=500),  # Hz
    Register(40004, "acceleration", Group.BASIC, default=2000),  # Hz per second (assumed)
    Register(40005, "pitch", Group.BASIC, high=_LONG, default=500, words=2),  # units × 100 a turn
    Register(40007, "home_input", Group.BASIC, high=INPUTS),
    Register(40008, "stop_mode", Group.BASIC, high=1),  # 0 ramps down, 1 at once
    Register(40009, "speed", Group.BASIC, default=60),  # turns a minute
    Register(40010, "distance", Group.BASIC, high=_LONG, words=2),  # units × 100
    Register(40012, "direction", Group.BASIC, high=1),  # 0 forward, 1 reverse
    Register(40013, "arrived", Group.STATUS),
    _spare(40014),
    Register(40015, "forward_limit_input", Group.BASIC, high=INPUTS),
    Register(40016, "reverse_limit_input", Group.BASIC, high=INPUTS),
    Register(40017, "station", Group.BASIC, low=1, high=247, default=1),
    Register(40018, "project_start_input", Group.BASIC, high=INPUTS),
    Register(40019, "project_stop_input", Group.BASIC, high=INPUTS),
    Register(40020, "work_count", Group.VOLATILE, high=_LONG, words=2),
    _spare(40022),
    Register(40023, "position", Group.STATUS, words=2),  # units × 100, two's complement
    Register(40025, "project", Group.PROJECT, low=1, high=1, default=1),
    Register(40026, "total_steps", Group.PROJECT, low=1, high=MAX_STEPS, default=1),
    Register(40027, "step_start_input", Group.STEP, high=INPUTS),
    Register(40028, "step_start_frequency", Group.STEP),
    Register(40029, "step_acceleration", Group.STEP),
    Register(40030, "step_direction", Group.STEP, high=1),
    Register(40031, "step_speed", Group.STEP),
    Register(40032, "step_distance", Group.STEP, high=_LONG, words=2),
    Register(40034, "step_output", Group.STEP, high=8),
    Register(40035, "step_delay", Group.STEP, high=_LONG, words=2),  # ms
    Register(40037, "loop_first", Group.PROJECT, high=MAX_STEPS),
    Register(40038, "loop_last", Group.PROJECT, high=MAX_STEPS),
    Register(40039, "loop_count", Group.PROJECT),
    Register(40040, "step_number", Group.VOLATILE, low=1, high=MAX_STEPS, default=1),
    _spare(40041),
    Register(40042, "running_step", Group.STATUS),
    *_status(40043, "input", INPUTS),
    Register(40048, "output_1", Group.STATUS),
    Register(40049, "running", Group.STATUS),
    Register(40050, "project_loops", Group.PROJECT, default=1),
    Register(40051, "step_stop_input", Group.STEP, high=INPUTS),
    *map(_spare, range(40052, 40056)),
    Register(40056, "output_2", Group.STATUS),
    Register(40057, "output_3", Group.STATUS),
    Register(40058, "round_trips", Group.BASIC),
    Register(40074, "baud", Group.BASIC, high=_LONG, default=9600, words=2),
    Register(40076, "absolute", Group.BASIC, high=1),  # 0 relative, 1 absolute
    Register(40077, "signal_mode", Group.BASIC, high=2),  # 0 position, 1 speed by edge, 2 speed while on
    Register(40078, "forward_input", Group.BASIC, high=INPUTS),
    Register(40079, "reverse_input", Group.BASIC, high=INPUTS),
    Register(40080, "disabled", Group.BASIC, high=1),  # 0 enabled, 1 not
)

BY_NAME: Final = {register.name: register for register in REGISTERS}


#: The command coils by their numbers in the manual, 00001 and on. 00001 has lost its name there: saving
#: (assumed; its note 1 speaks of a save command). The manual prints 00008 as 80000, and calls 00017
#: "output 3 on".
_FROM_1 = (
    *("save", "read_project", "clear_project", "stop", "jog_forward", "jog_reverse", "to_zero", "run_once"),
    *("start_project", "home", "clear_position", "output_1_on", "output_1_off", "output_2_on"),
    *("output_2_off", "output_3_on", "output_3_off", "previous_step", "next_step"),
)
COILS: Final = {**dict(enumerate(_FROM_1, 1)), 37: "reset_basic"}

#: Ticks of a millisecond of 40035/40036.
DELAY_UNIT: Final = TICKS_PER_SECOND // 1000


def signed(value: int) -> int:
    """A 32-bit value as a signed one (two's complement, assumed)."""
    return value - (1 << 32) if value & 0x8000_0000 else value

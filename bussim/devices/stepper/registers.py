"""The stepper controller's registers and coils, as its manual's tables 5 and 6 list them."""

from enum import StrEnum
from typing import Final, NamedTuple

from bussim.units import TICKS_PER_SECOND
from bussim.words.tables import read_table

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


REGISTERS: Final = tuple(
    Register(number, group=Group(row.pop("group")), **row)
    for number, row in read_table("bussim.devices.stepper", "registers.yaml").items()
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

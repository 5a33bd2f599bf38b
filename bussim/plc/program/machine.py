"""What a running program keeps beside the PLC's memory, and how its errors show."""

from collections.abc import Callable
from typing import Protocol

from bussim.plc.errors import note_errors
from bussim.plc.memory import Device, Memory
from bussim.plc.program.instruction_times import InstructionTimes

#: Error codes of D8067 (FX programming manual): CALL too deep; an operand's address or data out of range.
CALLS_TOO_DEEP = 6702
OUT_OF_RANGE = 6706

#: Special devices (FX programming manual): operation error and its latch, their codes and steps.
ERROR, ERROR_LATCH = 8067, 8068
ERROR_CODE, LATCHED_STEP, ERROR_STEP = 8067, 8068, 8069
ZERO, BORROW, CARRY = 8020, 8021, 8022
BACKWARDS = 8024  # BMOV moves from its destination to its source

#: What an instruction does while its condition is on; what it does with its condition in every scan.
Act = Callable[[], None]
Take = Callable[[int], None]


class Ports(Protocol):
    """Carries RS, RS2 and CPAVL out. Called during a scan, only while the instruction's condition is on.

    ``instruction`` is the instruction's number in its program, the same in every scan: an RS or RS2 that
    stops being driven is one that a scan does not call. ``operands`` are S, m, D, n and, of RS2,
    n1; a constant is an int (0…65535 where it is written so), a register its Device, whose value the ports
    read when they need it.
    """

    def drive(self, instruction: int, operands: tuple[Device | int, ...], now: int) -> None:
        """RS or RS2 is carried out at the tick ``now``."""

    def cpavl(self, words: Device, bits: Device, port: int) -> bool:
        """CPAVL: the parameters of a port (2–6) are the 20 words and the 20 bits from these on.

        False if the PLC has no such port, or they do not lie in memory.
        """


class OperationError(Exception):
    """Data or an address that an instruction refuses; becomes M8067, never leaves the program."""

    def __init__(self, code: int = OUT_OF_RANGE) -> None:
        super().__init__(code)
        self.code = code


class Machine:
    """One program's state while it runs on one memory. Its lists are cells shared with closures.

    ``size`` is the number of instructions, ``origin`` the tick of power-on. ``now`` holds the tick of
    this scan since then, ``scan`` the scan's number (from 1), ``spent`` its nanoseconds so far.
    """

    def __init__(
        self, memory: Memory, times: InstructionTimes, ports: Ports | None, *, size: int, origin: int
    ) -> None:
        self.memory = memory
        self.times = times
        self.ports = ports
        self.origin = origin
        self.bits = {letter: memory.bits(letter) for letter in "XYMSTC"}
        self.words = {letter: memory.words(letter) for letter in "DRTCVZ"}
        self.now = [0]
        self.scan = [0]
        self.spent = [0]
        #: The condition that each instruction had when it was last carried out (edges and pulses).
        self.earlier = memory.earlier = memory.earlier or bytearray(size)
        #: Conditions kept for later on the same rung.
        self.saved = bytearray(size)
        #: Conditions of MC N0–N7 and, last, of the step; on where a jump has left the MC out (FX programming
        #: manual).
        self.levels = bytearray(9)
        #: Of each timer: the scan in which it was last driven (0: not), and the clock pulses by then.
        self.timer_scan = [0] * 512
        self.timer_pulse = [0] * 512
        #: Of each timer that goes on until END without its OUT: counts, and closes it if 1 is given.
        self.going: dict[int, Callable[[int], None]] = {}
        #: Of each counter: the condition of its OUT when last carried out.
        self.counter_input = bytearray(256)
        #: Called for every operation error with its code and the program step.
        self.failed: Callable[[int, int], None] | None = None
        #: Of each timer and counter: whether an RST holds it.
        self.held = memory.held

    def fail(self, code: int, step: int) -> None:
        """An operation error: M8067 and D8067, D8069; M8068 and D8068 keep the first one."""
        flags, words = self.bits["M"], self.words["D"]
        flags[ERROR] = 1
        words[ERROR_CODE], words[ERROR_STEP] = code, step
        note_errors(flags, words)
        if not flags[ERROR_LATCH]:
            flags[ERROR_LATCH] = 1
            words[LATCHED_STEP] = step
        if self.failed is not None:
            self.failed(code, step)

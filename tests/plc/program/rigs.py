"""A program on a memory, and devices by name, for tests."""

from __future__ import annotations

from bussim.errors import ProgramError
from bussim.plc.memory import Device, Memory, parse_device
from bussim.plc.program.execution import ProgramRun
from bussim.plc.program.instruction_times import DEFAULT_TIMES, InstructionTimes
from bussim.plc.program.machine import Ports
from bussim.plc.program.program import Program
from bussim.units import TICKS_PER_MS


class Rig:
    """Scans a program; times in ms. Words are signed where ``value`` is asked for."""

    def __init__(
        self,
        text: str,
        *,
        times: InstructionTimes = DEFAULT_TIMES,
        ports: Ports | None = None,
        end: bool = True,
    ) -> None:
        text = text.replace(" / ", "\n")
        self.memory = Memory()
        self.program = Program.parse(text + "\nEND" if end else text, "test.il")
        self.run = ProgramRun(self.program, self.memory, times=times, ports=ports)
        self.ms = 0.0
        self.run.run(0)

    def scan(self, count: int = 1, *, every: float = 10.0, **bits: int) -> Rig:
        """Set bits (X0=1), then so many scans, ``every`` ms apart."""
        for name, value in bits.items():
            self.memory.set(parse_device(name), value)
        for _ in range(count):
            self.run.scan(round(self.ms * TICKS_PER_MS))
            self.ms += every
        return self

    def bit(self, name: str) -> int:
        return self.memory.get(parse_device(name))

    def bits(self, *names: str) -> list[int]:
        return [self.bit(name) for name in names]

    def word(self, name: str) -> int:
        return self.memory.word(name[0], int(name[1:]))

    def value(self, name: str) -> int:
        word = self.word(name)
        return word - 0x10000 if word >= 0x8000 else word

    def pair(self, name: str) -> int:
        """The 32-bit value of two words, the low one first."""
        first = int(name[1:])
        pattern = self.memory.word(name[0], first) | self.memory.word(name[0], first + 1) << 16
        return pattern - (1 << 32) if pattern >= 1 << 31 else pattern

    def put(self, **words: int) -> Rig:
        for name, value in words.items():
            self.memory.set_word(name[0], int(name[1:]), value)
        return self

    def put_pair(self, name: str, value: int) -> Rig:
        first = int(name[1:])
        self.memory.set_word(name[0], first, value)
        self.memory.set_word(name[0], first + 1, value >> 16)
        return self

    def error(self) -> int:
        """D8067 if M8067 is on, else 0."""
        return self.word("D8067") if self.bit("M8067") else 0

    def flags(self) -> str:
        """The flags zero, borrow, carry that are on, as letters."""
        return "".join(
            letter
            for letter, at in zip("zbc", (8020, 8021, 8022), strict=True)
            if self.memory.get(Device("M", at))
        )


def always(text: str, **words: int) -> Rig:
    """One scan of instructions under M8000, with words set before."""
    return Rig("LD M8000 / " + text).put(**words).scan()


def problems(text: str) -> list[str]:
    """The messages of a program that cannot run."""
    try:
        Program.parse(text.replace(" / ", "\n"), "test.il")
    except ProgramError as error:
        return [str(problem) for problem in error.problems]
    return []

"""RS, RS2 and CPAVL of a program, carried out on its PLC's ports."""

from collections import Counter
from collections.abc import Hashable, Mapping

from bussim.plc.memory import Device, Memory
from bussim.plc.ports.cpavl import DEFAULT_TIMEOUT, TIMEOUT
from bussim.plc.ports.port_registers import PortRegisters
from bussim.plc.ports.rs2 import Drive, Rs2, port_of


class ProgramPorts:
    """The ports of one PLC; see :class:`bussim.plc.program.machine.Ports`."""

    def __init__(self, ports: Mapping[str, PortRegisters], memory: Memory, rs_port: str) -> None:
        self._ports = ports
        self._rs_port = int(rs_port[3:])
        self._memory = memory
        self._driven: dict[int, Rs2] = {}  # in the scan before
        self._now_driven: dict[int, Rs2] = {}
        self._holders: dict[str | None, int] = {}  # by port: the instruction that has it
        #: How often an instruction was refused its port, by the one that had it, itself and the port.
        self.refused: Counter[tuple[int, int, str]] = Counter()

    def drive(self, instruction: int, operands: tuple[Device | int, ...], now: int) -> None:
        """See the protocol."""
        s, m, d, n, n1 = operands if len(operands) > 4 else (*operands, self._rs_port)
        if isinstance(s, Device) and isinstance(d, Device):
            rs2 = self._now_driven[instruction] = Rs2(s, m, d, n, n1)
            port = port_of(rs2, self._memory)
            if self.rs2(instruction, rs2, now, driven=True) is not Drive.BUSY:
                self._holders[port] = instruction
            elif port in self._holders:  # else the scenario's polls have it
                self.refused[self._holders[port], instruction, f"{port}"] += 1

    def scan_over(self, now: int) -> None:
        """Instructions that this scan did not drive are not driven any more."""
        for instruction, rs2 in self._driven.items():
            if instruction not in self._now_driven:
                self.rs2(instruction, rs2, now, driven=False)
        self._driven, self._now_driven = self._now_driven, {}

    def rs2(self, instruction: Hashable, operands: Rs2, now: int, *, driven: bool) -> Drive:
        """An RS2 instruction is executed in the scan before the next END, its contact on or off.

        ``instruction`` is its number in the program. Refused where n1 names no port that runs
        the protocol for it.
        """
        port = port_of(operands, self._memory)
        registers = self._ports.get(port) if port is not None else None
        if registers is None:
            return Drive.REFUSED
        if driven:
            return registers.drive(instruction, operands, now)
        registers.undrive(instruction, now)
        return Drive.OFF

    def cpavl(self, words: Device, bits: Device, port: int) -> bool:
        """CPAVL: a port's words and bits lie here from the next STOP→RUN on.

        False if there is no such port, or they do not lie in memory.
        """
        registers = self._ports.get(f"COM{port}")
        if registers is None:
            return False
        try:
            registers.move(words, bits)
        except ValueError:
            return False
        timeout = words.address + TIMEOUT
        if not self._memory.word("D", timeout):
            self._memory.set_word("D", timeout, DEFAULT_TIMEOUT)
        return True

"""What a port does by its protocol: what Modbus master, Modbus slave and free protocol have in common."""

from collections.abc import Hashable
from typing import Any

from bussim.plc.ports.rs2 import Drive, Rs2

#: An event of an engine; its type depends on the protocol, so that each side names all of its own.
EngineItem = Any


class Side:
    """What a port does at END, from RUN to STOP: nothing, unless its protocol does it. Times are ticks.

    Within one END: what has been decided is taken over, what was executed in the scan that ends there
    goes out, and the polls (a program of their own) execute for the scan that begins.
    """

    @property
    def busy(self) -> bool:
        """Whether a transaction or reception is under way."""
        return False

    def wanted_end(self, now: int) -> int | None:
        """The earliest tick from which an END matters; None: none does before something happens."""
        return None

    def at_end(self, end: int) -> int:
        """Carry out what happens at this END; returns hints for the engine."""
        return 0

    def event(self, item: EngineItem, now: int) -> None:
        """Take an event of the engine."""

    def drive(self, instruction: Hashable, operands: Rs2, now: int) -> Drive:
        """An RS2 instruction is executed, its contact on."""
        return Drive.REFUSED

    def undrive(self, instruction: Hashable, now: int) -> None:
        """An RS2 instruction is executed, its contact off."""

    def release(self, now: int) -> None:
        """STOP or power-off."""

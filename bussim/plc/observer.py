"""What records a PLC's run."""

from collections.abc import Sequence
from typing import Protocol

from bussim.plc.inputs import Change
from bussim.plc.memory import Device
from bussim.plc.program.errors import Fault


class PlcObserver(Protocol):
    """Called by a PLC whose ENDs are carried out. Times are ticks."""

    takes_ends: bool  # whether it is called at every END

    def ended(self, end: int) -> None:
        """An END was carried out; the memory is as it left it, before the next scan."""

    def changed(self, device: Device, value: int, now: int) -> None:
        """An observed device has a new value at an END, or where supply or mode changes."""

    def sampled(self, device: Device, changes: Sequence[Change], sampled: int, end: int) -> None:
        """An input changed since the sampling before; ``end`` ends the scan that begins with this one."""

    def faulted(self, fault: Fault, now: int) -> None:
        """The program's latest scan met operation errors or refused an RS2, or stopped the program."""

"""A station of the link as the parts of its bus see it.

The bus, its reporter, the shared listener and the fast path are written against this protocol; the port
that fulfils it (:class:`bussim.sim.nn.link_port.LinkPort`) can therefore import the bus.
"""

from __future__ import annotations

from typing import Protocol

from bussim.plc.link_registers import LinkEngine
from bussim.plc.plc import Plc
from bussim.sim.wire.contract import LineNode


class LinkStation(LineNode, Protocol):
    """A PLC's port on an N:N link."""

    engine: LinkEngine | None

    @property
    def plc(self) -> Plc:
        """The PLC."""

    @property
    def pending(self) -> list[tuple[int, int, int]]:
        """(start, order, counter) of the frames that are to be sent."""

    @property
    def undelayed(self) -> bool:
        """Whether its frames leave when its engine asks for it, and its driver goes off at their end."""

    @property
    def longest_turnaround(self) -> int:
        """The longest turnaround that can be drawn now, in ticks."""

    def turnaround(self) -> int:
        """Draw the next reply's turnaround, in ticks."""

    def schedule(self, at: int, counter: int) -> None:
        """Schedule a frame to be sent from ``at`` on."""

    def arm_deadline(self) -> None:
        """Arm the engine's deadline."""

"""A station of the link as the parts of its bus see it.

The bus, its reporter and the block path are written for this class; the port that
completes it (:class:`bussim.sim.nn.link_port.LinkPort`) can therefore import the bus.
"""

from __future__ import annotations

from abc import abstractmethod

from bussim.plc.link_registers import LinkEngine
from bussim.plc.plc import Plc
from bussim.plc.turnaround import Turnarounds
from bussim.sim.wire.node import Node


class LinkStation(Node):
    """A PLC's port on an N:N link."""

    plc: Plc
    #: None unless the PLC is in RUN with good parameters.
    engine: LinkEngine | None = None

    @property
    @abstractmethod
    def undelayed(self) -> bool:
        """Whether its frames leave after its own turnaround alone, and its driver goes off at their end."""

    turnarounds: Turnarounds

    @abstractmethod
    def meet_deadline(self, now: int) -> None:
        """Do what the engine does at its deadline, if that has come."""

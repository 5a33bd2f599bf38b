"""A node of a serial bus as its bus and reporter see it, and the replies that the bus remembers.

The bus and the reporter are written against these protocols; the node
(:class:`bussim.sim.serial.node.SerialNode`) can therefore import both.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

from bussim.engines.free.events import FreeEvent
from bussim.engines.modbus.events import MasterEvent, PollEvent, SlaveEvent
from bussim.sim.wire.contract import LineNode

#: What the engine of a node may report.
SerialEvent = MasterEvent | SlaveEvent | PollEvent | FreeEvent


class Reply(NamedTuple):
    """A slave's reply on the wire: which request it belongs to, and when its values were taken."""

    start: int
    end: int
    asked: int  # first edge of the request
    served: int
    chars: int


class ReplyRecords(Protocol):
    """A bus as its reporter sees it."""

    @property
    def name(self) -> str:
        """Its name."""

    def reply_at(self, tick: int) -> Reply | None:
        """The reply that was on the wire at a tick."""

    def gave_up(self, master: str, asked: int, end: int) -> None:
        """A master's timeout was over before a response to its request."""


class SerialStation(LineNode, Protocol):
    """A PLC's port or a device on a serial bus."""

    kind: str
    protocol_name: str
    request_chars: int

    @property
    def bus(self) -> ReplyRecords:
        """Its bus."""

    def resume_reception(self) -> None:
        """The receiver goes on from where the latest whole frame ended."""

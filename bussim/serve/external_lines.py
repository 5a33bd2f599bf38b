"""Lines of the simulation with external nodes: a :class:`Bridge` connects the two."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Self

from bussim.engines.nn.contract import STORED
from bussim.engines.nn.frames import DATA, ENQ, KIND_NAMES, PARAMETERS, POLL, SOH, STX, Frame
from bussim.serve.bridge import Bridge
from bussim.serve.external_node import PartlyExternalLine
from bussim.sim.kernel import Kernel
from bussim.sim.nn.bus import LinkBus
from bussim.sim.nn.contract import LinkStation
from bussim.sim.serial.bus import SerialBus
from bussim.sim.wire.contract import LineNode, Reading, Transmission, WireFrame

_LINK_KINDS = {ENQ: KIND_NAMES[POLL], STX: KIND_NAMES[DATA], SOH: KIND_NAMES[PARAMETERS]}
_EXTERNAL_STREAM = "outside"


class BridgedLine(PartlyExternalLine, ABC):
    """What every line with a bridge does otherwise.

    What external nodes really sent is unknown: a frame of theirs is never counted as an undetected error.
    """

    bridge: Bridge

    def attach(self, bridge: Bridge, kernel: Kernel) -> Self:
        """Let a bridge lead out of the simulation; its nodes are not on the cable yet."""
        self.bridge = bridge
        bridge.attach(self, kernel)
        return self

    # -- what its nodes send ------------------------------------------------------------------------

    def begin(self, port: LineNode, frame: WireFrame, now: int) -> Transmission:
        """See the line."""
        tx = super().begin(port, frame, now)
        self.bridge.send(tx)
        return tx

    def begin_jabber(self, port: LineNode, chars: bytes, now: int, *, first: bool) -> Transmission:
        """See the line."""
        tx = super().begin_jabber(port, chars, now, first=first)
        self.bridge.send(tx)
        return tx

    def finish(self, port: LineNode, tx: Transmission, now: int) -> None:
        """See the line."""
        super().finish(port, tx, now)
        self.bridge.sent(now)

    def cut_transmission(self, tx: Transmission, now: int) -> None:
        """See the line."""
        super().cut_transmission(tx, now)
        self.bridge.cut()

    # -- what external nodes send --------------------------------------------------------------------

    def connected(self, one: LineNode, other: LineNode) -> bool:
        """See the line; the cable to external nodes is never cut."""
        external = self.bridge.external_node
        return one is external or other is external or super().connected(one, other)

    def stream_name(self, tx: Transmission) -> str:
        """See the line."""
        return _EXTERNAL_STREAM if tx.sender is self.bridge.external_node else super().stream_name(tx)

    def kind_name(self, tx: Transmission) -> str:
        """See the line."""
        if tx.sender is self.bridge.external_node:
            return self.kind_of_external(tx.chars)
        return super().kind_name(tx)

    @abstractmethod
    def kind_of_external(self, chars: bytes) -> str:
        """The kind of frame that an external node's characters may be."""

    def accepted(self, reading: Reading) -> None:
        """See the line."""
        super().accepted(reading._replace(origin=None))


class ExternalSerialBus(BridgedLine, SerialBus):
    """A serial bus with a bridge."""

    at_once = False  # the bridge has to see every frame

    def kind_of_external(self, chars: bytes) -> str:
        """Requests where a node of this bus is a slave, else responses."""
        return "request" if any(node.kind == "response" for node in self.ports) else "response"


class ExternalLinkBus(BridgedLine, LinkBus):
    """An N:N line with a bridge. It needs to know the PLCs by station that are not simulated."""

    in_blocks = False  # the bridge has to see every frame

    def leave_out(self, external_nodes: Mapping[int, str]) -> None:
        """These are not simulated."""
        self._external_nodes = dict(external_nodes)
        self._external_names = list(external_nodes.values())

    def connect(self, nodes: Sequence[LinkStation]) -> None:
        """See the bus."""
        super().connect(nodes)
        self._others = -1  # never all stations: what external ones received is unknown

    @property
    def plc_names(self) -> tuple[str, ...]:
        """See the bus; external stations that were received follow."""
        return (*super().plc_names, *self._external_names)

    def external_name(self, station: int) -> str:
        """See the base class; the PLC's name where the scenario has one."""
        name = self._external_nodes.get(station)
        if name is None:
            name = self._external_nodes[station] = f"station {station} outside"
            self._external_names.append(name)
        return name

    def kind_of_external(self, chars: bytes) -> str:
        """The kind by its header."""
        return _LINK_KINDS.get(chars[0], "")

    def accepted(self, reading: Reading) -> None:
        """See the line; a block of an external station is a refresh, too."""
        super().accepted(reading)
        port, frame, _, now, sender, _, hints = reading
        if hints & STORED and sender is None and isinstance(frame, Frame):
            source = len(self.ports) + self._external_names.index(self.external_name(frame.station))
            self.sink.refreshed(self.name, source, now, [port.position])

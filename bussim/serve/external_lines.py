"""Lines of the simulation that lead out of it: what their nodes send leaves by a :class:`Bridge`."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence

from bussim.engines.nn.frames import DATA, ENQ, KIND_NAMES, PARAMETERS, POLL, SOH, STX, Frame
from bussim.line.characters import LineTiming
from bussim.serve.bridge import Bridge
from bussim.serve.partly_external_line import PartlyExternalLine
from bussim.sim.kernel import Kernel
from bussim.sim.nn.bus import LinkBus
from bussim.sim.nn.port import LinkPort
from bussim.sim.nn.reporter import Reporter
from bussim.sim.serial.bus import SerialBus
from bussim.sim.wire.line import Witness
from bussim.sim.wire.node import Node
from bussim.sim.wire.transmission import Transmission, WireFrame
from bussim.trace.records import Sink

_LINK_KINDS = {ENQ: KIND_NAMES[POLL], STX: KIND_NAMES[DATA], SOH: KIND_NAMES[PARAMETERS]}
_EXTERNAL_STREAM = "outside"


class BridgedLine(PartlyExternalLine):
    """What every line with a way out does otherwise.

    Nobody knows what was really sent outside: a frame from there is never taken for an undetected error.
    """

    bridge: Bridge

    # -- what its nodes send ------------------------------------------------------------------------

    def begin(self, port: Node, frame: WireFrame, now: int) -> Transmission:
        """See the line."""
        tx = super().begin(port, frame, now)
        self.bridge.leave(tx)
        return tx

    def begin_jabber(self, port: Node, chars: bytes, now: int, *, first: bool) -> Transmission:
        """See the line."""
        tx = super().begin_jabber(port, chars, now, first=first)
        self.bridge.leave(tx)
        return tx

    def finish(self, port: Node, tx: Transmission, now: int) -> None:
        """See the line."""
        super().finish(port, tx, now)
        self.bridge.left(now)

    def cut_transmission(self, tx: Transmission, now: int) -> None:
        """See the line."""
        super().cut_transmission(tx, now)
        self.bridge.cut()

    # -- what comes from outside ---------------------------------------------------------------------

    def connected(self, one: Node, other: Node) -> bool:
        """See the line; the way out is never cut."""
        external = self.bridge.external_node
        return one is external or other is external or super().connected(one, other)

    def stream_key(self, tx: Transmission) -> Hashable:
        """See the line."""
        return _EXTERNAL_STREAM if tx.sender is self.bridge.external_node else super().stream_key(tx)

    def stream_name(self, tx: Transmission) -> str:
        """See the line."""
        return _EXTERNAL_STREAM if tx.sender is self.bridge.external_node else super().stream_name(tx)

    def kind_name(self, tx: Transmission) -> str:
        """See the line."""
        if tx.sender is self.bridge.external_node:
            return self.kind_of_strange(tx.chars)
        return super().kind_name(tx)

    def kind_of_strange(self, chars: bytes) -> str:
        """What kind of frame characters from outside may be."""
        raise NotImplementedError

    def accepted(
        self,
        port: Node,
        frame: WireFrame,
        start: int,
        now: int,
        sender: Node | None,
        blamed: Transmission | None,
        *,
        stored: bool,
    ) -> None:
        """See the line."""
        del blamed
        super().accepted(port, frame, start, now, sender, None, stored=stored)


class ExternalSerialBus(BridgedLine, SerialBus):
    """A bus beside the link with a way out."""

    def __init__(
        self, name: str, timing: LineTiming, kernel: Kernel, sink: Sink, witness: Witness, bridge: Bridge
    ) -> None:
        super().__init__(name, timing, sink, witness)
        self.bridge = bridge
        bridge.attach(self, kernel)

    def kind_of_strange(self, chars: bytes) -> str:
        """Requests where somebody here answers."""
        del chars
        return "request" if any(node.kind == "response" for node in self.ports) else "response"


class ExternalLinkBus(BridgedLine, LinkBus):
    """An N:N line with a way out; ``external_nodes`` are the PLCs by station that are to be found there."""

    def __init__(
        self,
        name: str,
        timing: LineTiming,
        kernel: Kernel,
        sink: Sink,
        reporter: Reporter,
        bridge: Bridge,
        external_nodes: Mapping[int, str],
    ) -> None:
        super().__init__(name, timing, kernel, sink, reporter)
        # The short ways for what nearly always happens do not lead outside.
        self.shared = False
        self.bridge = bridge
        self._external_nodes = dict(external_nodes)
        self._external_names = list(external_nodes.values())
        bridge.attach(self, kernel)

    def connect(self, ports: Sequence[LinkPort], horizon: int) -> None:
        """See the bus."""
        super().connect(ports, horizon)
        self._others = -1  # that all heard a block can never be told: there are others outside

    @property
    def plc_names(self) -> tuple[str, ...]:
        """See the bus; whoever was heard from outside follows."""
        return (*super().plc_names, *self._external_names)

    def external_name(self, station: int) -> str:
        """See the base class; by a name that the class was given."""
        name = self._external_nodes.get(station)
        if name is None:
            name = self._external_nodes[station] = f"station {station} outside"
            self._external_names.append(name)
        return name

    def kind_of_strange(self, chars: bytes) -> str:
        """By the header."""
        return _LINK_KINDS.get(chars[0], "")

    def accepted(
        self,
        port: Node,
        frame: WireFrame,
        start: int,
        now: int,
        sender: Node | None,
        blamed: Transmission | None,
        *,
        stored: bool,
    ) -> None:
        """See the line; a block from outside is a refresh, too."""
        super().accepted(port, frame, start, now, sender, blamed, stored=stored)
        if stored and sender is None and isinstance(frame, Frame):
            source = len(self.ports) + self._external_names.index(self.external_name(frame.station))
            self.sink.refreshed(self.name, source, now, [port.position])

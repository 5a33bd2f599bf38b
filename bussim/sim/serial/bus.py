"""A bus beside the link, and the truth about its answers, which RTU frames do not carry."""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable, Sequence
from typing import TYPE_CHECKING, NamedTuple

from bussim.engines.modbus.adu import Adu
from bussim.line.characters import LineTiming
from bussim.sim.wire.line import Line, Witness
from bussim.sim.wire.node import Node
from bussim.sim.wire.transmission import Transmission, WireFrame
from bussim.trace.records import Sink

if TYPE_CHECKING:
    from bussim.sim.serial.node import SerialNode

#: Replies that are remembered: more than can lie between an answer and the END that takes it over.
_REPLIES = 512


class Reply(NamedTuple):
    """A slave's reply on the wire: which request it answers, and when its values were taken."""

    start: int
    end: int
    asked: int  # first edge of the request
    served: int
    chars: int


class SerialBus(Line):
    """One bus with its PLC ports and devices in cable order."""

    def __init__(self, name: str, timing: LineTiming, sink: Sink, witness: Witness) -> None:
        super().__init__(name, timing, sink, witness)
        self.ports: Sequence[SerialNode] = []
        #: Nodes to whom a whole frame was told, and who wait for the silence that ends it.
        self.waiting: set[SerialNode] = set()
        # Of several frames at once only one is sound: a few of the latest are enough.
        self._told: deque[Transmission] = deque(maxlen=8)
        self._replies: deque[Reply] = deque(maxlen=_REPLIES)

    def connect(self, nodes: Sequence[SerialNode]) -> None:
        """LinkAttachment the nodes, in cable order."""
        self.position(nodes)
        self.ports = nodes

    # -- frames ------------------------------------------------------------------------------------

    def stream_key(self, tx: Transmission) -> Hashable:
        """See the line."""
        frame = tx.frame
        return (tx.sender.position, frame.station) if isinstance(frame, Adu) else tx.sender.position

    def stream_name(self, tx: Transmission) -> str:
        """See the line."""
        frame = tx.frame
        station = f" {frame.station}" if isinstance(frame, Adu) else ""
        return f"{tx.sender.name} {self.kind_name(tx)}{station}"

    def kind_name(self, tx: Transmission) -> str:
        """See the line."""
        return self.ports[tx.sender.position].kind

    def what(self, frame: WireFrame) -> str:
        """See the line."""
        return "Modbus" if isinstance(frame, Adu) else "free-protocol"

    def protocol_of(self, sender: Node) -> str:
        """See the line."""
        return self.ports[sender.position].protocol_name

    def _numbers(self, frame: WireFrame) -> tuple[int | None, int | None]:
        return (frame.station if isinstance(frame, Adu) else None), None

    # -- silences ----------------------------------------------------------------------------------

    def listens_alone(self, port: Node) -> None:
        """A node's receiver opens: what it was told of is what the receiver has heard so far."""
        node = self.ports[port.position]
        if node in self.waiting:
            node.listen_on()

    def _all_listen_alone(self) -> None:
        for node in sorted(self.waiting, key=_seat):
            node.listen_on()

    def begin(self, port: Node, frame: WireFrame, now: int) -> Transmission:
        """A node's driver is switched on for a frame; who waited for silence does not get it."""
        if self.waiting:
            self._all_listen_alone()
        return super().begin(port, frame, now)

    def _deliver(self, frame: WireFrame, tx: Transmission, now: int) -> None:
        self._told.append(tx)
        super()._deliver(frame, tx, now)

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
        """See the line; the frame may have been told of as a whole, and only its end heard by an receiver."""
        if sender is None:
            for tx in self._told:
                if tx.frame is not None and tx.start == start and tx.frame.chars == frame.chars:
                    sender = tx.sender
        super().accepted(port, frame, start, now, sender, blamed, stored=stored)

    # -- the truth ---------------------------------------------------------------------------------

    def replied(self, reply: Reply) -> None:
        """A slave has begun to answer."""
        self._replies.append(reply)

    def reply_at(self, tick: int) -> Reply | None:
        """The reply that was on the wire at a tick; None if none was, or several."""
        found: Reply | None = None
        for reply in reversed(self._replies):
            if reply.end <= tick:
                break  # so are all before it, but for one that began before another and outlasted it
            if reply.start <= tick:
                if found is not None:
                    return None
                found = reply
        return found


def _seat(node: Node) -> int:
    return node.position

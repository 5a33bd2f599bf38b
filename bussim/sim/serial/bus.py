"""A serial bus, and which request each reply on it belongs to, which RTU frames do not carry."""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable, Sequence

from bussim.engines.modbus.adu import Adu
from bussim.line.characters import LineTiming
from bussim.sim.notes import Notes
from bussim.sim.serial.contract import Reply, SerialStation
from bussim.sim.wire.contract import LineNode, Reading, Transmission, WireFrame
from bussim.sim.wire.line import Line
from bussim.trace.records import Sink

#: Replies that are remembered: more than can lie between a reply and the END that takes it over.
_REPLIES = 512
#: Frames that are remembered: a message may come in as many as it has characters.
_PIECES = 256
#: Requests that were given up and may still get a reply.
_GIVEN_UP = 64


class SerialBus(Line):
    """One bus with its PLC ports and devices in cable order."""

    def __init__(self, name: str, timing: LineTiming, sink: Sink, reporter: Notes) -> None:
        super().__init__(name, timing, sink, reporter)
        self.ports: Sequence[SerialStation] = []
        #: Nodes that have received a whole frame and wait for the silence that ends it.
        self.waiting: set[SerialStation] = set()
        # The latest that ended: at most so many characters make a frame, each perhaps sent by itself.
        self._delivered: deque[Transmission] = deque(maxlen=_PIECES)
        self._replies: deque[Reply] = deque(maxlen=_REPLIES)
        self._given_up: dict[int, str] = {}  # by the request's first edge: its master
        #: Responses that ended after their request had been given up, by master.
        self.late: dict[str, int] = {}

    def connect(self, nodes: Sequence[SerialStation]) -> None:
        """Put the nodes on the cable, in cable order."""
        self.set_nodes(nodes)
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

    def protocol_of(self, sender: LineNode) -> str:
        """See the line."""
        return self.ports[sender.position].protocol_name

    def _numbers(self, frame: WireFrame) -> tuple[int | None, int | None]:
        return (frame.station if isinstance(frame, Adu) else None), None

    # -- silences ----------------------------------------------------------------------------------

    def hand_over(self, port: LineNode) -> None:
        """A node's receiver opens: the whole frame that it waits behind counts as received so far."""
        node = self.ports[port.position]
        if node in self.waiting:
            node.resume_reception()

    def _hand_over_all(self) -> None:
        for node in sorted(self.waiting, key=_position):
            node.resume_reception()

    def begin(self, port: LineNode, frame: WireFrame, now: int) -> Transmission:
        """Switch a node's driver on for a frame; nodes that waited for silence receive its characters."""
        if self.waiting:
            self._hand_over_all()
        return super().begin(port, frame, now)

    def _deliver(self, frame: WireFrame, tx: Transmission, now: int) -> None:
        self._delivered.append(tx)
        super()._deliver(frame, tx, now)

    def accepted(self, reading: Reading) -> None:
        """See the line; what was sent undamaged may have been a part of a message, or several of them."""
        origin = reading.origin
        if reading.sender is None and origin is not None:
            heard = [*(tx for tx in self._delivered if tx is not origin), origin]
            parts = [tx for tx in heard if reading.start < tx.end and tx.start < reading.now]
            sent = [(tx.start, tx.frame.chars) for tx in heard if tx.frame is not None]
            sound = not any(tx.damaged or tx.collided or tx.cut for tx in parts)
            together = b"".join(tx.chars for tx in parts) if sound else b""
            chars = reading.frame.chars
            if (reading.start, chars) in sent or chars in together:
                return
        super().accepted(reading)

    # -- which request a reply belongs to ----------------------------------------------------------

    def replied(self, reply: Reply) -> None:
        """Record a slave's reply that begins now."""
        self._replies.append(reply)
        master = self._given_up.pop(reply.asked, None)
        if master is not None:
            self.late[master] = self.late.get(master, 0) + 1

    def gave_up(self, master: str, asked: int, end: int) -> None:
        """A master's timeout was over at ``end``, before a response to its request of ``asked``."""
        begun = next((reply for reply in self._replies if reply.asked == asked), None)
        if begun is None:
            self._given_up[asked] = master
            if len(self._given_up) > _GIVEN_UP:
                del self._given_up[next(iter(self._given_up))]
        elif begun.end > end:
            self.late[master] = self.late.get(master, 0) + 1

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


def _position(node: LineNode) -> int:
    return node.position

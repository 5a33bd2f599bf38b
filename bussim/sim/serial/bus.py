"""A serial bus, and which request each reply on it belongs to, which RTU frames do not carry."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from bussim.engines.free.engine import FreeFrame
from bussim.engines.modbus.adu import Adu
from bussim.line.characters import LineTiming
from bussim.sim.notes import Notes
from bussim.sim.serial.contract import Replies, SerialStation
from bussim.sim.serial.messages import Messages
from bussim.sim.serial.transaction_path import TransactionPath
from bussim.sim.wire.contract import LineNode, Reading, Transmission, WireFrame
from bussim.sim.wire.line import Line
from bussim.trace.records import LATE_RESPONSE, Outcome
from bussim.trace.sink import Sink

#: Frames that are remembered: a message may come in as many as it has characters.
_PIECES = 256


class SerialBus(Line):
    """One bus with its PLC ports and devices in cable order."""

    ports: Sequence[SerialStation]
    #: Whether whole transactions may be done at once (a test compares runs with and without).
    at_once = True

    def __init__(self, name: str, timing: LineTiming, sink: Sink, reporter: Notes) -> None:
        super().__init__(name, timing, sink, reporter)
        #: Nodes that have received a whole frame and wait for the silence that ends it.
        self.waiting: set[SerialStation] = set()
        #: The latest that ended: at most so many characters make a frame, each perhaps sent by itself.
        self.delivered: deque[Transmission] = deque(maxlen=_PIECES)
        self.replies = Replies(lambda master, tick: sink.irregular(name, master, tick, LATE_RESPONSE))
        self.messages = Messages(self._became)
        self.transaction_path = TransactionPath(self)

    @property
    def undisturbed(self) -> bool:
        """Whether the line is idle, every node receives whole frames, and nothing can touch them."""
        disturber = self.disturber
        busy = self.drivers or self.waiting or self._open_receivers
        return not (busy or disturber.active or disturber.replies_at_risk)

    def listeners_changed(self) -> None:
        """See the line."""
        super().listeners_changed()
        self.transaction_path.exchanges.clear()

    # -- frames ------------------------------------------------------------------------------------

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
        tx = super().begin(port, frame, now)
        if isinstance(frame, FreeFrame):
            self.messages.begun(tx, self.ports)
        return tx

    def close(self, now: int) -> None:
        """See the line."""
        super().close(now)
        self.messages.decide(now)

    def _became(self, node: SerialStation, tx: Transmission, outcome: Outcome) -> None:
        """It is known what became of a message at a node; a wrong one is believed, since it has no check."""
        self.sink.exchanged(self.name, node.name, tx.sender.name, tx.start, outcome)
        if outcome is Outcome.WRONG and not tx.mistaken:
            tx.mistaken = True
            self.undetected_frames += 1

    def _deliver(self, frame: WireFrame, tx: Transmission, now: int) -> None:
        self.delivered.append(tx)
        super()._deliver(frame, tx, now)

    def accepted(self, reading: Reading) -> None:
        """See the line; what was sent undamaged may have been a part of a message, or several of them."""
        origin = reading.origin
        if reading.sender is None and origin is not None:
            heard = [*(tx for tx in self.delivered if tx is not origin), origin]
            parts = [tx for tx in heard if reading.start < tx.end and tx.start < reading.now]
            sent = [(tx.start, tx.frame.chars) for tx in heard if tx.frame is not None]
            sound = not any(tx.damaged or tx.collided or tx.cut for tx in parts)
            together = b"".join(tx.chars for tx in parts) if sound else b""
            chars = reading.frame.chars
            if (reading.start, chars) in sent or chars in together:
                return
        super().accepted(reading)


def _position(node: LineNode) -> int:
    return node.position

"""A node with Modbus or the free protocol: what PLC ports and devices have in common."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from typing import Any

from bussim.engines.contract import OPEN
from bussim.engines.free.engine import FreePort
from bussim.engines.free.events import Received
from bussim.engines.modbus.adu import Adu
from bussim.engines.modbus.events import RequestServed
from bussim.engines.modbus.master import Master
from bussim.engines.modbus.slave import Slave
from bussim.line.characters import LineTiming
from bussim.sim.kernel import HEARING, Kernel
from bussim.sim.serial.bus import SerialBus
from bussim.sim.serial.contract import Reply, SerialEvent, SerialStation
from bussim.sim.serial.reporter import SerialReporter
from bussim.sim.wire.contract import LineNode

#: Requests that are remembered until their replies begin.
_MOST_SERVED = 64


class SerialNode(SerialStation):
    """One position of a serial bus.

    ``delays``, where given, draw what is added to a reply's delay, uniform below ``jitter`` ticks.
    """

    def __init__(
        self,
        name: str,
        bus: SerialBus,
        position: int,
        kernel: Kernel,
        reporter: SerialReporter,
        *,
        delays: Iterator[float] | None = None,
        jitter: int = 0,
    ) -> None:
        super().__init__(name, bus, position, kernel)
        self.bus = bus
        self.reporter = reporter
        self.replies = bus.replies
        self.delays = delays if jitter else None
        self.longest_delay = jitter
        self._silence_timer = kernel.timer(self._on_silence, HEARING)
        self._received_until = 0
        self._outcome_timer = kernel.timer(self._on_outcome, HEARING)
        self._response: tuple[Adu, int, int] | None = None  # that it receives whole, with its two ends
        # By the number of a request: its first edge, and when its values were taken.
        self._served: dict[int, tuple[int, int]] = {}

    # -- its protocol ------------------------------------------------------------------------------

    def use_engine(self, engine: Any, timing: LineTiming, now: int) -> None:
        """Use this engine, at this rate and format, from now on; it is not started yet."""
        self.engine, self.engine_since = engine, now
        self._served.clear()
        self.stations = engine.maps if isinstance(engine, Slave) else ()
        if isinstance(engine, (Slave, Master)):
            self.protocol_name = f"modbus-{engine.config.framing.mode.value.lower()}"
            self.kind = "response" if isinstance(engine, Slave) else "request"
        else:
            self.protocol_name, self.kind = "free", "data"
        self.home_timing = timing
        self.retime(now)

    def quiet(self, timing: LineTiming) -> int:
        """The silence that its engine waits for; two characters where it waits for none."""
        quiet: int = getattr(self.engine, "quiet", 0)
        return quiet or timing.characters(2)

    def understands(self, sender: LineNode) -> bool:
        """Whether whole frames of another node are frames of its own protocol (free: any bytes)."""
        if isinstance(self.engine, FreePort):
            return True
        return isinstance(sender, SerialNode) and sender.protocol_name == self.protocol_name

    # -- what the engine asks for ------------------------------------------------------------------

    def handle(self, hints: int, now: int) -> None:
        """Do what the engine asks for with its hints."""
        if hints & OPEN:
            # An open receiver watches for the silence itself.
            if not self.receiver.is_open and self not in self.bus.waiting:
                self._received_until = now
                self.bus.waiting.add(self)
                self._silence_timer.set(now + self.quiet(self.timing))
            hints &= ~OPEN
        super().handle(hints, now)

    def _on_silence(self, now: int) -> None:
        engine = self.engine
        if self in self.bus.waiting and engine is not None:
            self.bus.waiting.discard(self)
            self.handle(engine.line_idle(now), now)

    def catch_up(self, now: int) -> None:
        """Whether a master or a free port has timed out depends on the characters so far."""
        self.bus.receive_so_far(self, now)

    def resume_reception(self) -> None:
        """See the base class."""
        self.bus.waiting.discard(self)
        self._silence_timer.cancel()
        self.receiver.hold(self._received_until)

    def came_sound(self, start: int, peer: SerialStation) -> bool:
        """See the base class."""
        sent = (tx for tx in self.bus.delivered if tx.start == start and tx.sender is self)
        alike = self.nominal and peer.nominal and self.bus.connected(self, peer)
        return alike and any(tx.sound_for(peer.position) for tx in sent)

    def halt(self, now: int) -> None:
        """STOP or power-off: see the base class."""
        super().halt(now)
        self.bus.waiting.discard(self)
        self._silence_timer.cancel()

    def report(self, item: SerialEvent, now: int) -> None:
        """Take an event of the engine."""
        if isinstance(item, RequestServed) and not item.broadcast:
            served = self._served
            served[item.number] = (item.start, item.tick)
            if len(served) > _MOST_SERVED:
                del served[next(iter(served))]
        elif isinstance(item, Received):
            self.bus.messages.received(self, item)
        self.handle_event(item, now)

    @abstractmethod
    def handle_event(self, item: SerialEvent, now: int) -> None:
        """Act on an event of the engine."""

    # -- sending -----------------------------------------------------------------------------------

    def schedule(self, at: int, counter: int) -> None:
        """Schedule a frame to be sent from ``at`` on; a reply is delayed by the node's own turnaround."""
        super().schedule(self.reply_at(at) if self.kind == "response" else at, counter)

    def reply_at(self, at: int) -> int:
        """When a reply begins that its engine has ready at a tick: one draw for each reply."""
        at += self.extra_turnaround
        return at if self.delays is None else at + int(next(self.delays) * (self.longest_delay + 1))

    def _on_start(self, now: int) -> None:
        engine = self.engine
        if self.sending is not None or engine is None:
            return  # what falls due while it sends follows at once: see _on_end
        pending = self.pending
        counter = pending.pop(0)[2]
        if pending:
            self._start_timer.set(max(pending[0][0], now))
        bus = self.bus
        replies = self.kind == "response"
        if replies and bus.disturber.replies_at_risk and bus.disturber.reply_vanishes(self.position, now):
            self.handle(engine.give_up_reply(now), now)
            return
        frame = engine.begin_transmit(now, counter)
        bus.waiting.discard(self)
        if not replies:
            self.request_chars = len(frame.chars)
            asks = self.kind == "request"
            if asks and bus.transaction_path.pass_transaction(self, frame, now, self._kernel):
                return
        self._begin(frame, now)
        if replies and self.sending is not None:
            self.replied(counter, now, self.sending.end, len(frame.chars))

    def replied(self, counter: int, begun: int, end: int, chars: int) -> None:
        """A reply of so many characters begins that is over at ``end``; ``counter`` is its engine's."""
        asked = self._served.pop(counter, None)
        if asked is not None:
            self.bus.replies.replied(Reply(begun, end, *asked, chars))
        self.reporter.replied(self)

    def await_outcome(self, response: Adu, start: int, end: int, now: int) -> None:
        """It receives a whole response from ``start`` to ``end``, and knows at ``now`` that it is over."""
        self._response = response, start, end
        self._outcome_timer.set(now)

    def _on_outcome(self, now: int) -> None:
        if self._response is not None:
            self.handle(self.engine.receive_complete(*self._response, now), now)

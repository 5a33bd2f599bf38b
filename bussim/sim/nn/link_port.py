"""A PLC's port on an N:N link."""

from __future__ import annotations

from bussim.engines.nn.events import NnEvent
from bussim.engines.nn.frames import QUIET_CHARS
from bussim.engines.nn.master import Master
from bussim.line.characters import LineTiming
from bussim.line.random_streams import Streams
from bussim.plc.link_registers import LinkEngine
from bussim.plc.plc import Plc, PlcState
from bussim.plc.turnaround import Turnarounds
from bussim.sim.kernel import Kernel
from bussim.sim.nn.bus import LinkBus
from bussim.sim.nn.contract import LinkStation
from bussim.sim.wire.contract import LineNode


class LinkPort(LinkStation):
    """The port that M8179 selects. Its node has the PLC's name."""

    def __init__(self, plc: Plc, bus: LinkBus, position: int, kernel: Kernel, streams: Streams) -> None:
        self.plc = plc
        self.bus = bus
        super().__init__(plc.name, bus, position, kernel)
        self.is_master = False
        self.reporter = bus.reporter
        self.replies_at_end = plc.profile.reply.at_end
        self.turnarounds = Turnarounds(plc.profile.turnaround, streams, plc.name)
        self._longest_turnaround = plc.profile.turnaround.longest
        # Replies that wait for an END: when each was ready, and its counter.
        self._waits: list[tuple[int, int]] = []
        # Polls that wait for their reply: when each ended, and its counter.
        self._polled: list[tuple[int, int]] = []
        if self.replies_at_end:
            plc.cycle.on_change = self._ends_moved

    def quiet(self, timing: LineTiming) -> int:
        """Two characters (assumed; see the link's frames)."""
        return timing.characters(QUIET_CHARS)

    def understands(self, sender: LineNode) -> bool:
        """Always: a link has no other frames than its own."""
        return True

    def report(self, item: NnEvent, now: int) -> None:
        """Pass an event on to the bus's reporter."""
        self.reporter.engine_event(self, item, now)

    @property
    def powered(self) -> bool:
        """Whether the PLC has a supply."""
        return self.plc.state is not PlcState.OFF

    def run(self, engine: LinkEngine | None, first_end: int, now: int) -> None:
        """The PLC is in RUN: its port receives, and a master begins after its first END."""
        self.engine = engine
        self.is_master = isinstance(engine, Master)
        if engine is None:
            self.reporter.refused(now, self.plc)
            return
        self.bus.listeners_changed()
        self.handle(engine.start(first_end if self.is_master else now), now)
        self.bus.join_midway(self, now)

    def halt(self, now: int) -> None:
        """STOP or power-off: see the base class."""
        super().halt(now)
        self._waits.clear()
        self._polled.clear()

    # -- what the engine asks for ------------------------------------------------------------------

    def arm_deadline(self) -> None:
        """See the base class; the timer is the bus's."""
        at = self.engine.deadline() if self.engine is not None else None
        timer = self.bus.deadlines
        if at is not None and (timer.at < 0 or at < timer.at):
            timer.set(max(at, self._kernel.now))

    def meet_deadline(self, now: int) -> None:
        """See the base class."""
        at = self.engine.deadline() if self.engine is not None else None
        if at is not None and at <= now and self.engine is not None:
            self.handle(self.engine.on_deadline(now), now)

    # -- sending -----------------------------------------------------------------------------------

    @property
    def undelayed(self) -> bool:
        """See the base class."""
        delayed = self.jabbering or self.late_release or self.replies_at_end or self.extra_turnaround
        return not (delayed or self.tail or self.pending)

    def schedule(self, at: int, counter: int) -> None:
        """Schedule a frame to be sent from ``at`` on; a slave adds its turnaround."""
        if not self.is_master:
            self._polled.append((at, counter))
            at += self.turnarounds.draw() + self.extra_turnaround
            if self.replies_at_end:
                self._waits.append((at, counter))
                at = self.plc.cycle.next_end(at, self._kernel.now)
        super().schedule(at, counter)

    def _on_start(self, now: int) -> None:
        engine = self.engine
        if self.sending is not None or engine is None:
            return  # what falls due while it sends follows at once: see _on_end
        bus, pending = self.bus, self.pending
        counter = pending.pop(0)[2]
        if self._waits:
            self._waits.remove(next(wait for wait in self._waits if wait[1] == counter))
        if self.is_master and engine.wants_image and bus.block_path.pass_scans(self, now):
            return
        if pending:
            self._start_timer.set(max(pending[0][0], now))
        polled = now
        if not self.is_master:
            index = 0
            while self._polled[index][1] != counter:
                index += 1
            polled, _ = self._polled.pop(index)
            if bus.disturber.replies_at_risk and bus.disturber.reply_vanishes(self.position, now):
                return
        if engine.wants_image:
            engine.image = self.plc.image_at(now)
        frame = engine.begin_transmit(now, counter)
        if now - polled > self._longest_turnaround:
            self.reporter.replied(self, now - polled, now, len(frame.chars) * bus.character)
        self._begin(frame, now)

    def _ends_moved(self, end: int) -> None:
        """The PLC's scans after ``end`` take another time: reschedule the replies that wait for END."""
        waits, now = self._waits, self._kernel.now
        if not waits:
            return
        next_end = self.plc.cycle.next_end
        self.pending[:] = sorted(
            (max(next_end(max(ready, end), now), now), order, counter)
            for order, (ready, counter) in enumerate(waits)
        )
        self._sequence = len(waits)
        self._start_timer.set(self.pending[0][0])

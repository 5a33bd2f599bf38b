"""A PLC's port on a bus: it runs the link's engine in simulated time.

The port keeps the engine's appointments: deadlines, replies after their turnaround, frames at their
start and end. It is also where a station's own faults sit.
"""

from __future__ import annotations

from bisect import insort
from typing import TYPE_CHECKING

from bussim.engines.contract import DEADLINE, EVENTS, OPEN, STORED, TRANSMIT, Transmit
from bussim.engines.nn.master import Master
from bussim.line.characters import LineTiming
from bussim.plc.board import LinkEngine
from bussim.plc.plc import Plc
from bussim.plc.profiles import Reply
from bussim.plc.streams import Streams
from bussim.plc.turnaround import Turnarounds
from bussim.sim.ear import Ear
from bussim.sim.kernel import DEADLINES, HEARING, SENDING, Kernel
from bussim.sim.reporter import Reporter
from bussim.sim.transmission import Transmission

if TYPE_CHECKING:
    from bussim.sim.bus import Bus

_IDLE = b""
_ONLY_TRANSMIT = TRANSMIT | STORED


class Port:
    """One seat of a bus. ``seat`` is its place in cable order, from 0."""

    __slots__ = (
        "_deadline_timer",
        "_end_timer",
        "_kernel",
        "_longest_turnaround",
        "_release_timer",
        "_sequence",
        "_start_timer",
        "_turnarounds",
        "bus",
        "ear",
        "engine",
        "extra_turnaround",
        "is_master",
        "jabbering",
        "late_release",
        "nominal",
        "pending",
        "plc",
        "replies_at_end",
        "reporter",
        "seat",
        "sending",
        "tail",
        "timing",
    )

    def __init__(self, plc: Plc, bus: Bus, seat: int, kernel: Kernel, streams: Streams) -> None:
        self.plc = plc
        self.bus = bus
        self.seat = seat
        self.timing = bus.timing
        #: Whether it sends and receives with the bus's own rate, format and clock.
        self.nominal = True
        self.ear = Ear(self, kernel, self.timing)
        #: The link's engine; None unless the PLC is in RUN with good parameters.
        self.engine: LinkEngine | None = None
        self.is_master = False
        self.reporter: Reporter = bus.reporter
        #: The frame that it is sending, if its driver is on for one.
        self.sending: Transmission | None = None
        #: Its driver is still on after a frame (late release).
        self.tail = False
        self.jabbering = False
        self.extra_turnaround = 0
        self.late_release = 0
        self.replies_at_end = plc.profile.reply is Reply.END
        self._turnarounds = Turnarounds(plc.profile.turnaround, streams, plc.name)
        self._kernel = kernel
        self._longest_turnaround = plc.profile.turnaround.longest
        self.pending: list[tuple[int, int, int]] = []  # (start, order, counter) of what is to be sent
        self._sequence = 0
        self._start_timer = kernel.timer(self._on_start, SENDING)
        self._end_timer = kernel.timer(self._on_end, HEARING)
        self._release_timer = kernel.timer(self._on_release, HEARING)
        self._deadline_timer = kernel.timer(self._on_deadline, DEADLINES)

    @property
    def now(self) -> int:
        """The current tick."""
        return self._kernel.now

    @property
    def name(self) -> str:
        """The PLC's name."""
        return self.plc.name

    @property
    def driving(self) -> bool:
        """Whether its driver is on: it hears nothing then."""
        return self.sending is not None or self.tail or self.jabbering

    # -- the PLC's states --------------------------------------------------------------------------

    def run(self, now: int) -> None:
        """The PLC goes to RUN: it listens, and a master begins after its first END."""
        engine, first_end = self.plc.run(now, traced=self.bus.sink.traced)
        self.engine = engine
        self.is_master = isinstance(engine, Master)
        if engine is None:
            self.reporter.refused(now, self.plc)
            return
        self.bus.audience_changed()
        self.handle(engine.start(first_end if self.is_master else now), now)
        self.bus.join_midway(self, now)

    def halt(self, now: int) -> None:
        """STOP or power-off: silent and deaf at once; a frame on the wire is cut at this tick."""
        engine = self.engine
        if engine is not None:
            self.bus.retire(self)
            engine.stop(now)
            self.drain(now)
        self.engine = None
        self.pending.clear()
        self._start_timer.cancel()
        self._deadline_timer.cancel()
        self.ear.close()
        if self.sending is not None:
            self._end_timer.cancel()
            self.bus.cut(self, now)
            self.sending = None
        if self.tail:
            self._release_timer.cancel()
            self.tail = False
            self.bus.driver_off(self, now)
        self.bus.audience_changed()

    def set_timing(self, timing: LineTiming, now: int) -> None:
        """Send and receive with another rate, format or clock; what is being received is lost."""
        self.timing = timing
        self.nominal = timing == self.bus.timing
        self.bus.relisten(self, timing, now)
        self.bus.audience_changed()

    # -- the engine's wishes -----------------------------------------------------------------------

    def handle(self, hints: int, now: int) -> None:
        """Look at what the engine asks for."""
        engine = self.engine
        if engine is None:
            return
        if hints | STORED == _ONLY_TRANSMIT:
            at, engine.due = engine.due, -1
            self.appoint(at, engine.due_counter)
            return
        if hints & OPEN:
            self.ear.hold(now)
        if hints & EVENTS:
            self.drain(now)
        if hints & TRANSMIT and engine.due >= 0:
            at, engine.due = engine.due, -1
            self.appoint(at, engine.due_counter)
        if hints & DEADLINE:
            self.watch()

    def drain(self, now: int) -> None:
        """Report the engine's events; a transmission among them is appointed."""
        engine = self.engine
        while engine is not None:
            item = engine.poll()
            if item is None:
                return
            if isinstance(item, Transmit):
                self.appoint(item.at, item.counter)
            else:
                self.reporter.engine_event(self, item, now)
                engine = self.engine

    def watch(self) -> None:
        """Arm the deadline's timer unless it comes up earlier anyway: one lazy watchdog a port."""
        engine = self.engine
        at = engine.deadline() if engine is not None else None
        timer = self._deadline_timer
        if at is not None and (timer.at < 0 or at < timer.at):
            timer.set(max(at, self._kernel.now))

    def _on_deadline(self, now: int) -> None:
        engine = self.engine
        if engine is None:
            return
        if self in self.bus.gallery.members:
            return  # the gallery watches for all its members
        at = engine.deadline()
        if at is None:
            return
        if at > now:
            self._deadline_timer.set(at)
            return
        self.handle(engine.on_deadline(now), now)
        self.watch()

    # -- sending -----------------------------------------------------------------------------------

    def turnaround(self) -> int:
        """Draw the next reply's turnaround, in ticks."""
        return self._turnarounds.draw() + self.extra_turnaround

    @property
    def prompt(self) -> bool:
        """Whether its frames leave when its engine wants them, and its driver goes off with their end."""
        return not (self.jabbering or self.late_release or self.replies_at_end or self.tail)

    @property
    def longest_turnaround(self) -> int:
        """The longest turnaround that can be drawn now, in ticks."""
        return self._longest_turnaround + self.extra_turnaround

    def appoint(self, at: int, counter: int) -> None:
        """A frame is to be sent from ``at`` on; a slave adds its turnaround."""
        if not self.is_master:
            at += self.turnaround()
            if self.replies_at_end:
                at = self.plc.cycle.next_end(at, self._kernel.now)
        pending = self.pending
        now = self._kernel.now
        if at < now:
            at = now
        if pending:
            self._sequence += 1
            insort(pending, (at, self._sequence, counter))
            self._start_timer.set(pending[0][0])
        else:
            pending.append((at, 0, counter))
            self._start_timer.chain(at)

    def _on_start(self, now: int) -> None:
        engine = self.engine
        if self.sending is not None or engine is None:
            return  # what falls due while it sends follows at once: see _on_end
        bus, pending = self.bus, self.pending
        counter = pending.pop(0)[2]
        if self.is_master and bus.lane.exchange(self, now):
            return
        if pending:
            self._start_timer.set(max(pending[0][0], now))
        if bus.disturber.replies_at_risk and not self.is_master and bus.reply_vanishes(self, now):
            return
        image = self.plc.image_at(now) if engine.wants_image else _IDLE
        frame = engine.begin_transmit(now, image, counter)
        if self.ear.is_open:
            self.ear.close()
        if self.tail:
            self._release_timer.cancel()
            self.tail = False
            bus.driver_kept(now)
        self.sending = tx = bus.begin(self, frame, now)
        self._end_timer.chain(tx.end)

    def _on_end(self, now: int) -> None:
        tx = self.sending
        if tx is None:
            return
        self.sending = None
        if self.late_release and not (self.jabbering or tx.silent or tx.cut):
            self.tail = True
            self._release_timer.set(now + self.late_release)
        self.bus.finish(self, tx, now)
        engine = self.engine
        if engine is not None:
            hints = engine.transmit_done(now)
            if hints:
                self.handle(hints, now)
            if self.pending:
                self._start_timer.set(max(self.pending[0][0], now))

    def _on_release(self, now: int) -> None:
        self.tail = False
        self.bus.driver_off(self, now)

"""A half-duplex line: one driver at a time, collisions where there are two, and who hears what.

In the ordinary case one port drives a quiet line, nothing disturbs the frame, and everybody else is
told of it as a whole at its end. Everything else is heard character by character through the ports'
ears, on the level that the line really has.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from bussim.engines.contract import STORED
from bussim.engines.nn.frames import DATA, POLL, Frame
from bussim.line.characters import LineTiming
from bussim.sim.disturb import Disturber
from bussim.sim.gallery import Gallery
from bussim.sim.kernel import DEADLINES, Kernel
from bussim.sim.lane import Lane
from bussim.sim.ledger import Ledger
from bussim.sim.port import Port
from bussim.sim.reporter import Reporter
from bussim.sim.transmission import Transmission
from bussim.trace import FrameRecord, Sink

Hear = Callable[[Frame, int, int], int]
#: Told of whole frames one by one; told character by character; how many the gallery stands for.
Audience = tuple[tuple[tuple[Port, Hear], ...], tuple[Port, ...], int]


class Bus:
    """One N:N line with its ports in cable order."""

    def __init__(self, name: str, timing: LineTiming, kernel: Kernel, sink: Sink, reporter: Reporter) -> None:
        self.name = name
        self.timing = timing
        self.sink = sink
        self.reporter = reporter
        self.ports: list[Port] = []
        self.disturber = Disturber(self)
        self.ledger = Ledger(0)
        self.gallery = Gallery()
        #: Whether slaves may be told together (a test compares both ways).
        self.together = True
        self.lane = Lane(self, kernel)
        self._gallery_timer = kernel.timer(self._watch_gallery, DEADLINES)
        self.character = timing.characters(1)
        self._air: list[Transmission] = []
        #: Drivers that are on: frames, jabber, and tails of late release.
        self.drivers = 0
        self._busy_since = 0
        self._audiences: dict[int, Audience] = {}
        self._segments: list[int] = []
        self._others = 0
        self._open_ears = 0
        #: Ticks during which some driver was on; frames; frames begun while another driver was on;
        #: transmissions that some receiver took for another frame.
        self.busy = 0
        self.frames = 0
        self.collisions = 0
        self.undetected_frames = 0

    def connect(self, ports: Iterable[Port], horizon: int) -> None:
        """Seat the ports, in cable order; ``horizon`` is the longest PLC scan on the line in ticks."""
        self.ports = list(ports)
        self._others = len(self.ports) - 1
        self._segments = [0] * len(self.ports)
        self.ledger = Ledger(horizon)

    def connected(self, one: Port, other: Port) -> bool:
        """Whether the cable between two ports is whole."""
        return self._segments[one.seat] == self._segments[other.seat]

    # -- who listens -------------------------------------------------------------------------------

    @property
    def plain(self) -> bool:
        """Whether nothing can touch a frame, all hear whole ones, and nobody wants a record of each."""
        return not (self.disturber.active or self.sink.traced or self._open_ears)

    def audience_changed(self) -> None:
        """Some port listens otherwise than before."""
        self._audiences.clear()
        self.lane.close()

    def leave_gallery(self, port: Port) -> None:
        """A port is going to listen for itself."""
        if port in self.gallery.members:
            self._dissolve()

    def _dissolve(self) -> None:
        """Every slave listens for itself from now on, also to what is on the line."""
        members = self.gallery.dissolve()
        if not members:
            return
        for port in members:
            port.watch()
        for tx in self._air:
            if tx.together:
                tx.together = 0
                tx.listeners += tuple(
                    (port, port.engine.receive_frame)
                    for port in members
                    if port is not tx.sender and port.engine is not None
                )
        self.audience_changed()

    def _watch_gallery(self, now: int) -> None:
        """The lazy watchdog of all members in one."""
        gallery = self.gallery
        if gallery.members:
            if gallery.deadline > now:
                self._gallery_timer.set(gallery.deadline)
            else:
                self._dissolve()

    def _gather(self) -> None:
        """The master's data frame is over: slaves that are calm and agree listen together."""
        if self.together and not self._open_ears and not any(self._segments):
            self._dissolve()
            self.gallery.form(self.ports)
            self.audience_changed()
            if self.gallery.members:
                timer, deadline = self._gallery_timer, self.gallery.deadline
                if timer.at < 0 or deadline < timer.at:
                    timer.set(deadline)

    def ear_opened(self) -> None:
        """A port begins to listen character by character."""
        self._open_ears += 1
        self.audience_changed()

    def ear_closed(self) -> None:
        """A port is told of whole frames again."""
        self._open_ears -= 1
        self.audience_changed()

    def audience(self, sender: Port) -> Audience:
        """Who hears a frame on a line without other drivers: whole, or character by character."""
        found = self._audiences.get(sender.seat)
        if found is None:
            whole: list[tuple[Port, Hear]] = []
            single: list[Port] = []
            members = self.gallery.members
            for port in self.ports:
                engine = port.engine
                if port is sender or engine is None or port.driving or not self.connected(port, sender):
                    continue
                if port in members:
                    continue
                if port.nominal and sender.nominal and not port.ear.is_open:
                    whole.append((port, engine.receive_frame))
                else:
                    single.append(port)
            together = len(members) - (sender in members)
            found = self._audiences[sender.seat] = (tuple(whole), tuple(single), together)
        return found

    # -- sending -----------------------------------------------------------------------------------

    def begin(self, port: Port, frame: Frame, now: int) -> Transmission:
        """A port's driver is switched on for a frame."""
        chars = frame.chars
        tx = Transmission(port, frame, chars, now, now + len(chars) * self.character, port.timing)
        self.frames += 1
        if self.disturber.active:
            self.disturber.disturb(tx)
        if self.drivers or tx.damaged or not port.nominal:
            self._begin_otherwise(tx, now)
            return tx
        # The ordinary case: an undamaged frame on a quiet line.
        self._busy_since = now
        tx.listeners, single, tx.together = self._audiences.get(port.seat) or self.audience(port)
        if single:
            self._spell_out(tx, single, now)
        self._air.append(tx)
        self.drivers = 1
        return tx

    def _begin_otherwise(self, tx: Transmission, now: int) -> None:
        if tx.sender.jabbering:
            tx.silent = True  # the port sends rubbish in its place
            return
        if not tx.sender.nominal:
            tx.set_chars(tx.chars)
        self._drive(tx, now)

    def begin_jabber(self, port: Port, chars: bytes, now: int, *, first: bool) -> Transmission:
        """A port that jabbers sends the next rubbish; ``first``: its driver was off before."""
        tx = Transmission(port, None, chars, now, now, port.timing)
        tx.set_chars(chars)
        if first:
            for other in self._air:
                other.drop(port)
            port.ear.close()
        self._drive(tx, now, counted=first)
        return tx

    def finish_jabber(self, tx: Transmission, now: int) -> None:
        """A stretch of rubbish is over; the next one follows at once."""
        self._air.remove(tx)
        self._count_driver_off(now)
        if self.sink.traced:
            self._record(tx)

    def reply_vanishes(self, port: Port, now: int) -> bool:
        """Whether a reply that is to begin now is never sent."""
        return self.disturber.reply_vanishes(port.seat, now)

    def _drive(self, tx: Transmission, now: int, *, counted: bool = True) -> None:
        sender = tx.sender
        self._dissolve()
        if self.drivers:
            self._crowd(tx, now, counted=counted)
        else:
            self._busy_since = now
            whole, single, _ = self.audience(sender)
            if tx.spoilt:
                self._spell_out(tx, [port for port, _ in whole], now)
            else:
                hit = {*(tx.rx_flips or ()), *(tx.rx_chars or ())}
                tx.listeners = tuple(pair for pair in whole if pair[0].seat not in hit)
                self._spell_out(tx, [port for port, _ in whole if port.seat in hit], now)
            if single:
                self._spell_out(tx, single, now)
        self._air.append(tx)
        self.drivers += 1

    def _spell_out(self, tx: Transmission, ports: Iterable[Port], now: int) -> None:
        """These ports hear a transmission that begins now character by character."""
        for port in ports:
            port.ear.open(now)
            port.ear.hear(tx, now)
            port.ear.replan(now)

    def _crowd(self, tx: Transmission, now: int, *, counted: bool) -> None:
        """A driver is switched on while others are on."""
        sender = tx.sender
        others = [port for port in self.ports if port is not sender and port.driving]
        clash = [port for port in others if self.connected(port, sender)]
        if clash:
            self.collisions += counted
            tx.collided = True
            for other in self._air:
                if self.connected(other.sender, sender):
                    other.collided = True
        for other in self._air:
            other.drop(sender)
        hearers = [
            port
            for port in self.ports
            if port is not sender
            and port.engine is not None
            and not port.driving
            and self.connected(port, sender)
        ]
        for port in hearers:
            self._open_up(port, now)
            port.ear.hear(tx, now)
            port.ear.replan(now)

    def _open_up(self, port: Port, now: int) -> None:
        """A port that was to be told of whole frames hears them character by character after all."""
        heard = [other for other in self._air if other.drop(port)]
        if not heard:
            port.ear.open(now)
            return
        port.ear.open(min(other.start for other in heard))
        for other in heard:
            port.ear.hear(other, other.start)
        port.ear.replan(now)

    def finish(self, port: Port, tx: Transmission, now: int) -> None:
        """A frame's last stop bit has left."""
        if tx.silent or tx.cut:
            # Its driver was not on (or not to the end), but it was deaf as if it had been.
            self.audience_changed()
            self.join_midway(port, now)
            return
        self._air.remove(tx)
        if not port.tail:
            self.drivers -= 1
        if self.drivers:
            if not port.tail and not port.jabbering:
                self.join_midway(port, now)
        else:
            self.busy += now - self._busy_since
        frame = tx.frame
        if frame is not None:
            self._deliver(frame, tx, now)
        if self.sink.traced:
            self._record(tx)
        if self._open_ears:
            for other in self.ports:
                if other.ear.is_open:
                    other.ear.settle()

    def _deliver(self, frame: Frame, tx: Transmission, now: int) -> None:
        """A whole undamaged frame reaches everybody who listens to whole frames."""
        start, kind, sender = tx.start, frame.kind, tx.sender
        gallery = self.gallery
        if tx.together and not gallery.hear(frame, start, now):
            members = gallery.members
            self._dissolve()
            tx.together = 0
            tx.listeners += tuple(
                (port, port.engine.receive_frame)
                for port in members
                if port is not sender and port.engine is not None
            )
        if kind != DATA:
            if tx.together and kind == POLL:
                polled = gallery.by_station.get(frame.station)
                if polled is not None:
                    polled.appoint(now, frame.counter)
            for port, hear in tx.listeners:
                hints = hear(frame, start, now)
                if hints:
                    port.handle(hints, now)
            return
        listeners = tx.listeners
        took = tx.together
        missed: list[int] = []
        for port, hear in listeners:
            hints = hear(frame, start, now)
            if hints & STORED:
                took += 1
                if hints == STORED:
                    continue
            else:
                missed.append(port.seat)
            port.handle(hints, now)
        if took == self._others:
            self.ledger.heard(frame.station, now, frame.data)
            self.sink.refreshed(self.name, sender.seat, now, None)
        elif took:
            seats = [port.seat for port, _ in listeners if port.seat not in missed]
            if tx.together:
                seats += [port.seat for port in gallery.members if port is not sender]
            others = [port.seat for port in self.ports if port is not sender and port.seat not in seats]
            self.ledger.heard(frame.station, now, frame.data, others)
            self.sink.refreshed(self.name, sender.seat, now, seats)
        if not frame.station and listeners:
            self._gather()

    def stored_alone(self, port: Port, frame: Frame, now: int, sender: Port | None) -> None:
        """One port took a block that it heard character by character; ``sender`` None: falsely."""
        self.ledger.heard_alone(frame.station, now, frame.data, port.seat)
        if sender is not None:
            self.sink.refreshed(self.name, sender.seat, now, [port.seat])

    def undetected(self, tx: Transmission, port: Port, frame: Frame, now: int) -> None:
        """A receiver read a valid frame that nobody sent."""
        if not tx.believed:
            tx.believed = True
            self.undetected_frames += 1
        self.reporter.undetected(now, port.name, tx.sender.name, frame)

    # -- drivers going off -------------------------------------------------------------------------

    def cut(self, port: Port, now: int) -> None:
        """What a port sends ends at this tick, in the middle of whatever it was."""
        tx = port.sending
        if tx is None or tx.silent or tx.cut:
            return
        self.cut_transmission(tx, now)

    def cut_transmission(self, tx: Transmission, now: int) -> None:
        """A transmission ends at this tick; its sender's driver goes off."""
        self._dissolve()
        tx.end = now
        tx.cut = True
        hearers = [port for port, _ in tx.listeners]
        tx.listeners = ()
        for port in hearers:
            port.ear.open(tx.start)
            port.ear.hear(tx, tx.start)
        self._air.remove(tx)
        self._count_driver_off(now)
        self.audience_changed()
        for port in self.ports:
            if port.ear.is_open:
                port.ear.replan(now)
                port.ear.settle()
        if self.sink.traced:
            self._record(tx)

    def _count_driver_off(self, now: int) -> None:
        self.drivers -= 1
        if not self.drivers:
            self.busy += now - self._busy_since

    def driver_kept(self, now: int) -> None:
        """A port whose driver was still on for its tail sends again: the tail is over."""
        self._count_driver_off(now)

    def driver_off(self, port: Port, now: int) -> None:
        """A port's driver is released without a frame ending (late release): it hears again."""
        self._count_driver_off(now)
        self.join_midway(port, now)

    def join_midway(self, port: Port, now: int) -> None:
        """A port begins to listen: frames on the line are heard from here on."""
        if port.engine is None or port.driving:
            return
        for tx in self._air:
            if tx.sender is not port and self.connected(tx.sender, port):
                port.ear.open(now)
                port.ear.hear(tx, now)
        if port.ear.is_open:
            port.ear.replan(now)

    def relisten(self, port: Port, timing: LineTiming, now: int) -> None:
        """A port's receiver starts anew, with another timing, in the middle of whatever is on the line."""
        self.leave_gallery(port)
        if any(listener is port for tx in self._air for listener, _ in tx.listeners):
            self._open_up(port, now)  # the characters so far were heard
        half_heard = port.ear.half_heard
        port.ear.close()
        port.ear.set_timing(timing)
        self.join_midway(port, now)
        if half_heard:
            port.ear.hold(now)  # the engine's reader still waits for the line's quiet

    def retire(self, port: Port) -> None:
        """A port's engine is about to stop: it hears nothing more."""
        self.leave_gallery(port)
        for tx in self._air:
            tx.drop(port)
        self.reporter.retire(port)

    # -- the cable ---------------------------------------------------------------------------------

    def set_cuts(self, cuts: Iterable[int], now: int) -> None:
        """The cable is broken behind these seats, and nowhere else."""
        self._dissolve()
        before = self._segments
        broken = set(cuts)
        after: list[int] = []
        segment = 0
        for seat in range(len(self.ports)):
            after.append(segment)
            segment += seat in broken
        affected = [
            (tx, port)
            for tx in self._air
            for port in self.ports
            if port.engine is not None
            and port is not tx.sender
            and not port.driving
            and (before[port.seat] == before[tx.sender.seat]) != (after[port.seat] == after[tx.sender.seat])
        ]
        for tx, port in affected:
            gained = after[port.seat] == after[tx.sender.seat]
            self._open_up(port, now)
            if gained:
                port.ear.hear(tx, now)
            else:
                port.ear.unhear(tx, now)
        self._segments = after
        for _, port in affected:
            if port.ear.is_open:
                port.ear.replan(now)
                port.ear.settle()
        self.audience_changed()

    def close(self, now: int) -> None:
        """The run is over (for now): count a driver that is still on."""
        self.gallery.sync()
        if self.drivers:
            self.busy += now - self._busy_since
            self._busy_since = now

    # -- the trace ---------------------------------------------------------------------------------

    def _record(self, tx: Transmission) -> None:
        frame = tx.frame
        self.sink.frame(
            FrameRecord(
                bus=self.name,
                start=tx.start,
                end=tx.end,
                sender=tx.sender.name,
                kind="jabber" if frame is None else frame.kind_name,
                station=None if frame is None else frame.station,
                counter=None if frame is None else frame.counter,
                chars=tx.chars,
                damaged_bits=tx.flips,
                damaged_at={self.ports[seat].name: bits for seat, bits in (tx.rx_flips or {}).items()},
                collided=tx.collided,
                cut=tx.cut,
            )
        )

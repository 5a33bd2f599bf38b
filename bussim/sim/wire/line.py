"""A half-duplex line: one driver at a time, collisions where there are two, and which nodes receive what.

In the ordinary case one node drives an idle line, nothing disturbs the frame, and all other nodes receive
it as a whole at its end. Everything else is received character by character through the nodes' receivers,
on the level that the line really has.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Collection, Iterable

from bussim.line.characters import LineTiming
from bussim.sim.notes import Notes
from bussim.sim.wire.contract import Cable, LineNode, Reading, Transmission, WireFrame
from bussim.sim.wire.disturber import Disturber
from bussim.trace.records import (
    AFTER_FRAME,
    IN_FRAME,
    JABBER,
    OFF_RATE,
    UNEVEN,
    WITHOUT_FRAME,
    FrameRecord,
)
from bussim.trace.sink import Sink

#: A pause inside a frame of so many characters shows, and a rate that is off by so much of itself: a
#: receiver tells a character's last bit wrong from half a bit in 9.5 on.
_PAUSE_CHARS, _OFF = 2, 0.04


class Line(Cable):
    """One line with its nodes in cable order. ``frames`` and the other counts are of the whole run."""

    #: How trace records name the protocol of this line, where a frame does not name it.
    protocol = ""
    #: Whether what nothing can come between is done ahead of its event.
    in_blocks = False

    def __init__(self, name: str, timing: LineTiming, sink: Sink, reporter: Notes) -> None:
        super().__init__()
        self.name = name
        self.timing = timing
        self.sink = sink
        self.reporter = reporter
        self.disturber = Disturber(self)
        self.character = timing.characters(1)
        self._on_wire: list[Transmission] = []
        #: Frames that are over, but whose driver is still on.
        self._tails: list[Transmission] = []
        #: Frames that are over, in that order, from the first on whose driver is still on.
        self._unrecorded: list[Transmission] = []
        self._written: tuple[LineTiming, str, float] | None = None  # the latest timing, as records have it
        #: Drivers that are on: frames, jabber, and tails of late release.
        self.drivers = 0
        self._busy_since = 0
        #: Ticks during which some driver was on; frames; frames begun while another driver was on;
        #: transmissions that some receiver accepted as another frame.
        self.busy = 0
        self.frames = 0
        self.collisions = 0
        self.undetected_frames = 0

    # -- what a protocol's line knows of its frames --------------------------------------------------

    @abstractmethod
    def _numbers(self, frame: WireFrame) -> tuple[int | None, int | None]:
        """Station and counter that a frame carries, where it does."""

    @abstractmethod
    def what(self, frame: WireFrame) -> str:
        """A frame in a word or two, for a note."""

    def protocol_of(self, sender: LineNode) -> str:
        """The protocol of a node, for the trace."""
        return self.protocol

    def _deliver(self, frame: WireFrame, tx: Transmission, now: int) -> None:
        """Pass a whole undamaged frame to every node that receives whole frames."""
        start = tx.start
        for port, receive in tx.listeners:
            hints = receive(frame, start, now)
            if hints:
                port.handle(hints, now)

    # -- sending -----------------------------------------------------------------------------------

    def begin(self, port: LineNode, frame: WireFrame, now: int) -> Transmission:
        """Switch a node's driver on for a frame."""
        chars = frame.chars
        tx = Transmission(port, frame, chars, now, now + len(chars) * self.character, port.timing)
        self.frames += 1
        if self.disturber.active:
            self.disturber.disturb(tx)
        if self.drivers or tx.damaged or not port.nominal:
            self._begin_otherwise(tx, now)
            return tx
        # The ordinary case: an undamaged frame on an idle line.
        self._busy_since = now
        tx.listeners, single = self._listeners_by_position.get(port.position) or self.listeners_of(port)
        if single:
            self._deliver_by_character(tx, single, now)
        self._on_wire.append(tx)
        self.drivers = 1
        return tx

    def _begin_otherwise(self, tx: Transmission, now: int) -> None:
        if tx.sender.jabbering:
            tx.silent = True  # the node's jabber is on the wire in its place
            return
        sender = tx.sender
        if not sender.nominal:
            tx.set_chars(tx.chars)
            ours, timing = self.timing, tx.timing
            off = abs(timing.baud * (1 + timing.ppm / 1_000_000) / ours.baud - 1)
            if timing.format != ours.format or off >= _OFF:
                self.sink.irregular(self.name, sender.name, now, OFF_RATE)
        if any(ticks >= _PAUSE_CHARS * self.character for _, ticks in tx.pauses):
            self.sink.irregular(self.name, sender.name, now, UNEVEN)
        self._drive(tx, now)

    def begin_jabber(self, port: LineNode, chars: bytes, now: int, *, first: bool) -> Transmission:
        """Begin the next characters of a node that jabbers; ``first``: its driver was off before."""
        tx = Transmission(port, None, chars, now, now, port.timing)
        tx.set_chars(chars)
        self.sink.irregular(self.name, port.name, now, JABBER)
        if first:
            for other in self._on_wire:
                other.drop(port)
            port.receiver.close()
        self._drive(tx, now, counted=first)
        return tx

    def finish_jabber(self, tx: Transmission, now: int) -> None:
        """A jabbering node's characters are over; the next ones follow at once."""
        self._on_wire.remove(tx)
        self.count_driver_off(now)
        if self.sink.traced:
            self.record(tx)

    def _drive(self, tx: Transmission, now: int, *, counted: bool = True) -> None:
        sender = tx.sender
        self._hand_over_all()
        if self.drivers:
            self._overlap(tx, now, counted=counted)
        else:
            self._busy_since = now
            whole, single = self.listeners_of(sender)
            if tx.corrupted:
                self._deliver_by_character(tx, [port for port, _ in whole], now)
            else:
                hit = {*(tx.rx_flips or ()), *(tx.rx_chars or ())}
                tx.listeners = tuple(pair for pair in whole if pair[0].position not in hit)
                self._deliver_by_character(tx, [port for port, _ in whole if port.position in hit], now)
            if single:
                self._deliver_by_character(tx, single, now)
        self._on_wire.append(tx)
        self.drivers += 1

    def _deliver_by_character(self, tx: Transmission, ports: Collection[LineNode], now: int) -> None:
        """Let these nodes receive a transmission that begins now character by character."""
        for port in ports:
            port.receiver.open(now)
            port.receiver.attach(tx, now)
            port.receiver.replan(now)

    def _overlap(self, tx: Transmission, now: int, *, counted: bool) -> None:
        """Begin a transmission while other drivers are on."""
        sender = tx.sender
        driving = [
            port
            for port in self.ports
            if port is not sender and port.driving and self.connected(port, sender)
        ]
        if driving:
            self.collisions += counted
            for port in driving if counted else ():
                if port.sending is not None and port.sending.start == now:
                    continue  # of two that begin at once none was first
                what = AFTER_FRAME if port.tail else WITHOUT_FRAME if port.jabbering else IN_FRAME
                self.sink.irregular(self.name, port.name, now, what)
            tx.collided = True
            for other in self._on_wire:
                if self.connected(other.sender, sender):
                    other.collided = True
        for other in self._on_wire:
            other.drop(sender)
        for port in self._receivers_of(sender):
            self._switch_to_characters(port, now)
            self._attach_tails(port, now)
            port.receiver.attach(tx, now)
            port.receiver.replan(now)

    def _attach_tails(self, port: LineNode, now: int) -> None:
        """Let a node's receiver see the drivers that are on after their frames."""
        for tail in self._tails:
            if tail.sender is not port and self.connected(tail.sender, port):
                port.receiver.attach(tail, now)

    def _switch_to_characters(self, port: LineNode, now: int) -> None:
        """A node that was to receive whole frames at their ends receives their characters after all."""
        dropped = [other for other in self._on_wire if other.drop(port)]
        if not dropped:
            port.receiver.open(now)
            return
        port.receiver.open(min(other.start for other in dropped))
        for other in dropped:
            port.receiver.attach(other, other.start)
        port.receiver.replan(now)

    def receive_so_far(self, port: LineNode, now: int) -> None:
        """Pass the characters so far of an unfinished frame to a node that was to receive it at its end."""
        if any(listener is port for tx in self._on_wire for listener, _ in tx.listeners):
            self._switch_to_characters(port, now)

    def finish(self, port: LineNode, tx: Transmission, now: int) -> None:
        """A frame's last stop bit has left."""
        if tx.silent or tx.cut:
            # Its driver was not on (or not to the end), but the node received nothing, as if it had been.
            self.listeners_changed()
            self.join_midway(port, now)
            return
        self._on_wire.remove(tx)
        if port.tail:
            self._tails.append(tx)
        else:
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
            self.record(tx)
        if self._open_receivers:
            for other in self.ports:
                if other.receiver.is_open:
                    other.receiver.settle()

    def accepted(self, reading: Reading) -> None:
        """See the base class."""
        origin = reading.origin
        if reading.sender is None and origin is not None:
            if not origin.mistaken:
                origin.mistaken = True
                self.undetected_frames += 1
            receiver, what = reading.port.name, self.what(reading.frame)
            self.reporter.undetected(reading.now, receiver, origin.sender.name, what)

    # -- drivers going off -------------------------------------------------------------------------

    def cut(self, port: LineNode, now: int) -> None:
        """End what a node sends at this tick, in the middle of whatever it was."""
        tx = port.sending
        if tx is None or tx.silent or tx.cut:
            return
        self.cut_transmission(tx, now)

    def cut_transmission(self, tx: Transmission, now: int) -> None:
        """End a transmission at this tick; its sender's driver goes off."""
        self._hand_over_all()
        tx.end = now
        tx.cut = True
        listeners = [port for port, _ in tx.listeners]
        tx.listeners = ()
        for port in listeners:
            port.receiver.open(tx.start)
            port.receiver.attach(tx, tx.start)
        self._on_wire.remove(tx)
        self.count_driver_off(now)
        self.listeners_changed()
        self._replan_open(self.ports, now)
        if self.sink.traced:
            self.record(tx)

    def _replan_open(self, ports: Iterable[LineNode], now: int) -> None:
        for port in ports:
            if port.receiver.is_open:
                port.receiver.replan(now)
                port.receiver.settle()

    def count_driver_off(self, now: int) -> None:
        """One driver less is on: its frame or jabber is over."""
        self.drivers -= 1
        if not self.drivers:
            self.busy += now - self._busy_since

    def release(self, tail: Transmission, now: int) -> None:
        """The driver goes off that was still on after a frame."""
        early = tail.driven_until > now
        tail.released = now
        self._tails.remove(tail)
        self.count_driver_off(now)
        if early:
            self._replan_open(self.ports, now)
        self._record_released()

    def join_midway(self, port: LineNode, now: int) -> None:
        """A node begins to receive: frames on the wire reach it from here on."""
        if port.engine is None or port.driving:
            return
        for tx in self._on_wire:
            if tx.sender is not port and self.connected(tx.sender, port):
                port.receiver.open(now)
                port.receiver.attach(tx, now)
        self._attach_tails(port, now)
        if port.receiver.is_open:
            port.receiver.replan(now)

    def restart_receiver(self, port: LineNode, timing: LineTiming, now: int) -> None:
        """Restart a node's receiver with another timing, in the middle of whatever is on the wire."""
        self.hand_over(port)
        self.receive_so_far(port, now)
        frame_open = port.receiver.frame_open
        port.receiver.close()
        port.receiver.set_timing(timing)
        self.join_midway(port, now)
        if frame_open:
            port.receiver.hold(now)  # the engine's reader still waits for the line's silence

    def detach(self, port: LineNode) -> None:
        """A node's engine is about to stop: it receives nothing more."""
        self.hand_over(port)
        for tx in self._on_wire:
            tx.drop(port)

    # -- the cable ---------------------------------------------------------------------------------

    def set_cuts(self, cuts: Iterable[int], now: int) -> None:
        """The cable is broken behind these positions, and nowhere else."""
        self._hand_over_all()
        before = self._segments
        broken = set(cuts)
        after: list[int] = []
        segment = 0
        for position in range(len(self.ports)):
            after.append(segment)
            segment += position in broken
        affected = [
            (tx, port)
            for tx in (*self._on_wire, *self._tails)
            for port in self.ports
            if port.engine is not None
            and port is not tx.sender
            and not port.driving
            and (before[port.position] == before[tx.sender.position])
            != (after[port.position] == after[tx.sender.position])
        ]
        for tx, port in affected:
            gained = after[port.position] == after[tx.sender.position]
            self._switch_to_characters(port, now)
            if gained:
                port.receiver.attach(tx, now)
            else:
                port.receiver.detach(tx, now)
        self._segments = after
        self._replan_open([port for _, port in affected], now)
        self.listeners_changed()

    def close(self, now: int) -> None:
        """The run is over (for now): count a driver that is still on."""
        if self.drivers:
            self.busy += now - self._busy_since
            self._busy_since = now
        for tx in self._unrecorded:
            self.sink.take(self.frame_record(tx))
        self._unrecorded.clear()

    # -- the trace ---------------------------------------------------------------------------------

    def record(self, tx: Transmission) -> None:
        """A frame is over; frames are recorded in this order, once it is known when drivers went off."""
        self._unrecorded.append(tx)
        self._record_released()

    def _record_released(self) -> None:
        while self._unrecorded and self._unrecorded[0] not in self._tails:
            self.sink.take(self.frame_record(self._unrecorded.pop(0)))

    def frame_record(self, tx: Transmission) -> FrameRecord:
        """The record of a frame that is over."""
        frame, timing = tx.frame, tx.timing
        written = self._written
        if written is None or timing is not written[0]:
            written = self._written = timing, str(timing.format), float(timing.ppm)
        station, counter = (None, None) if frame is None else self._numbers(frame)
        return FrameRecord(
            bus=self.name,
            start=tx.start,
            end=tx.end,
            sender=tx.sender.name,
            kind="jabber" if frame is None else self.kind_name(tx),
            station=station,
            counter=counter,
            chars=tx.chars,
            damaged_bits=tx.flips,
            damaged_at={self.ports[position].name: bits for position, bits in (tx.rx_flips or {}).items()},
            collided=tx.collided,
            cut=tx.cut,
            protocol=self.protocol_of(tx.sender),
            baud=timing.baud,
            format=written[1],
            ppm=written[2],
            released=tx.released,
            pauses=tx.pauses,
        )

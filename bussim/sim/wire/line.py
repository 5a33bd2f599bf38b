"""A half-duplex line: one driver at a time, collisions where there are two, and who hears what.

In the ordinary case one node drives a quiet line, nothing disturbs the frame, and everybody else is
told of it as a whole at its end. Everything else is heard character by character through the nodes'
ears, on the level that the line really has.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Sequence
from typing import TYPE_CHECKING, Any, Protocol

from bussim.line.characters import LineTiming
from bussim.sim.wire.disturber import Disturber
from bussim.sim.wire.transmission import Transmission, WireFrame
from bussim.trace.records import FrameRecord, Sink

if TYPE_CHECKING:
    from bussim.sim.wire.node import Node

# What an engine's receive_frame takes is its own protocol's; a line tells it of no other.
Hear = Callable[[Any, int, int], int]
#: Told of whole frames one by one; told character by character; how many are told together.
Audience = tuple[tuple[tuple["Node", Hear], ...], tuple["Node", ...], int]


class Witness(Protocol):
    """Who is told what a line found out about its receivers."""

    def undetected(self, tick: int, receiver: str, sender: str, what: str) -> None:
        """A receiver believed a frame that nobody sent."""


class Line:
    """One line with its nodes in cable order. ``frames`` and the other counts are of the whole run."""

    #: How trace records name what is spoken here, where a frame does not tell.
    protocol = ""

    def __init__(self, name: str, timing: LineTiming, sink: Sink, witness: Witness) -> None:
        self.name = name
        self.timing = timing
        self.sink = sink
        self._witness = witness
        self.ports: Sequence[Node] = []
        self.disturber = Disturber(self)
        self.character = timing.characters(1)
        #: Nodes for whom somebody else listens (see :meth:`listens_alone`).
        self._stood_in_for: tuple[Node, ...] = ()
        self._air: list[Transmission] = []
        #: Drivers that are on: frames, jabber, and tails of late release.
        self.drivers = 0
        self._busy_since = 0
        self._listeners_by_position: dict[int, Audience] = {}
        self._segments: list[int] = []
        self._open_receivers = 0
        #: Ticks during which some driver was on; frames; frames begun while another driver was on;
        #: transmissions that some receiver took for another frame.
        self.busy = 0
        self.frames = 0
        self.collisions = 0
        self.undetected_frames = 0

    def position(self, nodes: Sequence[Node]) -> None:
        """LinkAttachment the nodes, in cable order."""
        self.ports = nodes
        self._segments = [0] * len(nodes)

    def connected(self, one: Node, other: Node) -> bool:
        """Whether the cable between two nodes is whole."""
        return self._segments[one.position] == self._segments[other.position]

    # -- what a protocol's line says of its frames --------------------------------------------------

    def stream_key(self, tx: Transmission) -> Hashable:
        """Frames with equal keys draw their noise from one stream; cheap."""
        raise NotImplementedError

    def stream_name(self, tx: Transmission) -> str:
        """The name of that stream: who sends what to whom."""
        raise NotImplementedError

    def kind_name(self, tx: Transmission) -> str:
        """What kind of frame it is, in a word."""
        raise NotImplementedError

    def _numbers(self, frame: WireFrame) -> tuple[int | None, int | None]:
        """Station and counter that a frame carries, where it does."""
        raise NotImplementedError

    def what(self, frame: WireFrame) -> str:
        """A frame in a word or two, for a note."""
        raise NotImplementedError

    def protocol_of(self, sender: Node) -> str:
        """What a node speaks, for the trace."""
        del sender
        return self.protocol

    def _deliver(self, frame: WireFrame, tx: Transmission, now: int) -> None:
        """A whole undamaged frame reaches everybody who listens to whole frames."""
        start = tx.start
        for port, hear in tx.listeners:
            hints = hear(frame, start, now)
            if hints:
                port.handle(hints, now)

    # -- who listens -------------------------------------------------------------------------------

    @property
    def plain(self) -> bool:
        """Whether nothing can touch a frame, all hear whole ones, and nobody wants a record of each."""
        return not (self.disturber.active or self.sink.traced or self._open_receivers)

    def listeners_changed(self) -> None:
        """Some node listens otherwise than before."""
        self._listeners_by_position.clear()

    def listens_alone(self, port: Node) -> None:
        """A node is going to listen for itself."""

    def _all_listen_alone(self) -> None:
        """Every node listens for itself from now on, also to what is on the line."""

    def receiver_opened(self) -> None:
        """A node begins to listen character by character."""
        self._open_receivers += 1
        self.listeners_changed()

    def receiver_closed(self) -> None:
        """A node is told of whole frames again."""
        self._open_receivers -= 1
        self.listeners_changed()

    def listeners_of(self, sender: Node) -> Audience:
        """Who hears a frame on a line without other drivers: whole, or character by character."""
        found = self._listeners_by_position.get(sender.position)
        if found is None:
            whole: list[tuple[Node, Hear]] = []
            single: list[Node] = []
            members = self._stood_in_for
            for port in self.ports:
                engine = port.engine
                if port is sender or engine is None or port.driving or not self.connected(port, sender):
                    continue
                if port in members:
                    continue
                if port.nominal and sender.nominal and not port.receiver.is_open and port.understands(sender):
                    whole.append((port, engine.receive_frame))
                else:
                    single.append(port)
            shared = len(members) - (sender in members)
            found = self._listeners_by_position[sender.position] = (tuple(whole), tuple(single), shared)
        return found

    # -- sending -----------------------------------------------------------------------------------

    def begin(self, port: Node, frame: WireFrame, now: int) -> Transmission:
        """A node's driver is switched on for a frame."""
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
        tx.listeners, single, tx.shared = self._listeners_by_position.get(port.position) or self.listeners_of(
            port
        )
        if single:
            self._spell_out(tx, single, now)
        self._air.append(tx)
        self.drivers = 1
        return tx

    def _begin_otherwise(self, tx: Transmission, now: int) -> None:
        if tx.sender.jabbering:
            tx.silent = True  # the node sends rubbish in its place
            return
        if not tx.sender.nominal:
            tx.set_chars(tx.chars)
        self._drive(tx, now)

    def begin_jabber(self, port: Node, chars: bytes, now: int, *, first: bool) -> Transmission:
        """A node that jabbers sends the next rubbish; ``first``: its driver was off before."""
        tx = Transmission(port, None, chars, now, now, port.timing)
        tx.set_chars(chars)
        if first:
            for other in self._air:
                other.drop(port)
            port.receiver.close()
        self._drive(tx, now, counted=first)
        return tx

    def finish_jabber(self, tx: Transmission, now: int) -> None:
        """A stretch of rubbish is over; the next one follows at once."""
        self._air.remove(tx)
        self._count_driver_off(now)
        if self.sink.traced:
            self._record(tx)

    def reply_vanishes(self, port: Node, now: int) -> bool:
        """Whether a reply that is to begin now is never sent."""
        return self.disturber.reply_vanishes(port.position, now)

    def _drive(self, tx: Transmission, now: int, *, counted: bool = True) -> None:
        sender = tx.sender
        self._all_listen_alone()
        if self.drivers:
            self._crowd(tx, now, counted=counted)
        else:
            self._busy_since = now
            whole, single, _ = self.listeners_of(sender)
            if tx.corrupted:
                self._spell_out(tx, [port for port, _ in whole], now)
            else:
                hit = {*(tx.rx_flips or ()), *(tx.rx_chars or ())}
                tx.listeners = tuple(pair for pair in whole if pair[0].position not in hit)
                self._spell_out(tx, [port for port, _ in whole if port.position in hit], now)
            if single:
                self._spell_out(tx, single, now)
        self._air.append(tx)
        self.drivers += 1

    def _spell_out(self, tx: Transmission, ports: Iterable[Node], now: int) -> None:
        """These nodes hear a transmission that begins now character by character."""
        for port in ports:
            port.receiver.open(now)
            port.receiver.hear(tx, now)
            port.receiver.replan(now)

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
            port.receiver.hear(tx, now)
            port.receiver.replan(now)

    def _open_up(self, port: Node, now: int) -> None:
        """A node that was to be told of whole frames hears them character by character after all."""
        heard = [other for other in self._air if other.drop(port)]
        if not heard:
            port.receiver.open(now)
            return
        port.receiver.open(min(other.start for other in heard))
        for other in heard:
            port.receiver.hear(other, other.start)
        port.receiver.replan(now)

    def hear_so_far(self, port: Node, now: int) -> None:
        """A node is told now what it has heard of a frame that it was to be told of at its end."""
        if any(listener is port for tx in self._air for listener, _ in tx.listeners):
            self._open_up(port, now)

    def finish(self, port: Node, tx: Transmission, now: int) -> None:
        """A frame's last stop bit has left."""
        if tx.silent or tx.cut:
            # Its driver was not on (or not to the end), but it was deaf as if it had been.
            self.listeners_changed()
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
        if self._open_receivers:
            for other in self.ports:
                if other.receiver.is_open:
                    other.receiver.settle()

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
        """A node read a valid frame, begun at ``start``, by characters; ``sender`` None: nobody sent it.

        ``blamed`` is the latest transmission that it was made of. ``stored`` is the engine's hint.
        """
        del start, stored
        if sender is None and blamed is not None:
            self._undetected(blamed, port, self.what(frame), now)

    def _undetected(self, tx: Transmission, port: Node, what: str, now: int) -> None:
        """A receiver read a valid frame that nobody sent."""
        if not tx.believed:
            tx.believed = True
            self.undetected_frames += 1
        self._witness.undetected(now, port.name, tx.sender.name, what)

    # -- drivers going off -------------------------------------------------------------------------

    def cut(self, port: Node, now: int) -> None:
        """What a node sends ends at this tick, in the middle of whatever it was."""
        tx = port.sending
        if tx is None or tx.silent or tx.cut:
            return
        self.cut_transmission(tx, now)

    def cut_transmission(self, tx: Transmission, now: int) -> None:
        """A transmission ends at this tick; its sender's driver goes off."""
        self._all_listen_alone()
        tx.end = now
        tx.cut = True
        hearers = [port for port, _ in tx.listeners]
        tx.listeners = ()
        for port in hearers:
            port.receiver.open(tx.start)
            port.receiver.hear(tx, tx.start)
        self._air.remove(tx)
        self._count_driver_off(now)
        self.listeners_changed()
        for port in self.ports:
            if port.receiver.is_open:
                port.receiver.replan(now)
                port.receiver.settle()
        if self.sink.traced:
            self._record(tx)

    def _count_driver_off(self, now: int) -> None:
        self.drivers -= 1
        if not self.drivers:
            self.busy += now - self._busy_since

    def driver_kept(self, now: int) -> None:
        """A node whose driver was still on for its tail sends again: the tail is over."""
        self._count_driver_off(now)

    def driver_off(self, port: Node, now: int) -> None:
        """A node's driver is released without a frame ending (late release): it hears again."""
        self._count_driver_off(now)
        self.join_midway(port, now)

    def join_midway(self, port: Node, now: int) -> None:
        """A node begins to listen: frames on the line are heard from here on."""
        if port.engine is None or port.driving:
            return
        for tx in self._air:
            if tx.sender is not port and self.connected(tx.sender, port):
                port.receiver.open(now)
                port.receiver.hear(tx, now)
        if port.receiver.is_open:
            port.receiver.replan(now)

    def relisten(self, port: Node, timing: LineTiming, now: int) -> None:
        """A node's receiver starts anew, with another timing, in the middle of whatever is on the line."""
        self.listens_alone(port)
        if any(listener is port for tx in self._air for listener, _ in tx.listeners):
            self._open_up(port, now)  # the characters so far were heard
        half_heard = port.receiver.half_heard
        port.receiver.close()
        port.receiver.set_timing(timing)
        self.join_midway(port, now)
        if half_heard:
            port.receiver.hold(now)  # the engine's reader still waits for the line's quiet

    def detach(self, port: Node) -> None:
        """A node's engine is about to stop: it hears nothing more."""
        self.listens_alone(port)
        for tx in self._air:
            tx.drop(port)

    # -- the cable ---------------------------------------------------------------------------------

    def set_cuts(self, cuts: Iterable[int], now: int) -> None:
        """The cable is broken behind these seats, and nowhere else."""
        self._all_listen_alone()
        before = self._segments
        broken = set(cuts)
        after: list[int] = []
        segment = 0
        for position in range(len(self.ports)):
            after.append(segment)
            segment += position in broken
        affected = [
            (tx, port)
            for tx in self._air
            for port in self.ports
            if port.engine is not None
            and port is not tx.sender
            and not port.driving
            and (before[port.position] == before[tx.sender.position])
            != (after[port.position] == after[tx.sender.position])
        ]
        for tx, port in affected:
            gained = after[port.position] == after[tx.sender.position]
            self._open_up(port, now)
            if gained:
                port.receiver.hear(tx, now)
            else:
                port.receiver.unhear(tx, now)
        self._segments = after
        for _, port in affected:
            if port.receiver.is_open:
                port.receiver.replan(now)
                port.receiver.settle()
        self.listeners_changed()

    def close(self, now: int) -> None:
        """The run is over (for now): count a driver that is still on."""
        if self.drivers:
            self.busy += now - self._busy_since
            self._busy_since = now

    # -- the trace ---------------------------------------------------------------------------------

    def _record(self, tx: Transmission) -> None:
        frame, timing = tx.frame, tx.timing
        station, counter = (None, None) if frame is None else self._numbers(frame)
        self.sink.frame(
            FrameRecord(
                bus=self.name,
                start=tx.start,
                end=tx.end,
                sender=tx.sender.name,
                kind="jabber" if frame is None else self.kind_name(tx),
                station=station,
                counter=counter,
                chars=tx.chars,
                damaged_bits=tx.flips,
                damaged_at={
                    self.ports[position].name: bits for position, bits in (tx.rx_flips or {}).items()
                },
                collided=tx.collided,
                cut=tx.cut,
                protocol=self.protocol_of(tx.sender),
                baud=timing.baud,
                format=str(timing.format),
                ppm=float(timing.ppm),
            )
        )

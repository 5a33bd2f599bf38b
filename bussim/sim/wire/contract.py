"""What a line, its nodes and their receivers require of each other, and the transmissions between them.

A line delivers to nodes, a node sends on its line, a receiver reports to both: each of the three is
written against the types of this module, so that none has to import another one that imports it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

from bussim.engines.contract import RxChar
from bussim.line.characters import LineTiming
from bussim.line.contention import Disputed
from bussim.line.uart import Sampled
from bussim.line.wave import Interval, Pause, Wave, low_intervals, paused

Bits = tuple[int, ...]
#: An engine's ``receive_frame``. What it takes is a frame of its own protocol; a line passes it no other.
ReceiveFrame = Callable[[Any, int, int], int]


class WireFrame(Protocol):
    """A frame of any protocol, as far as a line is concerned."""

    @property
    def chars(self) -> bytes:
        """Its characters on the wire."""


class NodeReceiver(Protocol):
    """A node's receiver as its line uses it; see :class:`bussim.sim.wire.receiver.Receiver`."""

    #: When the latest character came that was not part of a whole undamaged frame.
    heard_at: int

    @property
    def is_open(self) -> bool:
        """Whether it receives character by character."""

    @property
    def frame_open(self) -> bool:
        """Whether something unfinished waits for more characters, or for the line's silence."""

    @property
    def idle_at(self) -> int:
        """When the silence that ends the unfinished frame is over, -1 without one."""

    def open(self, ready: int) -> None:
        """Begin to receive character by character."""

    def close(self) -> None:
        """Stop receiving character by character."""

    def attach(self, tx: Transmission, since: int) -> None:
        """A transmission reaches this node from ``since`` on."""

    def detach(self, tx: Transmission, until: int) -> None:
        """A transmission reaches this node no more."""

    def replan(self, now: int) -> None:
        """The line has changed: find the next character anew."""

    def settle(self) -> None:
        """Close if the line is idle and no frame is unfinished."""

    def hold(self, now: int) -> None:
        """Wait for the silence that ends a frame."""

    def set_timing(self, timing: LineTiming) -> None:
        """Use another rate, format or clock."""

    def receive_external(self, chars: Sequence[tuple[RxChar, int, int]], now: int, silence: int) -> None:
        """Characters come from outside of the simulation."""

    def line_idle(self, now: int) -> None:
        """The line is known to have been idle for long enough."""


class LineNode(ABC):
    """A node as its line, its receiver and transmissions see it; see :class:`bussim.sim.wire.node.Node`."""

    name: str
    #: Its line, and its number along the cable.
    line: Cable
    position: int
    #: Rate, format and clock, as they are now with its faults.
    timing: LineTiming
    #: Whether it sends and receives with the line's own rate, format and clock.
    nominal = True
    receiver: NodeReceiver
    #: None unless the node is switched on and its engine runs. Its frames are its own protocol's.
    engine: Any = None
    #: The frame that it is sending, if its driver is on for one.
    sending: Transmission | None = None
    #: The frame after whose end its driver is still on (late release).
    tail: Transmission | None = None
    #: Whether it sends random characters without end.
    jabbering = False

    @property
    @abstractmethod
    def now(self) -> int:
        """The current tick."""

    @property
    def driving(self) -> bool:
        """Whether its driver is on: it receives nothing then."""
        return self.sending is not None or self.tail is not None or self.jabbering

    @abstractmethod
    def quiet(self, timing: LineTiming) -> int:
        """The silence that ends an unfinished frame, in ticks, with a receiver of this timing."""

    @abstractmethod
    def understands(self, sender: LineNode) -> bool:
        """Whether this node's engine can take a whole frame of another node."""

    @abstractmethod
    def handle(self, hints: int, now: int) -> None:
        """Do what the engine asks for with its hints."""

    @abstractmethod
    def drain(self, now: int) -> None:
        """Report the engine's events; a transmission among them is scheduled."""

    @abstractmethod
    def finish_early(self, now: int) -> None:
        """What it is sending has left already, whatever its rate says: a reply to it has come since."""


class Reading(NamedTuple):
    """A valid frame that a node read character by character.

    ``sender`` is the node that sent it, None if none did: then ``origin`` is the latest transmission that
    it was made of. ``hints`` are the engine's.
    """

    port: LineNode
    frame: WireFrame
    start: int
    now: int
    sender: LineNode | None
    origin: Transmission | None
    hints: int


#: Nodes that receive whole frames; those that receive characters.
Listeners = tuple[tuple[tuple[LineNode, ReceiveFrame], ...], tuple[LineNode, ...]]


class Cable(ABC):
    """A line as its receivers and what disturbs its frames see it: nodes, in segments that a break separates.

    Which nodes receive a sender's frames whole is worked out once for each sender and kept until
    :meth:`listeners_changed`: it changes with faults, STOP and RUN, not with frames.
    """

    def __init__(self) -> None:
        #: Which level disputed bits have.
        self.disputed: Disputed = None
        self.ports: Sequence[LineNode] = []
        self._segments: list[int] = []
        self._listeners_by_position: dict[int, Listeners] = {}
        self._open_receivers = 0

    # -- what a protocol's line knows of its frames --------------------------------------------------
    # Not abstract: lines that lead out call these of the class beside them through super().

    def stream_name(self, tx: Transmission) -> str:
        """The name of the stream that its noise is drawn from: sender, kind and receiver."""
        raise NotImplementedError

    def kind_name(self, tx: Transmission) -> str:
        """The kind of a transmission's frame in a word, as the trace names it."""
        raise NotImplementedError

    @abstractmethod
    def accepted(self, reading: Reading) -> None:
        """A node has read a valid frame: an undetected error if no node sent it."""

    # -- which nodes receive what --------------------------------------------------------------------

    def connect(self, nodes: Sequence[Any]) -> None:
        """Put the nodes on the cable, in cable order."""
        self.ports = nodes
        self._segments = [0] * len(nodes)

    def connected(self, one: LineNode, other: LineNode) -> bool:
        """Whether the cable between two nodes is whole."""
        return self._segments[one.position] == self._segments[other.position]

    def listeners_changed(self) -> None:
        """Forget which nodes receive what: some node receives otherwise than before."""
        self._listeners_by_position.clear()

    def hand_over(self, port: LineNode) -> None:  # noqa: B027 - a line may have done nothing for it
        """A node receives for itself from now on: hand over what the line has done on its behalf."""

    def _hand_over_all(self) -> None:  # noqa: B027 - the same
        """Every node receives for itself from now on, also what is on the wire."""

    def receiver_opened(self) -> None:
        """A node begins to receive character by character."""
        self._open_receivers += 1
        self.listeners_changed()

    def receiver_closed(self) -> None:
        """A node receives whole frames again."""
        self._open_receivers -= 1
        self.listeners_changed()

    def listeners_of(self, sender: LineNode) -> Listeners:
        """The nodes that receive a frame while no other driver is on: whole, or character by character."""
        found = self._listeners_by_position.get(sender.position)
        if found is None:
            whole: list[tuple[LineNode, ReceiveFrame]] = []
            single: list[LineNode] = []
            for port in self._receivers_of(sender):
                if port.nominal and sender.nominal and not port.receiver.is_open and port.understands(sender):
                    whole.append((port, port.engine.receive_frame))
                else:
                    single.append(port)
            found = self._listeners_by_position[sender.position] = (tuple(whole), tuple(single))
        return found

    def _receivers_of(self, sender: LineNode) -> list[LineNode]:
        """The nodes whose receivers a sender's signal reaches: in operation, connected, driver off."""
        return [
            port
            for port in self.ports
            if port is not sender
            and port.engine is not None
            and not port.driving
            and self.connected(port, sender)
        ]


class Transmission:
    """Characters that one node sends. ``frame`` is the frame that they encode, None for jabber.

    ``chars`` are the characters on the wire, which a fault may have made other than the frame's.
    ``end`` moves when the sender is cut off; ``released`` is when its driver goes off where that is later.
    ``listeners`` receive it whole and undamaged at its end; every other node receives it, or parts of it,
    character by character.
    """

    # What most frames never change stands here, not in each of them.
    flips: Bits = ()  # bits inverted on the wire
    rx_flips: dict[int, Bits] | None = None  # bits inverted in the receiver of one position only
    # Characters that one position's receiver loses (value None) or adds: (index, value).
    rx_chars: dict[int, tuple[int, int | None]] | None = None
    pauses: tuple[Pause, ...] = ()
    damaged = False  # something above is set, or ``chars`` are not the frame's
    released: int | None = None
    collided = False
    cut = False
    silent = False  # nothing of it reaches the wire
    mistaken = False  # some receiver accepted it as another frame
    listeners: tuple[tuple[LineNode, ReceiveFrame], ...] = ()
    # Of receivers that it reaches alike: until when it is driven, their wave, what they have read of it.
    sampled: tuple[int, Wave, dict[int, Sampled | None]] | None = None
    _lows: dict[Bits, list[Interval]] | None = None

    def __init__(
        self,
        sender: LineNode,
        frame: WireFrame | None,
        chars: bytes,
        start: int,
        end: int,
        timing: LineTiming,
    ) -> None:
        self.sender = sender
        self.frame = frame
        self.chars = chars
        self.start = start
        self.end = end
        self.timing = timing

    def set_chars(self, chars: bytes) -> None:
        """Send these characters; the end follows, rounded once from the first edge."""
        if chars is not self.chars:
            self.chars = chars
            self.damaged = True
        self.end = self.start + self.timing.characters(len(chars)) + paused(self.pauses, len(chars) - 1)

    @property
    def driven_until(self) -> int:
        """When its driver goes off."""
        return self.end if self.released is None else self.released

    @property
    def corrupted(self) -> bool:
        """Whether what reaches the wire is not the frame back to back, in every receiver."""
        return bool(self.flips or self.pauses) or self.frame is None or self.chars is not self.frame.chars

    def sound_for(self, position: int) -> bool:
        """Whether nothing that disturbs a frame came to a receiver beside it."""
        hit = {*(self.rx_flips or ()), *(self.rx_chars or ())}
        return not (self.corrupted or self.collided or self.cut) and position not in hit

    def pause(self, index: int, ticks: int) -> None:
        """Wait so long after the character at an index."""
        pauses = dict(self.pauses)
        pauses[index] = pauses.get(index, 0) + ticks
        self.pauses = tuple(sorted(pauses.items()))
        self.damaged = True
        self.set_chars(self.chars)

    def invert(self, position: int | None, bits: Bits) -> None:
        """Invert bits: on the wire (None) or in one position's receiver."""
        self.damaged = True
        if position is None:
            self.flips = tuple(sorted(set(self.flips) ^ set(bits)))
            return
        if self.rx_flips is None:
            self.rx_flips = {}
        self.rx_flips[position] = tuple(sorted(set(self.rx_flips.get(position, ())) ^ set(bits)))

    def miscount(self, position: int, index: int, value: int | None) -> None:
        """One position's receiver loses the character at an index (value None), or adds one before it."""
        self.damaged = True
        if self.rx_chars is None:
            self.rx_chars = {}
        self.rx_chars[position] = (index, value)

    def drop(self, port: LineNode) -> bool:
        """A node does not receive this as a whole frame after all; returns whether it would have."""
        for index, (listener, _) in enumerate(self.listeners):
            if listener is port:
                self.listeners = self.listeners[:index] + self.listeners[index + 1 :]
                return True
        return False

    def lows(self, position: int) -> list[Interval]:
        """Where a position's receiver sees the line pulled low by this transmission, regardless of a cut."""
        flips = self.flips
        if self.rx_flips is not None:
            own = self.rx_flips.get(position)
            if own:
                # A bit inverted on the wire and again in the receiver is right once more.
                flips = tuple(sorted(set(flips) ^ set(own)))
        if self._lows is None:
            self._lows = {}
        found = self._lows.get(flips)
        if found is None:
            found = low_intervals(self.chars, self.timing, self.start, flips, self.pauses)
            self._lows[flips] = found
        return found

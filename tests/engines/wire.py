"""A scripted wire in virtual time: the least driver that runs N:N engines against each other.

Every node's receiver is the real UART on the line's real level. With ``whole`` a frame that nothing
disturbs is handed over as a whole at its end; otherwise everything goes character by character. The
driver checks the engines' hints as it goes: nothing may be asked for that was not announced.

At one tick: scripted actions, then what was heard, then deadlines, then transmissions.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from heapq import heappop, heappush
from itertools import chain, count, repeat

from bussim.engines.contract import DEADLINE, EVENTS, OPEN, TRANSMIT, RxChar, Transmit
from bussim.engines.nn.contract import STORED
from bussim.engines.nn.events import NnEvent, StationBack, StationLost
from bussim.engines.nn.frames import DATA, MODES, STX, Frame, LinkSettings, decode
from bussim.engines.nn.master import Master, MasterConfig, MasterState
from bussim.engines.nn.monitor import SlaveConfig
from bussim.engines.nn.slave import Slave, SlaveState
from bussim.line.characters import NN_LINE
from bussim.line.uart import Sampled, Uart
from bussim.line.wave import Wave, clip, low_intervals

MS = 72_000
CHAR = NN_LINE.characters(1)
QUIET = 2 * CHAR
GAP = TURNAROUND = 30_060  # 0.4175 ms
OVERHEAD = 253_440  # 3.52 ms
TIMEOUT_UNIT = 10 * MS
POLL_TICKS, PARAMETERS_TICKS = 5 * CHAR, 14 * CHAR

SCRIPT, RECEPTION, DEADLINES, SEND = range(4)


@dataclass(eq=False)
class Tx:
    """One transmission; ``number`` counts its sender's, from 0. ``sender`` None: scripted noise."""

    sender: Node | None
    frame: Frame | None
    chars: bytes
    start: int
    end: int
    number: int
    cut: int | None = None


@dataclass(eq=False)
class Node:
    """A station on the wire."""

    engine: Master | Slave
    name: str = ""
    image: bytes = bytes(8)
    #: Its replies' turnarounds in the order of their polls.
    turnarounds: Iterator[int] = field(default_factory=lambda: repeat(TURNAROUND))
    #: Whether the reply that is about to begin is lost instead.
    vanishes: Callable[[int], bool] = lambda _reply: False
    stored: list[tuple[int, int, bytes]] = field(default_factory=list)
    events: list[NnEvent] = field(default_factory=list)
    sent: list[Tx] = field(default_factory=list)
    #: Stations whose flags are on, by the events.
    flagged: set[int] = field(default_factory=set)

    wire: Wire | None = None
    _pieces: list[tuple[Tx, int]] = field(default_factory=list)
    _whole: Tx | None = None
    _line: Wave = field(default_factory=lambda: Wave(()))
    _plan: int = 0
    _ready: int = 0
    _next: Sampled | None = None
    _half: bool = False
    _heard: int = 0
    _armed: int | None = None
    _pending: list[tuple[int, int, int]] = field(default_factory=list)
    _sending: Tx | None = None
    _replies: Iterator[int] = field(default_factory=count)
    _order: Iterator[int] = field(default_factory=count)
    _uart: Uart = field(default_factory=lambda: Uart(NN_LINE))

    @property
    def on(self) -> bool:
        return self.engine.state not in (MasterState.STOPPED, SlaveState.STOPPED)

    # -- RUN and STOP ------------------------------------------------------------------------------

    def start(self, now: int) -> None:
        self.flagged.clear()
        self._listen(now)
        self._after(self.engine.start(now), now)

    def stop(self, now: int) -> None:
        hints = self.engine.stop(now)
        assert self.engine.deadline() is None
        assert hints & DEADLINE
        self._after(hints, now)
        self._armed = None
        self._pending.clear()
        self._stop_receiving()
        if self._sending is not None:
            tx, self._sending = self._sending, None
            self._wire.cut(tx, now)

    @property
    def _wire(self) -> Wire:
        assert self.wire is not None
        return self.wire

    # -- the engine's wishes -----------------------------------------------------------------------

    def _after(self, hints: int, now: int) -> None:
        """Look at everything and hold it against what the hints announced."""
        engine = self.engine
        wanted = 0
        while (item := engine.poll()) is not None:
            if isinstance(item, Transmit):
                wanted |= TRANSMIT
                self._schedule(item, now)
            else:
                wanted |= EVENTS
                self.events.append(item)
                self._check(item)
        assert wanted & ~hints == 0, f"{self.name} at {now}: wants {wanted}, hints {hints}"
        assert engine.poll() is None
        assert self.flagged == {k for k, flag in enumerate(engine.status.flags) if flag}
        deadline = engine.deadline()
        if hints & DEADLINE:
            self._arm(deadline)
        else:
            assert deadline is None or (self._armed is not None and self._armed <= deadline)

    def _check(self, event: NnEvent) -> None:
        """An event says what the status says, and a flag that goes on was off."""
        if isinstance(event, StationLost):
            assert event.new == (event.station not in self.flagged)
            self.flagged.add(event.station)
        elif isinstance(event, StationBack):
            self.flagged.remove(event.station)

    def _arm(self, deadline: int | None) -> None:
        if deadline is not None and (self._armed is None or deadline < self._armed):
            assert deadline >= self._wire.now, "a deadline in the past"
            self._armed = deadline
            self._wire.at(deadline, lambda: self._expire(deadline), DEADLINES)

    def _expire(self, armed: int) -> None:
        if self._armed != armed or not self.on:
            return
        self._armed = None
        now, deadline = self._wire.now, self.engine.deadline()
        if deadline is None or deadline > now:
            self._arm(deadline)
            return
        assert deadline == now
        self._after(self.engine.on_deadline(now), now)
        after = self.engine.deadline()
        assert after is None or after > now
        self._arm(after)

    def _schedule(self, item: Transmit, now: int) -> None:
        at = item.at + (next(self.turnarounds) if item.reply else 0)
        at = max(at, now)
        self._pending.append((at, next(self._order), item.counter))
        self._pending.sort()
        self._wire.at(at, self._send, SEND)

    def _send(self) -> None:
        now = self._wire.now
        if self._sending is not None or not self._pending or self._pending[0][0] > now:
            return
        counter = self._pending.pop(0)[2]
        if isinstance(self.engine, Slave) and self.vanishes(next(self._replies)):
            return
        wanted = self.engine.wants_image
        self.engine.image = self.image if wanted else b""
        frame = self.engine.begin_transmit(now, counter)
        assert wanted == (frame.kind == DATA)
        self._stop_receiving()
        tx = Tx(self, frame, frame.chars, now, now + CHAR * len(frame.chars), len(self.sent))
        self._sending = tx
        self.sent.append(tx)
        self._wire.transmit(tx)

    def sent_all(self, tx: Tx, now: int) -> None:
        """Its last stop bit has left."""
        if self._sending is not tx:
            return
        self._sending = None
        self._listen(now)
        self._after(self.engine.transmit_done(now), now)
        self._send()

    # -- hearing -----------------------------------------------------------------------------------

    def _stop_receiving(self) -> None:
        self._pieces.clear()
        self._whole = self._next = None
        self._half = False
        self._plan += 1

    def _listen(self, now: int) -> None:
        """From now on, also to what is on the line already."""
        self._stop_receiving()
        self._ready = now
        self._pieces = [(tx, now) for tx in self._wire.on_wire if tx.sender is not self]
        self.replan()

    def receive(self, tx: Tx, *, whole: bool) -> None:
        """A transmission begins."""
        if tx.sender is self or self._sending is not None or not self.on:
            return
        if whole and not self._half and not self._pieces and not self._wire.damage(tx, self):
            self._whole = tx
            return
        self.receive_by_character()
        self._pieces.append((tx, tx.start))
        self.replan()

    def receive_by_character(self) -> None:
        """The frame that was to be heard whole is disturbed: character by character from its start."""
        if self._whole is not None:
            tx, self._whole = self._whole, None
            self._ready = tx.start
            self._pieces = [(tx, tx.start)]
            self.replan()

    def ended(self, tx: Tx, now: int) -> None:
        """A transmission has ended; hand it over if it was heard whole."""
        if self._whole is tx:
            assert tx.frame is not None
            self._whole = None
            self._received(self.engine.receive_frame(tx.frame, tx.start, now), now, tx.frame)
        elif not self._half and self._next is None:
            self._pieces = [(piece, since) for piece, since in self._pieces if piece in self._wire.on_wire]

    def replan(self) -> None:
        """The line has changed: find the next character anew."""
        self._line = Wave(
            clip(low_intervals(tx.chars, NN_LINE, tx.start, self._wire.damage(tx, self)), since, tx.cut)
            for tx, since in self._pieces
        )
        self._next_edge()

    def _next_edge(self) -> None:
        self._plan += 1
        plan = self._plan
        self._next = self._uart.next_character(self._line, self._ready)
        if self._next is not None:
            self._wire.at(max(self._next.end, self._wire.now), lambda: self._character(plan), RECEPTION)

    def _character(self, plan: int) -> None:
        char = self._next
        if plan != self._plan or char is None or not self.on:
            return
        self._ready, self._next = char.ready, None
        engine = self.engine
        engine.heard = None
        rx = RxChar(char.value, char.parity_ok, char.stop_ok)
        hints = engine.receive(rx, char.start, char.end)
        frame = engine.heard
        if self._sending is None and plan == self._plan:
            self._next_edge()
            if self._next is None:
                self._pieces = [(tx, since) for tx, since in self._pieces if tx in self._wire.on_wire]
        self._received(hints, char.end, frame)

    def _received(self, hints: int, end: int, frame: Frame | None) -> None:
        if hints & STORED:
            assert frame is not None
            self.stored.append((end, frame.station, frame.data))
        self._half = bool(hints & OPEN)
        if self._half:
            self._heard += 1
            heard = self._heard
            self._wire.at(max(self._wire.now, end + QUIET), lambda: self._quiet(heard), RECEPTION)
        self._after(hints, end)

    def _quiet(self, heard: int) -> None:
        now = self._wire.now
        if not self._half or heard != self._heard or (self._next is not None and self._next.start < now):
            return
        self._half = False
        self._pieces = [(tx, since) for tx, since in self._pieces if tx in self._wire.on_wire]
        self._after(self.engine.line_idle(now), now)


class Wire:
    """The line and its clock."""

    def __init__(self, *nodes: Node, whole: bool) -> None:
        self.now = 0
        self.nodes = nodes
        self.whole = whole
        self.on_wire: list[Tx] = []
        self.sent: list[Tx] = []
        #: Data frames of the first node.
        self.scans = 0
        #: Which bits of a transmission a node hears inverted.
        self.damage: Callable[[Tx, Node], Collection[int]] = lambda _tx, _node: ()
        self._queue: list[tuple[int, int, int, Callable[[], None]]] = []
        self._number = count()
        for node in nodes:
            node.wire = self

    def at(self, tick: int, action: Callable[[], None], order: int = SCRIPT) -> None:
        """Do something at a tick."""
        assert tick >= self.now
        heappush(self._queue, (tick, order, next(self._number), action))

    def run(self, until: int) -> None:
        """Do everything up to and including a tick."""
        while self._queue and self._queue[0][0] <= until:
            self.now, _, _, action = heappop(self._queue)
            action()
        self.now = until

    def run_scans(self, scans: int) -> None:
        """Go on until the first node, a master, has begun so many more data frames (at most 100 s each)."""
        wanted, limit = self.scans + scans, self.now + scans * 100_000 * MS
        while self.scans < wanted:
            assert self._queue
            assert self._queue[0][0] <= limit
            self.run(self._queue[0][0])

    def inject(self, tick: int, chars: bytes) -> None:
        """Characters from nowhere."""
        tx = Tx(None, decode(chars), chars, tick, tick + CHAR * len(chars), 0)
        self.at(tick, lambda: self.transmit(tx), SEND)

    def transmit(self, tx: Tx) -> None:
        quiet = not self.on_wire
        self.on_wire.append(tx)
        self.sent.append(tx)
        self.scans += tx.sender is self.nodes[0] and tx.chars[0] == STX
        for node in self.nodes:
            if not quiet:
                node.receive_by_character()
            node.receive(tx, whole=self.whole and quiet and tx.frame is not None)
        self.at(tx.end, lambda: self._end(tx), RECEPTION)

    def cut(self, tx: Tx, now: int) -> None:
        """A transmission ends in the middle."""
        tx.cut = now
        self.on_wire.remove(tx)
        for node in self.nodes:
            node.receive_by_character()
            node.replan()

    def _end(self, tx: Tx) -> None:
        if tx.cut is not None:
            return
        self.on_wire.remove(tx)
        # All nodes hear the end of it before one acts on it.
        for node in self.nodes:
            node.ended(tx, self.now)
        if tx.sender is not None:
            tx.sender.sent_all(tx, self.now)


# -- links ------------------------------------------------------------------------------------------------


def master_node(
    slaves: int = 2,
    *,
    mode: int = 0,
    attempts: int = 1,
    timeout: int = 5,
    probe: bool = False,
    on_edge: bool = False,
) -> Node:
    """A master; ``timeout`` in 10 ms."""
    config = MasterConfig(
        LinkSettings(slaves, mode, min(10, attempts - 1), timeout),
        attempts=attempts,
        timeout=timeout * TIMEOUT_UNIT,
        gap=GAP,
        overhead=OVERHEAD,
        probe=probe,
        count_on_edge=on_edge,
    )
    return Node(Master(config, traced=True), "master", bytes([0xA0]) * MODES[mode].size)


def slave_node(
    station: int,
    *turnarounds: int,
    mode: int = 0,
    modes: tuple[int, ...] = (0, 1, 2, 3, 4),
    on_edge: bool = False,
) -> Node:
    """A slave; its first turnarounds, then the usual one."""
    config = SlaveConfig(station, modes, TIMEOUT_UNIT, TURNAROUND + 7_200, CHAR, on_edge)
    return Node(
        Slave(config),
        f"slave{station}",
        bytes([0xA0 + station]) * MODES[mode].size,
        chain(turnarounds, repeat(TURNAROUND)),
    )

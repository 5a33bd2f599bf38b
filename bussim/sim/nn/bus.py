"""The N:N link's line: who keeps which block, and what is done in one go where nobody can come between."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence

from bussim.engines.contract import STORED
from bussim.engines.nn.frames import DATA, KIND_NAMES, POLL, Frame
from bussim.line.characters import LineTiming
from bussim.sim.kernel import DEADLINES, Kernel
from bussim.sim.nn.block_history import Ledger
from bussim.sim.nn.fast_path import Lane
from bussim.sim.nn.port import LinkPort
from bussim.sim.nn.reporter import Reporter
from bussim.sim.nn.shared_listener import Gallery
from bussim.sim.wire.line import Line
from bussim.sim.wire.node import Node
from bussim.sim.wire.transmission import Transmission, WireFrame
from bussim.trace.records import Sink


class LinkBus(Line):
    """One N:N line. ``ports`` are all its nodes: nothing else can sit on such a line."""

    protocol = "nn"

    def __init__(self, name: str, timing: LineTiming, kernel: Kernel, sink: Sink, reporter: Reporter) -> None:
        super().__init__(name, timing, sink, reporter)
        self.reporter = reporter
        self.ports: Sequence[LinkPort] = []
        self.ledger = Ledger(0)
        self.gallery = Gallery()
        #: Whether slaves may be told together (a test compares both ways).
        self.together = True
        self.lane = Lane(self, kernel)
        self._gallery_timer = kernel.timer(self._watch_gallery, DEADLINES)
        self._others = 0

    def connect(self, ports: Sequence[LinkPort], horizon: int) -> None:
        """Seat the ports, in cable order; ``horizon`` is the longest PLC scan on the line in ticks."""
        self.seat(ports)
        self.ports = ports
        self._others = len(ports) - 1
        self.ledger = Ledger(horizon)

    @property
    def seats(self) -> tuple[str, ...]:
        """Names by the positions that refreshes are told with."""
        return tuple(port.name for port in self.ports)

    # -- frames ------------------------------------------------------------------------------------

    def luck_key(self, tx: Transmission) -> Hashable:
        """See the line."""
        frame = tx.frame
        assert isinstance(frame, Frame)  # noqa: S101 - narrows the type; jabber draws no noise
        return (tx.sender.seat, frame.kind, frame.station)

    def luck_name(self, tx: Transmission) -> str:
        """See the line."""
        frame = tx.frame
        assert isinstance(frame, Frame)  # noqa: S101 - narrows the type; jabber draws no noise
        return f"{tx.sender.name} {KIND_NAMES[frame.kind]} {frame.station}"

    def kind_name(self, tx: Transmission) -> str:
        """See the line."""
        return "" if tx.frame is None else self.what(tx.frame)

    def what(self, frame: WireFrame) -> str:
        """See the line."""
        assert isinstance(frame, Frame)  # noqa: S101 - narrows the type; the link has no others
        return frame.kind_name

    def _numbers(self, frame: WireFrame) -> tuple[int | None, int | None]:
        assert isinstance(frame, Frame)  # noqa: S101 - narrows the type; the link has no others
        return frame.station, frame.counter

    # -- who listens -------------------------------------------------------------------------------

    def audience_changed(self) -> None:
        """Some port listens otherwise than before."""
        super().audience_changed()
        self.lane.close()

    def listens_alone(self, port: Node) -> None:
        """A port is going to listen for itself."""
        if port in self.gallery.members:
            self._all_listen_alone()

    def _all_listen_alone(self) -> None:
        """Every slave listens for itself from now on, also to what is on the line."""
        members = self.gallery.dissolve()
        if not members:
            return
        self._stood_in_for = ()
        for port in members:
            port.watch()
        for tx in self._air:
            if tx.together:
                self._split(tx, members)
        self.audience_changed()

    @staticmethod
    def _split(tx: Transmission, members: Iterable[LinkPort]) -> None:
        """What the gallery was to hear of a frame, its former members hear."""
        tx.together = 0
        tx.listeners += tuple(
            (port, port.engine.receive_frame)
            for port in members
            if port is not tx.sender and port.engine is not None
        )

    def _watch_gallery(self, now: int) -> None:
        """The lazy watchdog of all members in one."""
        gallery = self.gallery
        if gallery.members:
            if gallery.deadline > now:
                self._gallery_timer.set(gallery.deadline)
            else:
                self._all_listen_alone()

    def _gather(self) -> None:
        """The master's data frame is over: slaves that are calm and agree listen together."""
        if self.together and not self._open_ears and not any(self._segments):
            self._all_listen_alone()
            self.gallery.form(self.ports)
            self._stood_in_for = self.gallery.members
            self.audience_changed()
            if self.gallery.members:
                timer, deadline = self._gallery_timer, self.gallery.deadline
                if timer.at < 0 or deadline < timer.at:
                    timer.set(deadline)

    def _deliver(self, frame: WireFrame, tx: Transmission, now: int) -> None:
        """A whole undamaged frame reaches everybody who listens to whole frames."""
        assert type(frame) is Frame  # noqa: S101 - narrows the type; the link has no others
        start, kind, sender = tx.start, frame.kind, tx.sender
        gallery = self.gallery
        if tx.together and not gallery.hear(frame, start, now):
            members = gallery.members
            self._all_listen_alone()
            self._split(tx, members)
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
        """See the line; and a block that one port took alone goes into the ledger."""
        super().accepted(port, frame, start, now, sender, blamed, stored=stored)
        if stored:
            assert isinstance(frame, Frame)  # noqa: S101 - narrows the type; the link has no others
            self.ledger.heard_alone(frame.station, now, frame.data, port.seat)
            if sender is not None:
                self.sink.refreshed(self.name, sender.seat, now, [port.seat])

    def retire(self, port: Node) -> None:
        """A port's engine is about to stop: it hears nothing more."""
        super().retire(port)
        assert isinstance(port, LinkPort)  # noqa: S101 - narrows the type; the link has no others
        self.reporter.retire(port)

    def close(self, now: int) -> None:
        """The run is over (for now): everything is brought up to date."""
        self.gallery.sync()
        super().close(now)

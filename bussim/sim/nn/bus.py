"""The N:N link's line: who keeps which block, and what is done in one go where nobody can come between."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence

from bussim.engines.contract import STORED
from bussim.engines.nn.frames import DATA, KIND_NAMES, POLL, Frame
from bussim.line.characters import LineTiming
from bussim.sim.kernel import DEADLINES, Kernel
from bussim.sim.nn.block_history import BlockHistory
from bussim.sim.nn.fast_path import FastPath
from bussim.sim.nn.port import LinkPort
from bussim.sim.nn.reporter import Reporter
from bussim.sim.nn.shared_listener import SharedListener
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
        self.block_history = BlockHistory(0)
        self.shared_listener = SharedListener()
        #: Whether slaves may be told together (a test compares both ways).
        self.shared = True
        self.fast_path = FastPath(self, kernel)
        self._shared_timer = kernel.timer(self._watch_shared, DEADLINES)
        self._others = 0

    def connect(self, ports: Sequence[LinkPort], horizon: int) -> None:
        """LinkAttachment the ports, in cable order; ``horizon`` is the longest PLC scan on the line in ticks."""
        self.position(ports)
        self.ports = ports
        self._others = len(ports) - 1
        self.block_history = BlockHistory(horizon)

    @property
    def plc_names(self) -> tuple[str, ...]:
        """Names by the positions that refreshes are told with."""
        return tuple(port.name for port in self.ports)

    # -- frames ------------------------------------------------------------------------------------

    def stream_key(self, tx: Transmission) -> Hashable:
        """See the line."""
        frame = tx.frame
        assert isinstance(frame, Frame)  # noqa: S101 - narrows the type; jabber draws no noise
        return (tx.sender.position, frame.kind, frame.station)

    def stream_name(self, tx: Transmission) -> str:
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

    def listeners_changed(self) -> None:
        """Some port listens otherwise than before."""
        super().listeners_changed()
        self.fast_path.close()

    def listens_alone(self, port: Node) -> None:
        """A port is going to listen for itself."""
        if port in self.shared_listener.members:
            self._all_listen_alone()

    def _all_listen_alone(self) -> None:
        """Every slave listens for itself from now on, also to what is on the line."""
        members = self.shared_listener.dissolve()
        if not members:
            return
        self._stood_in_for = ()
        for port in members:
            port.watch()
        for tx in self._air:
            if tx.shared:
                self._split(tx, members)
        self.listeners_changed()

    @staticmethod
    def _split(tx: Transmission, members: Iterable[LinkPort]) -> None:
        """What the shared listener was to hear of a frame, its former members hear."""
        tx.shared = 0
        tx.listeners += tuple(
            (port, port.engine.receive_frame)
            for port in members
            if port is not tx.sender and port.engine is not None
        )

    def _watch_shared(self, now: int) -> None:
        """The lazy watchdog of all members in one."""
        shared_listener = self.shared_listener
        if shared_listener.members:
            if shared_listener.deadline > now:
                self._shared_timer.set(shared_listener.deadline)
            else:
                self._all_listen_alone()

    def _gather(self) -> None:
        """The master's data frame is over: slaves that are calm and agree listen together."""
        if self.shared and not self._open_receivers and not any(self._segments):
            self._all_listen_alone()
            self.shared_listener.form(self.ports)
            self._stood_in_for = self.shared_listener.members
            self.listeners_changed()
            if self.shared_listener.members:
                timer, deadline = self._shared_timer, self.shared_listener.deadline
                if timer.at < 0 or deadline < timer.at:
                    timer.set(deadline)

    def _deliver(self, frame: WireFrame, tx: Transmission, now: int) -> None:
        """A whole undamaged frame reaches everybody who listens to whole frames."""
        assert type(frame) is Frame  # noqa: S101 - narrows the type; the link has no others
        start, kind, sender = tx.start, frame.kind, tx.sender
        shared_listener = self.shared_listener
        if tx.shared and not shared_listener.hear(frame, start, now):
            members = shared_listener.members
            self._all_listen_alone()
            self._split(tx, members)
        if kind != DATA:
            if tx.shared and kind == POLL:
                polled = shared_listener.by_station.get(frame.station)
                if polled is not None:
                    polled.schedule(now, frame.counter)
            for port, hear in tx.listeners:
                hints = hear(frame, start, now)
                if hints:
                    port.handle(hints, now)
            return
        listeners = tx.listeners
        took = tx.shared
        missed: list[int] = []
        for port, hear in listeners:
            hints = hear(frame, start, now)
            if hints & STORED:
                took += 1
                if hints == STORED:
                    continue
            else:
                missed.append(port.position)
            port.handle(hints, now)
        if took == self._others:
            self.block_history.heard(frame.station, now, frame.data)
            self.sink.refreshed(self.name, sender.position, now, None)
        elif took:
            positions = [port.position for port, _ in listeners if port.position not in missed]
            if tx.shared:
                positions += [port.position for port in shared_listener.members if port is not sender]
            others = [
                port.position for port in self.ports if port is not sender and port.position not in positions
            ]
            self.block_history.heard(frame.station, now, frame.data, others)
            self.sink.refreshed(self.name, sender.position, now, positions)
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
        """See the line; and a block that one port took alone goes into the block history."""
        super().accepted(port, frame, start, now, sender, blamed, stored=stored)
        if stored:
            assert isinstance(frame, Frame)  # noqa: S101 - narrows the type; the link has no others
            self.block_history.heard_alone(frame.station, now, frame.data, port.position)
            if sender is not None:
                self.sink.refreshed(self.name, sender.position, now, [port.position])

    def detach(self, port: Node) -> None:
        """A port's engine is about to stop: it hears nothing more."""
        super().detach(port)
        assert isinstance(port, LinkPort)  # noqa: S101 - narrows the type; the link has no others
        self.reporter.detach(port)

    def close(self, now: int) -> None:
        """The run is over (for now): everything is brought up to date."""
        self.shared_listener.sync()
        super().close(now)

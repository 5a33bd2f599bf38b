"""The N:N link's line: it keeps the blocks that stations have received, and shares work among listeners."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from bussim.engines.nn.contract import STORED
from bussim.engines.nn.frames import DATA, KIND_NAMES, POLL, Frame
from bussim.line.characters import LineTiming
from bussim.sim.kernel import DEADLINES, Kernel
from bussim.sim.nn.block_history import BlockHistory
from bussim.sim.nn.contract import LinkStation
from bussim.sim.nn.fast_path import FastPath
from bussim.sim.nn.reporter import LinkReporter
from bussim.sim.nn.shared_listener import SharedListener
from bussim.sim.wire.contract import LineNode, Reading, Transmission, WireFrame
from bussim.sim.wire.line import Line
from bussim.trace.records import Sink


class LinkBus(Line):
    """One N:N line. ``ports`` are all its nodes: no other devices share such a line."""

    protocol = "nn"
    ports: Sequence[LinkStation]
    #: Whether slaves may share a listener (a test compares runs with and without).
    shared = True

    def __init__(
        self, name: str, timing: LineTiming, kernel: Kernel, sink: Sink, reporter: LinkReporter
    ) -> None:
        super().__init__(name, timing, sink, reporter)
        self.reporter: LinkReporter = reporter
        self.block_history = BlockHistory()
        self.shared_listener = SharedListener()
        self.fast_path = FastPath(self, kernel, self.shared_listener, self.block_history)
        self._shared_timer = kernel.timer(self._watch_shared, DEADLINES)
        self._others = 0
        #: How long a data frame lasts, in ticks; 0 on a link without a working master.
        self.block_time = 0

    def connect(self, nodes: Sequence[LinkStation]) -> None:
        """See the base class."""
        super().connect(nodes)
        self._others = len(nodes) - 1

    @property
    def plc_names(self) -> tuple[str, ...]:
        """Names by the positions that records of refreshes use."""
        return tuple(port.name for port in self.ports)

    # -- frames ------------------------------------------------------------------------------------

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

    # -- listeners ---------------------------------------------------------------------------------

    def listeners_changed(self) -> None:
        """Some port receives otherwise than before."""
        super().listeners_changed()
        self.fast_path.invalidate()

    def hand_over(self, port: LineNode) -> None:
        """A port receives for itself from now on: the shared listener ends for all its members."""
        if port in self.shared_listener.members:
            self._hand_over_all()

    def _hand_over_all(self) -> None:
        """Every slave receives for itself from now on, also what is on the wire."""
        members = self.shared_listener.release()
        if not members:
            return
        self._represented = ()
        for port in members:
            port.arm_deadline()
        for tx in self._on_wire:
            if tx.shared:
                self._split(tx, members)
        self.listeners_changed()

    @staticmethod
    def _split(tx: Transmission, members: Iterable[LinkStation]) -> None:
        """A frame that the shared listener was to receive goes to its former members."""
        tx.shared = 0
        tx.listeners += tuple(
            (port, port.engine.receive_frame)
            for port in members
            if port is not tx.sender and port.engine is not None
        )

    def _watch_shared(self, now: int) -> None:
        """The members' common watchdog; like a node's, its timer may fire early and is then set again."""
        shared_listener = self.shared_listener
        if shared_listener.members:
            if shared_listener.deadline > now:
                self._shared_timer.set(shared_listener.deadline)
            else:
                self._hand_over_all()

    def _form_shared_listener(self) -> None:
        """Let slaves that are steady and agree share a listener, now that the master's data frame is over.

        That is the point of a link scan where no poll is pending, so that their states can be equal.
        """
        if self.shared and not self._open_receivers and not any(self._segments):
            self._hand_over_all()
            self.shared_listener.form(self.ports)
            self._represented = self.shared_listener.members
            self.listeners_changed()
            if self.shared_listener.members:
                timer, deadline = self._shared_timer, self.shared_listener.deadline
                if timer.at < 0 or deadline < timer.at:
                    timer.set(deadline)

    def _deliver(self, frame: WireFrame, tx: Transmission, now: int) -> None:
        """Pass a whole undamaged frame to every port that receives whole frames."""
        assert type(frame) is Frame  # noqa: S101 - narrows the type; the link has no others
        start, kind, sender = tx.start, frame.kind, tx.sender
        shared_listener = self.shared_listener
        if tx.shared and not shared_listener.receive(frame, start, now):
            members = shared_listener.members
            self._hand_over_all()
            self._split(tx, members)
        if kind != DATA:
            if tx.shared and kind == POLL:
                polled = shared_listener.by_station.get(frame.station)
                if polled is not None:
                    polled.schedule(now, frame.counter)
            for port, receive in tx.listeners:
                hints = receive(frame, start, now)
                if hints:
                    port.handle(hints, now)
            return
        # A data frame. Nearly always all stations store its block: then counting them is enough, and only
        # otherwise are positions listed.
        listeners = tx.listeners
        took = tx.shared
        missed: list[int] = []
        for port, receive in listeners:
            hints = receive(frame, start, now)
            if hints & STORED:
                took += 1
                if hints == STORED:
                    continue
            else:
                missed.append(port.position)
            port.handle(hints, now)
        if took == self._others:
            self.block_history.received(frame.station, now, frame.data)
            self.sink.refreshed(self.name, sender.position, now, None)
        elif took:
            positions = [port.position for port, _ in listeners if port.position not in missed]
            if tx.shared:
                positions += [port.position for port in shared_listener.members if port is not sender]
            others = [
                port.position for port in self.ports if port is not sender and port.position not in positions
            ]
            self.block_history.received(frame.station, now, frame.data, others)
            self.sink.refreshed(self.name, sender.position, now, positions)
        if not frame.station and listeners:
            self._form_shared_listener()

    def accepted(self, reading: Reading) -> None:
        """See the line; a block that this port alone has stored goes into the block history."""
        super().accepted(reading)
        port, frame, _, now, sender, _, hints = reading
        if hints & STORED:
            assert isinstance(frame, Frame)  # noqa: S101 - narrows the type; the link has no others
            self.block_history.received_by(port.position, frame.station, now, frame.data)
            if sender is not None:
                self.sink.refreshed(self.name, sender.position, now, [port.position])

    def detach(self, port: LineNode) -> None:
        """A port's engine is about to stop: it receives nothing more, and its counts are added up."""
        super().detach(port)
        self.reporter.add_up(self.ports[port.position])

    def close(self, now: int) -> None:
        """The run is over (for now): everything is brought up to date."""
        self.shared_listener.sync()
        super().close(now)

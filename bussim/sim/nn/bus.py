"""The N:N link's line: it keeps the blocks that stations have received, and one timer for all deadlines."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from bussim.engines.contract import OPEN
from bussim.engines.nn.contract import STORED
from bussim.engines.nn.frames import DATA, KIND_NAMES, Frame, FrameReader
from bussim.line.characters import LineTiming
from bussim.sim.independent import Part
from bussim.sim.kernel import DEADLINES, Kernel, Timer
from bussim.sim.nn.block_history import BlockHistory
from bussim.sim.nn.block_path import BlockPath
from bussim.sim.nn.contract import LinkStation
from bussim.sim.nn.reporter import LinkReporter
from bussim.sim.wire.contract import LineNode, Reading, Transmission, WireFrame
from bussim.sim.wire.line import Line
from bussim.trace.sink import Sink


class LinkBus(Line):
    """One N:N line. ``ports`` are all its nodes: no other devices share such a line."""

    protocol = "nn"
    ports: Sequence[LinkStation]
    #: Whether ordinary link scans may be done many at once (a test compares runs with and without).
    in_blocks = True
    #: The parts of the simulation on which no link may act; none: what happens meanwhile is to come in order.
    parts: Sequence[Part] = ()
    #: Timers that change nothing but what is recorded.
    recording: Collection[Timer] = ()

    def __init__(
        self, name: str, timing: LineTiming, kernel: Kernel, sink: Sink, reporter: LinkReporter
    ) -> None:
        super().__init__(name, timing, sink, reporter)
        self.reporter: LinkReporter = reporter
        self.block_history = BlockHistory()
        self.block_path = BlockPath(self, kernel)
        self._kernel = kernel
        #: Deadlines move with nearly every frame, nearly always to a later tick: it may fire early, and is
        #: then set again. There is one for all ports, so that those of one tick come in cable order.
        self.deadlines = kernel.timer(self._on_deadlines, DEADLINES)
        #: How long a data frame lasts, in ticks; 0 on a link without a working master.
        self.block_time = 0

    @property
    def plc_names(self) -> tuple[str, ...]:
        """Names by the positions that records of refreshes use."""
        return tuple(port.name for port in self.ports)

    @property
    def whole(self) -> bool:
        """Whether the cable is, and no node receives character by character."""
        return not (self._open_receivers or any(self._segments))

    # -- deadlines ---------------------------------------------------------------------------------

    def rewatch(self) -> None:
        """Arm the timer for the earliest deadline, after it was cancelled or has fired."""
        for port in self.ports:
            port.arm_deadline()

    def _on_deadlines(self, now: int) -> None:
        for port in self.ports:
            port.meet_deadline(now)
        self.rewatch()

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

    def _deliver_by_character(self, tx: Transmission, ports: Collection[LineNode], now: int) -> None:
        """See the line; where nothing comes between, what ends nothing is received ahead of its time."""
        # Jabber is a fault's, whose end is planned only when it has begun.
        busy = tx.frame is None or tx.rx_chars or self.drivers or self._open_receivers
        others = self.listeners_of(tx.sender)[1] or any(port.engine.unfinished for port in ports)
        ahead = self.in_blocks and not (busy or others)
        if ahead:
            self.deadlines.cancel()
            self.rewatch()
            until = min(self._kernel.next(), tx.end)
        super()._deliver_by_character(tx, ports, now)
        receivers = [self.ports[port.position].receiver for port in ports]
        if ahead and receivers and all(each.reads_as(receivers[0]) for each in receivers):
            # The last one is received in its time, so that what waits for silence from then on waits in turn.
            coming, reader = receivers[0].coming(until)[:-1], FrameReader()
            if taken := reader.take((char.start, char[3:]) for char in coming):
                for port, receiver in zip(ports, receivers, strict=True):
                    hints = port.engine.follow(reader)
                    receiver.passed(coming[taken - 1], frame_open=bool(hints & OPEN))

    # -- listeners ---------------------------------------------------------------------------------

    def _deliver(self, frame: WireFrame, tx: Transmission, now: int) -> None:
        """Pass a whole undamaged frame to every port that receives whole frames."""
        assert type(frame) is Frame  # noqa: S101 - narrows the type; the link has no others
        if frame.kind != DATA:
            super()._deliver(frame, tx, now)
            return
        # A data frame. Nearly always all stations store its block: then counting them is enough, and only
        # otherwise are positions listed.
        start, sender, took = tx.start, tx.sender, 0
        missed: list[int] = []
        for port, receive in tx.listeners:
            hints = receive(frame, start, now)
            if hints & STORED:
                took += 1
                if hints == STORED:
                    continue
            else:
                missed.append(port.position)
            port.handle(hints, now)
        if took == len(self.ports) - 1:
            self.block_history.received(frame.station, now, frame.data)
            self.sink.refreshed(self.name, sender.position, now, None)
        elif took:
            positions = [port.position for port, _ in tx.listeners if port.position not in missed]
            others = [
                port.position for port in self.ports if port is not sender and port.position not in positions
            ]
            self.block_history.received(frame.station, now, frame.data, others)
            self.sink.refreshed(self.name, sender.position, now, positions)

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

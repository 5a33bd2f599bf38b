"""One position of a line: it runs a protocol engine in simulated time.

A node calls its engine at its deadlines and when its frames begin and end. A station's own faults act
here, too. What is peculiar to a protocol stands in the subclasses.
"""

from __future__ import annotations

from abc import abstractmethod
from bisect import insort
from dataclasses import replace
from fractions import Fraction
from typing import Any

from bussim.engines.contract import DEADLINE, EVENTS, OPEN, TRANSMIT, Transmit
from bussim.line.characters import LineTiming
from bussim.sim.kernel import DEADLINES, HEARING, SENDING, Kernel
from bussim.sim.wire.contract import LineNode
from bussim.sim.wire.line import Line
from bussim.sim.wire.receiver import Receiver


class Node(LineNode):
    """One position of a line, in cable order from 0; ``name`` is unique in the scenario."""

    line: Line
    receiver: Receiver

    def __init__(self, name: str, line: Line, position: int, kernel: Kernel) -> None:
        self.name = name
        self.line = line
        self.position = position
        self._kernel = kernel
        #: Rate, format and clock as the node is set, and as they are now with its faults.
        self.home_timing = line.timing
        self.timing = line.timing
        #: Another format or rate in force (None: not), and parts per million of clock error, each of a fault.
        self.timing_faults: list[tuple[LineTiming | None, Fraction]] = []
        self.receiver = Receiver(self, kernel, self.timing)
        self.extra_turnaround = 0
        self.late_release = 0
        self.pending: list[tuple[int, int, int]] = []  # (start, order, counter) of what is to be sent
        self._sequence = 0
        self._start_timer = kernel.timer(self._on_start, SENDING)
        self._end_timer = kernel.timer(self._on_end, HEARING)
        self._release_timer = kernel.timer(self._on_release, HEARING)
        self._deadline_timer = kernel.timer(self._on_deadline, DEADLINES)

    # -- what differs by protocol ------------------------------------------------------------------

    @abstractmethod
    def report(self, item: Any, now: int) -> None:
        """Take an event of its engine; a transmission is none."""

    # -- state -------------------------------------------------------------------------------------

    @property
    def now(self) -> int:
        """See the base class."""
        return self._kernel.now

    @property
    @abstractmethod
    def powered(self) -> bool:
        """Whether it has a supply."""

    def halt(self, now: int) -> None:
        """STOP or power-off: it sends and receives no more; a frame on the wire is cut at this tick."""
        engine = self.engine
        if engine is not None:
            self.line.detach(self)
            engine.stop(now)
            self.drain(now)
        self.engine = None
        self.pending.clear()
        self._start_timer.cancel()
        self._deadline_timer.cancel()
        self.receiver.close()
        if self.sending is not None:
            self._end_timer.cancel()
            self.line.cut(self, now)
            self.sending = None
        self.release(now)
        self.line.listeners_changed()

    def retime(self, now: int) -> None:
        """Send and receive as it is set, with the faults that are on: the latest format, clock errors added.

        What is being received is lost.
        """
        timing = self.home_timing
        for other, _ in self.timing_faults:
            timing = other or timing
        for _, ppm in self.timing_faults:
            timing = replace(timing, ppm=timing.ppm + ppm)
        self.timing = timing
        self.nominal = timing == self.line.timing
        self.line.restart_receiver(self, timing, now)
        self.line.listeners_changed()

    # -- what the engine asks for ------------------------------------------------------------------

    def handle(self, hints: int, now: int) -> None:
        """See the base class."""
        engine = self.engine
        if engine is None:
            return
        if hints & OPEN:
            self.receiver.hold(now)
        if hints & EVENTS:
            self.drain(now)
        if hints & TRANSMIT and engine.due >= 0:
            at, engine.due = engine.due, -1
            self.schedule(at, engine.due_counter)
        if hints & DEADLINE:
            self.arm_deadline()

    def drain(self, now: int) -> None:
        """See the base class."""
        engine = self.engine
        while engine is not None:
            item = engine.poll()
            if item is None:
                return
            if isinstance(item, Transmit):
                self.schedule(item.at, item.counter)
            else:
                self.report(item, now)
                engine = self.engine

    def arm_deadline(self) -> None:
        """Arm the deadline's timer unless it fires earlier anyway.

        A deadline moves with nearly every frame, nearly always to a later tick. A timer that fires too
        early looks again (:meth:`_on_deadline`); moving it each time would cost an entry in SimPy's queue
        for each frame.
        """
        engine = self.engine
        at = engine.deadline() if engine is not None else None
        timer = self._deadline_timer
        if at is not None and (timer.at < 0 or at < timer.at):
            timer.set(max(at, self._kernel.now))

    def _on_deadline(self, now: int) -> None:
        engine = self.engine
        if engine is None:
            return
        at = engine.deadline()
        if at is not None and at <= now:
            self.catch_up(now)
            at = engine.deadline()
        if at is None:
            return
        if at > now:
            self._deadline_timer.set(at)
            return
        self.handle(engine.on_deadline(now), now)
        self.arm_deadline()

    def catch_up(self, now: int) -> None:
        """Before a deadline: pass on the characters so far to an engine whose decision depends on them."""

    # -- sending -----------------------------------------------------------------------------------

    def schedule(self, at: int, counter: int) -> None:
        """Schedule a frame to be sent from ``at`` on."""
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
            self._start_timer.set(at)

    @abstractmethod
    def _on_start(self, now: int) -> None:
        """Begin the frame that is due."""

    def _begin(self, frame: Any, now: int) -> None:
        """Switch the driver on for a frame."""
        line = self.line
        if self.receiver.is_open:
            self.receiver.close()
        if self.tail is not None:
            self.release(now)
        self.sending = tx = line.begin(self, frame, now)
        if line.in_blocks and tx.end < self._kernel.next():
            self._kernel.now = tx.end  # nothing happens before: an event for it is one too many
            self._on_end(tx.end)
        else:
            self._end_timer.set(tx.end)

    def _on_end(self, now: int) -> None:
        tx = self.sending
        if tx is None:
            return
        self.sending = None
        if self.late_release and not (self.jabbering or tx.silent or tx.cut):
            self.tail, tx.released = tx, now + self.late_release
            self._release_timer.set(tx.released)
        self.line.finish(self, tx, now)
        engine = self.engine
        if engine is not None:
            hints = engine.transmit_done(now)
            if hints:
                self.handle(hints, now)
            if self.pending:
                self._start_timer.set(max(self.pending[0][0], now))

    def finish_early(self, now: int) -> None:
        """See the base class."""
        tx = self.sending
        if tx is None or tx.cut or self.jabbering:
            return
        self._end_timer.cancel()
        tx.end = now
        self._on_end(now)

    def release(self, now: int) -> None:
        """Switch the driver off if it is still on after a frame."""
        tail = self.tail
        if tail is not None:
            self._release_timer.cancel()
            self.tail = None
            self.line.release(tail, now)

    def _on_release(self, now: int) -> None:
        self.release(now)
        self.line.join_midway(self, now)

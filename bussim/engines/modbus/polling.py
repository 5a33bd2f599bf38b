"""A master that works through a poll list on its own, without a PLC's scan: an HMI, a PC."""

from __future__ import annotations

from collections import deque

from bussim.engines.contract import DEADLINE, EVENTS, RxChar, Transmit
from bussim.engines.modbus.adu import Adu
from bussim.engines.modbus.codes import MEANINGS
from bussim.engines.modbus.events import MasterEvent, PollEvent, TransactionEnded
from bussim.engines.modbus.master import Master, MasterConfig, refusal
from bussim.engines.modbus.polls import Poll, PollList


class PollingMaster:
    """A :class:`Master` with a :class:`PollList`. See :mod:`bussim.engines.contract`.

    The next poll begins as soon as it is due and the interval since the last transaction is over.
    Raises ValueError for a poll that a master cannot send.
    """

    __slots__ = ("_events", "_next", "list", "master")

    def __init__(self, config: MasterConfig, polls: PollList[Poll]) -> None:
        for number, poll in enumerate(polls.polls):
            error = refusal(poll.station, poll.request, config.limits)
            if error is not None:
                raise ValueError(f"poll {number} cannot be sent: {MEANINGS[error]}")
        self.master = Master(config)
        self.list = polls
        self._events: deque[MasterEvent | PollEvent] = deque()
        self._next: int | None = None  # when the next turn can begin

    @property
    def due(self) -> int:
        """When the request may leave; meaningful after the hint TRANSMIT."""
        return self.master.due

    @due.setter
    def due(self, value: int) -> None:
        self.master.due = value

    @property
    def due_counter(self) -> int:
        """The number of the transaction that is due or runs."""
        return self.master.due_counter

    @due_counter.setter
    def due_counter(self, value: int) -> None:
        self.master.due_counter = value

    @property
    def quiet(self) -> int:
        """Ticks of silence after which the driver calls :meth:`line_idle`."""
        return self.master.quiet

    @property
    def heard(self) -> Adu | None:
        """The latest sound frame that was completely heard, whosever it is."""
        return self.master.heard

    @heard.setter
    def heard(self, value: Adu | None) -> None:
        self.master.heard = value

    @property
    def heard_start(self) -> int:
        """Its first edge."""
        return self.master.heard_start

    def start(self, now: int) -> int:
        """Power-on; returns hints."""
        self.list.drop(now)
        return self._step(now, self.master.start(now))

    def stop(self, now: int) -> int:
        """Power-off; returns hints."""
        self._next = None
        return self.master.stop(now)

    def receive(self, char: RxChar, start: int, end: int) -> int:
        """One character; see the contract."""
        return self._step(end, self.master.receive(char, start, end))

    def receive_frame(self, frame: Adu, start: int, end: int) -> int:
        """A whole undamaged frame."""
        return self._step(end, self.master.receive_frame(frame, start, end))

    def line_idle(self, now: int) -> int:
        """The line has been quiet for :attr:`quiet` ticks."""
        return self._step(now, self.master.line_idle(now))

    def deadline(self) -> int | None:
        """The master's deadline, or when the next turn can begin."""
        return self._next if self.master.idle else self.master.deadline()

    def on_deadline(self, now: int) -> int:
        """The master's deadline, or the next turn."""
        if self.master.idle:
            return self._step(now, 0)
        return self._step(now, self.master.on_deadline(now))

    def begin_transmit(self, now: int, counter: int = 0) -> Adu:
        """The request that is due."""
        return self.master.begin_transmit(now, counter)

    def transmit_done(self, now: int) -> int:
        """The request has left."""
        return self._step(now, self.master.transmit_done(now))

    def poll(self) -> Transmit | MasterEvent | PollEvent | None:
        """The next event, then the request that is due."""
        return self._events.popleft() if self._events else self.master.poll()

    def _step(self, now: int, hints: int) -> int:
        """Take the master's events over, and begin the next transaction if its time has come."""
        while hints & EVENTS or self.master.idle:
            again: Poll | None = None
            if hints & EVENTS:
                again = self._collect(now)
            if not self.master.idle:
                break
            poll = again or self._due_now(now)
            if poll is None:
                return hints | DEADLINE
            hints = hints & ~EVENTS | self.master.submit(poll.station, poll.request, now)
        return hints | EVENTS if self._events else hints

    def _due_now(self, now: int) -> Poll | None:
        due = self.list.next_due()
        self._next = None if due is None else max(due, self.master.ready_at)
        return self.list.take(now) if self._next is not None and self._next <= now else None

    def _collect(self, now: int) -> Poll | None:
        again: Poll | None = None
        while (item := self.master.poll()) is not None:
            if isinstance(item, Transmit):
                self.master.due = item.at
                break
            self._events.append(item)
            if isinstance(item, TransactionEnded) and self.list.running is not None:
                again, ended = self.list.ended(now, item.error)
                self._events.extend(ended)
        return again

"""A master that works through a poll list on its own, without a PLC's scan: an HMI, a PC."""

from bussim.engines.contract import DEADLINE, EVENTS, RxChar
from bussim.engines.modbus.adu import Adu
from bussim.engines.modbus.codes import MEANINGS, PortError
from bussim.engines.modbus.master import Master, MasterConfig, refusal
from bussim.engines.modbus.polls import Poll, PollList


class PollingMaster(Master):
    """A :class:`Master` with a :class:`PollList`, whose events it reports as well.

    The next poll begins as soon as it is due and the interval since the last transaction is over.
    Raises ValueError for a poll that a master cannot send.
    """

    def __init__(self, config: MasterConfig, polls: PollList[Poll]) -> None:
        for number, poll in enumerate(polls.polls):
            error = refusal(poll.station, poll.request, config.limits, config.last_station)
            if error is not None:
                raise ValueError(f"poll {number} cannot be sent: {MEANINGS[error]}")
        super().__init__(config)
        self.list = polls
        self._again: Poll | None = None  # the poll that is to be repeated at once
        self._next: int | None = None  # when the next turn can begin

    def start(self, now: int) -> int:
        """Power-on; returns hints."""
        self.list.drop(now)
        self._again = None
        return self._go_on(now, super().start(now))

    def stop(self, now: int) -> int:
        """Power-off; returns hints."""
        self._next = None
        return super().stop(now)

    def receive(self, char: RxChar, start: int, end: int) -> int:
        """One character; see the contract."""
        return self._go_on(end, super().receive(char, start, end))

    def receive_frame(self, frame: Adu, start: int, end: int) -> int:
        """A whole undamaged frame."""
        return self._go_on(end, super().receive_frame(frame, start, end))

    def receive_complete(self, frame: Adu, start: int, end: int, now: int) -> int:
        """A whole undamaged frame that is over."""
        return self._go_on(now, super().receive_complete(frame, start, end, now))

    def line_idle(self, now: int) -> int:
        """The line has been idle for :attr:`quiet` ticks."""
        return self._go_on(now, super().line_idle(now))

    def deadline(self) -> int | None:
        """The transaction's deadline, or when the next turn can begin."""
        return self._next if self.idle else super().deadline()

    def on_deadline(self, now: int) -> int:
        """The transaction's deadline, or the next turn."""
        return self._go_on(now, 0 if self.idle else super().on_deadline(now))

    def transmit_done(self, now: int) -> int:
        """The request has left."""
        return self._go_on(now, super().transmit_done(now))

    def _on_ended(self, now: int, error: PortError | None) -> None:
        if self.list.running is not None:
            self._again, ended = self.list.ended(now, error)
            self._events.extend(ended)

    def _go_on(self, now: int, hints: int) -> int:
        """Begin the next transaction if its time has come."""
        while self.idle:
            poll, self._again = self._again or self._due_now(now), None
            if poll is None:
                return hints | DEADLINE
            held = self._held_until(poll, now)
            if held > now:
                self._again, self._next = poll, held
                return hints | DEADLINE
            hints = hints & ~EVENTS | self.submit(poll.station, poll.request, now)
        return hints | EVENTS if self._events else hints

    def _held_until(self, poll: Poll, now: int) -> int:
        """When a poll may begin; for a master that waits for late responses."""
        return now

    def _due_now(self, now: int) -> Poll | None:
        due = self.list.next_due()
        self._next = None if due is None else max(due, self.ready_at)
        if self._next is None or self._next > now:
            return None
        poll = self.list.take(now)
        if poll is None and (due := self.list.next_due()) is not None:  # a turn was left out
            self._next = max(due, self.ready_at)
        return poll

"""Poll lists: which transaction is next, how often it is retried, and when it comes round again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from bussim.engines.modbus.codes import PortError
from bussim.engines.modbus.events import CycleEnded, PollEnded, PollEvent
from bussim.engines.modbus.pdu import Request


@dataclass(frozen=True, slots=True)
class Poll:
    """One entry of a poll list.

    ``every`` is its period in ticks, 0 for again as soon as the others had their turn; a failed
    attempt is repeated at once, up to ``retries`` times.
    """

    station: int
    request: Request
    every: int = 0
    retries: int = 0


class PollList:
    """Deals out the polls of one port in turn; says nothing on the wire itself.

    A poll is due at ``start`` and then every ``every`` ticks, on that grid: turns that could not be
    begun before the next one came due are skipped, not caught up. Of several that are due the one
    after the latest in the list is next.
    """

    __slots__ = (
        "_attempts",
        "_begun",
        "_cycle_start",
        "_cycles",
        "_due",
        "_last",
        "_late",
        "_unseen",
        "polls",
        "running",
    )

    def __init__(self, polls: Sequence[Poll], start: int = 0) -> None:
        self.polls = tuple(polls)
        #: Index of the poll whose turn it is, None between turns.
        self.running: int | None = None
        self._due = [start] * len(self.polls)
        self._last = len(self.polls) - 1
        self._attempts = 0
        self._begun = 0
        self._late = 0
        self._cycle_start: int | None = None
        self._cycles = 0
        self._unseen = set(range(len(self.polls)))

    def next_due(self) -> int | None:
        """When :meth:`take` may be called next; None while a turn runs or the list is empty."""
        return min(self._due) if self.running is None and self._due else None

    def take(self, now: int) -> Poll | None:
        """Begin the turn that is next; None if none is due at ``now``."""
        if self.running is not None:
            return None
        count = len(self.polls)
        for step in range(1, count + 1):
            index = (self._last + step) % count
            if self._due[index] <= now:
                return self._begin(index, now)
        return None

    def _begin(self, index: int, now: int) -> Poll:
        poll = self.polls[index]
        due = self._due[index]
        self._late = now - due
        # The next point of the grid after now; without a period it is due again when it is over.
        self._due[index] = due + ((now - due) // poll.every + 1) * poll.every if poll.every else now
        self.running = self._last = index
        self._begun = now
        self._attempts = 1
        if self._cycle_start is None:
            self._cycle_start = now
        return poll

    def ended(self, now: int, error: PortError | None) -> tuple[Poll | None, tuple[PollEvent, ...]]:
        """An attempt of the running turn was decided.

        Returns the poll to try again at once, or None, and what is over. Raises RuntimeError if no
        turn runs.
        """
        index = self.running
        if index is None:
            raise RuntimeError("no poll is running")
        poll = self.polls[index]
        if error is not None and self._attempts <= poll.retries:
            self._attempts += 1
            return poll, ()
        self.running = None
        if not poll.every:
            self._due[index] = now
        events: list[PollEvent] = [PollEnded(now, index, self._begun, self._attempts, error, self._late)]
        self._unseen.discard(index)
        if not self._unseen:
            begun = self._begun if self._cycle_start is None else self._cycle_start
            events.append(CycleEnded(now, self._cycles, now - begun))
            self._cycles += 1
            self._cycle_start = None
            self._unseen = set(range(len(self.polls)))
        return None, tuple(events)

    def drop(self, now: int) -> None:
        """The running turn is forgotten (STOP); every poll is due again from ``now`` on."""
        self.running = None
        self._due = [now] * len(self.polls)
        self._cycle_start = None
        self._unseen = set(range(len(self.polls)))

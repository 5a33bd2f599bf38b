"""Poll lists: which transaction is next, how often it is retried, and when it comes round again."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from bussim.engines.modbus.codes import PortError
from bussim.engines.modbus.events import CycleEnded, PollEnded, PollEvent
from bussim.engines.modbus.pdu import Request


class Turn(Protocol):
    """When an entry of a list has its turns. Times in ticks.

    First ``at`` after the list's start, then every ``every`` ticks on that grid (0: again as soon as
    the others had their turn), ``times`` times (None: for ever). A failed attempt is repeated up to
    ``retries`` times. After a failed turn only every ``skip_after_failure``-th one (1: each) is made, until
    one is good.
    """

    @property
    def at(self) -> int:
        """When it is due first, from the list's start on."""

    @property
    def every(self) -> int:
        """Its period, 0 for none."""

    @property
    def times(self) -> int | None:
        """How many turns it has, None for no limit."""

    @property
    def retries(self) -> int:
        """How often a failed attempt is repeated."""

    @property
    def skip_after_failure(self) -> int:
        """Which of its turns is made after a failed one: 1 is the next."""


@dataclass(frozen=True, slots=True)
class Poll:
    """One entry of a poll list that is a Modbus transaction; see :class:`Turn`."""

    station: int
    request: Request
    every: int = 0
    retries: int = 0
    at: int = 0
    times: int | None = None
    name: str = ""
    skip_after_failure: int = 1


TurnT = TypeVar("TurnT", bound=Turn)


class PollList(Generic[TurnT]):
    """Deals out the polls of one port in turn; says nothing on the wire itself.

    Turns that could not be begun before the poll came due again are skipped, not caught up. Of
    several that are due the one after the latest in the list is next. A cycle is over when every
    poll without ``times`` had a turn: a poll with ``times`` is a command and no part of it, nor is one whose
    turns are left out after a failure. A poll without period that nothing else is due beside has the turns
    that it leaves out at once. ``pause`` is
    the least time in ticks from the end of a turn to the next one.
    """

    def __init__(self, polls: Sequence[TurnT], start: int = 0, pause: int = 0) -> None:
        self.polls = tuple(polls)
        self._pause = pause
        #: Index of the poll whose turn it is, None between turns.
        self.running: int | None = None
        self._cyclic = frozenset(index for index, poll in enumerate(self.polls) if poll.times is None)
        self._cycles = 0
        self._attempts = 0
        self._begun = 0
        self._late = 0
        self._cycle_start: int | None = None
        self._due: list[int | None] = []
        self._left: list[int | None] = []
        self._left_out: list[int] = []
        self.drop(start)

    @property
    def attempt(self) -> int:
        """The number of the running turn's attempt, from 1."""
        return self._attempts

    def next_due(self) -> int | None:
        """When :meth:`take` may be called next; None while a turn runs or nothing is due any more."""
        if self.running is not None:
            return None
        due = min((due for due in self._due if due is not None), default=None)
        return None if due is None else max(due, self._paused)

    def take(self, now: int) -> TurnT | None:
        """Begin the turn that is next; None if none is due at ``now``."""
        if self.running is not None or now < self._paused:
            return None
        count, again = len(self.polls), True
        while again:
            again = False
            for step in range(1, count + 1):
                index = (self._last + step) % count
                due, poll = self._due[index], self.polls[index]
                if due is None or due > now:
                    continue
                if not self._left_out[index]:
                    return self._begin(index, due, now)
                self._left_out[index] -= 1
                self._unseen.discard(index)
                if poll.every:
                    self._due[index] = _next_due(due, poll.every, now)
                again = again or not poll.every
        return None

    def _begin(self, index: int, due: int, now: int) -> TurnT:
        poll = self.polls[index]
        self._late = now - due
        left = self._left[index]
        if left is not None:
            self._left[index] = left = left - 1
        if left == 0:
            self._due[index] = None
        else:
            # Without a period it is due again when it is over.
            self._due[index] = _next_due(due, poll.every, now) if poll.every else now
        self.running = self._last = index
        self._begun = now
        self._attempts = 1
        if self._cycle_start is None and index in self._cyclic:
            self._cycle_start = now
        return poll

    def ended(self, now: int, error: PortError | None) -> tuple[TurnT | None, tuple[PollEvent, ...]]:
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
        self._left_out[index] = 0 if error is None else poll.skip_after_failure - 1
        if self._pause:
            self._paused = now + self._pause
        if not poll.every and self._due[index] is not None:
            self._due[index] = now
        events: list[PollEvent] = [PollEnded(now, index, self._begun, self._attempts, error, self._late)]
        self._unseen.discard(index)
        if index in self._cyclic and all(self._left_out[unseen] for unseen in self._unseen):
            begun = self._begun if self._cycle_start is None else self._cycle_start
            events.append(CycleEnded(now, self._cycles, now - begun))
            self._cycles += 1
            self._begin_cycle()
        return None, tuple(events)

    def _begin_cycle(self) -> None:
        self._cycle_start = None
        self._unseen = set(self._cyclic)

    def drop(self, now: int) -> None:
        """The running turn is forgotten (STOP), and the list begins anew at ``now``."""
        self.running = None
        self._paused = 0
        self._due = [None if poll.times == 0 else now + poll.at for poll in self.polls]
        self._left = [poll.times for poll in self.polls]
        self._left_out = [0] * len(self.polls)
        self._last = len(self.polls) - 1
        self._begin_cycle()


def _next_due(due: int, every: int, now: int) -> int:
    """The next point of a grid after now."""
    return due + ((now - due) // every + 1) * every

"""A poll list on a real port: turns as they end, and a stop when every poll had its turns."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import assert_never

from bussim.engines.modbus.events import (
    CycleEnded,
    ForeignFrame,
    FrameRejected,
    MasterEvent,
    PollEnded,
    PollEvent,
    TransactionEnded,
    Unanswered,
)
from bussim.engines.modbus.polls import Poll
from bussim.live.modbus import ModbusHandling


@dataclass(frozen=True, slots=True)
class Turn:
    """A turn of a poll: its index in the list, and its attempts, the last of which decided it.

    ``instead`` is an earlier request, which had timed out, that the response taken may answer. ``echoed``:
    what was taken is no response, but the request that the adapter returns. ``timed``: its times are known.
    ``late`` are the attempts that failed while this computer was late: they say nothing of the line.
    """

    index: int
    poll: Poll
    attempts: tuple[TransactionEnded, ...]
    ended: PollEnded
    instead: Unanswered | None = None
    echoed: bool = False
    timed: bool = True
    late: tuple[TransactionEnded, ...] = ()

    @property
    def last(self) -> TransactionEnded:
        """The attempt that decided it."""
        return self.attempts[-1]

    @property
    def responded(self) -> bool:
        """Whether the station responded at all, be it with an exception."""
        return self.ok or self.last.exception > 0

    @property
    def ok(self) -> bool:
        """Whether a good response was taken."""
        return self.last.error is None and not self.echoed

    @property
    def mismatched(self) -> bool:
        """Whether the response taken may be another request's."""
        return self.instead is not None and self.instead.request != self.poll.request

    @property
    def response(self) -> int | None:
        """Ticks from the end of the request to the end of its response, None where unknown."""
        last = self.last
        if (
            not self.timed
            or self.instead is not None
            or not self.responded
            or last.asked is None
            or last.answer_end is None
        ):
            return None
        return last.answer_end - last.asked


class PollTurns(ModbusHandling):
    """Puts the attempts of a polling master into turns; ``on_turn`` is called with each.

    ``on_late`` is called with each response to a request that had timed out, if it was thrown away. With
    ``rounds`` :attr:`done` becomes true when every poll has had so many turns.
    """

    def __init__(
        self,
        polls: Sequence[Poll],
        on_turn: Callable[[Turn], None],
        rounds: int | None = None,
        on_late: Callable[[ForeignFrame], None] = lambda _frame: None,
    ) -> None:
        super().__init__()
        self._polls = polls
        self._on_turn = on_turn
        limits = ([each for each in (rounds, poll.times) if each is not None] for poll in polls)
        self._limits = [min(each, default=None) for each in limits]
        self._on_late = on_late
        self._instead: Unanswered | None = None
        self._attempts: list[TransactionEnded] = []
        self._late: list[TransactionEnded] = []
        self._turns = [0] * len(polls)

    @property
    def done(self) -> bool:
        """Whether every poll has had its turns; one with ``times`` may have fewer."""
        return all(
            limit is not None and turns >= limit
            for limit, turns in zip(self._limits, self._turns, strict=True)
        )

    def event(self, event: MasterEvent | PollEvent, now: int) -> None:
        """See the base class."""
        match event:
            case TransactionEnded():
                self._attempts.append(event)
                failed = event.error is not None and not event.exception
                if failed and self.lateness.spoils(event.sent or now, now):
                    self._late.append(event)
            case FrameRejected():
                self.count(event)
            case PollEnded(index=index):
                attempts, self._attempts = tuple(self._attempts), []
                late, self._late = tuple(self._late), []
                if attempts:
                    self._turns[index] += 1
                    turn = Turn(index, self._polls[index], attempts, event, self._instead, late=late)
                    self._on_turn(turn)
                self._instead = None
            case ForeignFrame(late=None):
                self.rejected["no station was asked for it"] += 1
            case ForeignFrame(taken=True):
                self._instead = event.late
            case ForeignFrame():
                self._on_late(event)
            case CycleEnded():
                pass  # cycles are the turns of all polls
            case _:
                assert_never(event)

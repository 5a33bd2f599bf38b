"""How long a poll list goes round: bounds for any outcome of its polls, and the mean without errors.

A list deals its turns out one at a time, of the polls that are due the one after the latest in the list's
order (:class:`~bussim.engines.modbus.polls.PollList`). A poll that is due therefore waits for at most one
turn of each other poll, commands (polls with ``times``) among them. A cycle is over when every poll without
``times`` had a turn.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate

from bussim.exact.metrics import YEAR
from bussim.exact.polls.master_timing import MasterTiming, Span, exactly
from bussim.exact.polls.poll_list import PollListModel, PollModel


@dataclass(frozen=True, slots=True)
class Cost:
    """What a turn of one poll takes: up to so many attempts (at least ``fewest``), each with this need."""

    poll: PollModel
    attempts: int
    need: Span
    fewest: int = 1

    def turn(self, master_timing: MasterTiming) -> Span:
        """From the poll's request to the next one's, attempt by attempt."""
        turn = master_timing.turn(self.need)
        return Span(turn.least * self.fewest, turn.most * self.attempts)

    def taken(self, master_timing: MasterTiming) -> Span:
        """From the poll's request to the taking over of its last attempt."""
        taken, again = master_timing.taken(self.need), master_timing.turn(self.need)
        return Span(
            taken.least + (self.fewest - 1) * again.least, taken.most + (self.attempts - 1) * again.most
        )

    def own(self, master_timing: MasterTiming) -> int:
        """The least time from the beginning of its turn to the end."""
        return master_timing.entry.least + self.taken(master_timing).least


def without_errors(poll: PollModel) -> Cost:
    """A poll whose first attempts are all good."""
    return Cost(poll, 1, poll.need)


def failing(model: PollListModel, poll: PollModel) -> Cost:
    """A poll to which no slave responds. A broadcast cannot fail."""
    if not poll.device:
        return without_errors(poll)
    return Cost(poll, poll.attempts, exactly(poll.request + model.timeout), poll.attempts)


def at_worst(model: PollListModel, poll: PollModel, tail: int = 0) -> Cost:
    """All of a poll's attempts spent, each decided up to ``tail`` ticks after its timeout."""
    if not poll.device:
        return without_errors(poll)
    longest = max(poll.need.most, poll.request + model.timeout + tail)
    return Cost(poll, poll.attempts, Span(poll.request, longest))


class Round:
    """One master's cycle with a cost for each of its cyclic polls, of which there must be some.

    ``commands`` are the costs of the others. ``skips``: turns may be left out after failed ones.
    """

    def __init__(
        self, model: PollListModel, costs: Sequence[Cost], commands: Sequence[Cost], *, skips: bool = False
    ) -> None:
        self._master_timing = master_timing = model.master_timing
        self._costs = costs
        self._late = master_timing.interval if master_timing.begins_late else 0
        self._turns = [cost.turn(master_timing) for cost in costs]
        self._ordered = not commands
        #: The longest time that one turn of each command takes.
        self.commands = sum(cost.turn(master_timing).most for cost in commands)
        #: The longest time that all other turns take, one each, in any order.
        self.all = sum(turn.most for turn in self._turns)
        # From coming due, with nothing under way, to the request; the first turn of all may have a shorter
        # time before it, as it has not a whole scan before its END.
        self._waits = Span(master_timing.entry.least, master_timing.idle + master_timing.entry.most)
        self._first_entry = min(self._waits.least, model.first_end)
        self._first_before = max(master_timing.entry.most, model.first_end)
        self._first = next((poll for poll in model.polls if not poll.at), None)
        periods = {cost.poll.every for cost in costs}
        self._same_start = same_start = len({cost.poll.at for cost in costs}) == 1
        #: Whether the list goes round and round: every poll is due again when its turn comes, since it has
        #: no period, or since one turn of each poll takes longer than its period.
        self.continuous = periods == {0} or (
            not skips
            and same_start
            and max(periods) <= sum(cost.own(master_timing) + self._late for cost in costs)
        )
        #: Whether every turn is over before the poll comes due again.
        self.fits = 0 not in periods and self.all + self.commands + self._waits.most <= min(periods)
        # All come due at once and have their turns in the list's order.
        self._simultaneous = self.fits and len(periods) == 1 and same_start and not skips

    def time(self) -> Span:
        """From the beginning of the first turn to the end of the last, while no command has a turn."""
        costs, master_timing = self._costs, self._master_timing
        if self.continuous:
            # What is before the first request is the gap of the turn before, not the one that goes with
            # the last poll's own transaction.
            gap = master_timing.gap(costs[-1].need if self._ordered else None)
            return sum(self._turns[:-1], gap) + costs[-1].taken(master_timing) + exactly(-self._late)
        least = sum(cost.own(master_timing) for cost in costs) + (len(costs) - 1) * self._late
        before = exactly(0) if master_timing.begins_late else master_timing.gap()
        if self._simultaneous:
            before = master_timing.entry
        return Span(least, max(self._over(index, before.most) for index in range(len(costs))))

    def first(self) -> int:
        """The longest time that the first cycle takes, for which some polls come due later than others."""
        late = [cost.poll.at for cost in self._costs]
        before, spread = self._first_before, max(late) - min(late)
        if spread:
            before = max(before, spread + self._waits.most)
        taken = [cost.taken(self._master_timing).most for cost in self._costs]
        return before + self.all + max(own - turn.most for own, turn in zip(taken, self._turns, strict=True))

    def longest(self) -> int:
        """The longest cycle that there can be, the first and those with a turn of each command among them."""
        return max(self.time().most, self.first()) + self.commands

    def _over(self, index: int, before: int) -> int:
        """The longest time from a cycle's begin to the end of one poll's turn, if that is the last."""
        cost, wait = self._costs[index], before
        if not self._simultaneous and len(self._costs) > 1:
            # Its latest turn was over before this cycle, so that it is due a period after that turn began.
            rest = max(0, cost.poll.every - cost.own(self._master_timing))
            wait = max(wait, rest + self._waits.most)
        return wait + self.all - self._turns[index].most + cost.taken(self._master_timing).most

    def period(self) -> Span | None:
        """From cycle to cycle where the list goes round and round; None where the polls have periods."""
        return sum(self._turns, exactly(0)) if self.continuous else None

    def age(self, index: int, own: Cost | None = None) -> int:
        """How old what a poll read can become before the next values replace it, from RUN on.

        ``own`` is the turn that has brought them (None: as every turn of it).
        """
        cost, master_timing = self._costs[index], self._master_timing
        poll, taken = cost.poll, cost.taken(master_timing).most
        kept = taken - poll.served.least
        if self._simultaneous and self._ordered:
            entry = self._first_entry if poll.at == 0 else self._waits.least
            before = self._turns[:index]
            spread = sum(turn.most - turn.least for turn in before) + self._waits.most - entry
            return poll.every + spread + kept
        return self.between(index, own) + kept

    def between(self, index: int, own: Cost | None = None) -> int:
        """The longest time from the request of one of a poll's turns, ``own``, to that of the next one."""
        poll, turn = self._costs[index].poll, (own or self._costs[index]).turn(self._master_timing).most
        if poll.every and not self.continuous:
            entry = self._first_entry if poll is self._first else self._waits.least
            turn = max(turn, poll.every + self._waits.most - entry)
        return turn + self.all - self._turns[index].most + self.commands

    @cached_property
    def _due(self) -> tuple[set[int], list[int]]:
        """The polls that are due again whenever their turn comes, and the least time of each poll's turn."""
        owns = [cost.own(self._master_timing) + self._late for cost in self._costs]
        every = [cost.poll.every for cost in self._costs]
        by_period = sorted(range(len(owns)), key=every.__getitem__)
        count = every.count(0)
        for at, together in enumerate(accumulate(owns[at] for at in by_period), 1):
            if self._same_start and every[by_period[at - 1]] <= together:
                count = at
        return set(by_period[:count]), owns

    def turns_a_year(self, index: int) -> float:
        """How many turns a poll has in a year at most; between them each that is always due has one."""
        period, (due, owns) = self.period(), self._due
        own = sum(owns[at] for at in due | {index})
        return YEAR / (max(self._costs[index].poll.every, own) if period is None else period.least)

    def share(self) -> tuple[float, float]:
        """Bounds of the long-run share of time for which its frames are on the wire."""
        costs, master_timing = self._costs, self._master_timing
        frames = sum(cost.poll.frames for cost in costs)
        period = self.period()
        if period is not None:
            return frames / period.most, frames / period.least
        paced = sum(cost.poll.frames / cost.poll.every for cost in costs if cost.poll.every)
        if self.fits:
            return paced, paced
        rest = [
            cost.poll.frames / (cost.own(master_timing) + self._late) for cost in costs if not cost.poll.every
        ]
        longest = self.all + self.commands + self._waits.most
        least = sum(cost.poll.frames / (longest + cost.poll.every) for cost in costs)
        densest = max(cost.poll.frames / (cost.own(master_timing) + self._late) for cost in costs)
        return least, min(paced + max(rest, default=0.0), densest)

    def mean(self) -> float | None:
        """Mean of :meth:`time`, all first attempts good; None where no closed form is known."""
        master_timing = self._master_timing
        if any(cost.poll.waits for cost in self._costs):
            time = self.time()
            return float(time.least) if time.fixed else None
        means = [master_timing.mean(cost.need) for cost in self._costs]
        known = [mean for mean in means if mean is not None]
        if len(known) < len(means):
            return None
        taken = sum(mean[0] for mean in known)
        if self.continuous:
            return taken + sum(mean[1] for mean in known) - self._late
        if self._simultaneous and self._ordered:
            return master_timing.mean_entry() + taken + sum(mean[1] for mean in known[:-1])
        return None

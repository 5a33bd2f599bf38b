"""How long a poll list goes round: bounds for any outcome of its polls, and the mean without errors.

A list deals its turns out one at a time, of the polls that are due the one after the latest in the list's
order (:class:`~bussim.engines.modbus.polls.PollList`). A poll that is due therefore waits for at most one
turn of each other poll. A cycle is over when every poll without ``times`` had a turn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

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

    def alone(self, master_timing: MasterTiming) -> Span:
        """The same as a bound for any neighbours: what was the next one's gap may be its own."""
        return (master_timing.taken(self.need) + master_timing.gap()).times(self.attempts)

    def own(self, master_timing: MasterTiming) -> int:
        """The least time from the beginning of its turn to the end."""
        return (
            master_timing.entry.least
            + self.fewest * master_timing.taken(self.need).least
            + (self.fewest - 1) * master_timing.gap().least
        )


def failing(model: PollListModel, poll: PollModel) -> Cost:
    """A poll to which no slave responds. A broadcast cannot fail."""
    if not poll.device:
        return Cost(poll, 1, poll.need)
    return Cost(poll, poll.attempts, exactly(poll.request + model.timeout), poll.attempts)


def at_worst(model: PollListModel, poll: PollModel) -> Cost:
    """All of a poll's attempts spent, each for as long as anything on the line can make it last."""
    if not poll.device:
        return Cost(poll, 1, poll.need)
    longest = max(poll.need.most, poll.request + model.timeout + model.tail)
    return Cost(poll, poll.attempts, Span(poll.request, longest))


class Round:
    """One master's cycle with a cost for each of its cyclic polls, of which there must be some.

    ``ordered``: no commands come between.
    """

    def __init__(self, master_timing: MasterTiming, costs: Sequence[Cost], *, ordered: bool) -> None:
        self._master_timing = master_timing
        self._ordered = ordered
        self._costs = costs
        self._late = master_timing.interval if master_timing.begins_late else 0
        self._alone = [cost.alone(master_timing) for cost in costs]
        #: The longest time that all turns take, one each, in any order.
        self.all = sum(span.most for span in self._alone)
        periods = {cost.poll.every for cost in costs}
        same_start = len({cost.poll.at for cost in costs}) == 1
        #: Whether the list goes round and round: every poll is due again when its turn comes, since it has
        #: no period, or since one turn of each poll takes longer than its period.
        self.continuous = periods == {0} or (
            same_start and max(periods) <= sum(cost.own(master_timing) + self._late for cost in costs)
        )
        #: Whether every turn is over before the poll comes due again.
        self.fits = 0 not in periods and self.all + master_timing.idle <= min(periods)
        # All come due at once and have their turns in the list's order.
        self._simultaneous = self.fits and len(periods) == 1 and same_start

    def time(self) -> Span:
        """From the beginning of the first turn to the end of the last."""
        costs, master_timing = self._costs, self._master_timing
        if self.continuous:
            # What is before the first request is the gap of the turn before, not the one that goes with
            # the last poll's own transaction.
            *others, last = costs
            gap = master_timing.gap(last.need if self._ordered else None)
            total = sum((cost.turn(master_timing) for cost in others), gap)
            taken, again = master_timing.taken(last.need), master_timing.turn(last.need)
            return Span(
                total.least + taken.least + (last.fewest - 1) * again.least - self._late,
                total.most + taken.most + (last.attempts - 1) * again.most - self._late,
            )
        least = sum(cost.own(master_timing) for cost in costs) + (len(costs) - 1) * self._late
        if self._simultaneous:
            return Span(least, self.all - self._late)
        # Each poll had its latest turn before this cycle, so that it is due a period after that turn began.
        wait = max(cost.poll.every - cost.own(master_timing) for cost in costs)
        return Span(least, max(0, wait) + master_timing.idle + self.all)

    def period(self) -> Span | None:
        """From cycle to cycle where the list goes round and round; None where the polls have periods."""
        return (
            sum((cost.turn(self._master_timing) for cost in self._costs), exactly(0))
            if self.continuous
            else None
        )

    def age(self, index: int) -> int:
        """How old what a poll read can become before the next values replace it."""
        cost, master_timing = self._costs[index], self._master_timing
        served, taken = cost.poll.served.least, master_timing.taken(cost.need).most
        if self.continuous:
            others = sum(other.turn(master_timing).most for other in self._costs if other is not cost)
            return others + cost.turn(master_timing).most - served + taken
        begun = master_timing.entry.least + served
        if not cost.poll.every:
            return self.all + taken - served
        if self._simultaneous and self._ordered:
            until = sum(span.most for span in self._alone[: index + 1])
            before = sum(other.own(master_timing) + self._late for other in self._costs[:index])
            return cost.poll.every + master_timing.idle + until - before - begun
        return cost.poll.every + master_timing.idle + self.all - begun

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
        least = sum(cost.poll.frames / (self.all + master_timing.idle + cost.poll.every) for cost in costs)
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

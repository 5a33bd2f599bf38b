"""One setting of a port's poll list with its figures: timeout, retries and interval. Times in ticks."""

import math
from dataclasses import dataclass, replace

from bussim.exact.polls.failures import dependent, failures
from bussim.exact.polls.master_timing import exactly
from bussim.exact.polls.metrics import PollFigures, poll_figures
from bussim.exact.polls.poll_list import PollListModel, PollModel
from bussim.exact.sizing.noise_levels import BAD, LEVELS
from bussim.exact.text import in_ms
from bussim.plc.ports.cpavl import DEFAULT_INTERVAL, INTERVAL_UNIT, TIMEOUT_UNIT
from bussim.units import TICKS_PER_MS
from bussim.words.language import say

#: The longest timeout that the word +9 of a port holds, in units.
MOST_UNITS = 0xFFFF
#: Costs that differ by less than this share are the same.
_FREE = 1e-3


def with_setting(model: PollListModel, timeout: int, retries: int, interval: int) -> PollListModel:
    """The poll list with another setting; each poll has the same retries."""
    polls = tuple(replace(poll, retries=retries) for poll in model.polls)
    return replace(
        model, timeout=timeout, master_timing=model.master_timing.with_interval(interval), polls=polls
    )


def timeout_unit(model: PollListModel) -> int:
    """The step of timeouts: 10 ms in the word +9 of a PLC's port, 1 ms of a device."""
    return TICKS_PER_MS if model.words is None else TIMEOUT_UNIT


def least_timeout(model: PollListModel) -> int:
    """The least timeout that no response outlasts, neither a possible one nor a measured one; of its unit."""
    unit = timeout_unit(model)
    longest = max((poll.awaited.most - poll.request for poll in model.polls if poll.device), default=0)
    longest = max(longest, model.seen)
    return max(1, -(-longest // unit)) * unit


def failing_cost(model: PollListModel, timeout: int) -> float:
    """What one attempt of each poll costs on average that gets no response."""
    timing = model.master_timing
    total = 0.0
    for poll in model.polls:
        need = exactly(poll.request + timeout)
        mean = timing.mean(need)
        total += timing.turn(need).most if mean is None else sum(mean)
    return total


def top_of_step(model: PollListModel, timeout: int) -> int:
    """The longest timeout that costs no more than this one: what counts is the END after it."""
    unit, cost = timeout_unit(model), failing_cost(model, timeout)
    while timeout < MOST_UNITS * unit and failing_cost(model, timeout + unit) <= cost * (1 + _FREE):
        timeout += unit
    return timeout


def intervals(model: PollListModel) -> tuple[int, ...]:
    """Intervals in the order of trial: its own if longer than a port's default, that, what slaves need."""
    unit = TICKS_PER_MS if model.words is None else INTERVAL_UNIT
    least = max(1, -(-model.silence // unit)) * unit  # 0 in the word of a port stands for 5 ms
    default = max(DEFAULT_INTERVAL, least)
    return tuple(dict.fromkeys((max(model.master_timing.interval, default), default, least)))


@dataclass(frozen=True, slots=True)
class PortSetting:
    """One setting and its figures.

    ``errors`` are failed turns a year of all polls, NaN where they are not known (``reason``); ``cycle`` is
    the longest cycle without errors, with a turn of each command; ``dead`` what a cycle takes on average, at
    most, with the device dead that costs most, ``dead_longest`` the longest, ``two_dead`` the longest with
    the two devices dead that cost most (None where there are not so many); ``age`` is that of the oldest
    data without errors (None: nothing is read).
    """

    timeout: int
    retries: int
    interval: int
    figures: PollFigures
    errors: float
    reason: str

    @property
    def attempts(self) -> int:
        """Attempts of a turn at most."""
        return self.retries + 1

    @property
    def cycle(self) -> int | None:
        """See the class."""
        found = self.figures
        return None if found.cycle is None else found.cycle.most + (found.command or 0)

    @property
    def dead(self) -> float | None:
        """See the class."""
        return max((each.mean for each in self.figures.dead), default=None)

    @property
    def dead_longest(self) -> int | None:
        """See the class."""
        return max((each.cycle.most for each in self.figures.dead), default=None)

    @property
    def two_dead(self) -> int | None:
        """See the class."""
        found = (each.cycle.most for each in self.figures.more_dead if len(each.devices) == 2)
        return next(found, None)

    @property
    def age(self) -> int | None:
        """See the class."""
        ages = (one.before_refresh for one in self.figures.polls)
        return max((age for age in ages if age is not None), default=None)

    def value(self, goal: str) -> float:
        """The figure that a goal limits; 0 where there is no such figure."""
        found: dict[str, float | None] = {
            "errors": self.errors,
            "cycle": self.cycle,
            "dead": self.dead,
            "age": self.age,
        }
        return found[goal] or 0.0

    def to_json(self) -> dict[str, object]:
        """The setting and its figures, times in ms."""
        return {
            "timeout_ms": in_ms(self.timeout),
            "retries": self.retries,
            "interval_ms": in_ms(self.interval),
            "attempts": self.attempts,
            "failed_turns_per_year": None if math.isnan(self.errors) else self.errors,
            "reason": self.reason,
            "cycle_ms": in_ms(self.cycle),
            "one_dead_ms": {"mean_at_most": in_ms(self.dead), "max": in_ms(self.dead_longest)},
            "two_dead_ms": in_ms(self.two_dead),
            "age_ms": in_ms(self.age),
        }


def setting_of(model: PollListModel, timeout: int, retries: int, interval: int) -> PortSetting:
    """A setting of a poll list with its figures.

    Failures are the more of those with the noise as entered and at the assumed level bad.
    """
    changed = with_setting(model, timeout, retries, interval)
    figures = poll_figures(changed, means=False)
    reasons: dict[str, None] = {}
    worst = 0.0
    for one in figures.polls:
        poll, law = one.poll, one.failures
        if law is None or not poll.device:
            continue
        reasons |= dict.fromkeys(filter(None, (law.reason, dependent(changed, poll))))
        bad = failures(replace(changed, noise_reasons=()), at_level(poll, LEVELS[BAD]), law.a_year)
        worst += max(law.failed_a_year, bad.failed_a_year)
    reason = say("semicolon_list", texts=list(reasons)) if reasons else ""
    return PortSetting(timeout, retries, interval, figures, math.nan if reason else worst, reason)


def at_level(poll: PollModel, ber: float) -> PollModel:
    """A poll on a line with this bit error rate instead of its noise."""
    return replace(poll, hits=((poll.bits, ber),), loss=0.0)

"""The figures of one poll list: what ``bussim exact`` prints of it, and its JSON form."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

from bussim.exact.polls.cycle import Cost, Round, at_worst, failing, without_errors
from bussim.exact.polls.failures import Failures, failures
from bussim.exact.polls.master_timing import Span
from bussim.exact.polls.poll_list import PollListModel, PollModel
from bussim.exact.polls.text import remarks, when_off
from bussim.units import TICKS_PER_MS
from bussim.words.language import say


@dataclass(frozen=True, slots=True)
class OnePoll:
    """A poll without errors. Times in ticks; ages only of what is read again and again.

    ``response`` is from the request's end to the response's, ``transaction`` from the request's first edge
    to its taking over, ``turn`` to the next request. ``on_arrival`` and ``before_refresh`` are how old its
    values are at most when they are taken over, and when the next ones replace them, commands included;
    ``worst_refresh`` is the latter where every attempt of every poll is spent, but no turn of this one
    fails, and each turn that fails adds up to ``failed_turn``. ``failures`` are of polls without ``times``.
    """

    poll: PollModel
    response: Span
    transaction: Span
    turn: Span
    on_arrival: int | None
    before_refresh: int | None
    worst_refresh: int | None = None
    failed_turn: int | None = None
    failures: Failures | None = None

    def to_json(self) -> dict[str, object]:
        """The poll's entry of the JSON form, times in ms."""
        poll = self.poll
        return {
            "station": poll.station,
            "device": poll.device or None,
            "function": poll.function,
            "count": poll.count,
            "every_ms": _ms(poll.every) if poll.every else None,
            "at_ms": _ms(poll.at),
            "times": poll.times,
            "retries": poll.retries,
            "response_ms": span_json(self.response),
            "response_quantiles_ms": self._quantiles(),
            "failures": None if self.failures is None else self.failures.to_json(),
            "transaction_ms": span_json(self.transaction),
            "turn_ms": span_json(self.turn),
            "age_ms": {
                "on_arrival": _ms(self.on_arrival),
                "before_refresh": _ms(self.before_refresh),
                "worst": _ms(self.worst_refresh),
                "failed_turn": _ms(self.failed_turn),
            },
        }

    def _quantiles(self) -> dict[str, object]:
        """Of the response time, which is uniform but where the slave responds at its END."""
        least, width = self.response.least, self.response.most - self.response.least
        known = not self.poll.waits
        return {f"p{part}": _ms(least + width * part / 100) if known else None for part in (50, 95, 99)}


@dataclass(frozen=True, slots=True)
class Dead:
    """What follows if slaves are dead (``devices``).

    ``lost`` is what its attempts would cost if nothing but the timeout counted: attempts times timeout
    over the polls that ask it. ``cycle`` is what the whole cycle takes then, at least where turns are left
    out, ``mean`` what it takes at most on average over the turns that are made and those left out.
    """

    devices: tuple[str, ...]
    polls: tuple[PollModel, ...]
    lost: int
    cycle: Span
    mean: float

    def to_json(self) -> dict[str, object]:
        """The entry of the JSON form, times in ms."""
        return {
            "devices": list(self.devices),
            "polls": [poll.name for poll in self.polls],
            "attempts": sum(poll.attempts for poll in self.polls),
            "lost_ms": _ms(self.lost),
            "cycle_ms": {**span_json(self.cycle), "mean_at_most": _ms(self.mean)},
        }


@dataclass(frozen=True, slots=True)
class PollFigures:
    """Figures of one poll list. Times in ticks; None where there is no such figure.

    ``cycle`` and ``mean`` are without errors, from the second cycle on, and while no command (a poll with
    ``times``) has a turn; ``first`` is the longest first cycle, ``command`` what one turn of each command
    adds at most. ``worst`` is the longest cycle that there can be without responses, every attempt spent on
    every poll and command; ``disturbed`` the same where something else arrives at the end of each timeout, as
    long as it can last. ``load`` is the share of time for which the list's frames are on the wire, between
    two bounds, each with its response. ``dead`` is by slave; ``more_dead`` has the two and the three slaves
    whose loss costs most each, and all of them.
    """

    model: PollListModel
    cycle: Span | None = None
    first: int | None = None
    mean: float | None = None
    worst: int | None = None
    disturbed: int | None = None
    command: int | None = None
    worst_command: int | None = None
    load: tuple[float, float] | None = None
    polls: tuple[OnePoll, ...] = ()
    dead: tuple[Dead, ...] = ()
    more_dead: tuple[Dead, ...] = ()
    remarks: tuple[str, ...] = field(default=())

    @property
    def failed_a_year(self) -> float | None:
        """Failed turns of all cyclic polls a year; None where they are not known, or there is no noise."""
        found = [one.failures for one in self.polls if one.failures is not None]
        noisy = any(one.poll.hits or one.poll.loss for one in self.polls)
        if not noisy or any(each.reason for each in found):
            return None
        return math.fsum(each.failed_a_year for each in found)

    @property
    def all_dead(self) -> Dead | None:
        """What follows if every slave is dead."""
        return max((*self.dead, *self.more_dead), key=lambda dead: len(dead.devices), default=None)

    def to_json(self) -> dict[str, object]:
        """One list of the JSON form, times in ms. Quantities that do not exist are null."""
        model, cycle, load = self.model, self.cycle, self.load
        return {
            "valid": model.valid,
            "reasons": list(model.obstacles),
            "notes": [*model.notes, *self.remarks],
            "bus": model.bus,
            "protocol": model.protocol,
            "timeout_ms": _ms(model.timeout),
            "interval_ms": _ms(model.master_timing.interval),
            "cycle_ms": {**span_json(cycle), "mean": _ms(self.mean), "first": _ms(self.first)},
            "worst_case_ms": _ms(self.worst),
            "worst_case_disturbed_ms": _ms(self.disturbed),
            "command_ms": {"no_error": _ms(self.command), "worst": _ms(self.worst_command)},
            "failed_turns_per_year": self.failed_a_year,
            "bus_load": {"min": load[0] if load else None, "max": load[1] if load else None},
            "polls": {one.poll.name: one.to_json() for one in self.polls},
            "dead": {dead.devices[0]: dead.to_json() for dead in self.dead},
            "more_dead": [dead.to_json() for dead in self.more_dead],
            "all_dead": self.all_dead.to_json() if self.all_dead is not None else None,
        }

    def in_words(self) -> list[str]:
        """The figures that are read best as sentences: what a dead slave costs."""
        if not self.model.valid:
            return [say("poll_no_figures", reason=reason) for reason in self.model.obstacles]
        return [
            when_off(each.devices, each.polls, self.model.timeout, each.lost, each.cycle)
            for each in (*self.dead, *self.more_dead)
        ]


def poll_figures(model: PollListModel, *, means: bool = True) -> PollFigures:
    """Work out the figures of one poll list; without ``means`` bounds only, which takes less time."""
    if not model.valid:
        return PollFigures(model)
    silent, noisy = partial(at_worst, model), partial(at_worst, model, tail=model.tail)
    if not model.cyclic:
        longest = [
            sum(cost(poll).turn(model.master_timing).most for poll in model.commands)
            for cost in (without_errors, noisy)
        ]
        polls = tuple(_one_poll(model, None, None, poll) for poll in model.polls)
        return PollFigures(model, command=longest[0], worst_command=longest[1], polls=polls)
    clean, spent, worst = (_round(model, cost) for cost in (without_errors, silent, noisy))
    devices = dict.fromkeys(poll.device for poll in model.cyclic if poll.device)
    dead = tuple(_dead(model, (device,)) for device in devices)
    costly = [each.devices[0] for each in sorted(dead, key=lambda each: -each.cycle.most)]
    counts = [count for count in sorted({2, 3, len(costly)}) if 2 <= count <= len(costly)]
    return PollFigures(
        model,
        cycle=clean.time(),
        first=clean.first(),
        mean=clean.mean() if means else None,
        worst=spent.longest(),
        disturbed=worst.longest(),
        command=clean.commands if model.commands else None,
        worst_command=worst.commands if model.commands else None,
        load=clean.share(),
        polls=tuple(_one_poll(model, clean, worst, poll) for poll in model.polls),
        dead=dead,
        more_dead=tuple(
            _dead(model, tuple(each for each in devices if each in costly[:count])) for count in counts
        ),
        remarks=remarks(model, fits=clean.fits, continuous=clean.continuous),
    )


def _round(model: PollListModel, cost: Callable[[PollModel], Cost]) -> Round:
    skips = cost is not without_errors and any(poll.skip > 1 for poll in model.polls)
    cyclic, commands = ([cost(poll) for poll in polls] for polls in (model.cyclic, model.commands))
    return Round(model, cyclic, commands, skips=skips)


def _one_poll(model: PollListModel, clean: Round | None, worst: Round | None, poll: PollModel) -> OnePoll:
    """``clean`` and ``worst`` are the cycles without errors and at worst, None where no poll is cyclic."""
    master_timing, request = model.master_timing, poll.request
    taken = master_timing.taken(poll.need)
    one = OnePoll(
        poll,
        response=Span(poll.response_end.least - request, poll.response_end.most - request),
        transaction=taken,
        turn=master_timing.turn(poll.need),
        on_arrival=None,
        before_refresh=None,
    )
    if clean is not None and poll.cyclic:
        a_year = clean.turns_a_year(model.cyclic.index(poll))
        one = replace(one, failures=failures(model, poll, a_year))
    if not poll.reads:
        return one
    one = replace(one, on_arrival=min(taken.most - poll.served.least, poll.after + master_timing.late))
    if clean is None or worst is None or not poll.cyclic:
        return one
    index = model.cyclic.index(poll)
    return replace(
        one,
        before_refresh=clean.age(index),
        worst_refresh=worst.age(index, without_errors(poll)),
        failed_turn=worst.between(index) * poll.skip,
    )


def _dead(model: PollListModel, devices: tuple[str, ...]) -> Dead:
    hit = tuple(poll for poll in model.cyclic if poll.device in devices)
    cycle = _round(
        model, lambda poll: failing(model, poll) if poll.device in devices else without_errors(poll)
    )
    lost = sum(poll.attempts for poll in hit) * model.timeout
    time = cycle.time()
    others = replace(model, polls=tuple(poll for poll in model.polls if poll not in hit))
    least_skip = min(poll.skip for poll in hit)
    if least_skip == 1 or not others.cyclic:
        return Dead(devices, hit, lost, time, time.most)
    without = _round(others, without_errors).time()
    mean = without.most + max(0, time.most - without.most) / least_skip
    return Dead(devices, hit, lost, Span(without.least, time.most), mean)


def span_json(span: Span | None) -> dict[str, object]:
    """A time between two bounds, in ms."""
    return {"min": _ms(span.least if span else None), "max": _ms(span.most if span else None)}


def _ms(ticks: float | None) -> float | None:
    return None if ticks is None else ticks / TICKS_PER_MS

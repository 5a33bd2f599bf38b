"""The figures of one poll list: what ``bussim exact`` prints of it, and its JSON form."""

from __future__ import annotations

from dataclasses import dataclass, field

from bussim.exact.polls.cycle import Cost, Round, at_worst, failing
from bussim.exact.polls.master_timing import Span
from bussim.exact.polls.poll_list import PollListModel, PollModel
from bussim.exact.polls.text import remarks, when_off
from bussim.units import TICKS_PER_MS


@dataclass(frozen=True, slots=True)
class OnePoll:
    """A poll without errors. Times in ticks; ages only of what is read again and again.

    ``response`` is from the request's end to the response's, ``transaction`` from the request's first edge
    to its taking over, ``turn`` to the next request. ``on_arrival`` and ``before_refresh`` are how old its
    values are at most when they are taken over, and when the next ones replace them.
    """

    poll: PollModel
    response: Span
    transaction: Span
    turn: Span
    on_arrival: int | None
    before_refresh: int | None

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
            "transaction_ms": span_json(self.transaction),
            "turn_ms": span_json(self.turn),
            "age_ms": {"on_arrival": _ms(self.on_arrival), "before_refresh": _ms(self.before_refresh)},
        }


@dataclass(frozen=True, slots=True)
class Dead:
    """What follows if a slave is dead (``device``), or if all are (``device`` is "").

    ``lost`` is what its attempts would cost if nothing but the timeout counted: attempts times timeout
    over the polls that ask it. ``cycle`` is what the whole cycle takes then.
    """

    device: str
    polls: tuple[PollModel, ...]
    lost: int
    cycle: Span

    def to_json(self) -> dict[str, object]:
        """The entry of the JSON form, times in ms."""
        return {
            "polls": [poll.name for poll in self.polls],
            "attempts": sum(poll.attempts for poll in self.polls),
            "lost_ms": _ms(self.lost),
            "cycle_ms": span_json(self.cycle),
        }


@dataclass(frozen=True, slots=True)
class PollFigures:
    """Figures of one poll list. Times in ticks; None where there is no such figure.

    ``cycle`` and ``mean`` are without errors, from the second cycle on, and while no command (a poll with
    ``times``) has a turn; ``worst`` is the longest cycle that there can be, every attempt spent for as
    long as it can last. ``command`` is what one turn of a command adds at most, without errors and at
    worst. ``load`` is the share of time for which the list's frames are on the wire, between two bounds,
    each with its response.
    """

    model: PollListModel
    cycle: Span | None = None
    mean: float | None = None
    worst: int | None = None
    command: int | None = None
    worst_command: int | None = None
    load: tuple[float, float] | None = None
    polls: tuple[OnePoll, ...] = ()
    dead: tuple[Dead, ...] = ()
    all_dead: Dead | None = None
    remarks: tuple[str, ...] = field(default=())

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
            "cycle_ms": {**span_json(cycle), "mean": _ms(self.mean)},
            "worst_case_ms": _ms(self.worst),
            "command_ms": {"no_error": _ms(self.command), "worst": _ms(self.worst_command)},
            "bus_load": {"min": load[0] if load else None, "max": load[1] if load else None},
            "polls": {one.poll.name: one.to_json() for one in self.polls},
            "dead": {dead.device: dead.to_json() for dead in self.dead},
            "all_dead": self.all_dead.to_json() if self.all_dead is not None else None,
        }

    def in_words(self) -> list[str]:
        """The figures that are read best as sentences: what a dead slave costs."""
        if not self.model.valid:
            return [f"no figures: {reason}" for reason in self.model.obstacles]
        dead = self.dead if self.all_dead is None or len(self.dead) < 2 else (*self.dead, self.all_dead)
        return [when_off(each.device, each.polls, self.model.timeout, each.lost, each.cycle) for each in dead]


def poll_figures(model: PollListModel) -> PollFigures:
    """Work out the figures of one poll list."""
    if not model.valid:
        return PollFigures(model)
    cyclic, commands = model.cyclic, model.commands
    command = _longest_turn(model, [Cost(poll, 1, poll.need) for poll in commands])
    worst_command = _longest_turn(model, [at_worst(model, poll) for poll in commands])
    if not cyclic:
        polls = tuple(_one_poll(model, None, poll) for poll in model.polls)
        return PollFigures(model, command=command, worst_command=worst_command, polls=polls)
    clean = _round(model, [Cost(poll, 1, poll.need) for poll in cyclic])
    dead = tuple(_dead(model, device) for device in dict.fromkeys(p.device for p in cyclic if p.device))
    worst = _round(model, [at_worst(model, poll) for poll in cyclic])
    return PollFigures(
        model,
        cycle=clean.time(),
        mean=clean.mean(),
        worst=worst.time().most,
        command=command,
        worst_command=worst_command,
        load=clean.share(),
        polls=tuple(_one_poll(model, clean, poll) for poll in model.polls),
        dead=dead,
        all_dead=_dead(model, "") if dead else None,
        remarks=remarks(model, fits=clean.fits, continuous=clean.continuous),
    )


def _round(model: PollListModel, costs: list[Cost]) -> Round:
    return Round(model.master_timing, costs, ordered=not model.commands)


def _one_poll(model: PollListModel, clean: Round | None, poll: PollModel) -> OnePoll:
    """``clean`` is the cycle without errors, None where no poll is cyclic."""
    master_timing, request = model.master_timing, poll.request
    taken = master_timing.taken(poll.need)
    arrival = refresh = None
    if poll.reads:
        arrival = min(taken.most - poll.served.least, poll.after + master_timing.late)
        refresh = clean.age(model.cyclic.index(poll)) if clean is not None and poll.cyclic else None
    return OnePoll(
        poll,
        response=Span(poll.response_end.least - request, poll.response_end.most - request),
        transaction=taken,
        turn=master_timing.turn(poll.need),
        on_arrival=arrival,
        before_refresh=refresh,
    )


def _dead(model: PollListModel, device: str) -> Dead:
    """The figures with a dead slave; "": with all of them dead."""
    hit = tuple(poll for poll in model.cyclic if poll.device and device in ("", poll.device))
    costs = [failing(model, poll) if poll in hit else Cost(poll, 1, poll.need) for poll in model.cyclic]
    lost = sum(poll.attempts for poll in hit) * model.timeout
    return Dead(device, hit, lost, _round(model, costs).time())


def _longest_turn(model: PollListModel, costs: list[Cost]) -> int | None:
    return max((cost.alone(model.master_timing).most for cost in costs), default=None)


def span_json(span: Span | None) -> dict[str, object]:
    """A time between two bounds, in ms."""
    return {"min": _ms(span.least if span else None), "max": _ms(span.most if span else None)}


def _ms(ticks: float | None) -> float | None:
    return None if ticks is None else ticks / TICKS_PER_MS

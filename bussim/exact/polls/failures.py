"""How often attempts and turns of a poll fail, where each attempt fails independently of the others.

An attempt is good if none of its bits is damaged, the reply is not lost and its response is in time; a turn
fails if all of its attempts do. That does not hold where a response can still be under way when the next
request leaves, which may take it for its own or be damaged by it, nor for a slave that responds at its END
where some responses are too late: the wait for END goes on from one attempt to the next.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import assert_never

from bussim.exact.polls.poll_list import PollListModel, PollModel
from bussim.scenario.fault_kinds import Direction
from bussim.scenario.model import ALWAYS, BitErrors, Burst, Impulse, Noise, ReplyLoss
from bussim.words.language import say


@dataclass(slots=True)
class LineErrors:
    """Noise on a bus for one master, by the slave that it asks, "" for each.

    ``requests`` and ``replies`` have bit error rates, ``lost`` the chances that a reply vanishes whole;
    ``reasons`` say what is not worked out.
    """

    requests: dict[str, list[float]] = field(default_factory=dict)
    replies: dict[str, list[float]] = field(default_factory=dict)
    lost: dict[str, list[float]] = field(default_factory=dict)
    reasons: list[str] = field(default_factory=list)

    @classmethod
    def of(cls, noises: Iterable[Noise], bus: str, master: str) -> LineErrors:
        """The noise of a bus as one of its masters meets it."""
        found = cls()
        for noise in noises:
            if noise.target.bus == bus and not noise.harmless:
                found._add(noise, master)
        return found

    def _add(self, noise: Noise, master: str) -> None:
        if noise.window != ALWAYS:
            self.reasons.append(say("poll_noise_partly", name=noise.name))
            return
        match noise.kind:
            case BitErrors(ber):
                self._bits(noise, master, ber)
            case Burst(ber_good=good, ber_bad=bad) if good == bad:
                self._bits(noise, master, good)
            case ReplyLoss(probability):
                self.lost.setdefault(noise.target.station or "", []).append(probability)
            case Burst() | Impulse():
                self.reasons.append(say("poll_noise_bursts", name=noise.name))
            case _ as never:
                assert_never(never)

    def _bits(self, noise: Noise, master: str, rate: float) -> None:
        station, received = noise.target.station, noise.target.direction is Direction.RX
        slave = station if station is not None and station != master else ""
        if station is None or received == (station == master):
            self.replies.setdefault(slave, []).append(rate)
        if station is None or received != (station == master):
            self.requests.setdefault(slave, []).append(rate)

    def hits(self, device: str, request: int, response: int) -> tuple[tuple[int, float], ...]:
        """The bits of a transaction with a slave, in numbers that have a bit error rate each."""
        return (
            *((request, rate) for name in ("", device) for rate in self.requests.get(name, ())),
            *((response, rate) for name in ("", device) for rate in self.replies.get(name, ())),
        )

    def loss(self, device: str) -> float:
        """The chance that a slave's reply vanishes."""
        return 1 - math.prod(1 - chance for name in ("", device) for chance in self.lost.get(name, ()))


def in_time(poll: PollModel, timeout: int) -> float | None:
    """The chance that a response comes before the timeout (ticks); None where it is not known."""
    end, last = poll.awaited, poll.request + timeout
    if end.most <= last:
        return 1.0
    if end.least > last:
        return 0.0
    return None if poll.waits else (last - end.least + 1) / (end.most - end.least + 1)


def dependent(model: PollListModel, poll: PollModel) -> str:
    """Why the attempts of a poll do not fail independently of each other, in words; "" if they do."""
    chance = in_time(poll, model.timeout)
    if chance is None:
        return say("poll_end_wait", device=poll.device)
    following = poll.request + model.timeout + model.master_timing.gap().least
    if chance < 1 and poll.response_end.most > following:
        return say("poll_meets_next", device=poll.device)
    return ""


def attempt_fails(model: PollListModel, poll: PollModel) -> float:
    """The chance that an attempt of a poll fails. Bit errors that a check does not see are no failures."""
    good = (in_time(poll, model.timeout) or 0.0) * (1 - poll.loss)
    undamaged = math.fsum(bits * math.log1p(-rate) for bits, rate in poll.hits)
    return 0.0 - math.expm1(undamaged) if good == 1 else 1 - good * math.exp(undamaged)


@dataclass(frozen=True, slots=True)
class Failures:
    """How often a poll fails: chances of an ``attempt`` and of a ``turn``, and turns ``a_year`` at most.

    ``reason`` says why they are not known (the chances are 1 then).
    """

    attempt: float
    turn: float
    a_year: float
    reason: str = ""

    @property
    def failed_a_year(self) -> float:
        """Failed turns a year."""
        return self.turn * self.a_year

    def to_json(self) -> dict[str, object]:
        """As plain data; null where it is not known."""
        known = not self.reason
        return {
            "attempt_fails": self.attempt if known else None,
            "turn_fails": self.turn if known else None,
            "failed_turns_per_year": self.failed_a_year if known else None,
            "reason": self.reason,
        }


def failures(model: PollListModel, poll: PollModel, a_year: float) -> Failures:
    """The failures of a poll with so many turns a year. A broadcast cannot fail."""
    if not poll.device:
        return Failures(0.0, 0.0, a_year)
    reasons = list(model.noise_reasons)
    reason = say("semicolon_list", texts=reasons) if reasons else dependent(model, poll)
    if reason:
        return Failures(1.0, 1.0, a_year, reason)
    fails = attempt_fails(model, poll)
    return Failures(fails, fails**poll.attempts, a_year)

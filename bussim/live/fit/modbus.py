"""Estimates from a recording of a bus with a Modbus master: polls, periods, responses, loss, bit errors."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import assert_never

from bussim.engines.modbus.adu import Adu
from bussim.line.characters import CharFormat, LineTiming
from bussim.live.fit.clusters import Attempt
from bussim.live.fit.comparison import Behaviour
from bussim.live.fit.noise import MASTER, UNKNOWN, FrameLog, MasterReceiver, NoiseEstimate, received
from bussim.live.fit.outages import DAMAGED, REPLIED, SILENT, Losses, Outcomes, losses
from bussim.live.fit.polls import PollEstimate, Request, Turn, numbered, polls_of, repeats_of
from bussim.live.fit.statistics import Estimate, mean
from bussim.live.fit.turnaround import TurnaroundDistribution, distribution_of
from bussim.live.sniff.decoder import Line
from bussim.live.sniff.functions import Asked, usual_size
from bussim.live.sniff.heard import Heard, LineProtocol, Verdict
from bussim.live.sniff.modbus import ModbusDecoder, Open
from bussim.trace.records import TransactionRecord
from bussim.trace.sink import Sink

#: What an attempt was to its station. A wrong answer is one: its device is at fault, not the line.
_OUTCOMES = {
    "ok": REPLIED,
    "exception": REPLIED,
    "wrong_answer": REPLIED,
    "no_answer": SILENT,
    "damaged": DAMAGED,
}
#: The kind of a frame whose length nothing tells.
_ANY = "any"


@dataclass(frozen=True, slots=True)
class SlaveEstimate:
    """A slave: from the end of a request to the first edge of its response (ticks), and which got none."""

    station: int
    requests: int
    delay: Estimate | None
    distribution: TurnaroundDistribution | None
    losses: Losses
    wrong: int  # wrong answers
    exceptions: dict[int, int]


@dataclass(frozen=True, slots=True)
class BusEstimate:
    """A bus with one Modbus master. Times in ticks.

    ``behaviour``: its times are those of attempts, from a request's first edge to the end of its response or
    of the wait for it, its distances those of requests.
    """

    protocol: LineProtocol
    baud: int
    format: str
    polls: tuple[PollEstimate, ...]
    slaves: tuple[SlaveEstimate, ...]
    interval: int | None  # shortest pause from a response to the next request
    timeout: int | None  # shortest wait after a request without a response…
    timeout_between: tuple[int, int] | None  # …or the middle of these, where no wait shows it
    noise: NoiseEstimate
    silence: int  # of the line: the end of a frame
    behaviour: Behaviour
    frames: int
    damaged: int
    begin: int
    recording: str = ""  # where it was measured


@dataclass(slots=True)
class _Slave:
    delays: array[int] = field(default_factory=lambda: array("q"))
    attempts: Outcomes = field(default_factory=Outcomes)
    wrong: int = 0
    exceptions: Counter[int] = field(default_factory=Counter)

    def estimate(self, station: int, lost: Losses, resolution: int) -> SlaveEstimate:
        """What is known of it, from times that are exact to ``resolution`` ticks."""
        delay = mean(self.delays).widened(resolution) if self.delays else None
        law = distribution_of(self.delays) if self.delays else None
        exceptions, requests = dict(sorted(self.exceptions.items())), len(self.attempts.outcomes)
        return SlaveEstimate(station, requests, delay, law, lost, self.wrong, exceptions)


class BusObserver(ModbusDecoder):
    """Decodes a Modbus bus, and keeps what the estimates need."""

    def __init__(self, line: Line, sink: Sink) -> None:
        super().__init__(line, sink)
        self._protocol = LineProtocol.RTU
        self._slaves: dict[int, _Slave] = {}
        self._bits = CharFormat.parse(line.format).bits
        self._log = FrameLog(self._bits)
        self._turns: list[Turn] = []
        self._exchanges = array("q")
        self._begin: int | None = None
        self._damaged_requests: dict[int, Attempt] = {}  # by the number of the frame
        self._latest_damage = -1  # number of the latest damaged frame
        self._replied: Asked | None = None  # the request that is being replied to…
        self._reply_bits = 0  # …and the bits of the reply
        self._two_characters = LineTiming(line.baud, CharFormat.parse(line.format)).characters(2)
        self._pause = line.silence  # of the master behind a reply
        self._latest: tuple[_Slave, int] | None = None  # of the latest attempt: its slave, its number
        #: Damaged responses that were not asked for again: attempt, frame, slave, number of the attempt.
        self._unrepeated: list[tuple[int, int, _Slave, int]] = []

    def heard(self, heard: Heard) -> None:
        """Take in a frame."""
        self._protocol = heard.protocol
        if self._begin is None:
            self._begin = heard.start
        super().heard(heard)

    def _count(self, heard: Heard, kind: str, sender: str) -> None:
        """Keep frames, in the order in which it is known what they are."""
        super()._count(heard, kind, sender)
        match heard.verdict:
            case Verdict.DAMAGED:
                self._hear_damage(heard)
            case Verdict.SOUND:
                self._hear_sound(heard, kind)
            case Verdict.STRAY | Verdict.TORN:
                pass
            case _:
                assert_never(heard.verdict)

    def _hear_damage(self, heard: Heard) -> None:
        """A damaged frame is the reply to the open request, the first one behind it, or else a request."""
        open_, size = self._open, len(heard.chars)
        replies = open_ is not None and not open_.damaged
        who, what = MASTER, _ANY
        if replies and open_ is not None:
            usual = usual_size(open_.asked)
            who, what = open_.asked.station, open_.asked.name
            size = self._chars(usual) if usual else size
        number = self._log.add(heard.start, heard.end, size, who, (who > 0, what), damaged=True)
        self._latest_damage = number
        if not replies:
            self._damaged_requests[number] = Attempt(heard.start, None, failed=True)

    def _hear_sound(self, heard: Heard, kind: str) -> None:
        who, what = UNKNOWN, _ANY
        if kind == "request":
            who = MASTER
        elif kind in ("response", "exception") and self._replied is not None:
            who = self._replied.station
            what = self._replied.name if kind == "response" else _ANY
        self._log.add(heard.start, heard.end, len(heard.chars), who, (who > 0, what), damaged=False)

    def _chars(self, pdu: int) -> int:
        """The characters of a frame with a PDU of so many."""
        return 2 * pdu + 7 if self._protocol is LineProtocol.ASCII else pdu + 3

    def _request(self, heard: Heard, asked: Asked) -> None:
        dropped, attempt = self._dropped.total(), 1
        if self._open is not None:
            attempt = self._open.attempt
        elif self._failed is not None:
            attempt = self._failed[1]
        super()._request(heard, asked)
        if self._dropped.total() > dropped and self._latest is not None:
            self._unrepeated.append((attempt, self._latest_damage, *self._latest))

    def _respond(self, heard: Heard, open_: Open, exception: int | None = None) -> None:
        self._replied, self._reply_bits = open_.asked, len(heard.chars) * self._bits
        super()._respond(heard, open_, exception)

    def _frame(self, heard: Heard, frame: Adu) -> None:
        recorder = self.recorder_damage
        super()._frame(heard, frame)
        if self.recorder_damage > recorder:  # the request before it was damaged, and its station heard it
            self._log.withdraw(self._latest_damage)
            self._damaged_requests.pop(self._latest_damage, None)

    def _take(self, record: TransactionRecord) -> None:
        super()._take(record)
        if record.sent is None or record.asked is None or record.outcome == "undecided":
            return
        request = (record.station, record.function, record.address, record.quantity)
        of_reply = record.answer_end, self._reply_bits, record.outcome
        self._turns.append(Turn(request, record.attempt, record.sent, record.asked, *of_reply))
        outcome = _OUTCOMES.get(record.outcome)
        if outcome is None:
            return
        slave = self._slaves.setdefault(record.station, _Slave())
        self._latest = slave, len(slave.attempts.outcomes)
        slave.attempts.add(outcome, record.sent, record.asked)
        slave.wrong += record.outcome == "wrong_answer"
        self._exchanges.append(record.end - record.sent)
        if record.answer_start is not None:
            slave.delays.append(max(0, record.answer_start - record.asked))
            slave.exceptions.update([record.exception] if record.exception else ())

    # -- estimating ----------------------------------------------------------------------------

    def estimate(self, resolution: int = 0, span: int = 0, *, timed: bool = True) -> BusEstimate | None:
        """The estimates from times that are exact to ``resolution`` ticks, in a recording of ``span`` ticks.

        None where no request was heard. Without ``timed`` there are no times, and nothing is said of any.
        """
        if not self._turns:
            return None
        self._turns = turns = numbered(self._turns) if timed else self._turns
        for slave in self._slaves.values() if not timed else ():
            slave.delays = array("q")
        self._leave_out_recorder()
        found = {
            number: losses({number: slave.attempts})[number] for number, slave in sorted(self._slaves.items())
        }
        attempts = [
            Attempt(start, number, outcome != REPLIED)
            for number, lost in found.items()
            for start, outcome in self._slaves[number].attempts.apart_from(lost)
        ]
        repeats = repeats_of(turns) if timed else None
        unasked = frozenset(repeats or ())
        pauses = [
            turn.sent - before.replied
            for number, (before, turn) in enumerate(pairwise(turns), 1)
            if before.replied is not None and number not in unasked
        ]
        self._pause = max(self._line.silence, min(pauses, default=0))
        polls = polls_of(turns, unasked, span, timed=timed)
        timeout, between = self._timeout(unasked, polls) if timed else (None, None)
        noise = self._log.estimate(
            [*attempts, *self._damaged_requests.values()], self._master_receiver(repeats), timed=timed
        )
        return BusEstimate(
            protocol=self._protocol,
            baud=self._line.baud,
            format=self._line.format,
            polls=polls,
            slaves=tuple(
                self._slaves[number].estimate(number, lost, resolution) for number, lost in found.items()
            ),
            interval=max(0, min(pauses)) if pauses and timed else None,
            timeout=timeout,
            timeout_between=between,
            noise=noise,
            silence=self._line.silence,
            behaviour=Behaviour(
                times=self._exchanges,
                distances=[turn.sent - before.sent for before, turn in pairwise(turns)],
                failed=noise.bursts.failures,
                attempts=noise.bursts.attempts,
                again=noise.bursts.p_fail_after_fail,
                load=self.busy / span if span else 0.0,
            ),
            frames=self.frames,
            damaged=self.damaged,
            begin=self._begin or 0,
        )

    def _timeout(
        self, repeats: frozenset[int], polls: Sequence[PollEstimate]
    ) -> tuple[int | None, tuple[int, int] | None]:
        """The master's timeout, and between what it is where no wait shows it.

        A wait does not show it if what was requested next was due just then. Behind a sound reply that the
        master has not heard it waits as long, but there a turn that is due may look like a repeat.
        """
        usual = {each.request: (each.low or 0, each.high or 0) for each in polls}
        slack = self._line.silence + self._line.slack
        latest: dict[Request, int] = {}
        waits: list[int] = []
        unheard: list[int] = []
        hidden: list[int] = []
        longest = 0
        for number, (before, turn) in enumerate(pairwise(self._turns), 1):
            if before.attempt == 1 and number - 1 not in repeats:
                latest[before.request] = before.sent
            wait, (low, high) = turn.sent - before.asked, usual[turn.request]
            if number in repeats:
                if not self._at_once(before, turn):  # behind damage it does not wait
                    unheard.append(wait)
            elif before.replied is not None:
                longest = max(longest, before.replied - before.asked)
            elif before.outcome == "no_answer":
                since = latest.get(turn.request)  # None: whether it was due is not known
                on_time = since is None or low - slack <= turn.sent - since <= high + slack
                due = turn.attempt == 1 and on_time
                (hidden if due else waits).append(wait)
        if waits or unheard:
            return max(min(waits or unheard), self._line.silence), None
        if not hidden:
            return None, None
        between = longest, min(hidden)
        return max(sum(between) // 2, self._line.silence), between

    def _at_once(self, before: Turn, turn: Turn) -> bool:
        """Whether a request comes behind the reply to the one before as soon as others do."""
        wait = turn.sent - (before.replied or before.asked)
        return wait <= self._pause + self._line.slack + self._two_characters

    def _leave_out_recorder(self) -> None:
        """What was damaged at the recorder only enters no rate."""
        for attempt, frame, slave, number in self._unrepeated if self.repeats_after_damage else ():
            if attempt < self._most_attempts:
                self._log.withdraw(frame)
                slave.attempts.outcomes[number] = REPLIED
        self._unrepeated.clear()

    def _master_receiver(self, repeats: Sequence[int] | None) -> MasterReceiver:
        if repeats is None:
            return MasterReceiver()
        if not repeats and max(turn.attempt for turn in self._turns) == 1:
            return MasterReceiver(0)  # a master that never repeats does not show what it has not taken
        damaged, unheard = Counter[int](), Counter[int]()
        for number in repeats:
            before, turn = self._turns[number - 1 : number + 1]
            (damaged if self._at_once(before, turn) else unheard)[before.reply_bits] += 1
        return received(self._log.replies(), damaged, unheard)

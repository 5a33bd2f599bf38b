"""Modbus traffic as a listener sees it: requests paired with their responses.

A frame is a response if a request of its station and function is open and it fits that request; else it is
a request if its function, byte count and quantity allow that; else it is a response without a request, or a
wrong one. A write to one coil or register and its response are the same bytes: which is which is known by
the wires that they come on, by an echo, or by the times between frames that are all alike.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import log
from statistics import median

from bussim.engines.modbus.adu import LAST_STATION, Adu
from bussim.engines.modbus.codes import PortError
from bussim.engines.modbus.pdu import EXCEPTION_BIT
from bussim.live.sniff.decoder import Decoder, Line
from bussim.live.sniff.functions import REPEATED, Asked, asked_of, responds, response_size
from bussim.live.sniff.heard import Heard, Verdict
from bussim.trace.records import BusTotals, TransactionRecord
from bussim.trace.sink import Sink
from bussim.units import TICKS_PER_SECOND

#: Outcomes of an exchange, and the port error that a PLC would have of each.
ERRORS = {
    "no_answer": PortError.TIMEOUT,
    "damaged": PortError.CHECK,
    "wrong_answer": PortError.LENGTH,
    **dict.fromkeys(("ok", "exception", "broadcast", "unclear", "undecided")),
}
#: Outcomes of what is no attempt at an exchange.
NO_ATTEMPT = frozenset(("broadcast", "undecided"))
#: Two frames that are alike are request and response if the second comes after at most so many times the
#: slowest response of its station, or of nothing is known, after so many ticks.
_SLOWEST, _FIRST = 3, TICKS_PER_SECOND
#: The medians of waits for responses and of pauses differ at least by this factor, or nothing is decided.
_APART = 1.5
#: So many frames that are alike are evaluated at once at most.
_MOST_ALIKE = 512
#: The share of requests that come twice where the recording has echoes, in tenths.
_ECHOED = 9


@dataclass(slots=True)
class Open:
    """A request without a response so far."""

    asked: Asked
    heard: Heard
    attempt: int
    damaged: bool = False
    wrong: bool = False
    lost: bool = False
    echoed: bool = False


class ModbusDecoder(Decoder):
    """Records the transactions and frames on one bus."""

    def __init__(self, line: Line, sink: Sink) -> None:
        super().__init__(line, sink)
        self._open: Open | None = None
        self._alike: list[Heard] = []  # frames whose direction their neighbours will show
        self._alike_asked: Asked | None = None
        #: The latest failed attempt: its request, number and outcome.
        self._failed: tuple[Heard, int, str] | None = None
        self._slowest: dict[int, int] = {}
        self._master_wire: int | None = None
        self._distinct = 0  # requests that cannot be taken for their responses…
        self._doubled = 0  # …and those of them that came twice at once
        self._damaged_request = False  # the latest frame was damaged and no request was open
        self._most_attempts = 1
        self._repeated = 0
        self._dropped: Counter[int] = Counter()  # damaged responses without a repeat, by attempt
        self.late = 0  # responses that came after the master's timeout
        self.wrong_seen = 0  # wrong responses that the right one followed
        self.stations: set[int] = set()
        self.reserved: set[int] = set()  # stations beyond 247 that were asked

    def expected(self, wire: int) -> Asked | None:
        """The request that is open for a response on a wire."""
        if self._alike:
            return self._alike_asked
        open_ = self._open
        if open_ is None or (self._line.wires > 1 and open_.heard.wire == wire):
            return None
        return open_.asked

    @property
    def echo(self) -> bool:
        """Whether each request is heard twice."""
        if self._line.echo is not None:
            return self._line.echo
        return self._doubled > 0 and 10 * self._doubled >= _ECHOED * self._distinct

    @property
    def repeats_after_damage(self) -> bool:
        """Whether the master repeats after failures, so that it has taken what it does not repeat."""
        return self._repeated > self._dropped.total()

    # -- what is heard -------------------------------------------------------------------------

    def heard(self, heard: Heard) -> None:
        """See the base class."""
        frame = heard.frame
        alike = self._alike
        if alike and not _same(heard, alike[0]):
            if heard.verdict in (Verdict.STRAY, Verdict.TORN):
                self._count(heard, heard.verdict.value, "unknown")
                return
            self._settle()
        if not isinstance(frame, Adu):
            self._count(heard, heard.verdict.value, "unknown")
            if heard.verdict is Verdict.DAMAGED:
                self._damaged_request = self._open is None
                if self._open is not None:
                    self._open.damaged = True
        elif self._alike:
            self._alike.append(heard)
            if len(self._alike) >= _MOST_ALIKE:
                self._settle()
        else:
            self._frame(heard, frame)

    def lost(self) -> None:
        """See the base class."""
        self._settle()
        if self._open is not None:
            self._open.lost = True

    def close(self) -> None:
        """See the base class."""
        self._settle()
        open_, self._open = self._open, None
        if open_ is not None:
            self._transaction(open_, None, "undecided", open_.heard.end)
        if self.repeats_after_damage:
            self.recorder_damage += sum(n for k, n in self._dropped.items() if k < self._most_attempts)

    def _frame(self, heard: Heard, frame: Adu) -> None:
        open_, asked = self._open, asked_of(frame.station, frame.pdu)
        several = self._line.wires > 1
        other_wire = several and open_ is not None and open_.heard.wire != heard.wire
        if asked is not None and asked.function in REPEATED and not several and not asked.without_response:
            self._alike, self._alike_asked = [heard], asked
        elif open_ is not None and self._is_double(heard, open_) and not several:
            self._twice(heard, open_)
        elif (
            open_ is not None
            and (other_wire or not several)
            and frame.station == open_.asked.station
            and responds(frame.pdu, open_.asked)
        ):
            self._respond(heard, open_, frame.pdu[1] if frame.pdu[0] & EXCEPTION_BIT else None)
        elif asked is not None and (not several or self._master_wire in (None, heard.wire)):
            self._request(heard, asked)
        else:
            self._count(heard, "unknown", "unknown")
            if open_ is not None:
                open_.wrong = True
            else:
                self.unasked += 1
                self.recorder_damage += self._damaged_request
            self._damaged_request = False

    def _is_double(self, heard: Heard, open_: Open) -> bool:
        """Whether a frame repeats the open request closer than any master does that heard nothing."""
        behind = not (open_.echoed or open_.damaged or open_.wrong)
        return behind and self._close(open_.heard, heard) and _same(heard, open_.heard)

    def _twice(self, heard: Heard, open_: Open) -> None:
        open_.echoed = True
        self._doubled += 1
        self._drop(heard)

    def _drop(self, heard: Heard) -> None:
        """A frame that came twice: an echo, or a stray."""
        echo = self.echo
        self.echoes += echo
        verdict = Verdict.TORN if echo else Verdict.STRAY
        self._count(heard._replace(verdict=verdict), "echo" if echo else "stray", "unknown")

    def _request(self, heard: Heard, asked: Asked) -> None:
        self._fail(heard.start)
        self._count(heard, "request", "master")
        self._damaged_request = False
        attempt = 1
        if self._failed is not None:
            failed, number, outcome = self._failed
            if _same(failed, heard):
                attempt = number + 1
                self._repeated += 1
                self._most_attempts = max(attempt, self._most_attempts)
            elif outcome == "damaged":
                self._dropped[number] += 1
            self._failed = None
        if asked.station > LAST_STATION:
            self.reserved.add(asked.station)
        self._distinct += asked.function not in REPEATED
        open_ = Open(asked, heard, attempt)
        if asked.without_response:
            self._transaction(open_, None, "broadcast", heard.end)
        else:
            self._open = open_

    def _respond(self, heard: Heard, open_: Open, exception: int | None = None) -> None:
        asked = open_.asked
        self._open = None
        self.stations.add(asked.station)
        took = heard.start - open_.heard.end
        if exception is not None or asked.function not in REPEATED:
            self._slowest[asked.station] = max(took, self._slowest.get(asked.station, 0))
        if self._line.wires > 1:
            self._master_wire = open_.heard.wire
        self.late += open_.attempt > 1 and took < self._line.silence
        self.wrong_seen += open_.wrong
        kind = "response" if exception is None else "exception"
        self._count(heard, kind, f"station {asked.station}")
        self._transaction(open_, heard, "ok" if exception is None else kind, heard.end, exception or 0)

    def _fail(self, now: int) -> None:
        """The master goes on: what is open has failed."""
        open_, self._open = self._open, None
        if open_ is None:
            return
        pdu = open_.asked.pdu
        if self.frames == 1 and response_size(pdu, 0, None) == len(pdu):
            # By its bytes the first frame may be a response as well, and nothing replied to it.
            self.unasked += 1
            return
        outcome = "wrong_answer" if open_.wrong else "damaged" if open_.damaged else "no_answer"
        if open_.lost:
            outcome = "undecided"
        else:
            self._failed = (open_.heard, open_.attempt, outcome)
        self._transaction(open_, None, outcome, now)

    # -- frames that are all alike -------------------------------------------------------------

    def _settle(self) -> None:
        """Say of frames that are all alike which are requests and which responses."""
        frames, self._alike = self._alike, []
        asked = self._alike_asked
        if not frames or asked is None:
            return
        if self.echo:
            self._settle_echoes(frames, asked)
            return
        if not self._line.slack:
            closest = self._line.closest
            doubles = [after for before, after in pairwise(frames) if after.start - before.end < closest]
            for heard in doubles:
                frames.remove(heard)
                self._drop(heard)
        limit = self._longest_wait(frames, asked.station)
        if limit is None:
            self._fail(frames[0].start)
            for heard in frames:
                self._count(heard, "unknown", "unknown")
                self._transaction(Open(asked, heard, 1), None, "unclear", heard.end)
            return
        for heard in frames:
            open_ = self._open
            if open_ is None or open_.damaged or heard.start - open_.heard.end > limit:
                self._request(heard, asked)
            elif _same(open_.heard, heard):
                self._respond(heard, open_)
            else:
                self._request(heard, asked)

    def _settle_echoes(self, frames: list[Heard], asked: Asked) -> None:
        """A request is heard twice, its response once."""
        double: Heard | None = None
        for heard, after in zip(frames, [*frames[1:], None], strict=True):
            if heard is double:
                self._drop(heard)
            elif after is not None and self._close(heard, after):
                double = after
                self._request(heard, asked)
            elif self._open is not None and _same(self._open.heard, heard):
                self._respond(heard, self._open)
            else:
                self._request(heard, asked)

    def _close(self, before: Heard, after: Heard) -> bool:
        return after.start - before.end < self._line.silence + self._line.slack

    def _longest_wait(self, frames: Sequence[Heard], station: int) -> float | None:
        """The longest wait for a response among frames that are alike; None if it cannot be known."""
        waits = [after.start - before.end for before, after in pairwise(frames)]
        limit = _boundary(waits) if len(waits) > 1 else None
        if limit is None and station in self._slowest:
            limit = _SLOWEST * self._slowest[station] + self._line.slack
        return _FIRST if limit is None and len(waits) < 2 else limit

    # -- records -------------------------------------------------------------------------------

    def _transaction(
        self, open_: Open, response: Heard | None, outcome: str, end: int, exception: int = 0
    ) -> None:
        asked, heard = open_.asked, open_.heard
        self.outcomes[outcome] += 1
        self._take(
            TransactionRecord(
                bus=self._line.bus,
                master="master",
                poll=asked.name,
                attempt=open_.attempt,
                station=asked.station,
                function=asked.function,
                address=asked.address,
                quantity=asked.quantity,
                sent=heard.start,
                asked=heard.end,
                answer_start=response.start if response else None,
                answer_end=response.end if response else None,
                end=end,
                taken=end,
                outcome=outcome,
                error=ERRORS[outcome],
                exception=exception,
                served=None,
                mismatched=False,
                chars=len(heard.chars) + (len(response.chars) if response else 0),
            )
        )

    def _take(self, record: TransactionRecord) -> None:
        self._sink.take(record)

    def totals(self) -> BusTotals:
        """Counts so far."""
        nodes = ("master", *(f"station {number}" for number in sorted(self.stations)))
        return BusTotals(*self._line[:3], nodes, self.busy, self.frames, collisions=0, undetected=0)


def _same(one: Heard, other: Heard) -> bool:
    """Whether two frames say the same, however they are written."""
    return isinstance(one.frame, Adu) and isinstance(other.frame, Adu) and one.frame[:2] == other.frame[:2]


def _boundary(waits: Sequence[int]) -> float | None:
    """What divides waits for responses from the pauses behind them; None if there are no two classes.

    The two classes whose logarithms lie furthest apart (Otsu's criterion). Behind a response comes a
    pause: two waits of the shorter class hardly ever follow each other.
    """
    ordered = sorted(waits)
    count, logs = len(ordered), [log(max(1, wait)) for wait in sorted(waits)]
    whole, part, best, at = sum(logs), 0.0, -1.0, 1
    for number in range(1, count):
        part += logs[number - 1]
        apart = (whole * number / count - part) ** 2 / (number * (count - number))
        if apart > best:
            best, at = apart, number
    short, long = ordered[:at], ordered[at:]
    if median(long) < _APART * max(1, median(short)):
        return None
    limit = (short[-1] + long[0]) / 2
    overlapping = sum(max(pair) < limit for pair in pairwise(waits))
    return limit if 10 * overlapping <= len(short) else None

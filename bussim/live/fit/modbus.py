"""Estimates from a recording of a bus with a Modbus master: polls, periods, responses, loss, bit errors."""

from __future__ import annotations

from array import array
from collections import Counter
from dataclasses import dataclass, field
from itertools import pairwise
from statistics import median_low

from bussim.engines.modbus.adu import BROADCAST
from bussim.line.characters import CharFormat
from bussim.live.fit.statistics import Estimate, bit_error_rate, mean, proportion
from bussim.live.fit.turnaround import TurnaroundDistribution, distribution_of
from bussim.live.sniff.decoder import Line
from bussim.live.sniff.heard import Heard, LineProtocol, Verdict
from bussim.live.sniff.modbus import ModbusDecoder
from bussim.trace.records import Sink, TransactionRecord

#: A request is periodic if nine tenths of its turns begin within so much of a period of their grid.
_LATE, _MOST = 0.25, 0.9
#: From fewer distances no period is concluded.
_LEAST = 5


@dataclass(frozen=True, slots=True)
class PollEstimate:
    """A request that recurs. ``every`` is the median distance of its turns in ticks, None for a single one.

    ``low`` and ``high`` hold nine tenths of the distances; ``periodic``: its turns keep to a grid.
    """

    station: int
    function: int
    address: int
    quantity: int
    turns: int
    first: int
    every: int | None
    low: int | None
    high: int | None
    periodic: bool
    retries: int


@dataclass(frozen=True, slots=True)
class SlaveEstimate:
    """A slave: from the end of a request to the first edge of its response (ticks), and which got none."""

    station: int
    requests: int
    delay: Estimate | None
    distribution: TurnaroundDistribution | None
    loss: Estimate | None
    exceptions: dict[int, int]


@dataclass(frozen=True, slots=True)
class BusEstimate:
    """A bus with one Modbus master. Times in ticks."""

    protocol: LineProtocol
    baud: int
    format: str
    polls: tuple[PollEstimate, ...]
    slaves: tuple[SlaveEstimate, ...]
    interval: int | None  # shortest pause from a response to the next request
    timeout: int | None  # shortest wait after a request without a response
    ber: Estimate | None
    frames: int
    damaged: int
    begin: int
    recording: str = ""  # where it was measured


@dataclass(slots=True)
class _Poll:
    starts: array[int] = field(default_factory=lambda: array("q"))
    attempts: int = 1


@dataclass(slots=True)
class _Slave:
    delays: array[int] = field(default_factory=lambda: array("q"))
    requests: int = 0
    lost: int = 0
    exceptions: Counter[int] = field(default_factory=Counter)


class BusObserver(ModbusDecoder):
    """Decodes a Modbus bus, and keeps what the estimates need."""

    def __init__(self, line: Line, sink: Sink) -> None:
        super().__init__(line, sink)
        self._protocol = LineProtocol.RTU
        self._bits = CharFormat.parse(line.format).bits
        self._polls: dict[tuple[int, int, int, int], _Poll] = {}
        self._slaves: dict[int, _Slave] = {}
        self._sizes: dict[int, list[int]] = {}
        self._response_end: int | None = None
        self._interval: int | None = None
        self._timeout: int | None = None
        self._begin: int | None = None

    def heard(self, heard: Heard) -> None:
        """Take in a frame."""
        self._protocol = heard.protocol
        if self._begin is None:
            self._begin = heard.start
        if heard.verdict in (Verdict.SOUND, Verdict.DAMAGED):
            self._sizes.setdefault(len(heard.chars) * self._bits, [0, 0])[heard.frame is None] += 1
        super().heard(heard)

    def _take(self, record: TransactionRecord) -> None:
        super()._take(record)
        if record.sent is None or record.asked is None or record.outcome == "undecided":
            return
        key = (record.station, record.function, record.address, record.quantity)
        poll = self._polls.setdefault(key, _Poll())
        poll.attempts = max(poll.attempts, record.attempt)
        if record.attempt == 1:
            poll.starts.append(record.sent)
        if self._response_end is not None:
            pause = record.sent - self._response_end
            self._interval = pause if self._interval is None else min(pause, self._interval)
        self._response_end = record.answer_end
        if record.station == BROADCAST or record.outcome == "unclear":
            return
        slave = self._slaves.setdefault(record.station, _Slave())
        slave.requests += 1
        if record.answer_start is not None:
            slave.delays.append(max(0, record.answer_start - record.asked))
            if record.exception:
                slave.exceptions[record.exception] += 1
        elif record.outcome == "no_answer":
            slave.lost += 1
            wait = record.end - record.asked
            self._timeout = wait if self._timeout is None else min(wait, self._timeout)

    def estimate(self) -> BusEstimate | None:
        """The estimates; None where no request was heard."""
        if not self._polls:
            return None
        interval = max(0, self._interval) if self._interval is not None else None
        return BusEstimate(
            protocol=self._protocol,
            baud=self._line.baud,
            format=self._line.format,
            polls=tuple(_poll(key, poll) for key, poll in self._polls.items()),
            slaves=tuple(_slave(number, slave) for number, slave in sorted(self._slaves.items())),
            interval=interval,
            timeout=None if self._timeout is None else max(self._timeout, self._line.silence),
            ber=bit_error_rate({bits: (sound, bad) for bits, (sound, bad) in self._sizes.items()}),
            frames=self.frames,
            damaged=self.damaged,
            begin=self._begin or 0,
        )


def _poll(key: tuple[int, int, int, int], poll: _Poll) -> PollEstimate:
    starts = poll.starts
    apart = sorted(after - before for before, after in pairwise(starts))
    every = low = high = None
    periodic = False
    if apart:
        every = median_low(apart)
        low, high = apart[len(apart) // 20], apart[-1 - len(apart) // 20]
        turns = round((starts[-1] - starts[0]) / every) if every else 0
        if len(apart) >= _LEAST and turns:
            grid = (starts[-1] - starts[0]) / turns
            periodic = _on_grid(starts, grid)
            every = round(grid) if periodic else every
    return PollEstimate(
        *key, len(starts), starts[0] if starts else 0, every, low, high, periodic, poll.attempts - 1
    )


def _on_grid(starts: array[int], grid: float) -> bool:
    """Whether turns keep to a grid: others may hold them up, but lateness does not add up."""
    late = sorted((start - starts[0] + grid / 2) % grid for start in starts)
    middle = late[len(late) // 2]
    near = sum(abs(each - middle) <= _LATE * grid for each in late)
    return near >= _MOST * len(late)


def _slave(number: int, slave: _Slave) -> SlaveEstimate:
    return SlaveEstimate(
        number,
        slave.requests,
        mean(slave.delays) if slave.delays else None,
        distribution_of(slave.delays) if slave.delays else None,
        proportion(slave.lost, slave.requests) if slave.requests else None,
        dict(sorted(slave.exceptions.items())),
    )

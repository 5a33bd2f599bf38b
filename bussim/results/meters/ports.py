"""Counts of the ports beside the N:N links: transactions, polls, data ages, free protocol.

Memory does not grow with a run: counts, and histograms of times. Times are ticks.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import assert_never

from bussim.results.meters.exchanges import Exchange
from bussim.results.meters.failures import Irregular
from bussim.results.meters.histogram import Histogram
from bussim.results.meters.plain_data import UNKEPT
from bussim.trace.records import (
    CycleRecord,
    FreeRecord,
    OrdinaryTurns,
    Outcome,
    PollRecord,
    RunTotals,
    TransactionRecord,
)

#: The yy of D8063 = 7xyy that have a count of their own (PW10 board manual, section 8).
NO_RESPONSE = 9
WRONG_CHECK = 3
#: Outcomes where the master took a response as that to its request.
_RESPONSES = ("ok", "exception")
#: Modbus functions that read: only data that is read has an age.
_READS = frozenset({1, 2, 3, 4})
#: The station number of requests that nobody answers (Modbus over serial line, section 2.2).
_BROADCAST = 0


def response_time(record: TransactionRecord) -> int | None:
    """Last stop bit of the request to the last stop bit of its response, an exception included.

    None without a response, and where the response is to another request.
    """
    own = record.outcome in _RESPONSES and not record.mismatched
    if not own or record.asked is None or record.answer_end is None:
        return None
    return record.answer_end - record.asked


@dataclass(slots=True)
class Poll:
    """One poll of a master; ``""`` are all that a program drove.

    ``on_arrival`` is how old values are when the master takes them over, ``before_refresh`` how old
    they have become when the next ones replace them, ``last_served`` when the slave took the latest
    ones that arrived. All three are of polls that read.
    """

    transactions: int = 0
    ok: int = 0
    own: int = field(
        default=0, compare=False, metadata=UNKEPT
    )  # ok with the request's own response; in the summary alone
    timeouts: int = field(default=0, compare=False, metadata=UNKEPT)  # likewise
    broadcasts: int = field(default=0, compare=False, metadata=UNKEPT)  # likewise
    reads: bool = False
    turns: int = 0
    failed_turns: int = 0
    last_served: int | None = None
    responses: Histogram = field(default_factory=Histogram)
    late: Histogram = field(default_factory=Histogram)
    on_arrival: Histogram = field(default_factory=Histogram)
    before_refresh: Histogram = field(default_factory=Histogram)

    def transaction(self, record: TransactionRecord) -> None:
        """Count an attempt."""
        self.transactions += 1
        self.ok += record.outcome == "ok"
        self.broadcasts += record.station == _BROADCAST
        self.timeouts += record.error == NO_RESPONSE and not record.exception
        took = response_time(record)
        if took is not None:
            self.responses.add(took)
            self.own += record.outcome == "ok"
        if record.function in _READS:
            self.reads = True
            if record.outcome == "ok" and record.served is not None:
                self._arrived(record.served, record.taken)

    def turn(self, record: PollRecord) -> None:
        """Count a turn."""
        self.turns += 1
        self.failed_turns += record.error is not None
        self.late.add(record.late)

    def ordinary_turns(self, turns: OrdinaryTurns) -> None:
        """Count turns of a read with one good attempt each."""
        first, number = turns.first, len(turns.sent)
        served = (first.served or 0) - (first.sent or 0)
        took = (response_time(first) or 0) + (first.sent or 0) - (first.answer_start or 0)
        self.transactions += number
        self.ok += number
        self.own += number
        self.turns += number
        self.reads = True
        self.late.add_all(turns.late)
        self.responses.add_all(
            [begun - sent + took for sent, begun in zip(turns.sent, turns.begun, strict=True)]
        )
        self.on_arrival.add_all([end - at - served for at, end in zip(turns.sent, turns.taken, strict=True)])
        before = [] if self.last_served is None else [self.last_served]
        before += [sent + served for sent in turns.sent]
        ends = turns.taken[1:] if self.last_served is None else turns.taken
        self.before_refresh.add_all([end - at for at, end in zip(before, ends, strict=False)])
        self.last_served = before[-1]

    def _arrived(self, served: int, taken: int) -> None:
        if self.last_served is not None:
            self.before_refresh.add(taken - self.last_served)
        self.on_arrival.add(taken - served)
        self.last_served = served


@dataclass(slots=True)
class FreeCounts:
    """Free protocol of one node: sendings, receptions, receptions that ended by timeout, bytes."""

    sent: int = 0
    received: int = 0
    timeouts: int = 0
    damaged: int = 0  # characters
    bytes_sent: int = 0
    bytes_received: int = 0
    waits: Exchange = field(default_factory=Exchange, compare=False, metadata=UNKEPT)  # for a reception

    def add(self, record: FreeRecord) -> None:
        """Count a sending or a reception."""
        self.damaged += record.damaged
        if record.direction == "sent":
            self.sent += 1
            self.bytes_sent += len(record.data)
            return
        self.waits.add(record.end, Outcome.SILENT if record.start is None else Outcome.GOOD)
        self.bytes_received += len(record.data)
        if record.ended == "timeout":
            self.timeouts += 1
        else:
            self.received += 1


@dataclass(slots=True)
class PortRecord:
    """One node as Modbus master or with the free protocol.

    ``exceptions`` are by exception code (two hexadecimal digits), ``others`` by the text of the port
    error. ``timeout`` is the master's, in ticks, None where it is not known. ``mismatched`` are responses
    to another request that the master has taken, without those that it has refused. ``exchanges``, in the
    summary alone, are by the node that requests go to, or that messages come from; ``mistaken`` and
    ``excepted``, likewise, are when responses to others were taken and when exceptions came.
    """

    bus: str
    timeout: int | None = None
    polls: dict[str, Poll] = field(default_factory=dict)
    cycles: Histogram = field(default_factory=Histogram)
    exceptions: Counter[str] = field(default_factory=Counter)
    timeouts: int = 0
    crc_errors: int = 0
    others: Counter[str] = field(default_factory=Counter)
    mismatched: int = 0
    free: FreeCounts = field(default_factory=FreeCounts)
    mistaken: Irregular | None = field(default=None, compare=False, metadata=UNKEPT)
    excepted: Irregular | None = field(default=None, compare=False, metadata=UNKEPT)
    exchanges: dict[str, Exchange] = field(default_factory=dict, compare=False, metadata=UNKEPT)

    @property
    def responses(self) -> Histogram:
        """Response times of all polls."""
        merged = Histogram()
        for poll in self.polls.values():
            merged.merge(poll.responses)
        return merged

    def poll(self, name: str) -> Poll:
        """The poll of that name, a new one if there is none."""
        if name not in self.polls:
            self.polls[name] = Poll()
        return self.polls[name]

    def transaction(self, record: TransactionRecord) -> None:
        """Count an attempt."""
        self.poll(record.poll).transaction(record)
        if record.mismatched and record.outcome in _RESPONSES:
            self.mismatched += 1
            self.mistaken = Irregular.noted(self.mistaken, record.end)
        if record.outcome == "ok":
            return
        if record.exception:
            self.exceptions[f"{record.exception:02X}"] += 1
            self.excepted = Irregular.noted(self.excepted, record.end)
        elif record.error == NO_RESPONSE:
            self.timeouts += 1
        elif record.error == WRONG_CHECK:
            self.crc_errors += 1
        else:
            self.others[record.outcome] += 1


class PortMeter:
    """Takes the records of all nodes."""

    def __init__(self) -> None:
        self._nodes: dict[str, PortRecord] = {}

    def take(self, record: TransactionRecord | PollRecord | CycleRecord | FreeRecord) -> None:
        """Count a record of its node."""
        match record:
            case TransactionRecord():
                self._node(record.master, record.bus).transaction(record)
            case PollRecord():
                self._node(record.master, record.bus).poll(record.poll).turn(record)
            case CycleRecord():
                self._node(record.master, record.bus).cycles.add(record.duration)
            case FreeRecord():
                self._node(record.node, record.bus).free.add(record)
            case _:
                assert_never(record)

    def ordinary_turns(self, turns: Sequence[OrdinaryTurns], cycles: Sequence[CycleRecord]) -> None:
        """Count turns of a master without errors, and cycles of its list."""
        for each in turns:
            first = each.first
            node = self._node(first.master, first.bus)
            node.poll(first.poll).ordinary_turns(each)
            self.exchanged(first.bus, first.master, each.peer, each.sent[0], Outcome.GOOD)
            node.exchanges[each.peer].counts[Outcome.GOOD] += len(each.sent) - 1
        for cycle in cycles:
            self.take(cycle)

    def exchanged(self, bus: str, node: str, peer: str, start: int, outcome: Outcome) -> None:
        """Count what became of a message or request."""
        record = self._node(node, bus)
        record.exchanges.setdefault(peer, Exchange(bool(record.polls))).add(start, outcome)

    def nodes(self, totals: RunTotals) -> dict[str, PortRecord]:
        """Every node that a record has come from, in the order of the totals."""
        timeouts = {port.node: port.timeout for port in totals.ports}
        timeouts |= {device.name: device.timeout for device in totals.devices}
        order = {name: index for index, name in enumerate(timeouts)}
        names = sorted(self._nodes, key=lambda name: order.get(name, len(order)))
        for name in names:
            self._nodes[name].timeout = timeouts.get(name)
            for exchange in (*self._nodes[name].exchanges.values(), self._nodes[name].free.waits):
                exchange.close(totals.duration)
        return {name: self._nodes[name] for name in names}

    def _node(self, name: str, bus: str) -> PortRecord:
        if name not in self._nodes:
            self._nodes[name] = PortRecord(bus)
        return self._nodes[name]

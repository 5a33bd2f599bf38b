"""What became of requests and messages, and when."""

from __future__ import annotations

from bussim.results.meters.exchanges import Exchange
from bussim.results.meters.failures import Times
from bussim.trace.records import Outcome

GOOD, GARBLED, REPLY_DAMAGED, UNKNOWN = (
    Outcome.GOOD,
    Outcome.GARBLED,
    Outcome.REPLY_DAMAGED,
    Outcome.UNKNOWN,
)
SHOWN = ((10, GARBLED), (20, REPLY_DAMAGED), (30, GARBLED), (50, GOOD), (60, REPLY_DAMAGED))


def shown(exchange: Exchange) -> Exchange:
    for start, outcome in SHOWN:
        exchange.add(start, outcome)
    exchange.close(100)
    return exchange


def test_requests_have_the_cause_of_most_and_the_others_none() -> None:
    exchange = shown(Exchange(requests=True))
    assert exchange.failed == {
        GARBLED: Times(1, 10, 50, 40, 40, 10),
        REPLY_DAMAGED: Times(1, 60, 100, 40, 40, 60),
    }
    assert exchange.counts == {GOOD: 1, GARBLED: 2, REPLY_DAMAGED: 1, UNKNOWN: 1}


def test_each_outcome_of_messages_counts() -> None:
    exchange = shown(Exchange())
    assert exchange.failed == {
        GARBLED: Times(1, 10, 50, 40, 40, 10),
        REPLY_DAMAGED: Times(2, 20, 100, 70, 40, 60),
    }
    assert exchange.counts == {GOOD: 1, GARBLED: 2, REPLY_DAMAGED: 2}

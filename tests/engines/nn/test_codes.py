"""Every error code, in the master and in every slave that listens: who notes what about whom."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field

import pytest

from bussim.engines.nn.events import StationBack, StationLost
from bussim.engines.nn.frames import (
    DATA,
    POLL,
    LinkSettings,
    encode_data,
    encode_parameters,
)
from bussim.engines.nn.master import Master
from tests.engines.nn.links import (
    BODY,
    HEADER,
    SCAN,
    Entries,
    damage,
    in_attempt,
    link,
    lose,
    noted,
)
from tests.engines.wire import (
    CHAR,
    MS,
    TURNAROUND,
    Node,
    Tx,
    Wire,
)


@dataclass(frozen=True)
class Case:
    """What happens in the disturbed scan, and what each node has noted in the end."""

    happens: Callable[[Wire], None]
    noted: dict[str, Entries]
    slaves: int = 3
    attempts: int = 1
    failed: dict[int, dict[int, int]] = field(default_factory=dict)  # the master's attempts


def both(*steps: Callable[[Wire], None]) -> Callable[[Wire], None]:
    def happens(wire: Wire) -> None:
        for step in steps:
            step(wire)

    return happens


def late_into_the_next_exchange(wire: Wire) -> None:
    """Slave 1 replies 52 ms after its poll, when slave 2 (whose reply is lost) was polled."""
    wire.nodes[1].turnarounds = iter([TURNAROUND] * SCAN + [52 * MS] + [TURNAROUND] * 99)
    lose(wire, 2)


def late_into_the_next_scan(wire: Wire) -> None:
    """Slave 2 replies to the poll of the disturbed scan when it was polled in the next one."""
    wire.nodes[2].turnarounds = iter([TURNAROUND] * SCAN + [75 * MS] + [TURNAROUND] * 99)
    # The next scan's reply, with the usual turnaround, falls due first: that one is lost.
    wire.nodes[2].vanishes = lambda reply: reply == SCAN


def next_data_frame(wire: Wire, bit: int) -> None:
    """The data frame that follows the disturbed scan is damaged."""
    before = wire.damage

    def hook(tx: Tx, node: Node) -> Collection[int]:
        frame = tx.frame
        if frame is not None and (frame.kind, frame.station, frame.counter) == (DATA, 0, SCAN + 1):
            return [bit]
        return before(tx, node)

    wire.damage = hook


CASES = {
    "01, 21: a reply is lost": Case(
        lambda wire: lose(wire, 2),
        {"master": {2: (1, 0x01)}, "slave1": {2: (1, 0x21)}, "slave3": {2: (1, 0x21)}},
        failed={2: {0x01: 1}},
    ),
    "01, 21: replies to all three attempts are lost": Case(
        lambda wire: lose(wire, 2),
        {"master": {2: (1, 0x01)}, "slave1": {2: (1, 0x21)}, "slave3": {2: (1, 0x21)}},
        attempts=3,
        failed={2: {0x01: 3}},
    ),
    "nothing: the third attempt has a reply": Case(
        lambda wire: lose(wire, 2, attempts=(0, 1)), {}, attempts=3, failed={2: {0x01: 2}}
    ),
    "01, 21 of the last slave, checked at the next data frame": Case(
        lambda wire: lose(wire, 3),
        {"master": {3: (1, 0x01)}, "slave1": {3: (1, 0x21)}, "slave2": {3: (1, 0x21)}},
        failed={3: {0x01: 1}},
    ),
    "04: a reply is damaged on the line": Case(
        lambda wire: damage(wire, DATA, 2, [BODY]),
        {"master": {2: (1, 0x04)}, "slave1": {2: (1, 0x04)}, "slave3": {2: (1, 0x04)}},
        failed={2: {0x04: 1}},
    ),
    "04: a reply's header is damaged on the line": Case(
        lambda wire: damage(wire, DATA, 2, [HEADER]),
        {"master": {2: (1, 0x04)}, "slave1": {2: (1, 0x04)}, "slave3": {2: (1, 0x04)}},
        failed={2: {0x04: 1}},
    ),
    "04: a reply's last sum character is damaged on the line": Case(
        lambda wire: damage(wire, DATA, 2, [215]),
        {"master": {2: (1, 0x04)}, "slave1": {2: (1, 0x04)}, "slave3": {2: (1, 0x04)}},
        failed={2: {0x04: 1}},
    ),
    "04 in the master alone: it alone heard damage": Case(
        lambda wire: damage(wire, DATA, 2, [BODY], at=["master"]),
        {"master": {2: (1, 0x04)}},
        failed={2: {0x04: 1}},
    ),
    "04 in a slave alone": Case(
        lambda wire: damage(wire, DATA, 2, [BODY], at=["slave3"]), {"slave3": {2: (1, 0x04)}}
    ),
    "04 in a slave alone, its header": Case(
        lambda wire: damage(wire, DATA, 2, [HEADER], at=["slave3"]), {"slave3": {2: (1, 0x04)}}
    ),
    "the last attempt's outcome counts: damage, then silence": Case(
        both(
            lambda wire: damage(wire, DATA, 2, [BODY], attempts=(0,)),
            lambda wire: lose(wire, 2, attempts=(1,)),
        ),
        {"master": {2: (1, 0x01)}, "slave1": {2: (1, 0x21)}, "slave3": {2: (1, 0x21)}},
        attempts=2,
        failed={2: {0x04: 1, 0x01: 1}},
    ),
    "the last attempt's outcome counts: silence, then damage": Case(
        both(lambda wire: damage(wire, DATA, 2, [BODY]), lambda wire: lose(wire, 2, attempts=(0,))),
        {"master": {2: (1, 0x04)}, "slave1": {2: (1, 0x04)}, "slave3": {2: (1, 0x04)}},
        attempts=2,
        failed={2: {0x04: 1, 0x01: 1}},
    ),
    "01 in the master alone: the slaves heard the first attempt's reply": Case(
        both(
            lambda wire: damage(wire, DATA, 2, [BODY], at=["master"], attempts=(0,)),
            lambda wire: lose(wire, 2, attempts=(1,)),
        ),
        {"master": {2: (1, 0x01)}},
        attempts=2,
        failed={2: {0x04: 1, 0x01: 1}},
    ),
    "04 in the master alone: the slaves heard the first attempt's reply": Case(
        both(
            lambda wire: damage(wire, DATA, 2, [BODY], at=["master"], attempts=(0,)),
            lambda wire: damage(wire, DATA, 2, [BODY], attempts=(1, 2)),
        ),
        {"master": {2: (1, 0x04)}},
        attempts=3,
        failed={2: {0x04: 3}},
    ),
    "02, 22: another station's late reply": Case(
        late_into_the_next_exchange,
        {
            "master": {1: (1, 0x01), 2: (1, 0x02)},
            "slave1": {2: (1, 0x21)},  # it does not hear its own reply
            "slave2": {1: (1, 0x21)},
            "slave3": {1: (1, 0x21), 2: (1, 0x22)},
        },
        failed={1: {0x01: 1}, 2: {0x02: 1}},
    ),
    "03, 23: a reply from the scan before": Case(
        late_into_the_next_scan,
        {"master": {2: (2, 0x03)}, "slave1": {2: (2, 0x23)}},
        slaves=2,
        failed={2: {0x01: 1, 0x03: 1}},
    ),
    "14: the poll is damaged on the line": Case(
        lambda wire: damage(wire, POLL, 2, [23]),
        {
            "master": {2: (1, 0x01)},
            "slave1": {0: (1, 0x14)},  # no station was polled, so that only the master can be in error
            "slave2": {0: (1, 0x14)},
            "slave3": {0: (1, 0x14)},
        },
        failed={2: {0x01: 1}},
    ),
    "14: the poll's header is damaged on the line": Case(
        lambda wire: damage(wire, POLL, 2, [HEADER]),
        {"master": {2: (1, 0x01)}, **{f"slave{k}": {0: (1, 0x14)} for k in (1, 2, 3)}},
        failed={2: {0x01: 1}},
    ),
    "14 in the polled slave alone, 21 in the others": Case(
        lambda wire: damage(wire, POLL, 2, [23], at=["slave2"]),
        {
            "master": {2: (1, 0x01)},
            "slave1": {2: (1, 0x21)},
            "slave2": {0: (1, 0x14)},
            "slave3": {2: (1, 0x21)},
        },
        failed={2: {0x01: 1}},
    ),
    "14 in a listening slave alone: it takes the data without the poll": Case(
        lambda wire: damage(wire, POLL, 2, [23], at=["slave3"]), {"slave3": {0: (1, 0x14)}}
    ),
    "14 in that slave, and nothing about a station that it heard without a poll": Case(
        both(
            lambda wire: damage(wire, POLL, 2, [23], at=["slave3"], attempts=(0,)),
            lambda wire: damage(wire, DATA, 2, [BODY], at=["master"], attempts=(0,)),
            lambda wire: lose(wire, 2, attempts=(1,)),
        ),
        {"master": {2: (1, 0x01)}, "slave3": {0: (1, 0x14)}},
        attempts=2,
        failed={2: {0x04: 1, 0x01: 1}},
    ),
    "14: the master's data frame is damaged": Case(
        lambda wire: damage(wire, DATA, 0, [BODY]), {f"slave{k}": {0: (1, 0x14)} for k in (1, 2, 3)}
    ),
    "14: the header of the master's data frame is damaged": Case(
        lambda wire: damage(wire, DATA, 0, [HEADER]), {f"slave{k}": {0: (1, 0x14)} for k in (1, 2, 3)}
    ),
    "04: that header again, while a poll is pending": Case(
        both(lambda wire: lose(wire, 3), lambda wire: next_data_frame(wire, HEADER)),
        {"master": {3: (1, 0x01)}, "slave1": {3: (1, 0x04)}, "slave2": {3: (1, 0x04)}, "slave3": {}},
        failed={3: {0x01: 1}},
    ),
    "14, 21: its body instead, while a poll is pending: it began as only the master's frames do": Case(
        both(lambda wire: lose(wire, 3), lambda wire: next_data_frame(wire, BODY)),
        {
            "master": {3: (1, 0x01)},
            "slave1": {0: (1, 0x14), 3: (1, 0x21)},
            "slave2": {0: (1, 0x14), 3: (1, 0x21)},
            "slave3": {0: (1, 0x14)},
        },
        failed={3: {0x01: 1}},
    ),
    "04: a parameter frame is heard instead of a reply": Case(
        both(
            lambda wire: lose(wire, 2),
            lambda wire: in_attempt(
                wire, 2, 10 * MS, encode_parameters(SCAN, LinkSettings(3, 0, 0, 5)).chars
            ),
        ),
        {"master": {2: (1, 0x04)}, "slave1": {2: (1, 0x21)}, "slave3": {2: (1, 0x21)}},
        failed={2: {0x04: 1}},
    ),
    "04: noise is heard instead of a reply": Case(
        both(lambda wire: lose(wire, 2), lambda wire: in_attempt(wire, 2, 10 * MS, b"?")),
        {"master": {2: (1, 0x04)}, "slave1": {2: (1, 0x04)}, "slave3": {2: (1, 0x04)}},
        failed={2: {0x04: 1}},
    ),
    "04: an enquiry that goes no further is heard instead of a reply; 14 in the slaves": Case(
        both(lambda wire: lose(wire, 2), lambda wire: in_attempt(wire, 2, 10 * MS, b"\x053")),
        {
            "master": {2: (1, 0x04)},
            "slave1": {0: (1, 0x14), 2: (1, 0x21)},
            "slave2": {0: (1, 0x14)},
            "slave3": {0: (1, 0x14), 2: (1, 0x21)},
        },
        failed={2: {0x04: 1}},
    ),
    "01: an enquiry that is in progress at the deadline; 14 in the slaves": Case(
        both(lambda wire: lose(wire, 2), lambda wire: in_attempt(wire, 2, 50 * MS - 2 * CHAR, b"\x053")),
        {
            "master": {2: (1, 0x01)},
            "slave1": {0: (1, 0x14), 2: (1, 0x21)},
            "slave2": {0: (1, 0x14)},
            "slave3": {0: (1, 0x14), 2: (1, 0x21)},
        },
        failed={2: {0x01: 1}},
    ),
    "01: a character that has begun at the deadline": Case(
        both(lambda wire: lose(wire, 2), lambda wire: in_attempt(wire, 2, 50 * MS - CHAR + 1, b"?")),
        {"master": {2: (1, 0x01)}, "slave1": {2: (1, 0x04)}, "slave3": {2: (1, 0x04)}},
        failed={2: {0x01: 1}},
    ),
    "04: that character, if it has ended": Case(
        both(lambda wire: lose(wire, 2), lambda wire: in_attempt(wire, 2, 50 * MS - CHAR, b"?")),
        {"master": {2: (1, 0x04)}, "slave1": {2: (1, 0x04)}, "slave3": {2: (1, 0x04)}},
        failed={2: {0x04: 1}},
    ),
    "02: a second master's data frame": Case(
        both(
            lambda wire: lose(wire, 2),
            lambda wire: in_attempt(wire, 2, 10 * MS, encode_data(0, SCAN, bytes(8)).chars),
        ),
        # The slaves cannot distinguish it from their master's: it has moved past slave 2.
        {"master": {2: (1, 0x02)}, "slave1": {2: (1, 0x21)}, "slave3": {2: (1, 0x21)}},
        failed={2: {0x02: 1}},
    ),
    "02, 22: a second station 1; the first one ignores what carries its own number": Case(
        both(
            lambda wire: lose(wire, 2),
            lambda wire: in_attempt(wire, 2, 10 * MS, encode_data(1, SCAN, bytes(8)).chars),
        ),
        {"master": {2: (1, 0x02)}, "slave1": {2: (1, 0x21)}, "slave3": {2: (1, 0x22)}},
        failed={2: {0x02: 1}},
    ),
    "04: a reply in another mode, the deadline before two quiet characters": Case(
        both(
            lambda wire: lose(wire, 2),
            lambda wire: in_attempt(wire, 2, 50 * MS - 31 * CHAR, encode_data(2, SCAN, bytes(12)).chars),
        ),
        {"master": {2: (1, 0x04)}, "slave1": {2: (1, 0x04)}, "slave3": {2: (1, 0x04)}},
        failed={2: {0x04: 1}},
    ),
    "04: a reply in another mode": Case(
        both(
            lambda wire: lose(wire, 2),
            lambda wire: in_attempt(wire, 2, 10 * MS, encode_data(2, SCAN, bytes(12)).chars),
        ),
        {"master": {2: (1, 0x04)}, "slave1": {2: (1, 0x04)}, "slave3": {2: (1, 0x04)}},
        failed={2: {0x04: 1}},
    ),
}


@pytest.mark.parametrize("whole", [True, False], ids=["whole", "characters"])
@pytest.mark.parametrize("name", CASES)
def test_who_notes_what(name: str, whole: bool) -> None:
    case = CASES[name]
    wire = link(case.slaves, attempts=case.attempts, whole=whole)
    case.happens(wire)
    wire.run_scans(SCAN + 1)
    for node in wire.nodes:
        assert noted(node) == {}
    wire.run_scans(5)
    for node in wire.nodes:
        assert noted(node) == case.noted.get(node.name, {}), node.name
        # Everything was over in a scan or two: flags are off again, counts and codes stay.
        assert not any(node.engine.status.flags)
        backs = [event.station for event in node.events if isinstance(event, StationBack)]
        new = [event.station for event in node.events if isinstance(event, StationLost) and event.new]
        assert backs == new
        assert set(new) == set(case.noted.get(node.name, {}))
        # No station has a code about itself.
        own = wire.nodes.index(node)
        assert own not in new
        assert node.engine.status.running
    master = wire.nodes[0].engine
    assert isinstance(master, Master)
    assert master.failed_attempts == case.failed

"""When an attempt ends, to the tick; and what becomes of replies that come too late."""

from __future__ import annotations

import pytest

from bussim.engines.nn.events import AttemptEnded, StationLost
from bussim.engines.nn.frames import DATA, POLL, encode_data, encode_poll
from bussim.engines.nn.master import Master
from tests.engines.nn.links import (
    BODY,
    DATA_TICKS,
    HEADER,
    SCAN,
    TIMEOUT,
    damage,
    in_attempt,
    link,
    lose,
    noted,
)
from tests.engines.wire import (
    CHAR,
    GAP,
    MS,
    OVERHEAD,
    POLL_TICKS,
    QUIET,
    TURNAROUND,
    Tx,
    Wire,
    master_node,
    slave_node,
)

pytestmark = pytest.mark.parametrize("whole", [True, False], ids=["whole", "characters"])

#: From the end of a poll that gets no reply to the end of the next one.
AGAIN = TIMEOUT + GAP + POLL_TICKS
#: The last turnaround that is in time.
LAST = TIMEOUT - DATA_TICKS
#: The bits that make a SOH of the terminator in mode 0 (character 19): 0x03 → 0x01, parity to match.
ETX_TO_SOH = (192, 198)


def attempts(wire: Wire) -> list[AttemptEnded]:
    return [event for event in wire.nodes[0].events if isinstance(event, AttemptEnded)]


def failures(wire: Wire) -> dict[int, dict[int, int]]:
    engine = wire.nodes[0].engine
    assert isinstance(engine, Master)
    return engine.failed_attempts


def first_poll(wire: Wire) -> Tx:
    return next(tx for tx in wire.sent if tx.frame and tx.frame.kind == POLL)


def slow(slaves: int, *turnarounds: int, whole: bool, listeners: int = 0, attempts: int = 2) -> Wire:
    """A link whose slave 1 has these turnarounds first; ``listeners`` more slaves are never polled."""
    nodes = [master_node(slaves, attempts=attempts), slave_node(1, *turnarounds)]
    nodes += [slave_node(station) for station in range(2, slaves + listeners + 1)]
    wire = Wire(*nodes, whole=whole)
    for node in nodes:
        wire.at(0, lambda node=node: node.start(0))
    return wire


# -- the end of an attempt ---------------------------------------------------------------------------------


def test_a_reply_that_ends_at_the_deadline_s_tick_counts(whole: bool) -> None:
    wire = slow(1, LAST, whole=whole, attempts=1)
    wire.run(200 * MS)
    poll, decided = first_poll(wire), attempts(wire)[0]
    assert (decided.start, decided.polled) == (poll.start, poll.end)
    assert (decided.code, decided.end) == (0, poll.end + TIMEOUT)
    assert decided.reply == poll.end + LAST
    assert noted(wire.nodes[0]) == {}
    assert wire.nodes[0].stored[0] == (poll.end + TIMEOUT, 1, wire.nodes[1].image)


def test_a_reply_that_ends_a_tick_later_does_not(whole: bool) -> None:
    wire = slow(1, LAST + 1, whole=whole, attempts=1, listeners=1)
    wire.run(300 * MS)
    poll, failed = first_poll(wire), attempts(wire)[0]
    assert (failed.code, failed.end, failed.reply) == (0x01, poll.end + TIMEOUT, None)
    assert noted(wire.nodes[0]) == {1: (1, 0x01)}
    assert poll.end + TIMEOUT + 1 not in [end for end, _, _ in wire.nodes[0].stored]
    # The listening slave has no deadline: to it the reply was good.
    assert (poll.end + TIMEOUT + 1, 1, wire.nodes[1].image) in wire.nodes[2].stored
    assert noted(wire.nodes[2]) == {}


@pytest.mark.parametrize(
    ("kind", "bits"), [("torn in its body", [BODY]), ("its terminator now a header", ETX_TO_SOH)], ids=str
)
def test_a_torn_reply_fails_after_two_quiet_characters(kind: str, bits: list[int], whole: bool) -> None:
    del kind
    wire = link(2, attempts=2, whole=whole)
    damage(wire, DATA, 2, bits, attempts=(0,))
    wire.run_scans(5)
    (failed,) = [event for event in attempts(wire) if event.code]
    reply = next(tx for tx in wire.nodes[2].sent if tx.start > failed.polled)
    assert (failed.code, failed.end, failed.number) == (0x04, reply.end + QUIET, 1)
    repeat = next(tx for tx in wire.nodes[0].sent if tx.start > failed.end)
    assert repeat.start == failed.end + GAP
    assert failures(wire) == {2: {0x04: 1}}
    assert noted(wire.nodes[0]) == noted(wire.nodes[2]) == {}


def test_a_torn_reply_fails_after_quiet_also_if_a_whole_frame_follows_it(whole: bool) -> None:
    wire = link(2, attempts=2, whole=whole)
    lose(wire, 2, attempts=(0,))
    torn = encode_data(2, SCAN, bytes(8)).chars[:7] + encode_poll(5, SCAN).chars
    in_attempt(wire, 2, 10 * MS, torn, attempts=(0,))
    wire.run_scans(5)
    (failed,) = [event for event in attempts(wire) if event.code]
    assert (failed.code, failed.end) == (0x04, failed.polled + 10 * MS + 12 * CHAR + QUIET)


def test_what_was_torn_is_forgotten_in_the_next_attempt(whole: bool) -> None:
    wire = link(2, attempts=2, whole=whole)
    damage(wire, DATA, 2, [BODY], attempts=(0,))
    lose(wire, 2, attempts=(1,))
    in_attempt(wire, 2, 10 * MS, b"?", attempts=(1,))
    wire.run_scans(5)
    first, second = [event for event in attempts(wire) if event.code]
    assert first.end < second.polled
    assert (second.code, second.end) == (0x04, second.polled + TIMEOUT)


def test_a_torn_reply_fails_at_the_deadline_if_that_comes_first(whole: bool) -> None:
    wire = slow(1, LAST, whole=whole, attempts=2)
    wire.damage = lambda tx, _node: [BODY] if tx.sender is wire.nodes[1] and tx.number == 0 else []
    wire.run(200 * MS)
    failed = attempts(wire)[0]
    assert (failed.code, failed.end) == (0x04, failed.polled + TIMEOUT)


def test_a_reply_without_its_header_is_only_noise_and_runs_to_the_deadline(whole: bool) -> None:
    wire = link(2, attempts=2, whole=whole)
    damage(wire, DATA, 2, [HEADER], attempts=(0,))
    wire.run_scans(5)
    (failed,) = [event for event in attempts(wire) if event.code]
    assert (failed.code, failed.end) == (0x04, failed.polled + TIMEOUT)


def test_a_good_reply_after_noise_is_taken(whole: bool) -> None:
    wire = link(2, attempts=1, whole=whole)
    in_attempt(wire, 2, 100, b"?")
    wire.nodes[2].turnarounds = iter([2 * MS] * 99)
    wire.run_scans(5)
    assert failures(wire) == {}
    assert noted(wire.nodes[0]) == {}


@pytest.mark.parametrize(
    ("station", "counter", "code"), [(1, 2, 0x02), (0, 2, 0x02), (1, 1, 0x02), (2, 1, 0x03)]
)
def test_a_disagreement_fails_at_the_last_stop_bit_and_is_not_stored(
    station: int, counter: int, code: int, whole: bool
) -> None:
    """Where station and counter both disagree the station comes first."""
    wire = link(2, attempts=2, whole=whole)
    lose(wire, 2, attempts=(0,))
    in_attempt(wire, 2, 7 * MS, encode_data(station, counter, b"strange!").chars)
    wire.run_scans(3)
    wire.run(wire.now + 60 * MS)
    failed = next(event for event in attempts(wire) if event.code)
    assert (failed.station, failed.code) == (2, code)
    assert failed.reply == failed.polled + 7 * MS
    assert failed.end == failed.polled + 7 * MS + DATA_TICKS
    assert b"strange!" not in [data for _, _, data in wire.nodes[0].stored]


def test_outside_an_attempt_the_master_stores_and_counts_nothing(whole: bool) -> None:
    wire = link(1, whole=whole)
    wire.run_scans(3)
    master = wire.nodes[0]
    before = len(master.stored)
    wire.run(wire.now + DATA_TICKS + GAP + POLL_TICKS + TURNAROUND + DATA_TICKS + 100)
    assert len(master.stored) == before + 1
    # In the overhead, after the scan's last reply: a frame that would have been right, and noise.
    late = encode_data(1, 2, b"strange!")
    in_time = OVERHEAD + GAP - 200
    assert len(late.chars) * CHAR > in_time > 12 * CHAR
    wire.inject(wire.now, b"\x02????")
    wire.inject(wire.now + 5 * CHAR, late.chars)
    wire.run_scans(1)
    wire.run(wire.now + DATA_TICKS)
    assert failures(wire) == {}
    assert noted(master) == {}
    assert len(master.stored) == before + 1
    assert b"strange!" not in [data for _, _, data in master.stored]


# -- late replies ------------------------------------------------------------------------------------------


def test_a_late_reply_to_attempt_1_counts_for_attempt_2(whole: bool) -> None:
    wire = slow(1, 53 * MS, 25 * MS, whole=whole, listeners=1)
    wire.run(120 * MS)
    one, two = attempts(wire)[:2]
    assert (one.number, one.code, one.end) == (1, 0x01, one.polled + TIMEOUT)
    assert (two.number, two.code) == (2, 0)
    assert two.polled == one.polled + AGAIN
    assert (two.reply, two.end) == (one.polled + 53 * MS, one.polled + 53 * MS + DATA_TICKS)
    assert noted(wire.nodes[0]) == {}


def test_every_poll_gets_its_own_reply_one_behind_the_other_if_need_be(whole: bool) -> None:
    wire = slow(1, 53 * MS, 2 * MS, whole=whole)
    wire.run(130 * MS)
    one, two = wire.nodes[1].sent[:2]
    poll = first_poll(wire)
    assert one.start == poll.end + 53 * MS
    assert poll.end + AGAIN + 2 * MS < one.end  # due while the first one is being sent
    assert two.start == one.end
    assert one.frame == two.frame


def test_its_second_reply_in_another_station_s_exchange_02(whole: bool) -> None:
    wire = slow(2, 53 * MS, 40 * MS, whole=whole, listeners=1)
    wire.nodes[2].vanishes = lambda reply: reply < 2  # slave 2 does not reply in this scan
    wire.run_scans(2)
    wire.run(wire.now + DATA_TICKS)
    second = wire.nodes[1].sent[1]
    codes = [(event.station, event.number, event.code) for event in attempts(wire)]
    assert codes == [(1, 1, 0x01), (1, 2, 0), (2, 1, 0x02), (2, 2, 0x01)]
    assert attempts(wire)[2].end == second.end
    assert noted(wire.nodes[0]) == {2: (1, 0x01)}
    # The listening slave heard slave 1 reply to its second poll; of slave 2's last attempt only silence.
    assert noted(wire.nodes[3]) == {2: (1, 0x21)}
    assert noted(wire.nodes[2]) == {}


def test_its_second_reply_in_the_next_scan_03(whole: bool) -> None:
    wire = slow(1, *[53 * MS] * 9, whole=whole, listeners=1)
    wire.run_scans(3)
    wire.run(wire.now + DATA_TICKS)
    codes = [(event.number, event.code) for event in attempts(wire)]
    # A station that is always too slow: each scan begins with the reply that was left over.
    assert codes == [(1, 0x01), (2, 0), (1, 0x03), (2, 0)]
    stale = wire.nodes[1].sent[1]
    assert stale.frame is not None
    assert stale.frame.counter == 0
    assert attempts(wire)[2].end == stale.end
    assert failures(wire) == {1: {0x01: 1, 0x03: 1}}
    for node in wire.nodes:
        assert noted(node) == {}


def test_its_second_reply_over_the_master_s_data_frame_14(whole: bool) -> None:
    late = 53 * MS
    until_data = late + DATA_TICKS + OVERHEAD + GAP  # from the end of the first poll
    wire = slow(1, late, until_data + MS - AGAIN, whole=whole, listeners=1)
    wire.run_scans(2)
    data = wire.sent[-1]
    wire.run(data.end + GAP)
    reply = wire.nodes[1].sent[1]
    assert data.start < reply.start == data.start + MS < data.end < reply.end
    listener = wire.nodes[2]
    wire.run_scans(2)
    wire.run(wire.now + DATA_TICKS)
    # What it heard was damaged from the overlap on, and began like a frame of the master's.
    assert noted(listener)[0] == (1, 0x14)
    assert not listener.engine.status.flags[0]
    lost = [event for event in listener.events if isinstance(event, StationLost)]
    poll = next(tx for tx in wire.sent if tx.start == data.end + GAP)
    assert data.start < lost[0].tick < poll.end + CHAR + QUIET
    # The poll that followed ran into the tail of that reply: no station understood it.
    assert noted(wire.nodes[0]) == {}
    assert failures(wire) == {1: {0x01: 2}}
    assert len(wire.nodes[1].sent) >= 3


def test_a_reply_in_progress_does_not_hold_the_master_back(whole: bool) -> None:
    """It does not sense the carrier: its next poll runs into the reply, and both are lost."""
    wire = slow(1, TIMEOUT - MS, whole=whole, attempts=3)
    wire.run(300 * MS)
    one, two, three = attempts(wire)[:3]
    reply = wire.nodes[1].sent[0]
    assert one.code == 0x01
    assert one.end == one.polled + TIMEOUT
    assert reply.start < one.end < two.start < two.polled < reply.end
    assert two.code == 0x04  # the rest of the reply, heard from the middle
    assert two.end == two.polled + TIMEOUT
    assert three.code == 0
    assert len(wire.nodes[1].sent) >= 2


def test_the_reply_carries_the_image_at_its_start(whole: bool) -> None:
    wire = slow(1, 30 * MS, whole=whole)
    slave = wire.nodes[1]
    poll_end = 2 * GAP + 14 * CHAR + DATA_TICKS + GAP + POLL_TICKS
    wire.at(poll_end + 30 * MS - 1, lambda: setattr(slave, "image", b"newest!!"))
    wire.at(poll_end + 30 * MS + 1, lambda: setattr(slave, "image", b"too late"))
    wire.run(poll_end + 40 * MS)
    assert wire.nodes[0].stored == [(poll_end + 30 * MS + DATA_TICKS, 1, b"newest!!")]


# -- two stations with one number ----------------------------------------------------------------------------


def test_two_stations_with_one_number_and_other_turnarounds_collide(whole: bool) -> None:
    nodes = [master_node(1), slave_node(1), slave_node(1, *[TURNAROUND + 5_000] * 99), slave_node(2)]
    nodes[2].image = bytes(8)
    wire = Wire(*nodes, whole=whole)
    for node in nodes:
        wire.at(0, lambda node=node: node.start(0))
    wire.run_scans(4)
    wire.run(wire.now + DATA_TICKS)
    # Clean header of the first one, then both at once.
    assert noted(nodes[0]) == {1: (3, 0x04)}
    assert noted(nodes[3]) == {1: (3, 0x04)}
    # Each believes that it takes part. The first hears the second one's last bits: to it a noise after its
    # own reply, when no poll is pending, so the master's.
    assert noted(nodes[1]) == {0: (3, 0x14)}
    assert noted(nodes[2]) == {}
    assert all(node.engine.status.running for node in nodes[1:3])


def test_two_stations_with_one_number_far_apart_in_time(whole: bool) -> None:
    """The second reply comes when another station was polled: it disagrees, and is ignored by its twin."""
    nodes = [master_node(2), slave_node(1), slave_node(1, *[12 * MS] * 99), slave_node(2, *[30 * MS] * 99)]
    wire = Wire(*nodes, whole=whole)
    for node in nodes:
        wire.at(0, lambda node=node: node.start(0))
    wire.run_scans(2)
    wire.run(wire.now + DATA_TICKS)
    first_scan = [(event.station, event.code) for event in attempts(wire)][:2]
    assert first_scan == [(1, 0), (2, 0x02)]
    assert noted(nodes[1]).get(1) is None
    assert noted(nodes[2]).get(1) is None

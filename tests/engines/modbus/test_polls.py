"""Poll lists: order, periods, retries; and a master that works through one alone."""

from __future__ import annotations

import pytest

from bussim.engines.contract import EVENTS, OPEN, TRANSMIT, Engine
from bussim.engines.modbus.adu import Adu, Mode, encode_adu
from bussim.engines.modbus.codes import PortError
from bussim.engines.modbus.events import CycleEnded, MasterEvent, PollEnded, PollEvent, TransactionEnded
from bussim.engines.modbus.framing import Framing
from bussim.engines.modbus.master import MasterConfig
from bussim.engines.modbus.pdu import Request, write_register
from bussim.engines.modbus.polling import PollingMaster
from bussim.engines.modbus.polls import Poll, PollList
from bussim.engines.modbus.slave import Slave, SlaveConfig
from bussim.units import TICKS_PER_MS
from tests.engines.modbus.maps import PlainMap
from tests.engines.modbus.wire import RTU_LINE, Wire

MS = TICKS_PER_MS
RTU = Framing.rtu(RTU_LINE)
READ = Request(3, 0, 2)


def turns(polls: list[Poll], length: int, until: int, pause: int = 0) -> list[tuple[int, int]]:
    """(begin, index) of each turn if every attempt succeeds after ``length`` ticks."""
    dealer = PollList(polls, pause=pause)
    begun, now = [], 0
    while now < until:
        due = dealer.next_due()
        now = max(now, due)
        assert dealer.take(now) is not None
        begun.append((now, dealer.running))
        now += length
        dealer.ended(now, None)
    return begun


def test_without_periods_they_take_turns_at_once() -> None:
    polls = [Poll(1, READ), Poll(2, READ), Poll(3, READ)]
    assert turns(polls, 10, 60) == [(0, 0), (10, 1), (20, 2), (30, 0), (40, 1), (50, 2)]


def test_periods_keep_their_grid() -> None:
    assert turns([Poll(1, READ, every=100)], 30, 300) == [(0, 0), (100, 0), (200, 0), (300, 0)]


def test_turns_that_were_missed_are_skipped() -> None:
    # 250 ticks long, every 100: due at 100 and 200 while it runs, next begun late at 250, then 500 …
    assert turns([Poll(1, READ, every=100)], 250, 800) == [(0, 0), (250, 0), (500, 0), (750, 0)]


def test_a_period_waits_its_turn_among_others() -> None:
    polls = [Poll(1, READ, every=100), Poll(2, READ)]
    assert turns(polls, 30, 200) == [(0, 0), (30, 1), (60, 1), (90, 1), (120, 0), (150, 1), (180, 1)]


def test_a_pause_lies_behind_each_turn_whatever_its_station() -> None:
    polls = [Poll(1, READ), Poll(2, READ)]
    assert turns(polls, 10, 180, pause=50) == [(0, 0), (60, 1), (120, 0), (180, 1)]
    # A period that is over meanwhile waits for the pause.
    assert turns([Poll(1, READ, every=100)], 80, 450, pause=50) == [(0, 0), (130, 0), (260, 0), (390, 0)]


def test_a_retry_does_not_wait_for_the_pause() -> None:
    dealer = PollList([Poll(1, READ, retries=1)], pause=50)
    assert dealer.take(0) is not None
    assert dealer.ended(10, PortError.TIMEOUT)[0] is not None
    dealer.ended(20, None)
    assert dealer.take(69) is None
    assert dealer.next_due() == 70
    assert dealer.take(70) is not None


def test_retries_then_the_next() -> None:
    dealer = PollList([Poll(1, READ, retries=2), Poll(2, READ)])
    poll = dealer.take(0)
    assert dealer.next_due() is None
    assert dealer.take(0) is None
    assert dealer.ended(10, PortError.TIMEOUT) == (poll, ())
    assert dealer.ended(20, PortError.CHECK) == (poll, ())
    assert dealer.ended(30, PortError.TIMEOUT) == (
        None,
        (PollEnded(30, 0, 0, 3, PortError.TIMEOUT, 0),),
    )
    assert dealer.take(30) == Poll(2, READ)
    assert dealer.ended(40, None) == (None, (PollEnded(40, 1, 30, 1, None, 30), CycleEnded(40, 0, 40)))


def test_a_retry_that_succeeds_ends_the_turn() -> None:
    dealer = PollList([Poll(1, READ, retries=5)])
    dealer.take(0)
    dealer.ended(10, PortError.TIMEOUT)
    assert dealer.ended(20, None)[1][0] == PollEnded(20, 0, 0, 2, None, 0)


def test_late_is_how_long_a_turn_had_to_wait() -> None:
    dealer = PollList([Poll(1, READ, every=100), Poll(2, READ)])
    late = []
    for now in (0, 40, 90, 130):  # turns of 0, 1, 1 and, 30 too late, 0
        dealer.take(now)
        late.append(dealer.ended(now + 30, None)[1][0].late)
    # The second poll is due again as soon as it is over: at 70, taken at 90.
    assert late == [0, 40, 20, 30]


def test_a_cycle_is_over_when_all_had_a_turn() -> None:
    dealer = PollList([Poll(1, READ, every=100), Poll(2, READ, every=1000)])
    ended: list[PollEvent] = []
    for _ in range(12):
        due = dealer.next_due()
        dealer.take(due)
        ended += dealer.ended(due + 10, None)[1]
    cycles = [event for event in ended if isinstance(event, CycleEnded)]
    # The second cycle begins with the first poll at 100 and ends with the second one at 1000.
    assert [(cycle.number, cycle.duration) for cycle in cycles] == [(0, 10), (1, 910)]


def begun(dealer: PollList[Poll], length: int) -> list[tuple[int, str]]:
    """(begin, name) of each turn until none is due any more; every one succeeds after ``length`` ticks."""
    found, now = [], 0
    while (due := dealer.next_due()) is not None:
        now = max(now, due)
        poll = dealer.take(now)
        assert poll is not None
        found.append((now, poll.name))
        now += length
        dealer.ended(now, None)
    return found


def test_a_first_due_and_a_number_of_turns() -> None:
    polls = [
        Poll(1, READ, every=100, at=30, times=3, name="three"),
        Poll(1, READ, at=250, times=2, name="late"),
        Poll(1, READ, times=0, name="never"),
        Poll(1, READ, times=1, name="once"),
    ]
    dealer = PollList(polls)
    expected = [(0, "once"), (30, "three"), (130, "three"), (230, "three"), (250, "late"), (260, "late")]
    assert begun(dealer, 10) == expected
    # From another start on everything begins anew, the order of the list too.
    dealer.drop(1000)
    assert [dealer.next_due(), dealer.take(1000), dealer.attempt] == [1000, polls[3], 1]
    dealer.drop(2000)
    assert begun(dealer, 10) == [(2000 + tick, name) for tick, name in expected]


def test_retries_do_not_count_as_turns() -> None:
    dealer = PollList([Poll(1, READ, times=1, retries=1)])
    dealer.take(0)
    assert dealer.ended(5, PortError.TIMEOUT)[0] is not None
    assert dealer.attempt == 2
    assert dealer.ended(9, PortError.TIMEOUT)[0] is None
    assert dealer.next_due() is None


def test_a_cycle_is_made_of_the_polls_that_recur_for_ever() -> None:
    dealer = PollList(
        [Poll(1, READ, name="a"), Poll(1, READ, times=1, name="command"), Poll(1, READ, name="b")]
    )
    ended: list[PollEvent] = []
    now = 0
    for _ in range(5):
        dealer.take(now)
        now += 10
        ended += dealer.ended(now, None)[1]
    # a, command, b; then a, b.
    assert [event for event in ended if isinstance(event, CycleEnded)] == [
        CycleEnded(30, 0, 30),
        CycleEnded(50, 1, 20),
    ]
    commands = PollList([Poll(1, READ, times=1)])
    commands.take(0)
    assert [type(event) for event in commands.ended(5, None)[1]] == [PollEnded]


def test_misuse() -> None:
    dealer = PollList([])
    assert dealer.next_due() is None
    assert dealer.take(0) is None
    with pytest.raises(RuntimeError, match="no poll is running"):
        dealer.ended(0, None)


# -- the master that polls alone -----------------------------------------------------------------


def test_keeps_the_contract() -> None:
    engine: Engine[Adu, MasterEvent | PollEvent] = PollingMaster(MasterConfig(RTU, 100 * MS), PollList([]))
    assert engine.deadline() is None
    engine.start(0)
    assert engine.deadline() is None


def test_a_driver_may_take_what_is_due_without_poll() -> None:
    engine = PollingMaster(MasterConfig(RTU, 100 * MS), PollList([Poll(1, READ)]))
    assert engine.start(5) & TRANSMIT
    assert (engine.due, engine.due_counter) == (5, 1)
    engine.due = -1
    assert engine.poll() is None
    frame = engine.begin_transmit(5)
    engine.transmit_done(9 * MS)
    engine.heard = None
    assert engine.deadline() == 109 * MS
    foreign = frame._replace(station=2, chars=encode_adu(Mode.RTU, 2, frame.pdu).chars)
    assert engine.receive_frame(foreign, 20 * MS, 30 * MS) & OPEN
    assert engine.line_idle(30 * MS + engine.quiet) & EVENTS
    assert engine.heard == foreign


def test_polls_that_cannot_be_sent_are_misuse() -> None:
    with pytest.raises(ValueError, match="poll 1 cannot be sent: data"):
        PollingMaster(MasterConfig(RTU, 100 * MS), PollList([Poll(1, READ), Poll(1, Request(3, 0, 126))]))


def run(polls: list[Poll], stations: tuple[int, ...], until: int, *, whole: bool, **config: int) -> Wire:
    wire = Wire(RTU_LINE, whole=whole)
    master = PollingMaster(MasterConfig(RTU, **{"timeout": 100 * MS, **config}), PollList(polls))
    slave = Slave(SlaveConfig(RTU, delay=2 * MS), {station: PlainMap() for station in stations})
    wire.add(master)
    wire.add(slave)
    wire.handle(slave, slave.start(0))
    wire.handle(master, master.start(0))
    wire.run(until)
    return wire


@pytest.mark.parametrize("whole", [True, False])
def test_polls_one_slave(*, whole: bool) -> None:
    polls = [Poll(1, READ), Poll(1, write_register(5, 7)), Poll(0, write_register(6, 8), every=1000 * MS)]
    wire = run(polls, (1,), 2000 * MS, whole=whole)
    ended = [event for _, event in wire.events if isinstance(event, TransactionEnded)]
    assert len(ended) > 50
    assert all(event.error is None for event in ended)
    broadcasts = [event for event in ended if event.station == 0]
    assert 2 <= len(broadcasts) <= 3
    assert all(event.end - event.asked == 100 * MS for event in broadcasts)
    # A read: 8 characters, silence of 3.5, reply of 9 characters, silence of 3.5; then 5 ms.
    reads = [event for event in ended if event.request == READ]
    assert {event.end - event.sent for event in reads} == {RTU_LINE.characters(17) + 2 * RTU.quiet}
    starts = [event.sent for event in ended]
    pauses = {later - event.end for event, later in zip(ended, starts[1:], strict=False)}
    assert pauses == {5 * MS}


def test_wire_gives_the_same_whole_or_character_by_character() -> None:
    polls = [Poll(1, READ, every=50 * MS, retries=1), Poll(9, READ, retries=1), Poll(1, write_register(5, 7))]
    results = []
    for whole in (True, False):
        wire = run(polls, (1,), 3000 * MS, whole=whole)
        results.append(
            (
                [event for _, event in wire.events],
                [(start, chars) for start, _, chars in wire.sent],
            )
        )
    assert results[0] == results[1]


def test_a_dead_station_costs_timeout_times_attempts() -> None:
    wire = run([Poll(9, READ, retries=3)], (1,), 1000 * MS, whole=True, timeout=100 * MS)
    first = next(event for _, event in wire.events if isinstance(event, PollEnded))
    request = RTU_LINE.characters(8)
    assert first.tick - first.start == 4 * (request + 100 * MS) + 3 * 5 * MS
    assert (first.attempts, first.error) == (4, PortError.TIMEOUT)


def test_stop_and_start_again() -> None:
    wire = run([Poll(1, READ)], (1,), 105 * MS, whole=True)
    master = wire._engines[0]
    wire.handle(master, master.stop(wire.now))
    before = len(wire.sent)
    assert master.deadline() is None
    wire.run(300 * MS)
    assert len(wire.sent) <= before + 1  # a reply that was under way
    wire.handle(master, master.start(wire.now))
    wire.run(400 * MS)
    assert len(wire.sent) > before + 1


def test_a_timeout_shorter_than_the_slaves_delay_meets_late_replies() -> None:
    """Every response comes when the next request waits already; the ticks show to which request it belongs."""
    wire = Wire(RTU_LINE, whole=False)
    polls = [Poll(1, Request(3, address, 1)) for address in range(3)]
    master = PollingMaster(MasterConfig(RTU, timeout=30 * MS, interval=5 * MS), PollList(polls))
    plain = PlainMap()
    slave = Slave(SlaveConfig(RTU, delay=50 * MS), {1: plain})
    for engine in (slave, master):
        wire.add(engine)
        wire.handle(engine, engine.start(0))
    wire.run(1000 * MS)
    ended = [event for _, event in wire.events if isinstance(event, TransactionEnded)]
    late = [event for event in ended if event.error is None and event.answer_start - event.asked < 50 * MS]
    assert late
    assert any(event.error is PortError.TIMEOUT for event in ended)


def outcomes(polls: list[Poll], *, off: int, back: int, until: int) -> tuple[str, list[int]]:
    """Whose turns there are, of 10 ticks each, of which those of poll ``off`` fail before ``back``; when cycles ended."""
    dealer = PollList(polls)
    begun, ended, now = "", [], 0
    while (now := max(now, dealer.next_due() or 0)) < until:
        if dealer.take(now) is None:
            continue
        index = dealer.running or 0
        begun, now = begun + "abc"[index], now + 10
        _, events = dealer.ended(now, PortError.TIMEOUT if index == off and now <= back else None)
        ended += [event.tick for event in events if isinstance(event, CycleEnded)]
    return begun, ended


def test_a_poll_that_failed_leaves_turns_out() -> None:
    # b is off: it is asked in each third turn only, and no cycle waits for it.
    polls = [Poll(1, READ), Poll(2, READ, skip_after_failure=3), Poll(3, READ)]
    begun, ended = outcomes(polls, off=1, back=999, until=140)
    assert begun == "abc" + "ac" + "ac" + "abc" + "ac" + "ac"
    assert ended == [30, 50, 70, 100, 120, 140]
    # From 60 on it is there again: once it has been asked, each turn is made.
    begun, _ = outcomes(polls, off=1, back=60, until=140)
    assert begun == "abc" + "ac" + "ac" + "abc" + "abc" + "a"


def test_a_period_goes_on_while_turns_are_left_out() -> None:
    polls = [Poll(1, READ, every=100, skip_after_failure=4)]
    dealer = PollList(polls)
    begun, now = [], 0
    while now < 1000:
        now = max(now, dealer.next_due() or 0)
        if dealer.take(now) is not None:
            begun.append(now)
            dealer.ended(now + 10, PortError.TIMEOUT if now < 500 else None)
    assert begun == [0, 400, 800, 900, 1000]


def test_with_nothing_else_due_turns_are_left_out_at_once() -> None:
    assert outcomes([Poll(1, READ, skip_after_failure=9)], off=0, back=99, until=50)[0] == "aaaaa"

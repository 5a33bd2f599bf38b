"""A master that knows late responses, against slaves that respond in order after any time, in virtual time."""

from __future__ import annotations

from dataclasses import dataclass, field

import hypothesis.strategies as st
from hypothesis import given

from bussim.engines.contract import RxChar, Transmit
from bussim.engines.modbus.adu import Adu, Mode, encode_adu
from bussim.engines.modbus.events import ForeignFrame, TransactionEnded
from bussim.engines.modbus.framing import Framing
from bussim.engines.modbus.master import MasterConfig
from bussim.engines.modbus.pdu import Request
from bussim.engines.modbus.polls import Poll, PollList
from bussim.engines.modbus.resync import ResyncingMaster
from bussim.line.characters import CharFormat, LineTiming
from bussim.units import TICKS_PER_MS

LINE = LineTiming(19200, CharFormat(8, "E", 1))
FRAMING = Framing.rtu(LINE)
TIMEOUT = 100 * TICKS_PER_MS


@dataclass
class Run:
    """A master and its slaves, event by event. ``delays`` (ms, None: no response) are used in order."""

    master: ResyncingMaster
    delays: list[int | None]
    now: int = 0
    ended: list[TransactionEnded] = field(default_factory=list)
    foreign: list[ForeignFrame] = field(default_factory=list)
    due: list[tuple[int, Adu]] = field(default_factory=list)
    idle: int | None = None

    def until(self, transactions: int) -> None:
        self.master.start(0)
        while len(self.ended) < transactions and self._collect():
            times = [at for at in (self.master.deadline(), self.idle) if at is not None]
            times += [self.due[0][0]] if self.due else []
            if not times:
                return
            self.now = max(self.now, min(times))
            if self.due and self.due[0][0] <= self.now:
                self._respond(self.due.pop(0)[1])
            elif self.idle is not None and self.idle <= self.now:
                self.idle = None
                self.master.line_idle(self.now)
            else:
                self.master.on_deadline(self.now)

    def _collect(self) -> bool:
        while (item := self.master.poll()) is not None:
            if isinstance(item, Transmit):
                self.now = max(self.now, item.at)
                adu = self.master.begin_transmit(self.now, item.counter)
                self.now += LINE.characters(len(adu.chars))
                self.master.transmit_done(self.now)
                self._ask(adu)
            elif isinstance(item, TransactionEnded):
                self.ended.append(item)
            elif isinstance(item, ForeignFrame):
                self.foreign.append(item)
        return True

    def _ask(self, adu: Adu) -> None:
        delay = self.delays.pop(0) if self.delays else 2
        if delay is not None:
            function, address = adu.pdu[0], adu.pdu[2]
            pdu = bytes((function, 2, adu.station, address))  # its value says whose it is
            at = max(self.now + delay * TICKS_PER_MS, self.due[-1][0] + 20 * TICKS_PER_MS if self.due else 0)
            self.due.append((at, encode_adu(Mode.RTU, adu.station, pdu)))

    def _respond(self, adu: Adu) -> None:
        for number, value in enumerate(adu.chars):
            start = self.now + LINE.characters(number)
            self.master.receive(RxChar(value), start, self.now + LINE.characters(number + 1))
        self.now += LINE.characters(len(adu.chars))
        self.idle = self.now + FRAMING.quiet


def run(polls: list[Poll], delays: list[int | None], *, resync: bool = True, transactions: int = 30) -> Run:
    config = MasterConfig(FRAMING, TIMEOUT, begun_holds=True)
    found = Run(ResyncingMaster(config, PollList(polls), resync=resync), delays)
    found.until(transactions)
    return found


def wrong(found: Run) -> list[TransactionEnded]:
    return [
        ended
        for ended in found.ended
        if ended.response and ended.response.values != ((ended.station << 8) + ended.request.address,)
    ]


A, B = Poll(1, Request(3, 0, 1)), Poll(1, Request(3, 1, 1))

poll = st.builds(
    Poll,
    st.integers(1, 2),
    st.builds(Request, st.sampled_from([3, 4]), st.integers(0, 2), st.just(1)),
    retries=st.integers(0, 2),
)


@given(st.lists(poll, min_size=1, max_size=4), st.lists(st.none() | st.integers(1, 700), max_size=20))
def test_no_value_gets_a_wrong_name(polls: list[Poll], delays: list[int | None]) -> None:
    found = run(polls, delays)
    assert not wrong(found)
    assert found.ended[-1].error is None  # and it goes on where all respond in time


def test_without_resync_a_late_response_shifts_all_that_follow_and_is_told() -> None:
    found = run([A, B], [140], resync=False, transactions=9)
    assert len(wrong(found)) == 8
    assert [frame.taken for frame in found.foreign] == [True] * 8


def test_without_resync_a_slave_that_ignores_requests_while_it_is_busy_is_told() -> None:
    """A takes 140 ms, and B is asked meanwhile, in vain: each value of B is A's, and is said to be A's."""
    found = run([A, B], [140, None] * 4, resync=False, transactions=8)
    assert [ended.request for ended in wrong(found)] == [B.request] * 4
    assert [frame.late and frame.late.request for frame in found.foreign] == [A.request] * 4


def test_the_next_request_leaves_as_soon_as_the_late_response_has_come() -> None:
    found = run([A, B], [140], transactions=2)
    (late,) = found.foreign
    assert late.late is not None
    assert (late.late.request, late.taken) == (A.request, False)
    sent = found.ended[1].sent
    assert sent is not None
    assert late.tick <= sent < late.tick + 10 * TICKS_PER_MS


def test_a_response_that_never_comes_is_waited_for_three_timeouts_or_a_second() -> None:
    found = run([A, B], [None], transactions=2)
    first, second = found.ended
    assert first.asked is not None
    assert second.sent == first.asked + 1000 * TICKS_PER_MS


def test_other_stations_and_functions_do_not_wait() -> None:
    found = run([A, Poll(2, A.request), Poll(1, Request(4, 0, 1))], [None, 2, 2], transactions=3)
    assert [ended.error for ended in found.ended] == [9, None, None]
    assert found.ended[1].sent == found.ended[0].end + 5 * TICKS_PER_MS


def test_a_repeat_whose_response_may_be_the_late_one_is_the_last_doubt() -> None:
    found = run([Poll(1, A.request, retries=1)], [None], transactions=10)
    assert [frame.taken for frame in found.foreign] == [True]

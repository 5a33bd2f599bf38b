"""What every engine promises: nothing that is heard raises, and how it is delivered makes no difference."""

from __future__ import annotations

from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from bussim.engines.contract import OPEN, RxChar, Transmit
from bussim.engines.free.engine import FreeConfig, FreePort
from bussim.engines.modbus.adu import Adu, Mode, decode_ascii, decode_rtu, encode_adu
from bussim.engines.modbus.events import TransactionEnded
from bussim.engines.modbus.framing import Framing
from bussim.engines.modbus.master import Master, MasterConfig
from bussim.engines.modbus.pdu import (
    Request,
    encode_exception,
    encode_request,
    encode_response,
    write_register,
)
from bussim.engines.modbus.polling import PollingMaster
from bussim.engines.modbus.polls import Poll, PollList
from bussim.engines.modbus.slave import Slave, SlaveConfig
from bussim.units import TICKS_PER_MS
from tests.engines.modbus.frames import EXCHANGES
from tests.engines.modbus.maps import PlainMap
from tests.engines.modbus.wire import ASCII_LINE, RTU_LINE

MS = TICKS_PER_MS
FRAMINGS = {Mode.RTU: (Framing.rtu(RTU_LINE), RTU_LINE), Mode.ASCII: (Framing.ascii(), ASCII_LINE)}
READ = Request(3, 0, 2)


def engine_of(kind: str, mode: Mode) -> Any:
    framing, line = FRAMINGS[mode]
    if kind == "slave":
        return Slave(SlaveConfig(framing, delay=3 * MS), {1: PlainMap(), 17: PlainMap()})
    if kind == "free":
        return FreePort(FreeConfig(line, 100 * MS, start=0x02, end=0x03))
    config = MasterConfig(framing, 100 * MS, interval=0)
    if kind == "master":
        return Master(config)
    return PollingMaster(config, PollList([Poll(1, READ, retries=1), Poll(17, write_register(3, 4))]))


class Driver:
    """Runs one engine over a script of what it hears, keeping its deadlines and due transmissions."""

    def __init__(self, kind: str, mode: Mode, *, whole: bool) -> None:
        self.framing, self.line = FRAMINGS[mode]
        self.kind, self.mode, self.whole = kind, mode, whole
        self.engine = engine_of(kind, mode)
        self.now = 0
        self.seen: list[Any] = []
        self.open_since: int | None = None
        self.begin: int | None = None
        self.follow(self.engine.start(0))
        if kind == "free":
            self.follow(self.engine.drive(5, 0))

    def follow(self, hints: int, heard: int | None = None) -> None:
        if hints & OPEN and heard is not None:
            self.open_since = heard
        elif heard is not None:
            self.open_since = None
        while (item := self.engine.poll()) is not None:
            if isinstance(item, Transmit):
                self.begin = max(item.at, self.now)
            else:
                self.seen.append(item)
        if self.kind == "master" and self.engine.idle:
            self.follow(self.engine.submit(1, READ, self.now))

    def until(self, tick: int) -> None:
        """Everything that is due before the next character begins at ``tick``."""
        while True:
            due = []
            deadline = self.engine.deadline()
            if deadline is not None:
                due.append((max(deadline, self.now), 1))
            quiet = getattr(self.engine, "quiet", None)
            if self.open_since is not None and quiet is not None:
                due.append((self.open_since + quiet, 0))
            if self.begin is not None:
                due.append((self.begin, 2))
            if not due or min(due)[0] > tick:
                return
            self.now, what = min(due)
            if what == 0:
                self.open_since = None
                self.follow(self.engine.line_idle(self.now))
            elif what == 1:
                self.follow(self.engine.on_deadline(self.now))
            else:
                self.begin = None
                frame = self.engine.begin_transmit(self.now)
                self.seen.append(frame.chars)
                self.open_since = None
                self.now += self.line.characters(len(frame.chars))
                self.follow(self.engine.transmit_done(self.now))

    def receive_chars(self, gap: int, chars: bytes) -> None:
        start = self.now + gap
        self.until(start)
        start = max(start, self.now)
        end = start + self.line.characters(len(chars))
        adu = decode_rtu(chars) if self.mode is Mode.RTU else decode_ascii(chars)
        if self.whole and self.open_since is None and isinstance(adu, Adu):
            self.now = end
            self.follow(self.engine.receive_frame(adu, start, end), end)
            return
        for number, value in enumerate(chars):
            begun, ended = (start + self.line.characters(number + k) for k in (0, 1))
            hints = self.engine.receive(RxChar(value), begun, ended)
            self.now = ended
            self.follow(hints, ended)


def frames_for(mode: Mode) -> list[bytes]:
    pdus = [(e.station, encode_request(e.request)) for e in EXCHANGES]
    pdus += [(e.station, encode_response(e.response)) for e in EXCHANGES]
    pdus += [(1, encode_exception(3, 2)), (0, encode_request(write_register(1, 2)))]
    return [encode_adu(mode, station, pdu).chars for station, pdu in pdus]


modes = st.sampled_from(list(Mode))
kinds = st.sampled_from(["master", "slave", "polling", "free"])
gaps = st.sampled_from([0, 1, 10_000, 100_000, 200_000, 262_500, 300_000, 5 * MS, 99 * MS, 1100 * MS])


def scripts(mode: Mode) -> st.SearchStrategy[list[tuple[int, bytes]]]:
    junk = st.binary(min_size=1, max_size=20)
    halves = st.tuples(st.sampled_from(frames_for(mode)), st.integers(1, 12)).map(lambda p: p[0][: p[1]])
    return st.lists(st.tuples(gaps, st.sampled_from(frames_for(mode)) | junk | halves), max_size=12)


@given(st.data(), kinds, modes)
def test_nothing_that_is_heard_raises(data: st.DataObject, kind: str, mode: Mode) -> None:
    driver = Driver(kind, mode, whole=False)
    for gap, chars in data.draw(scripts(mode)):
        driver.receive_chars(gap, chars)
    driver.until(driver.now + 5000 * MS if kind in ("slave", "free") else driver.now + 500 * MS)


@given(st.data(), st.sampled_from(["master", "slave", "polling"]), modes)
def test_whole_frames_are_the_same_as_their_characters(data: st.DataObject, kind: str, mode: Mode) -> None:
    script = data.draw(scripts(mode))
    seen = []
    for whole in (True, False):
        driver = Driver(kind, mode, whole=whole)
        for gap, chars in script:
            driver.receive_chars(gap, chars)
        driver.until(driver.now + 300 * MS)
        seen.append(driver.seen)
    assert seen[0] == seen[1]


@given(st.binary(max_size=40), st.integers(0, 255), st.booleans(), st.booleans())
def test_damaged_characters_never_raise_nor_make_a_frame(
    chars: bytes, value: int, parity_ok: bool, stop_ok: bool
) -> None:
    """A frame with a damaged character in it is never served."""
    framing, line = FRAMINGS[Mode.RTU]
    plain = PlainMap()
    slave = Slave(SlaveConfig(framing), {1: plain})
    slave.start(0)
    good = EXCHANGES[3].request_chars
    stream = [RxChar(c) for c in good[:6]] + [RxChar(value, parity_ok, stop_ok)]
    stream += [RxChar(c) for c in good[7:] + chars]
    for number, char in enumerate(stream):
        slave.receive(char, line.characters(number), line.characters(number + 1))
    slave.line_idle(line.characters(len(stream)) + framing.quiet)
    intact = parity_ok and stop_ok and value == good[6] and not chars
    assert bool(plain.calls) == intact


@given(st.integers(1, 10**9), st.integers(1, 10**9))
def test_no_transaction_ends_before_its_timeout_in_silence(asked: int, timeout: int) -> None:
    master = Master(MasterConfig(FRAMINGS[Mode.RTU][0], timeout))
    master.start(0)
    master.submit(1, READ, 0)
    master.begin_transmit(0)
    master.transmit_done(asked)
    assert master.deadline() == asked + timeout
    master.line_idle(asked + timeout - 1)
    assert not master.idle
    master.on_deadline(asked + timeout)
    events = []
    while (item := master.poll()) is not None:
        events.append(item)
    assert [type(item) for item in events] == [TransactionEnded]
    assert events[0].end == asked + timeout

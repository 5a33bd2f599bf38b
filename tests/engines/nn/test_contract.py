"""The engines' contract, for master and slave alike, over random histories."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import FrozenInstanceError, fields, is_dataclass
from inspect import isfunction, signature
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bussim.engines.contract import (
    DEADLINE,
    EVENTS,
    OPEN,
    OWN_HINTS,
    SERVE,
    TRANSMIT,
    Engine,
    RxChar,
    Transmit,
)
from bussim.engines.nn import events
from bussim.engines.nn.contract import STORED, NnEngine
from bussim.engines.nn.events import NnEvent
from bussim.engines.nn.frames import (
    DATA,
    MODES,
    Frame,
    LinkSettings,
    encode_data,
    encode_parameters,
    encode_poll,
)
from bussim.engines.nn.master import Master, MasterConfig, MasterState
from bussim.engines.nn.monitor import SlaveConfig
from bussim.engines.nn.slave import Slave, SlaveState
from tests.engines.wire import CHAR, GAP, OVERHEAD, QUIET, TIMEOUT_UNIT, TURNAROUND

Either = Master | Slave
SLAVES, TIMEOUT = 3, 5
SETTINGS = LinkSettings(SLAVES, 0, 1, TIMEOUT)


def new_master(*, probe: bool = False, on_edge: bool = False) -> Master:
    timeout = TIMEOUT * TIMEOUT_UNIT
    return Master(MasterConfig(SETTINGS, 2, timeout, GAP, OVERHEAD, probe, on_edge), traced=True)


def new_slave(*, probe: bool = False, on_edge: bool = False) -> Slave:
    del probe
    return Slave(SlaveConfig(2, (0, 1), TIMEOUT_UNIT, TURNAROUND, CHAR, on_edge))


ENGINES = {"master": new_master, "slave": new_slave}
Make = Callable[..., Either]
each_engine = pytest.mark.parametrize("make", ENGINES.values(), ids=ENGINES)


@each_engine
def test_it_has_what_the_contract_names(make: Make) -> None:
    engine = make()
    for name in (*Engine.__annotations__, *NnEngine.__annotations__):
        assert hasattr(engine, name)
    methods = [name for name, member in vars(Engine).items() if isfunction(member) and name[0] != "_"]
    assert len(methods) == 10
    for name in methods:
        wanted, found = (list(signature(getattr(kind, name)).parameters) for kind in (Engine, type(engine)))
        assert found == wanted


# -- random histories ------------------------------------------------------------------------------------

#: Frames by how near they are to what would be right: counters and stations relative to the engine's.
sizes = st.sampled_from([8, 8, 8, 8, 12])
ops = st.one_of(
    st.tuples(st.just("reply"), st.sampled_from([0, 0, 0, 1, 5]), st.sampled_from([0, 0, 0, 1, 15]), sizes),
    st.tuples(st.just("poll"), st.integers(1, 4), st.sampled_from([0, 0, 0, 1])),
    st.tuples(st.just("master data"), st.sampled_from([0, 1, 1]), sizes),
    st.tuples(st.just("parameters"), st.sampled_from([SETTINGS, SETTINGS, SETTINGS._replace(timeout=9)])),
    st.tuples(st.just("other mode"), st.sampled_from([1, 4])),
    st.tuples(st.just("send")),
    st.tuples(st.just("send")),
    st.tuples(st.just("deadline")),
    st.tuples(st.just("nearly"), st.sampled_from([1, 2, 5, 6, 14, 15, 22, 23, 30, 31])),
    st.tuples(
        st.just("noise"),
        st.lists(
            st.tuples(st.sampled_from(b"\x01\x02\x03\x05012F?"), st.booleans(), st.booleans()), max_size=4
        ),
    ),
    st.tuples(st.just("quiet")),
    st.tuples(st.just("stop and start")),
)


class Twin:
    """One engine with its clock; ``whole``: given whole frames where that is allowed."""

    def __init__(self, engine: Either, *, whole: bool) -> None:
        self.engine = engine
        self.whole = whole
        self.now = 0
        self.open = False
        self.events: list[NnEvent] = []
        self.transmits: list[Transmit] = []
        self.log: list[object] = []
        self._after(engine.start(0))

    # What follows a call: hints are complete, `poll` drains, the deadline is not in the past.
    def _after(self, hints: int) -> int:
        engine = self.engine
        assert not hints & ~(TRANSMIT | DEADLINE | OPEN | EVENTS | STORED)
        wanted = 0
        while (item := engine.poll()) is not None:
            if isinstance(item, Transmit):
                assert item.at >= 0
                self.transmits.append(item)
                wanted |= TRANSMIT
            else:
                self.events.append(item)
                wanted |= EVENTS
        assert engine.poll() is None
        assert wanted & ~hints == 0
        assert not hints & TRANSMIT or wanted & TRANSMIT
        assert not hints & EVENTS or wanted & EVENTS
        deadline = engine.deadline()
        assert deadline is None or deadline >= self.now
        return hints & ~OPEN

    def frame(self, frame: Frame) -> None:
        start = self.now
        end = start + CHAR * len(frame.chars)
        deadline = self.engine.deadline()
        if deadline is not None and deadline < end:
            return  # a driver would call on_deadline first: that is the op of that name
        if self.whole and not self.open:
            self.now = end
            hints = self.engine.receive_frame(frame, start, end)
            self.open = bool(hints & OPEN)
            done = self._after(hints)
        else:
            done = 0
            for char in frame.chars:
                done |= self._char(RxChar(char))
        self.log.append(done)

    def _char(self, char: RxChar) -> int:
        start = self.now
        self.now += CHAR
        hints = self.engine.receive(char, start, self.now)
        self.open = bool(hints & OPEN)
        return self._after(hints)

    def do(self, op: tuple[object, ...]) -> None:
        engine = self.engine
        name, *rest = op
        frame = frame_of(engine, name, rest)
        if frame is not None:
            self.frame(frame)
        elif name == "send":
            self._send()
        elif name == "deadline":
            self.quiet()  # which comes first unless the deadline is near
            deadline = engine.deadline()
            if deadline is not None:
                self.now = deadline
                self.log.append(self._after(engine.on_deadline(deadline)))
                after = engine.deadline()
                assert after is None or after > deadline
        elif name == "noise":
            deadline = engine.deadline()
            chars = rest[0]
            assert isinstance(chars, list)
            if deadline is None or deadline >= self.now + CHAR * len(chars):
                self.log.append([self._char(RxChar(*char)) for char in chars])
        elif name == "nearly":
            # the deadline so many characters ahead, after quiet
            self.quiet()
            deadline, ahead = engine.deadline(), rest[0]
            assert isinstance(ahead, int)
            if deadline is not None:
                self.now = max(self.now, deadline - ahead * CHAR)
        elif name == "quiet":
            self.quiet()
        elif name == "stop and start":
            self._after(engine.stop(self.now))
            assert engine.deadline() is None
            assert not engine.status.running
            self.transmits.clear()
            self._after(engine.start(self.now))
            self.open = False

    def quiet(self) -> None:
        deadline = self.engine.deadline()
        if deadline is not None and deadline < self.now + QUIET:
            return
        self.now += QUIET
        if self.open:
            self.open = False
            self.log.append(self._after(self.engine.line_idle(self.now)))

    def _send(self) -> None:
        if not self.transmits:
            return
        item = self.transmits.pop(0)
        self.now = max(self.now, item.at)
        deadline = self.engine.deadline()
        if deadline is not None and deadline < self.now + 100 * CHAR:
            self.transmits.insert(0, item)
            return
        self.engine.image = bytes(range(8))
        frame = self.engine.begin_transmit(self.now, item.counter)
        self.log.append(frame)
        self.now += CHAR * len(frame.chars)
        self.open = False
        self.log.append(self._after(self.engine.transmit_done(self.now)))
        assert not item.reply or isinstance(self.engine, Slave)

    def outputs(self) -> list[object]:
        engine, status = self.engine, self.engine.status
        found: list[object] = [
            engine.state,
            engine.deadline(),
            engine.due,
            engine.due_counter,
            engine.wants_image,
        ]
        found += [list(status.counts), list(status.codes), list(status.flags)]
        found += [status.running, status.current, status.longest, status.longest_at]
        found += [list(self.events), list(self.transmits), list(self.log)]
        if isinstance(engine, Slave):
            found += [engine.reception, engine.settings, engine.watchdog, engine.steady]
        else:
            found += [engine.failed_attempts, engine.station_errors, engine.polls]
        return found


def frame_of(engine: Either, name: object, rest: list[object]) -> Frame | None:
    """The frame that an op stands for, near to what the engine expects."""
    if isinstance(engine, Master):
        station, counter = engine._station, engine._counter
    else:
        station, counter = max(engine.pending, 0) or 3, max(engine._counter, 0)
    match name, rest:
        case "reply", [int(other), int(later), int(size)]:
            return encode_data((station + other) % 8, (counter + later) % 16, bytes(range(size)))
        case "poll", [int(polled), int(later)]:
            return encode_poll(polled, (counter + later) % 16)
        case "master data", [int(later), int(size)]:
            return encode_data(0, (counter + later) % 16, bytes(size))
        case "parameters", [LinkSettings() as link]:
            return encode_parameters(counter, link)
        case "other mode", [int(mode)]:
            return encode_parameters(counter, SETTINGS._replace(mode=mode))
    return None


@each_engine
@given(history=st.lists(ops, max_size=30), probe=st.booleans(), on_edge=st.booleans())
def test_whole_frames_and_their_characters_are_the_same(
    make: Make, history: list[tuple[object, ...]], probe: bool, on_edge: bool
) -> None:
    one = Twin(make(probe=probe, on_edge=on_edge), whole=True)
    other = Twin(make(probe=probe, on_edge=on_edge), whole=False)
    # Begin where it becomes interesting: a slave with parameters, a master that listens.
    start: list[tuple[object, ...]] = [("parameters", SETTINGS), ("send",), ("send",), ("send",)]
    for op in start + history:
        one.do(op)
        other.do(op)
        assert one.now == other.now
        assert one.outputs() == other.outputs()


@each_engine
@given(
    history=st.lists(
        st.one_of(
            ops,
            st.tuples(st.just("raw"), st.lists(st.tuples(st.integers(0, 255), st.booleans(), st.booleans()))),
        ),
        max_size=30,
    )
)
def test_random_characters_never_raise(make: Make, history: list[tuple[object, ...]]) -> None:
    twin = Twin(make(), whole=True)
    for name, *rest in history:
        twin.do(("noise", *rest) if name == "raw" else (name, *rest))
    limits = twin.engine.status
    assert all(0 <= count <= 32767 for count in limits.counts)


@given(history=st.lists(ops, max_size=40))
def test_a_master_can_always_go_on(history: list[tuple[object, ...]]) -> None:
    """In RUN it either has something to send or an attempt that ends by itself, never both or neither."""
    engine = new_master()
    twin = Twin(engine, whole=True)
    for op in history:
        twin.do(op)
        assert engine.state is not MasterState.STOPPED
        assert len(twin.transmits) + (engine.deadline() is not None) == 1
        if engine.state is MasterState.REPLY:
            assert engine.deadline() == engine._poll_end + TIMEOUT * TIMEOUT_UNIT
        assert not any(item.reply for item in twin.transmits)


@given(history=st.lists(ops, max_size=40))
def test_a_slave_replies_to_every_poll_of_its_own_once(history: list[tuple[object, ...]]) -> None:
    engine = new_slave()
    twin = Twin(engine, whole=True)
    linked = polls = 0
    for op in [("parameters", SETTINGS), *history]:
        before, now, pending = engine.state, twin.now, len(twin.transmits)
        twin.do(op)
        if op[0] == "stop and start":
            assert twin.transmits == []
            continue
        if op[:2] == ("poll", 2) and before is SlaveState.LINKED and twin.now > now:
            polls += 1
            assert len(twin.transmits) == pending + 1
            assert twin.transmits[-1] == Transmit(twin.now, reply=True, counter=engine.reception.counter)
        linked += engine.state is SlaveState.LINKED
        if engine.deadline() is not None:
            assert engine.deadline() == engine.reception.heard_master + engine.watchdog
    assert linked >= 1


@each_engine
def test_starting_twice_is_the_caller_s_mistake(make: Make) -> None:
    engine = make()
    engine.start(0)
    with pytest.raises(KeyError):
        engine.start(0)


@each_engine
def test_stopped_it_receives_nothing_and_sends_nothing(make: Make) -> None:
    engine = make()
    for _ in range(2):
        frames = [
            encode_parameters(0, SETTINGS),
            encode_data(0, 0, bytes(8)),
            encode_poll(2, 0),
            encode_data(1, 0, bytes(8)),
        ]
        for frame in frames:
            assert engine.receive_frame(frame, 0, 100) == 0
            for char in frame.chars:
                assert engine.receive(RxChar(char), 0, 100) & ~OPEN == 0
        assert engine.line_idle(200) == 0
        assert engine.poll() is None
        assert engine.deadline() is None
        assert engine.transmit_done(300) == 0
        assert not engine.status.running
        assert engine.status.counts == engine.status.codes == [0] * 8
        engine.start(1000)
        while engine.poll() is not None:
            pass
        engine.stop(1001)


@pytest.mark.parametrize("event", get_args(events.NnEvent), ids=lambda event: event.__name__)
def test_events_are_frozen_values(event: type) -> None:
    assert is_dataclass(event)
    names = [field.name for field in fields(event)]
    one, same = event(*range(len(names))), event(*range(len(names)))
    assert one == same
    assert hash(one) == hash(same)
    for name in names:
        with pytest.raises(FrozenInstanceError):
            setattr(one, name, 99)
    with pytest.raises((AttributeError, TypeError)):
        one.anything = 1


def test_hints_are_separate_bits() -> None:
    hints = [TRANSMIT, DEADLINE, OPEN, EVENTS, SERVE, STORED]
    assert [hint.bit_count() for hint in hints] == [1] * 6
    assert sum(hints) == TRANSMIT | DEADLINE | OPEN | EVENTS | SERVE | STORED
    assert max(hints) == STORED == OWN_HINTS


def test_an_image_is_asked_for_only_where_it_is_sent() -> None:
    master = new_master()
    master.start(0)
    kinds = []
    for _ in range(3):
        wanted = master.wants_image
        master.image = bytes(MODES[0].size) if wanted else b""
        frame = master.begin_transmit(0)
        kinds.append((frame.kind == DATA, wanted))
        master.transmit_done(1)
    assert kinds == [(False, False), (True, True), (False, False)]
    assert new_slave().wants_image


def test_kept_encodings_follow_image_and_counter() -> None:
    """Encodings are kept while the image stays the same; equal images need not be the same object."""
    slave = new_slave()
    slave.start(0)
    for image in (b"abcdefgh", bytes(bytearray(b"abcdefgh")), b"ABCDEFGH", b"abcdefgh"):
        for counter in (0, 7, 0, 15):
            slave.image = image
            assert slave.begin_transmit(0, counter) == encode_data(2, counter, image)

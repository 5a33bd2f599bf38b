"""Faults of every kind, begun and ended at any time in any order: the line's books stay balanced."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from bussim.plc.profiles import PROFILES
from bussim.scenario import fault_kinds, model
from bussim.sim.nn.link_port import LinkPort
from tests.selection import quick
from tests.sim import chance
from tests.sim.build import MS, Recorder, bus_of, link, plc, run, started

NAMES = ("p0", "p1", "p2", "p3", "twin")
STATIONS = st.sampled_from(NAMES)
DIRECTIONS = st.sampled_from(list(fault_kinds.Direction))
COUNTS = st.sampled_from([None, 1, 3])
KINDS = st.one_of(
    st.builds(fault_kinds.PowerOff, STATIONS),
    st.builds(fault_kinds.Stop, STATIONS),
    st.builds(fault_kinds.DropReply, STATIONS, COUNTS),
    st.builds(fault_kinds.Slow, STATIONS, st.integers(1, 70 * MS)),
    st.builds(fault_kinds.Jabber, STATIONS),
    st.builds(fault_kinds.CableCut, st.just("link"), STATIONS),
    st.builds(fault_kinds.WrongFormat, STATIONS, st.sampled_from(chance.TIMINGS)),
    st.builds(fault_kinds.ClockPpm, STATIONS, st.sampled_from([Fraction(200), Fraction(60_000)])),
    st.builds(fault_kinds.LateRelease, STATIONS, st.sampled_from([1000, 40_000, 200_000])),
    st.builds(fault_kinds.LoseChar, STATIONS, DIRECTIONS, COUNTS),
    st.builds(fault_kinds.InsertChar, STATIONS, DIRECTIONS, COUNTS),
    st.builds(
        fault_kinds.FlipBits,
        STATIONS,
        DIRECTIONS,
        st.tuples(st.integers(0, 300), st.integers(0, 300)),
        COUNTS,
    ),
)
STEPS = st.one_of(st.integers(1, 100), st.integers(1, 60_000), st.integers(1, 6_000_000))


class Line(RuleBasedStateMachine):
    """A link whose faults begin and end between two events, at the rules' own times."""

    @initialize(seed=st.integers(0, 99), mode=st.integers(0, 2), family=st.sampled_from(["pw10", "fx2n"]))
    def build(self, seed: int, mode: int, family: str) -> None:
        registers = {"D8177": 3, "D8178": mode} if seed % 4 == 0 else {}
        more = [plc(seed % 4, profile=PROFILES[family], name="twin", registers=registers)]
        scenario = link(4, mode, seconds=3600, retries=1, profile=PROFILES[family], seed=seed, more=more)
        self.simulation, self.record = started(scenario)
        self.bus = bus_of(self.simulation)
        self.undo: list[Callable[[int], None]] = []
        self.count = 0

    @rule(step=STEPS)
    def wait(self, step: int) -> None:
        self.simulation.run(self.simulation.now + step)

    @rule(kind=KINDS, step=STEPS)
    def begin(self, kind: fault_kinds.FaultKind, step: int) -> None:
        self.count += 1
        fault = model.Fault(f"{self.count}", kind, model.Window(self.simulation.now))
        undo = self.simulation.faults._begin(fault, self.simulation.now)
        if undo is not None:
            self.undo.append(undo)
        self.simulation.run(self.simulation.now + step)

    @rule(number=st.integers(0, 20), step=STEPS)
    def end(self, number: int, step: int) -> None:
        if self.undo:
            self.undo.pop(number % len(self.undo))(self.simulation.now)
        self.simulation.run(self.simulation.now + step)

    @invariant()
    def balanced(self) -> None:
        if not hasattr(self, "bus"):
            return
        assert self.bus.drivers == sum(map(drivers, self.bus.ports))
        assert len(self.bus._on_wire) == sum(map(on_wire, self.bus.ports))
        assert self.bus._open_receivers == sum(port.receiver.is_open for port in self.bus.ports)
        self.bus.close(self.simulation.now)
        assert 0 <= self.bus.busy <= self.simulation.now
        for port in self.bus.ports:
            assert not (port.driving and port.receiver.is_open)
            assert (port.engine is not None) <= (port.plc.state.value == "run")

    def teardown(self) -> None:
        if not hasattr(self, "bus"):
            return
        for undo in self.undo:
            undo(self.simulation.now)
        self.simulation.run(self.simulation.now + 100_000)
        for name in self.simulation.plcs:
            self.simulation.faults._begin(model.Fault("stop", fault_kinds.Stop(name)), self.simulation.now)
        busy = self.bus.busy
        self.simulation.run(self.simulation.now + 10 * MS)
        # Every PLC is in STOP: no driver is on, nothing is received, nothing will happen.
        self.bus.close(self.simulation.now)
        assert self.bus.drivers == 0
        assert self.bus._on_wire == []
        assert self.bus._open_receivers == 0
        for port in self.bus.ports:
            assert port._start_timer.at == port._end_timer.at == port._release_timer.at == -1
        later = self.bus.busy
        self.simulation.run(self.simulation.now + 1000 * MS)
        self.bus.close(self.simulation.now)
        assert self.bus.busy == later >= busy
        assert_ordered(self.record)


def on_wire(port: LinkPort) -> int:
    """Transmissions of a port that reach the line now."""
    tx = port.sending
    return int(tx is not None and not tx.silent and not tx.cut) + int(port.jabbering)


def drivers(port: LinkPort) -> int:
    return on_wire(port) + (port.tail is not None)


def assert_ordered(record: Recorder) -> None:
    """Ticks never decrease from one call to the next of one method, those of refreshes of each source."""
    for ticks in (
        [scan.start + scan.duration for scan in record.scans],
        [attempt.end for attempt in record.attempts],
        [frame.end for frame in record.frames],
        [tick for _, tick, _, _ in record.failures],
        [note.tick for note in record.notes],
        *([tick for _, source, tick, _ in record.refreshes if source == position] for position in range(8)),
    ):
        assert ticks == sorted(ticks)
    driven: dict[str, int] = {}
    for frame in record.frames:
        assert frame.start <= frame.end
        assert frame.released is None or frame.end <= frame.released
        assert driven.get(frame.sender, 0) <= frame.start
        driven[frame.sender] = frame.released or frame.end


Line.TestCase.settings = settings(stateful_step_count=30)
TestLine = Line.TestCase


@pytest.mark.parametrize("seed", quick(20, range(200, 260)))
def test_records_come_in_order_and_loads_are_shares(seed: int) -> None:
    done = run(chance.scenario(seed, 0.6))
    assert_ordered(done.record)
    assert 0 <= done.link.busy <= done.totals.duration
    assert done.link.busy <= sum(f.end - f.start for f in done.record.frames) + 30 * MS or any(
        isinstance(fault.kind, fault_kinds.LateRelease) for fault in chance.scenario(seed).faults
    )
    scans = done.record.scans
    assert [scan.number for scan in scans] == list(range(len(scans)))
    for scan in scans:
        assert scan.duration > 0
        assert 0 <= scan.failed <= scan.attempts
        # What was not ordinary has a cause.
        assert bool(scan.cause) or scan.failed == 0
    assert sum(scan.failed for scan in scans) <= len(done.record.failures)
    failed = sum(sum(by_code.values()) for by_code in done.link.failed_attempts.values())
    assert failed == len(done.record.failures)

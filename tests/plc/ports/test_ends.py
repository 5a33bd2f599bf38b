"""Which ENDs matter: looking at those alone gives what looking at every one gives, tick for tick."""

from __future__ import annotations

from bisect import bisect_left
from itertools import pairwise
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from bussim.engines.modbus.framing import Framing
from bussim.engines.modbus.master import MasterConfig
from bussim.engines.modbus.pdu import Request, write_register
from bussim.engines.modbus.polling import PollingMaster
from bussim.engines.modbus.polls import Poll, PollList
from bussim.engines.modbus.slave import Slave, SlaveConfig
from bussim.plc.memory import Device
from bussim.plc.ports.events import TransactionTaken, TurnEnded
from bussim.plc.ports.spec import FreeSpec, PollSpec
from bussim.plc.profiles import PROFILES
from tests.engines.modbus.maps import PlainMap
from tests.plc.ports.bench import LINE, MS, Bench

RTU = Framing.rtu(LINE)
UNTIL = 800 * MS

scans = st.tuples(st.integers(2 * MS, 40 * MS), st.floats(0, 0.99)).map(lambda t: (t[0], int(t[0] * t[1])))
times = st.none() | st.integers(0, 5)
periods = st.sampled_from([0, 0, 30 * MS, 100 * MS, 333 * MS])


def idle_program(bench: Bench, now: int) -> None:
    """A program that does nothing makes every END matter."""


def outcome(bench: Bench) -> tuple[Any, ...]:
    cycle = bench.plc.cycle
    bench.plc.sync(UNTIL)
    cycle.count_up_to(UNTIL)
    memory = bench.plc.memory._words["D"].tolist()
    bits = list(bench.plc.memory._bits["M"])
    return bench.requests(), bench.reported, (cycle.count, cycle.total, cycle.longest), memory, bits


@st.composite
def polls(draw: st.DrawFn) -> list[PollSpec]:
    return [
        PollSpec(
            f"p{number}",
            "COM4",
            draw(st.sampled_from([1, 1, 9, 0])),  # 9 does not exist
            draw(st.sampled_from([3, 6, 16, 0x17])),
            number,
            1,
            Device("D", 500 + number),
            (number,),
            every=draw(periods),
            at=draw(st.integers(0, 200 * MS)),
            times=draw(times),
            retries=draw(st.integers(0, 2)),
        )
        for number in range(draw(st.integers(1, 4)))
    ]


@given(scan=scans, polls=polls(), delay=st.integers(0, 80 * MS), interval=st.sampled_from([0, 1, 300]))
def test_a_master(scan: tuple[int, int], polls: list[PollSpec], delay: int, interval: int) -> None:
    found, benches = [], []
    for program in (None, idle_program):
        bench = Bench(
            "COM4",
            "modbus-rtu-master",
            polls,
            profile=PROFILES["pw10"],
            program=program,
            scan=scan[0],
            jitter=scan[1],
            whole=True,
            w2=interval,
            w9=5,
        )
        bench.add(Slave(SlaveConfig(RTU, delay=delay), {1: PlainMap()}))
        bench.run(UNTIL)
        benches.append(bench)
        found.append(outcome(bench))
    assert found[0] == found[1]
    few, ends = benches[0].ends, benches[1].ends
    assert set(few) <= set(ends)
    # A request leaves at an END at which nothing was under way; its outcome is taken over at the first
    # END at or after it was decided; and no request leaves at an END that takes one over.
    taken = [item for item in benches[0].reported if isinstance(item, TransactionTaken)]
    for item in taken:
        assert item.taken == ends[bisect_left(ends, item.ended.end)]
        assert item.ended.sent is None or item.ended.sent in ends
    for before, after in pairwise(taken):
        left = after.ended.sent if after.ended.sent is not None else after.ended.end
        assert left > before.taken
        assert left >= before.ended.end + (interval or 50) * MS // 10 or before.ended.sent is None
    # A turn begins with the first scan after it was due: at RUN, or at an END.
    for turn in benches[0].reported:
        if isinstance(turn, TurnEnded):
            assert turn.late >= 0
            assert turn.start == 0 or turn.start in ends
            assert turn.start != 0 or turn.late == 0


@given(
    scan=scans,
    sends=st.lists(st.tuples(periods, st.integers(0, 200 * MS), times, st.sampled_from([0, 3])), max_size=3),
    listens=st.none() | st.tuples(st.integers(0, 300 * MS), times),
    heard=st.lists(st.tuples(st.integers(1, 250 * MS), st.binary(min_size=1, max_size=12)), max_size=8),
)
def test_the_free_protocol(
    scan: tuple[int, int],
    sends: list[tuple[int, int, int | None, int]],
    listens: tuple[int, int | None] | None,
    heard: list[tuple[int, bytes]],
) -> None:
    specs = [
        FreeSpec(
            f"s{number}",
            "COM3",
            Device("D", 200),
            4,
            b"\x01\x02\x03%d" % number,
            Device("D", 500) if count else None,
            count,
            every,
            at,
            turns,
        )
        for number, (every, at, turns, count) in enumerate(sends)
    ]
    if listens is not None:
        specs.append(
            FreeSpec("listen", "COM3", device=Device("D", 600), count=5, at=listens[0], times=listens[1])
        )
    found = []
    for program in (None, idle_program):
        bench = Bench(
            "COM3",
            "free",
            specs,
            profile=PROFILES["pw10"],
            program=program,
            scan=scan[0],
            jitter=scan[1],
            w5=0x0D,
            w9=4,
        )
        at = 0
        for pause, data in heard:
            bench.wire.receive(data, at + pause)
            at += pause + LINE.characters(len(data))
        bench.run(UNTIL)
        requests, reported, _, memory, bits = outcome(bench)
        # Words about something under way are those of the latest END that was served.
        del memory[7920:7940], bits[2920:2940]
        found.append((requests, reported, bench.plc.cycle.total, memory, bits))
    assert found[0] == found[1]


@given(scan=scans, delay=st.integers(0, 90 * MS), every=periods)
def test_a_slave(scan: tuple[int, int], delay: int, every: int) -> None:
    found = []
    for program in (None, idle_program):
        bench = Bench(
            "COM5",
            "modbus-rtu-slave",
            profile=PROFILES["pw10"],
            program=program,
            scan=scan[0],
            jitter=scan[1],
            whole=True,
        )
        polls = [
            Poll(1, Request(3, 0, 120), every),
            Poll(0, write_register(3, 7), 200 * MS),
            Poll(1, write_register(9, 7), at=delay),
        ]
        bench.add(PollingMaster(MasterConfig(RTU, 400 * MS), PollList(polls)))
        bench.run(UNTIL)
        found.append((outcome(bench), [item for _, item in bench.wire.events]))
    assert found[0] == found[1]

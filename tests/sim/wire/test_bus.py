"""The line: one driver at a time, what happens when there are two, and frames that end early."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bussim.line.characters import NN_LINE, CharFormat, LineTiming
from bussim.line.contention import Contention
from bussim.line.wave import Wave, low_intervals
from bussim.scenario import fault_kinds, model
from tests.sim.build import (
    CHAR,
    GAP,
    MS,
    OVERHEAD,
    PARAMETERS,
    POLL,
    SECOND,
    TURNAROUND,
    Done,
    bus_of,
    fault,
    link,
    plain_scan,
    registers_now,
    run,
    started,
    takers,
    timeout,
)

BIT = 1875


# -- the level -------------------------------------------------------------------------------------

FORMATS = st.sampled_from(
    [NN_LINE, LineTiming(19200, CharFormat(8, "N", 2)), LineTiming(38400, CharFormat(7, "O", 1))]
)


DRIVERS = st.lists(
    st.tuples(
        st.binary(min_size=1, max_size=4), FORMATS, st.integers(0, 40_000), st.sets(st.integers(0, 43))
    ),
    min_size=1,
    max_size=3,
)


def levels(chars: bytes, timing: LineTiming, start: int, inverted: set[int], span: int) -> list[int]:
    """A transmitter's level at every 125th tick, bit by bit from the format's definition."""
    fmt = timing.format
    bits: list[int] = []
    for value in chars:
        ones = [value >> n & 1 for n in range(fmt.data_bits)]
        parity = {"N": [], "E": [sum(ones) % 2], "O": [1 - sum(ones) % 2]}[fmt.parity]
        bits += [0, *ones, *parity, *[1] * fmt.stop_bits]
    bits = [bit ^ (number in inverted) for number, bit in enumerate(bits)]
    width = int(timing.bit)
    return [
        bits[(tick - start) // width] if 0 <= tick - start < width * len(bits) else 1
        for tick in range(0, span, 125)
    ]


@given(DRIVERS)
def test_where_two_drive_a_zero_wins(drivers: list[tuple[bytes, LineTiming, int, set[int]]]) -> None:
    span = 220_000
    wave = Wave(low_intervals(chars, timing, start, flips) for chars, timing, start, flips in drivers)
    each = [levels(chars, timing, start, flips, span) for chars, timing, start, flips in drivers]
    assert [wave.level(tick) for tick in range(0, span, 125)] == [min(now) for now in zip(*each, strict=True)]


# -- one driver at a time --------------------------------------------------------------------------


def test_on_a_healthy_line_no_two_drivers_are_on_at_once() -> None:
    frames = sorted(run(link(5, 1, seconds=2)).record.frames, key=lambda frame: frame.start)
    for before, after in pairwise(frames):
        gap = after.start - before.end
        assert gap >= (GAP if after.sender == "p0" else TURNAROUND)
    assert not any(frame.collided for frame in frames)


def overlapping(done: Done) -> int:
    """Frames of the trace that began while another was on the line."""
    frames = done.record.frames
    return sum(
        any(
            other is not frame
            and other.end > frame.start
            and (other.start, frames.index(other)) < (frame.start, frames.index(frame))
            for other in frames
        )
        for frame in frames
    )


@pytest.mark.parametrize("extra", [1, 40, 51, 52, 60, 77])
def test_collisions_are_frames_begun_while_another_driver_is_on(extra: int) -> None:
    done = run(link(3, 1, retries=1, seconds=1, faults=[fault_kinds.Slow("p1", extra * MS)]))
    assert abs(done.link.collisions - overlapping(done)) <= 1  # one may be on the line at the end
    collided = [frame for frame in done.record.frames if frame.collided]
    assert (len(collided) > 0) is (done.link.collisions > 0)
    for frame in collided:
        assert any(f is not frame and f.start < frame.end and frame.start < f.end for f in done.record.frames)


def test_a_sender_receives_nothing() -> None:
    # p2 replies after its time, in the middle of the master's next data frame.
    start = timeout(5) + OVERHEAD + GAP + PARAMETERS + GAP
    late = fault_kinds.Slow("p2", start + 8 * CHAR - TURNAROUND)
    done = run(link(3, 0, retries=0, seconds=0.15, faults=[late]))
    reply, drowned = done.of("p2")[0], done.of("p0")[1]
    assert drowned.start < reply.start < drowned.end < reply.end
    # p1 hears the two of them at once; p2 hears neither itself nor the end of what it had begun to hear.
    assert done.about("p1", 0)[:2] == (1, 0x14)
    assert done.about("p2", 0) == (0, 0, 0)
    assert takers(done, 0).keys() & {drowned.end} == set()
    # Nor the poll that began while it was sending.
    poll = next(frame for frame in done.of("p0", "poll") if frame.start > drowned.end)
    assert poll.start < reply.end
    assert poll.collided


# -- frames that end early -------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [fault_kinds.Stop, fault_kinds.PowerOff])
@pytest.mark.parametrize("inside", [1, 7 * CHAR + 938, 7 * CHAR + 939, -1])
def test_stop_and_power_off_cut_a_frame_at_that_tick(kind: type[fault_kinds.Stop], inside: int) -> None:
    frame = run(link(3, 1, seconds=1)).of("p1")[10]
    tick = frame.start + inside if inside > 0 else frame.end + inside
    cut = model.Fault("cut", kind("p1"), model.Window(tick))
    simulation, record = started(link(3, 1, retries=0, seconds=1, faults=[cut]))
    simulation.run(tick)
    assert bus_of(simulation).drivers == 1
    simulation.run(tick + 1)
    assert bus_of(simulation).drivers == 0
    simulation.run(SECOND)
    (found,) = [f for f in record.frames if f.cut]
    assert (found.sender, found.start, found.end) == ("p1", frame.start, tick)
    assert not [f for f in record.frames if f.sender == "p1" and f.start > tick]
    attempt = next(a for a in record.attempts if a.start > frame.start - 3 * MS and a.station == 1)
    if inside == -1:
        # One tick before the end: the last stop bit's centre had passed.
        assert (attempt.code, attempt.end) == (0, frame.end)
    elif inside == 1:
        # Not even a start bit: a spike that no receiver takes for a character.
        assert (attempt.code, attempt.end) == (1, frame.start - TURNAROUND + timeout(5))
    else:
        # Seven characters, and where the start bit lasts over its centre (tick 938) an eighth, which
        # ends as a character all the same; then quiet.
        chars = 7 if inside == 7 * CHAR + 938 else 8
        assert (attempt.code, attempt.end) == (4, frame.start + chars * CHAR + 2 * CHAR)


def test_a_master_cut_in_its_data_frame_is_damage_then_silence() -> None:
    frame = run(link(3, 1, seconds=1)).of("p0")[5]
    tick = frame.start + 9 * CHAR
    cut = model.Fault("cut", fault_kinds.Stop("p0"), model.Window(tick))
    simulation, _ = started(link(3, 1, seconds=1, faults=[cut]))
    simulation.run(tick + 2 * CHAR)
    assert registers_now(simulation, "p1")["D8211"] == 0
    simulation.run(tick + 2 * CHAR + 1)
    for slave in ("p1", "p2"):
        found = registers_now(simulation, slave)
        assert (found["D8203"], found["D8211"], found["M8183"]) == (1, 0x14, 1)
    simulation.run(SECOND)
    for slave in ("p1", "p2"):
        found = registers_now(simulation, slave)
        assert (found["D8203"], found["D8211"], found["M8183"]) == (2, 0x11, 1)


def test_a_station_that_begins_to_listen_in_the_middle_of_a_frame() -> None:
    # p2 listens and is never polled: the others' frames are where they are.
    others = {0: {"registers": {"D8177": 1}}}
    frame = run(link(3, 2, seconds=1, others=others)).of("p0")[15]
    middle = frame.start + 20 * CHAR + 700
    away = model.Fault("away", fault_kinds.Stop("p2"), model.Window(middle - 300 * MS, 300 * MS))
    # A dropped reply raises the flag that brings the parameters.
    drop = model.Fault("drop", fault_kinds.DropReply("p1", 1), model.Window(frame.end))
    done = run(link(3, 2, retries=0, seconds=2, others=others, faults=[away, drop]))
    assert frame.start in {f.start for f in done.of("p0")}
    # It had no parameters, so it noted nothing of the half that it heard; nor did it take anything.
    found = done.registers("p2")
    assert (found["D8203"], found["M8183"], found["D8174"]) == (0, 0, 1)
    hello = next(f for f in done.of("p0", "parameters") if f.start > middle)
    assert not [
        t for t, plc_names in takers(done, 0).items() if middle - 300 * MS < t < hello.end and 2 in plc_names
    ]
    assert [t for t, plc_names in takers(done, 0).items() if t > hello.end and 2 in plc_names]


# -- late release ----------------------------------------------------------------------------------


def test_a_tail_shorter_than_the_masters_gap_does_no_harm() -> None:
    done = run(link(3, 1, seconds=1, faults=[fault_kinds.LateRelease("p1", GAP - 1)]))
    assert (done.link.collisions, done.record.failures) == (0, [])
    # The driver is on, though: it counts as load.
    plain = run(link(3, 1, seconds=1))
    replies = len(done.of("p1"))
    assert done.link.busy - plain.link.busy in (replies * (GAP - 1), (replies - 1) * (GAP - 1))


def test_a_tail_costs_the_frame_that_begins_during_it() -> None:
    # The master's poll of p2 begins during p1's tail: its first two characters are undefined.
    done = run(link(3, 1, seconds=2, retries=1, faults=[fault_kinds.LateRelease("p1", GAP + 2 * CHAR)]))
    replies = done.of("p1")
    first = [poll for poll in done.of("p0", "poll") if poll.station == 2 and poll.collided]
    assert len(first) >= len(replies) - 1
    assert done.link.collisions == len(first)
    # Each such poll is lost, and so is the time of an attempt; its repeat comes when the driver is off.
    assert done.link.failed_attempts == {2: {1: len(done.record.failures)}}
    assert 0 <= len(first) - len(done.record.failures) <= 1
    assert done.link.station_errors == {1: 0, 2: 0}
    again = [poll for poll in done.of("p0", "poll") if poll.station == 2 and not poll.collided]
    assert [poll.start - before.end for before, poll in zip(first, again, strict=False)] == [
        timeout(5) + GAP
    ] * len(again)
    # The trace has when the driver went off; the frames are in the order in which they were over.
    assert {frame.released - frame.end for frame in replies if frame.released is not None} == {GAP + 2 * CHAR}
    assert all(frame.released is None for frame in done.of("p0"))
    ends = [frame.end for frame in done.record.frames]
    assert ends == sorted(ends)


def test_a_tail_ends_with_the_supply_and_with_the_next_frame() -> None:
    off = run(link(2, 1, seconds=0.2)).of("p1")[0].end + MS // 4
    faults = [fault_kinds.LateRelease("p1", 20 * MS), fault(fault_kinds.PowerOff("p1"), off / SECOND)]
    assert [frame.released for frame in run(link(2, 1, seconds=0.2, faults=faults)).of("p1")] == [off]
    frames = run(link(2, 1, seconds=0.2, faults=[fault_kinds.LateRelease("p0", 20 * MS)])).record.frames
    parameters, data, poll, *_ = [frame for frame in frames if frame.sender == "p0"]
    assert (parameters.released, data.released) == (data.start, poll.start)


def test_a_tail_harms_no_other_where_a_0_wins() -> None:
    by = GAP + 2 * CHAR
    zero = link(3, 1, seconds=1, faults=[fault_kinds.LateRelease("p1", by)], contention=Contention.ZERO_WINS)
    done = run(zero)
    assert abs(done.link.collisions - len(done.of("p1"))) <= 1
    polls = [frame for frame in done.of("p0", "poll") if frame.station == 2]
    assert all(frame.collided for frame in polls)
    # p2 is polled and replies, and p1 takes its block all the same.
    assert done.record.failures == []
    assert done.about("p1", 2) == (0, 0, 0)
    assert set(map(frozenset, takers(done, 2).values())) == {frozenset({0, 1})}
    # The rest of the poll is rubbish to it: damage, and no poll was pending.
    count, code, _ = done.about("p1", 0)
    assert code == 0x14
    assert abs(count - len(polls)) <= 1


def test_a_tail_over_the_whole_poll_and_the_replies_begin() -> None:
    by = GAP + POLL + TURNAROUND + 3 * CHAR + 900
    zero = link(3, 1, seconds=1, faults=[fault_kinds.LateRelease("p1", by)], contention=Contention.ZERO_WINS)
    done = run(zero)
    assert done.record.failures == []
    assert set(map(frozenset, takers(done, 2).values())) == {frozenset({0})}
    # It heard the reply from its fourth character on: damage with no poll pending is the master's.
    count, code, _ = done.about("p1", 0)
    assert code == 0x14
    assert abs(count - len(done.of("p1"))) <= 1


@pytest.mark.parametrize(("by", "code"), [(TURNAROUND - 1, None), (TURNAROUND + 3 * CHAR - 100, 4)])
def test_a_masters_tail_hides_the_beginning_of_the_replies(by: int, code: int | None) -> None:
    done = run(link(2, 1, retries=0, seconds=1, faults=[fault_kinds.LateRelease("p0", by)]))
    assert {found for _, found in done.codes} == ({code} if code else set())
    for attempt in done.record.attempts:
        if code:
            # Characters from the fourth on, no header: the attempt runs to its deadline.
            assert attempt.end == attempt.start + POLL + timeout(5)


# -- jabber ----------------------------------------------------------------------------------------


def test_a_jabbering_station_drowns_the_link_until_it_is_well() -> None:
    done = run(link(3, 1, seconds=3, faults=[fault(fault_kinds.Jabber("p1"), 1.0, 1.0)]))
    during = [frame for frame in done.record.frames if SECOND < frame.start < 2 * SECOND]
    jabber = [frame for frame in during if frame.kind == "jabber"]
    assert {frame.sender for frame in jabber} == {"p1"}
    assert not [frame for frame in during if frame.sender == "p1" and frame.kind != "jabber"]
    # Back to back, from the fault's begin to its end.
    spans = sorted((frame.start, frame.end) for frame in done.record.frames if frame.kind == "jabber")
    assert spans[0][0] == SECOND
    assert spans[-1][1] == 2 * SECOND
    assert all(before[1] == after[0] for before, after in pairwise(spans))
    assert done.link.busy > SECOND
    polls = [frame for frame in during if frame.kind == "poll"]
    assert all(frame.collided for frame in polls)
    assert done.link.collisions >= len(polls)
    in_time = [a for a in done.record.attempts if SECOND + 60 * MS < a.start < 2 * SECOND - 60 * MS]
    assert len(in_time) > 10
    assert {attempt.code for attempt in in_time} == {4}
    # A slave sees the damage once, as long as no valid frame of the master lies between.
    assert done.about("p2", 0)[0] >= 1
    # All are well again.
    tail = [scan for scan in done.record.scans if scan.start > 2.5 * SECOND]
    assert {scan.duration for scan in tail} == {plain_scan(3, 1)}


def test_two_jabber_faults_of_one_station_last_as_long_as_both() -> None:
    faults = [fault(fault_kinds.Jabber("p1"), 0.5, 0.5), fault(fault_kinds.Jabber("p1"), 0.7, 0.8)]
    done = run(link(2, 0, seconds=2, faults=faults))
    spans = sorted((frame.start, frame.end) for frame in done.record.frames if frame.kind == "jabber")
    assert spans[0][0] == SECOND // 2
    assert spans[-1][1] == SECOND * 3 // 2
    assert all(before[1] == after[0] for before, after in pairwise(spans))


def test_a_jabbering_station_without_power_is_silent() -> None:
    faults = [fault(fault_kinds.Jabber("p1"), 0.5, 1.0), fault(fault_kinds.PowerOff("p1"), 0.8, 0.3)]
    done = run(link(2, 0, seconds=2, faults=faults))
    spans = [(f.start, f.end) for f in done.record.frames if f.kind == "jabber"]
    eight, eleven = SECOND * 8 // 10, SECOND * 11 // 10
    assert not [span for span in spans if span[1] > eight and span[0] < eleven]
    assert {max(end for _, end in spans), min(start for start, _ in spans)} == {SECOND * 3 // 2, SECOND // 2}


def test_jabber_goes_on_in_stop() -> None:
    faults = [fault(fault_kinds.Jabber("p1"), 0.5, 1.0), fault(fault_kinds.Stop("p1"), 0.8, 0.3)]
    done = run(link(2, 0, seconds=2, faults=faults))
    jabber = sum(f.end - f.start for f in done.record.frames if f.kind == "jabber")
    assert jabber == SECOND


# -- formats and clocks ----------------------------------------------------------------------------

SLOW_LINE = LineTiming(19200, CharFormat(8, "N", 1))


@pytest.mark.parametrize(
    "timing",
    [
        SLOW_LINE,
        LineTiming(38400, CharFormat(7, "O", 1)),
        LineTiming(38400, CharFormat(8, "E", 1)),
        LineTiming(57600, CharFormat(7, "E", 1)),
    ],
)
def test_a_slave_with_a_wrong_format_is_as_good_as_absent(timing: LineTiming) -> None:
    wrong = fault(fault_kinds.WrongFormat("p1", timing), 0.5, 1.0)
    done = run(link(3, 1, retries=0, seconds=2.5, faults=[wrong]))
    during = [a for a in done.record.attempts if 0.6 * SECOND < a.start < 1.4 * SECOND]
    assert {(a.station, a.code) for a in during} == {(1, 1), (2, 0)}
    assert not [f for f in done.of("p1") if 0.6 * SECOND < f.start < 1.5 * SECOND]
    after = [a for a in done.record.attempts if a.start > 2 * SECOND]
    assert {(a.station, a.code) for a in after} == {(1, 0), (2, 0)}
    assert done.about("p0", 1)[2] == 0


def test_stations_with_the_same_wrong_format_understand_each_other() -> None:
    # 19200 8N1 at the master and p1: ten bits a character as well, each twice as long.
    faults = [fault_kinds.WrongFormat("p0", SLOW_LINE), fault_kinds.WrongFormat("p1", SLOW_LINE)]
    done = run(link(3, 1, retries=0, seconds=2, faults=faults))
    replies = {(a.station, a.code) for a in done.record.attempts}
    assert replies == {(1, 0), (2, 1)}
    for frame in done.record.frames:
        assert frame.end - frame.start == 2 * CHAR * len(frame.chars)
    assert done.about("p0", 1) == (0, 0, 0)
    assert done.registers("p2")["M8191"] == 0


@pytest.mark.parametrize("station", ["p0", "p1"])
@pytest.mark.parametrize("ppm", [200, -200, 2000, 30_000, -30_000])
def test_a_clock_a_little_off_is_harmless(station: str, ppm: int) -> None:
    done = run(link(3, 2, retries=0, seconds=1, faults=[fault_kinds.ClockPpm(station, Fraction(ppm))]))
    assert done.record.failures == []
    assert all(done.about(f"p{n}", other) == (0, 0, 0) for n in range(3) for other in range(8))
    # Rounded half up, once, from the first edge.
    for frame in done.record.frames:
        bits = Fraction(BIT * 10 * len(frame.chars))
        if frame.sender == station:
            bits /= 1 + Fraction(ppm, 1_000_000)
        assert frame.end - frame.start == (2 * bits + 1) // 2
    assert done.link.undetected == 0


@pytest.mark.parametrize("ppm", [60_000, -60_000])
def test_a_clock_far_off_is_deadly(ppm: int) -> None:
    # Nine and a half bits from the start edge to the stop bit's centre: 5.3 % make half a bit.
    done = run(link(3, 2, retries=0, seconds=1, faults=[fault_kinds.ClockPpm("p1", Fraction(ppm))]))
    assert set(done.codes) == {(1, 1)}
    assert done.of("p1") == []
    assert done.about("p0", 1)[2] == 1
    assert done.about("p0", 2) == (0, 0, 0)


def test_clock_errors_add_up() -> None:
    faults = [fault_kinds.ClockPpm("p1", Fraction(30_000)), fault_kinds.ClockPpm("p1", Fraction(30_000))]
    assert set(run(link(2, 0, retries=0, seconds=0.5, faults=faults)).codes) == {(1, 1)}
    faults = [fault_kinds.ClockPpm("p1", Fraction(60_000)), fault_kinds.ClockPpm("p1", Fraction(-60_000))]
    assert run(link(2, 0, retries=0, seconds=0.5, faults=faults)).record.failures == []

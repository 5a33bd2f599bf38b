"""The link and the PLC scan meet only at END."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import replace
from fractions import Fraction
from math import sqrt
from random import Random

import pytest

from bussim.plc.profiles import Reply, Turnaround
from bussim.plc.sources import Constant, Counter
from bussim.scenario import fault_kinds, model
from bussim.trace.records import FrameRecord
from tests.selection import quick
from tests.sim import chance
from tests.sim.build import (
    CHAR,
    GAP,
    JITTER,
    MS,
    PARAMETERS,
    SECOND,
    TURNAROUND,
    Done,
    fault,
    link,
    run,
    started,
    steady,
)

#: A source that counts microseconds: its value shows when an END was.
MICROSECOND = 72
CLOCK = Counter(MICROSECOND)
#: 8 ms and ten per cent.
SCAN = 633_600


def word(frame: FrameRecord) -> int:
    """The first D word of a frame of mode 0, from the characters on the wire."""
    return int(frame.chars[3:7], 16)


def latest(phase: int, tick: int, scan: int = SCAN) -> int | None:
    """The latest END at or before a tick."""
    return None if tick < phase else phase + (tick - phase) // scan * scan


def stamp(end: int) -> int:
    return end // MICROSECOND % 65_536


def pair(phase: int | None, master_phase: int = 0, **changes: object) -> model.Scenario:
    """Two stations in mode 0; each one's first word is a clock."""
    others = {
        0: {"phase": master_phase, "sources": {"D0": CLOCK}},
        1: {"phase": phase, "sources": {"D32": CLOCK}, **changes},
    }
    return link(2, 0, seconds=1, others=others)


# -- what a frame carries --------------------------------------------------------------------------


@pytest.mark.parametrize("phase", [0, 1, 1000, SCAN - 1, 5 * SCAN // 3])
def test_a_frame_carries_the_image_of_its_senders_latest_end(phase: int) -> None:
    done = run(pair(phase, master_phase=2 * MS))
    for frame in done.of("p0"):
        end = latest(2 * MS, frame.start)
        assert end is not None
        assert word(frame) == stamp(end)
    frames = done.of("p1")
    for frame in frames:
        end = latest(phase, frame.start)
        assert word(frame) == (0 if end is None else stamp(end))
    assert len(frames) > 50


def test_an_end_at_the_tick_of_a_transmission_comes_before_it() -> None:
    # p1's turnaround is the board's own: its frames are where they are, whatever its phase.
    start = run(pair(0)).of("p1")[20].start
    for before, expected in ((0, start), (1, start - 1), (-1, start + 1 - SCAN)):
        done = run(pair((start - before) % SCAN))
        frame = done.of("p1")[20]
        assert frame.start == start
        assert word(frame) == stamp(expected)


def test_a_masters_end_at_the_tick_of_its_data_frame_comes_before_it() -> None:
    # The data frame begins this long after the first END.
    lead = GAP + PARAMETERS + GAP
    profile = steady(scan_factor=Fraction(1))
    for scan, expected in ((lead, MS + lead), (lead + 1, MS), (lead - 1, MS + lead - 1)):
        others = {0: {"phase": MS, "sources": {"D0": CLOCK}, "scan": model.Scan(scan)}}
        frame = run(link(2, 0, seconds=0.1, profile=profile, others=others)).of("p0")[0]
        assert frame.start == MS + lead
        assert word(frame) == stamp(expected)


def test_before_the_first_end_a_frame_carries_the_memory_at_run() -> None:
    phase = 300 * MS
    others = {1: {"phase": phase, "sources": {"D32": Constant(5)}, "registers": {"D32": 123}}}
    out = [fault(fault_kinds.Stop("p1"), 0.6, 0.1), fault(fault_kinds.PowerOff("p1"), 1.5, 0.1)]
    done = run(link(2, 0, seconds=2.5, others=others, faults=out))
    seen = [(frame.start, word(frame)) for frame in done.of("p1")]
    for start, value in seen:
        # D32 is general: it begins anew after STOP as after the power loss, as the phase does.
        last = max(begun for begun in (0, 7 * SECOND // 10, 16 * SECOND // 10) if begun <= start)
        assert value == (123 if start < last + phase else 5)
    for since, until in ((0.6, 1.5), (1.5, 2.5)):
        assert {value for start, value in seen if since * SECOND < start < until * SECOND} == {123, 5}


@pytest.mark.parametrize("kind", [fault_kinds.Stop, fault_kinds.PowerOff])
def test_the_phase_counts_from_every_run(kind: type[fault_kinds.Stop]) -> None:
    again = SECOND // 2
    phase = 3 * MS
    done = run(
        link(
            2,
            0,
            seconds=1.5,
            others={1: {"phase": phase, "sources": {"D32": CLOCK}}},
            faults=[fault(kind("p1"), 0.25, 0.25)],
        )
    )
    frames = [frame for frame in done.of("p1") if frame.start > again]
    assert len(frames) > 20
    for frame in frames:
        end = latest(again + phase, frame.start)
        assert end is not None
        assert word(frame) == stamp(end)


# -- when a block is seen --------------------------------------------------------------------------


def seen(phase: int, reception: int, after: int) -> int:
    """What p1 sees of the master's clock ``after`` ticks from a reception."""
    simulation, _ = started(pair(phase))
    simulation.run(reception + after)
    plc = simulation.plcs["p1"]
    plc.sync(simulation.now)
    return plc.read("D0")


def test_a_block_is_seen_from_the_first_end_at_or_after_its_reception() -> None:
    frames = run(pair(0)).of("p0")
    reception, old, new = frames[20].end, word(frames[19]), word(frames[20])
    assert old != new
    at, after, before = reception % SCAN, (reception + 1) % SCAN, (reception - 1) % SCAN
    # END at the very tick: the reception comes first.
    assert seen(at, reception, 1) == new
    # END one tick later: not before it.
    assert seen(after, reception, 1) == new
    assert seen(after, reception, 0) == old
    # END one tick earlier: only a scan later.
    assert seen(before, reception, 1) == old
    assert seen(before, reception, SCAN - 2) == old
    assert seen(before, reception, SCAN) == new


def test_a_block_received_before_the_first_end_waits_for_it() -> None:
    phase = 200 * MS
    simulation, record = started(pair(phase))
    simulation.run(phase)
    plc = simulation.plcs["p1"]
    plc.sync(simulation.now - 1)
    assert plc.read("D0") == 0
    assert any(source == 0 for _, source, _, _ in record.refreshes)
    simulation.run(phase + 1)
    plc.sync(simulation.now)
    last = [frame for frame in record.frames if frame.sender == "p0" and frame.kind == "data"]
    assert plc.read("D0") == word(last[-1])


# -- the whole memory against the trace ------------------------------------------------------------


def _stopped(given: model.Fault, plc: str, now: int) -> bool:
    """Whether a fault has had a PLC in STOP, and is over."""
    until = given.window.until
    return given.kind == fault_kinds.Stop(plc) and until is not None and until <= now


def _whole_scenario(seed: int) -> model.Scenario:
    scenario = chance.scenario(seed, 0.6)
    stations = [plc for plc in scenario.plcs if plc.name != "twin"]
    harmless = (
        fault_kinds.PowerOff,
        fault_kinds.Jabber,
        fault_kinds.WrongFormat,
        fault_kinds.BoardError,
        fault_kinds.FlipBits,
    )
    return replace(
        scenario,
        plcs=tuple(replace(plc, profile=stations[0].profile) for plc in stations),
        faults=tuple(
            f
            for f in scenario.faults
            if not isinstance(f.kind, harmless) and getattr(f.kind, "node", "") != "twin"
        ),
        noise=tuple(n for n in scenario.noise if n.target.station != "twin"),
    )


@pytest.mark.parametrize("seed", quick(20, range(40)))
def test_the_shared_areas_are_what_the_trace_says(seed: int) -> None:
    """Every station's copies, at random instants, against the frames and who heard them."""
    scenario = _whole_scenario(seed)
    simulation, record = started(scenario)
    spacing = scenario.plcs[0].profile.word_spacing
    rng = Random(seed)
    compared = 0
    while simulation.now < scenario.duration:
        simulation.run(simulation.now + rng.randint(1, 80 * MS))
        now = simulation.now
        sent: dict[str, list[FrameRecord]] = {}
        for frame in record.frames:
            if frame.kind == "data":
                sent.setdefault(frame.sender, []).append(frame)
        words: dict[tuple[int, int], list[tuple[int, int]]] = {}
        for _, source, tick, heard in record.refreshes:
            # By a clock that is off it is heard some ticks before or after its end.
            frame = min(sent[scenario.plcs[source].name], key=lambda f: abs(f.end - tick))
            assert abs(frame.end - tick) < CHAR // 2
            at = 3 + 2 * {0: 0, 1: 4, 2: 8}[scenario.plcs[0].registers["D8178"]]
            chars = frame.chars[frame.chars.rindex(2) :]  # before it a fault may have put an STX
            value = int(chars[at : at + 4], 16)
            all_others = set(range(len(scenario.plcs))) - {source}
            for position in all_others if heard is None else heard:
                words.setdefault((position, source), []).append((tick, value))
        for position, spec in enumerate(scenario.plcs):
            plc = simulation.plcs[spec.name]
            if plc.master is None and plc.link_registers.block is None:
                continue
            plc.sync(now)
            end = plc.cycle.latest_end(now)
            if end is None:
                continue
            run = max((f.window.until for f in scenario.faults if _stopped(f, spec.name, now)), default=0)
            for source in range(len(scenario.plcs)):
                # Words below D200 are general: STOP has cleared them.
                received = [each for each in words.get((position, source), []) if each[0] >= run]
                if source == position:
                    continue
                index = bisect_right(received, (end, 1 << 20)) - 1
                if index >= 0:
                    compared += 1
                    assert plc.read(f"D{spacing * source}") == received[index][1]
    assert compared > 0 or len(record.refreshes) < 10


# -- replies at END --------------------------------------------------------------------------------


@pytest.mark.parametrize("phase", [0, 777, 3 * MS])
def test_a_reply_at_end_begins_at_the_first_end_after_its_turnaround(phase: int) -> None:
    profile = steady(reply=Reply.END)
    others = {1: {"phase": phase, "sources": {"D32": CLOCK}}}
    done = run(link(2, 0, seconds=1, profile=profile, others=others))
    replied = [attempt for attempt in done.record.attempts if attempt.code == 0]
    assert len(replied) > 30
    polls = {frame.start: frame for frame in done.of("p0", "poll")}
    for attempt, reply in zip(replied, done.of("p1"), strict=False):
        ready = polls[attempt.start].end + TURNAROUND
        end = phase + -(-(ready - phase) // SCAN) * SCAN
        assert reply.start == end
        # The image is that END's own.
        assert word(reply) == stamp(end)


def test_a_reply_ready_at_the_tick_of_an_end_goes_with_it() -> None:
    profile = steady(reply=Reply.END)
    first = run(link(2, 0, seconds=0.1, others={0: {"phase": 0}})).of("p0", "poll")[0]
    ready = first.end + TURNAROUND
    for phase, start in ((ready, ready), (ready - 1, ready - 1 + SCAN), (ready + 1, ready + 1)):
        others = {0: {"phase": 0}, 1: {"phase": phase % SCAN}}
        done = run(link(2, 0, seconds=0.2, profile=profile, others=others))
        assert done.of("p1")[0].start == start


def test_replies_at_end_wait_for_an_end_however_far_ahead() -> None:
    # Two seconds of extra turnaround at a scan of a millisecond: thousands of ENDs ahead.
    profile = steady(reply=Reply.END)
    others = {1: {"scan": model.Scan(MS), "phase": 0, "sources": {"D32": CLOCK}}}
    scenario = link(
        2,
        0,
        units=225,
        seconds=30,
        profile=profile,
        others=others,
        faults=[fault_kinds.Slow("p1", 2 * SECOND)],
    )
    done = run(scenario)
    replies = done.of("p1")
    assert len(replies) > 10
    scan = MS * 11 // 10
    for reply in replies:
        assert reply.start % scan == 0
        assert word(reply) == stamp(reply.start)


# -- the scan itself -------------------------------------------------------------------------------


@pytest.mark.parametrize("factor", [Fraction(11, 10), Fraction(1), Fraction(5, 4)])
def test_the_scan_is_longer_under_the_link(factor: Fraction) -> None:
    profile = steady(scan_factor=factor)
    others = {1: {"scan": model.Scan(8 * MS, 2 * MS)}}
    # p2's parameters are refused: it scans as if there were no link. So does one that is not on the link.
    more = [
        replace(link(2).plcs[1], name="refused", registers={"D8176": 9}, scan=model.Scan(8 * MS)),
        replace(link(2).plcs[1], name="alone", link=None, scan=model.Scan(8 * MS)),
    ]
    done = run(link(2, 0, seconds=10, profile=profile, others=others, more=more))
    totals = {plc.name: plc for plc in done.totals.plcs}
    assert totals["p0"].scan_mean == totals["p0"].scan_max == 8 * MS * factor
    jittery = totals["p1"]
    assert jittery.scan_mean is not None
    assert jittery.scan_max is not None
    sd = 2 * MS * float(factor) / sqrt(3)
    assert abs(jittery.scan_mean - float(8 * MS * factor)) < 4 * sd / sqrt(jittery.scans)
    assert 0.99 * 10 * MS * factor < jittery.scan_max <= 10 * MS * factor
    assert totals["refused"].scan_max == totals["alone"].scan_max == 8 * MS
    assert totals["alone"].scans in (1249, 1250)


def test_a_random_phase_is_the_plcs_own_and_within_a_scan() -> None:
    def first_ends(seed: int) -> list[int | None]:
        simulation, _ = started(link(4, 0, seconds=0.1, seed=seed))
        simulation.run(1)
        return [plc.cycle.next_end(0, 0) for plc in simulation.plcs.values()]

    ends = [first_ends(seed) for seed in range(60)]
    assert first_ends(7) == ends[7]
    flat = [end for row in ends for end in row if end is not None]
    assert len(flat) == len(set(flat)) == 240
    assert min(flat) > 0
    assert max(flat) <= SCAN
    # Uniform: mean half a scan, deviation a scan over the root of twelve.
    assert abs(sum(flat) / 240 - SCAN / 2) < 4 * SCAN / sqrt(12 * 240)


def turnarounds(done: Done) -> list[int]:
    return [attempt.turnaround for attempt in done.record.attempts if attempt.turnaround is not None]


def test_turnarounds_are_uniform_over_mean_and_jitter() -> None:
    done = run(link(2, 0, seconds=20, profile=steady(turnaround=Turnaround(TURNAROUND, JITTER))))
    found = turnarounds(done)
    count = len(found)
    assert min(found) >= TURNAROUND - JITTER
    assert max(found) <= TURNAROUND + JITTER
    sd = JITTER / sqrt(3)
    assert abs(sum(found) / count - TURNAROUND) < 4 * sd / sqrt(count)
    third = sum(turnaround < TURNAROUND - JITTER / 3 for turnaround in found)
    assert abs(third - count / 3) < 4 * sqrt(count * 2 / 9)

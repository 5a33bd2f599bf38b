"""Every error code, in every station that can see it, through the whole simulation."""

from __future__ import annotations

import pytest

from bussim.plc.sources import Constant
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
    data,
    fault,
    link,
    plain_scan,
    registers_now,
    run,
    slot,
    started,
    timeout,
)

TX, RX = fault_kinds.Direction.TX, fault_kinds.Direction.RX

NOTHING = (0, 0, 0)


#: A bit of a frame's second character, the station: parity shows it.
STATION_BIT = (12,)


def no_station_sees_itself(registers: dict[str, int], station: int) -> bool:
    return not any(registers[f"{d}{n + station}"] for d, n in (("D", 8203), ("D", 8211), ("M", 8183)))


def flip(sender: str, frame: str, at: float, count: int, bits: tuple[int, ...] = STATION_BIT) -> model.Fault:
    return fault(fault_kinds.FlipBits(sender, TX, bits, count, frame), at)


# -- nothing wrong ---------------------------------------------------------------------------------


def test_a_healthy_link_says_so_everywhere() -> None:
    done = run(link(4, 1, seconds=2))
    scan = (plain_scan(4, 1) + MS // 2) // MS
    for station in range(4):
        found = done.registers(f"p{station}")
        assert all(done.about(f"p{station}", other) == NOTHING for other in range(8))
        assert (found["D8201"], found["D8202"], found["M8191"]) == (scan, scan, 1)
        assert (found["D8173"], found["D8174"], found["D8175"]) == (station, 3, 1)
        assert (found["M8063"], found["D8063"], found["M8179"]) == (0, 0, 1)


def test_the_link_runs_from_the_first_data_frame_and_for_a_slave_from_its_first_reply() -> None:
    simulation, _ = started(link(3, 0, others={0: {"phase": 2 * MS}}))
    sent = 2 * MS + GAP + PARAMETERS + GAP  # the master's data frame begins
    replied = sent + data(0) + slot(0)  # p1's reply has left
    for tick, running in (
        (sent, (0, 0, 0)),
        (sent + 1, (1, 0, 0)),
        (replied, (1, 0, 0)),
        (replied + 1, (1, 1, 0)),
        (replied + slot(0) + 1, (1, 1, 1)),
    ):
        simulation.run(tick)
        assert tuple(registers_now(simulation, f"p{n}")["M8191"] for n in range(3)) == running


# -- silence: 01 and 21 ----------------------------------------------------------------------------


def test_a_station_dead_from_the_start() -> None:
    done = run(link(4, 2, retries=1, seconds=3, faults=[fault_kinds.PowerOff("p2")]))
    scans = done.link.station_errors[2]
    assert scans > 5
    assert done.about("p0", 2) == (scans, 0x01, 1)
    for slave in ("p1", "p3"):
        count, code, flag = done.about(slave, 2)
        # The listeners decide when the master moves on, the last time maybe after the end.
        assert (scans - count in (0, 1), code, flag) == (True, 0x21, 1)
        assert done.registers(slave)["M8191"] == 1
    for station in (0, 1, 3):
        own = done.registers(f"p{station}")
        assert no_station_sees_itself(own, station)
        assert all(done.about(f"p{station}", other) == NOTHING for other in {0, 1, 3, 4, 5, 6, 7} - {station})


def test_a_station_that_powers_up_late_is_healthy_one_scan_after_the_next_parameter_frame() -> None:
    late = SECOND + 12_345
    done = run(link(3, 0, retries=0, seconds=2, others={2: {"power_on": late}}))
    hello = next(frame for frame in done.of("p0", "parameters") if frame.start >= late)
    healthy = hello.end + GAP + data(0) + 2 * slot(0)
    assert done.link.healthy_at == healthy
    assert done.of("p2")[0].end == healthy
    assert [note.tick for note in done.notes("healthy")] == [healthy]
    count, code, flag = done.about("p0", 2)
    assert (count, code, flag) == (done.link.station_errors[2], 0x01, 0)
    assert done.about("p1", 2) == (count, 0x21, 0)
    # From then on it is as if it had always been there.
    assert done.registers("p2")["M8191"] == 1
    assert all(done.about("p2", other) in (NOTHING, (0, 0x31, 0)) for other in range(8))
    last = [scan for scan in done.record.scans if scan.start > healthy]
    assert {scan.duration for scan in last} == {plain_scan(3, 0)}


def test_all_powered_up_together_are_healthy_after_the_first_scan() -> None:
    done = run(link(8, 0, seconds=0.2, others={0: {"phase": MS}}))
    assert done.link.healthy_at == MS + GAP + PARAMETERS + GAP + data(0) + 7 * slot(0)


def test_a_slave_polled_before_it_has_parameters_notes_31_about_itself() -> None:
    # It powers up during the attempts at itself: the next polls are of no use to it.
    done = run(link(3, 0, retries=3, seconds=2, others={1: {"power_on": SECOND}}))
    polls = [f for f in done.of("p0", "poll") if f.station == 1 and f.start > SECOND]
    hello = next(f for f in done.of("p0", "parameters") if f.start > SECOND)
    assert polls[0].end < hello.start
    assert done.notes("no_parameters", "p1")[0].tick == polls[0].end
    assert done.about("p1", 1) == (0, 0x31, 0)
    assert done.registers("p1")["D8174"] == 2
    assert done.of("p1")[0].start > hello.end


# -- STOP of the master: 11 ------------------------------------------------------------------------


@pytest.mark.parametrize("units", [5, 12])
def test_a_master_in_stop_is_code_11(units: int) -> None:
    stop, lasting = SECOND, SECOND
    faults = [fault(fault_kinds.Stop("p0"), stop / SECOND, lasting / SECOND)]
    scenario = link(3, 2, units=units, seconds=3, faults=faults, others={0: {"phase": 3 * MS}})
    simulation, record = started(scenario)
    simulation.run(stop)
    # The last frame of the master that was heard whole; a frame that is cut is none.
    last = max(frame.end for frame in record.frames if frame.sender == "p0")
    silent = last + 2 * timeout(units) + TURNAROUND + data(2)
    simulation.run(silent)
    for slave in ("p1", "p2"):
        found = registers_now(simulation, slave)
        assert (found["D8203"], found["D8211"], found["M8183"], found["M8191"]) in (
            (0, 0, 0, 1),
            (1, 0x14, 1, 1),  # it was cut in the middle of a frame
        )
    before = [registers_now(simulation, slave)["D8203"] for slave in ("p1", "p2")]
    simulation.run(silent + 1)
    for number, slave in enumerate(("p1", "p2")):
        found = registers_now(simulation, slave)
        assert (found["D8203"], found["D8211"]) == (before[number] + 1, 0x11)
        assert (found["M8183"], found["M8191"]) == (1, 0)
    simulation.run(stop + lasting)
    assert [registers_now(simulation, slave)["D8203"] for slave in ("p1", "p2")] == [n + 1 for n in before]
    first = stop + lasting + 3 * MS + GAP  # its first END, a gap: the parameter frame
    simulation.run(first + PARAMETERS)
    assert registers_now(simulation, "p1")["M8183"] == 1
    simulation.run(first + PARAMETERS + 1)
    found = registers_now(simulation, "p1")
    assert (found["M8183"], found["M8191"]) == (0, 0)  # it has not replied yet
    longest = found["D8202"]
    simulation.run(scenario.duration)
    for number, slave in enumerate(("p1", "p2")):
        found = registers_now(simulation, slave)
        assert (found["D8203"], found["D8211"], found["M8183"]) == (before[number] + 1, 0x11, 0)
        # The second between was no link scan.
        assert found["D8202"] == longest == (plain_scan(3, 2) + MS // 2) // MS
        assert found["M8191"] == 1
    # STOP→RUN has cleared the master's own.
    found = registers_now(simulation, "p0")
    assert found["D8202"] == (plain_scan(3, 2) + MS // 2) // MS
    assert not any(found[f"D{n}"] for n in range(8203, 8219))


def test_a_slave_in_stop_counts_nothing_loses_its_parameters_and_clears_its_status_at_run() -> None:
    faults = [
        fault(fault_kinds.PowerOff("p2"), 0.3, 0.4),  # something for p1 to count
        fault(fault_kinds.Stop("p1"), 1.0, 0.5),
        fault(fault_kinds.PowerOff("p2"), 1.1, 0.2),
    ]
    simulation, record = started(link(3, 0, retries=0, seconds=3, faults=faults))
    simulation.run(SECOND)
    before = registers_now(simulation, "p1")
    assert before["D8205"] > 0
    simulation.run(SECOND + SECOND // 2)
    stopped = registers_now(simulation, "p1")
    assert stopped == {**before, "M8191": 0, "D8174": 0, "D8175": 0}
    assert not [frame for frame in record.frames if frame.sender == "p1" and frame.end > SECOND + 1]
    simulation.run(SECOND + SECOND // 2 + 1)
    running = registers_now(simulation, "p1")
    settings = ["D8173", "D8176", "D8177", "D8179", "D8180", "M8179"]
    assert [name for name, value in running.items() if value] == settings
    simulation.run(3 * SECOND)
    found = registers_now(simulation, "p1")
    assert (found["D8174"], found["M8191"], found["D8205"]) == (2, 1, 0)


# -- damage: 04 and 14 -----------------------------------------------------------------------------


def test_a_damaged_reply_fails_after_two_quiet_characters() -> None:
    done = run(link(3, 2, seconds=2, faults=[flip("p1", "data", 1.0, 1)]))
    damaged = next(frame for frame in done.of("p1") if frame.damaged_bits)
    attempt = next(a for a in done.record.attempts if a.code)
    assert damaged.damaged_bits == STATION_BIT
    assert (attempt.station, attempt.number, attempt.code, attempt.outcome) == (1, 1, 4, "damaged")
    assert attempt.end == damaged.end + 2 * CHAR
    assert done.codes == {(1, 4): 1}
    lost = GAP + POLL + TURNAROUND + data(2) + 2 * CHAR
    assert sorted(set(done.durations)) == [plain_scan(3, 2), plain_scan(3, 2) + lost]
    # The repeat was good: no station has anything to complain of.
    assert all(done.about(f"p{n}", other) == NOTHING for n in range(3) for other in range(8))
    assert [note.kind for note in done.record.notes if note.tick >= SECOND] == ["fault"]


def test_a_damaged_header_fails_at_the_deadline() -> None:
    # Bits 2 and 4 of the header: STX (0x02) becomes '\x08', parity holds, no header.
    done = run(link(3, 2, seconds=2, faults=[flip("p1", "data", 1.0, 1, (2, 4))]))
    attempt = next(a for a in done.record.attempts if a.code)
    assert attempt.code == 4
    assert attempt.end == attempt.start + POLL + timeout(5)


def test_every_reply_damaged_is_04_at_the_master_and_at_the_slaves() -> None:
    done = run(link(4, 1, retries=2, seconds=3, faults=[flip("p1", "data", 1.0, 3)]))
    for station in (0, 2, 3):
        assert done.about(f"p{station}", 1) == (1, 0x04, 0)
    assert done.about("p1", 1) == NOTHING
    assert done.codes == {(1, 4): 3}
    assert done.link.station_errors == {1: 1, 2: 0, 3: 0}


def test_one_receiver_may_be_damaged_alone() -> None:
    bad = fault_kinds.FlipBits("p3", RX, STATION_BIT, 1, "data")
    # The first data frame after the 1 s is of any station: keep to replies of p1.
    for number in range(40):
        done = run(link(4, 1, seconds=1.2, faults=[fault(bad, 1.0 + number * 0.002)]))
        hit = next(frame for frame in done.record.frames if frame.damaged_at)
        assert hit.damaged_at == {"p3": STATION_BIT}
        assert hit.damaged_bits == ()
        assert done.record.failures == []
        sender = hit.station
        assert sender is not None
        assert done.about("p3", sender) == (1, 0x14 if sender == 0 else 0x04, 0)
        assert all(done.about(f"p{n}", other) == NOTHING for n in range(3) for other in range(8))
        if sender == 1:
            break
    else:
        pytest.fail("never a reply of p1")


def test_a_damaged_poll_is_14_at_the_slaves_and_silence_at_the_master() -> None:
    done = run(link(4, 1, retries=2, seconds=2, faults=[flip("p0", "poll", 1.0, 2)]))
    for slave in ("p1", "p2", "p3"):
        # Two damaged polls in a row are one error: no valid frame of the master lies between.
        assert done.about(slave, 0) == (1, 0x14, 0)
    (polled,) = {station for station, _ in done.codes}
    assert done.codes == {(polled, 1): 2}
    assert done.about("p0", polled) == NOTHING


def test_the_masters_flag_is_on_until_its_next_valid_frame() -> None:
    simulation, record = started(link(3, 1, seconds=2, faults=[flip("p0", "poll", 1.0, 1)]))
    simulation.run(SECOND + 40 * MS)
    simulation.run(simulation.now + 60 * MS)
    hit = next(frame for frame in record.frames if frame.damaged_bits)
    quiet = hit.end + 2 * CHAR
    repeat = next(frame for frame in record.frames if frame.kind == "poll" and frame.start > hit.end)
    simulation, _ = started(link(3, 1, seconds=2, faults=[flip("p0", "poll", 1.0, 1)]))
    for tick, flag in ((quiet, 0), (quiet + 1, 1), (repeat.end, 1), (repeat.end + 1, 0)):
        simulation.run(tick)
        assert [registers_now(simulation, slave)["M8183"] for slave in ("p1", "p2")] == [flag, flag]


def test_a_damaged_data_frame_of_the_master_is_14_and_its_block_is_not_taken() -> None:
    sources = {"D0": Constant(1), "D1": Constant(2)}
    scenario = link(3, 2, seconds=2, others={0: {"sources": sources}}, faults=[flip("p0", "data", 1.0, 1)])
    done = run(scenario)
    (hit,) = [frame for frame in done.of("p0") if frame.damaged_bits]
    for slave in ("p1", "p2"):
        assert done.about(slave, 0) == (1, 0x14, 0)
        # Neither the interval before nor the one after it is measured: no two in a row.
        assert done.registers(slave)["D8202"] == (plain_scan(3, 2) + MS // 2) // MS
    assert set(done.durations) == {plain_scan(3, 2)}
    assert done.record.failures == []
    refreshed = [tick for _, position, tick, _ in done.record.refreshes if position == 0]
    assert hit.end not in refreshed
    assert len(refreshed) == len(done.of("p0")) - 1


def test_a_damaged_parameter_frame_is_14_too_and_a_slave_waits_for_the_next() -> None:
    done = run(link(3, 0, retries=0, seconds=1, faults=[flip("p0", "parameters", 0.0, 1)]))
    # No station was linked yet, so none had a code; all were polled in vain.
    assert done.about("p1", 0) == NOTHING
    assert (done.about("p1", 1), done.about("p2", 2)) == ((0, 0x31, 0), (0, 0x31, 0))
    assert done.about("p0", 1) == (1, 0x01, 0)
    assert done.link.healthy_at == done.of("p2")[0].end


# -- late replies: 01, 02, 03, 04, 14, 21, 22, 23 --------------------------------------------------


def test_a_late_reply_counts_for_the_second_attempt_and_disturbs_the_next_scan() -> None:
    extra = 55 * MS - TURNAROUND
    done = run(link(3, 0, retries=2, seconds=2, faults=[fault_kinds.Slow("p1", extra)]))
    first, second, third, *_ = [a for a in done.record.attempts if a.station == 1]
    late = first.start + POLL + 55 * MS  # the reply to the first attempt begins
    assert (first.code, first.end) == (1, first.start + POLL + timeout(5))
    assert (second.start, second.code) == (first.end + GAP, 0)
    assert second.end == late + data(0)
    # Its reply to the second attempt comes 55 ms after that poll: in the next scan, with the old counter.
    later = second.start + POLL + 55 * MS
    assert third.number == 1
    assert (third.code, third.end) == (3, later + data(0))
    frames = done.of("p1")
    assert [(frame.start, frame.counter) for frame in frames[:2]] == [(late, 0), (later, 0)]
    assert done.link.station_errors == {1: 0, 2: 0}
    assert {code for _, code in done.codes} >= {1, 3}
    assert {station for station, _ in done.codes} == {1}
    # The listener heard the wrong counter as well, but every exchange had a reply in the end.
    assert done.about("p2", 1) == NOTHING


def test_a_late_reply_with_no_attempt_left_is_a_wrong_counter_for_all() -> None:
    # One slave, one attempt: the reply comes when the next scan waits for the same station again.
    next_poll = timeout(5) + OVERHEAD + GAP + PARAMETERS + GAP + data(0) + GAP + POLL
    slow = fault_kinds.Slow("p1", next_poll + 10 * MS - TURNAROUND)
    # p2 listens and is never polled.
    others = {0: {"registers": {"D8177": 1}}}
    done = run(link(3, 0, retries=0, seconds=0.2, others=others, faults=[slow]))
    first, second, *_ = done.record.attempts
    assert (first.code, second.code) == (1, 3)
    assert second.start - first.start == next_poll
    assert second.end == second.start + POLL + 10 * MS + data(0)
    assert second.turnaround == 10 * MS
    assert done.about("p0", 1)[1:] == (0x03, 1)
    assert done.about("p2", 1)[1:] == (0x23, 1)


def test_a_late_reply_in_anothers_exchange_is_a_wrong_station() -> None:
    # p1 replies 55 ms after its poll, while the master waits for p2, which is off.
    faults = [fault_kinds.Slow("p1", 55 * MS - TURNAROUND), fault_kinds.PowerOff("p2")]
    done = run(link(4, 0, retries=0, seconds=0.2, faults=faults))
    first, second, *_ = done.record.attempts
    assert (first.station, first.code) == (1, 0x01)
    late = first.start + POLL + 55 * MS
    assert (second.station, second.code, second.end) == (2, 0x02, late + data(0))
    # A listener: p1 was silent (21), p2 was spoken for by another (22).
    assert done.about("p3", 1)[1] == 0x21
    assert done.about("p3", 2)[1] == 0x22
    simulation, _ = started(link(4, 0, retries=0, seconds=0.2, faults=faults))
    simulation.run(late + data(0) + GAP + POLL + 1)  # the master has moved on to p3
    found = registers_now(simulation, "p3")
    assert (found["D8204"], found["D8212"], found["M8184"]) == (1, 0x21, 1)
    assert (found["D8205"], found["D8213"], found["M8185"]) == (1, 0x22, 1)
    found = registers_now(simulation, "p0")
    assert (found["D8204"], found["D8212"], found["M8184"]) == (1, 0x01, 1)
    assert (found["D8205"], found["D8213"], found["M8185"]) == (1, 0x02, 1)


def test_a_late_reply_over_the_masters_data_frame_is_14() -> None:
    # The last station's reply comes with the next scan's data frame, which it drowns.
    start = timeout(5) + OVERHEAD + GAP + PARAMETERS + GAP
    faults = [fault_kinds.Slow("p2", start + 8 * CHAR - TURNAROUND)]
    done = run(link(3, 0, retries=0, seconds=0.15, faults=faults))
    clash = sorted((frame for frame in done.record.frames if frame.collided), key=lambda f: f.start)
    assert [(f.sender, f.kind) for f in clash[:3]] == [("p0", "data"), ("p2", "data"), ("p0", "poll")]
    assert done.about("p1", 0)[:2] == (1, 0x14)
    assert done.link.collisions >= 1


def test_a_late_reply_over_another_reply_is_damage() -> None:
    # p1 replies when p2 does.
    faults = [fault_kinds.Slow("p1", timeout(5) + GAP + POLL + 3 * CHAR)]
    done = run(link(4, 1, retries=0, seconds=0.3, faults=faults))
    attempt = next(a for a in done.record.attempts if a.station == 2)
    assert attempt.code == 0x04
    assert done.about("p3", 2)[1] == 0x04

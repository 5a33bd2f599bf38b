"""What a station costs that never replies, and what the registers say of it."""

from __future__ import annotations

import pytest

from bussim.plc.profiles import AbsentStation, Attempts, ErrorCount
from bussim.scenario import fault_kinds, model
from tests.sim.build import (
    GAP,
    MS,
    PARAMETERS,
    POLL,
    SECOND,
    Done,
    fault,
    link,
    plain_scan,
    run,
    slot,
    steady,
    timeout,
)

FULL, PROBE = AbsentStation.FULL, AbsentStation.PROBE
#: The parameter frame before each data frame while a flag is on.
HELLO = GAP + PARAMETERS


def silence(attempts: int, units: int = 5) -> int:
    """What a silent station takes instead of its slot."""
    return attempts * (GAP + POLL + timeout(units))


@pytest.mark.parametrize(("absent", "later"), [(FULL, None), (PROBE, 1)])
@pytest.mark.parametrize(
    ("reading", "retries", "attempts"),
    [
        (Attempts.RETRIES_PLUS_1, 0, 1),
        (Attempts.RETRIES_PLUS_1, 3, 4),
        (Attempts.RETRIES, 0, 1),
        (Attempts.RETRIES, 3, 3),
        (Attempts.RETRIES_PLUS_1, 10, 11),
    ],
)
@pytest.mark.parametrize(("stations", "dead", "mode"), [(3, 1, 2), (3, 2, 0), (2, 1, 1)])
def test_a_dead_station_costs_its_attempts(
    absent: AbsentStation,
    later: int | None,
    reading: Attempts,
    retries: int,
    attempts: int,
    stations: int,
    dead: int,
    mode: int,
) -> None:
    profile = steady(absent_station=absent, attempts=reading)
    scenario = link(
        stations,
        mode,
        profile=profile,
        retries=retries,
        seconds=2.5,
        faults=[fault_kinds.PowerOff(f"p{dead}")],
    )
    done = run(scenario)
    others = plain_scan(stations, mode) - slot(mode)
    first = others + silence(attempts) + HELLO
    rest = others + silence(later or attempts) + HELLO
    assert len(done.durations) > 3
    assert done.durations == [first] + [rest] * (len(done.durations) - 1)
    assert [scan.attempts for scan in done.record.scans] == [
        stations - 2 + attempts,
        *[stations - 2 + (later or attempts)] * (len(done.durations) - 1),
    ]
    assert {scan.stations_in_error for scan in done.record.scans} == {1}
    assert done.link.attempts == attempts
    # The scan that the run ends in may have spent them too.
    scans = len(done.durations)
    assert done.link.station_errors[dead] - scans in (0, 1)
    assert done.link.failed_attempts[dead].keys() == {1}
    assert done.about("p0", dead) == (done.link.station_errors[dead], 0x01, 1)
    assert done.codes == {(dead, 1): done.link.failed_attempts[dead][1]}


@pytest.mark.parametrize("units", [5, 7, 225])
def test_the_timeout_is_the_registers(units: int) -> None:
    done = run(link(3, 0, units=units, retries=0, seconds=8, faults=[fault_kinds.PowerOff("p2")]))
    assert set(done.durations) == {plain_scan(3, 0) - slot(0) + silence(1, units) + HELLO}


def test_two_dead_stations_cost_twice() -> None:
    faults = [fault_kinds.PowerOff("p1"), fault_kinds.PowerOff("p3")]
    done = run(link(4, 1, retries=1, seconds=2, faults=faults))
    assert set(done.durations) == {plain_scan(4, 1) - 2 * slot(1) + 2 * silence(2) + HELLO}
    cause = "station 1 (p1): 2 attempts, all 01; station 3 (p3): 2 attempts, all 01; parameter frame"
    assert {scan.cause for scan in done.record.scans} == {cause}
    assert done.link.healthy_at is None


@pytest.mark.parametrize(("absent", "later"), [(FULL, 3), (PROBE, 1)])
def test_a_station_that_drops_out_and_comes_back(absent: AbsentStation, later: int) -> None:
    out = fault(fault_kinds.PowerOff("p1"), at=1.0, lasting=1.5)
    scenario = link(3, 2, retries=2, profile=steady(absent_station=absent), seconds=4, faults=[out])
    done = run(scenario)
    plain, others = plain_scan(3, 2), plain_scan(3, 2) - slot(2)
    by_cause: dict[str, set[int]] = {}
    for scan in done.record.scans:
        by_cause.setdefault(scan.cause, set()).add(scan.duration)
    lost = "station 1 (p1): 3 attempts, all 01; parameter frame"
    kept = "station 1 (p1): 1 attempt, 01; parameter frame" if later == 1 else lost
    back = by_cause.keys() - {"", lost, kept}
    assert by_cause[""] == {plain}
    assert by_cause[lost] == {others + silence(3) + HELLO}
    assert by_cause[kept] == {others + silence(later) + HELLO}
    # The scan in which it replies again: it began with the flag on, and the next one does not.
    assert all("before the reply" in cause for cause in back)
    assert len(done.notes("station_error", "p0")) == len(done.notes("recovered", "p0")) == 1
    assert done.notes("recovered", "p0")[0].tick > 2.5 * SECOND
    # Counts and codes survive the recovery, the flag does not.
    count, code, flag = done.about("p0", 1)
    assert (code, flag) == (0x01, 0)
    assert count == done.link.station_errors[1] > 1
    # The longest scan is what D8202 holds, and the record of that scan says why.
    longest = max(done.durations)
    assert done.registers("p0")["D8202"] == (longest + MS // 2) // MS
    assert next(s.cause for s in done.record.scans if s.duration == longest) == lost
    assert done.registers("p0")["D8201"] == (plain + MS // 2) // MS


@pytest.mark.parametrize("absent", [FULL, PROBE])
@pytest.mark.parametrize(("error_count", "each"), [(ErrorCount.PER_SCAN, True), (ErrorCount.ON_EDGE, False)])
def test_errors_count_every_scan_or_once_a_loss(
    absent: AbsentStation, error_count: ErrorCount, each: bool
) -> None:
    outs = [fault(fault_kinds.PowerOff("p1"), at, 0.8) for at in (0.5, 2.0)]
    profile = steady(absent_station=absent, error_count=error_count)
    done = run(link(3, 0, retries=1, profile=profile, seconds=3.5, faults=outs))
    lost = done.link.station_errors[1]
    assert lost > 5
    assert len(done.notes("station_error", "p0")) == 2
    assert done.about("p0", 1) == (lost if each else 2, 0x01, 0)
    # A slave hears the same silence: code 21. A scan that it hears nothing of, it does not count.
    assert done.about("p2", 1) == (lost if each else 2, 0x21, 0)


def causes(done: Done) -> set[str]:
    return {scan.cause for scan in done.record.scans}


def test_the_cause_of_a_repeat_names_what_failed() -> None:
    drops = [
        model.Fault("one", fault_kinds.DropReply("p1", 1), model.Window(SECOND)),
        model.Fault("two", fault_kinds.DropReply("p2", 2), model.Window(2 * SECOND)),
    ]
    done = run(link(3, 2, retries=3, seconds=3, faults=drops))
    assert causes(done) == {
        "",
        "station 1 (p1): 1 failed attempt before the reply, 01",
        "station 2 (p2): 2 failed attempts before the reply, all 01",
    }
    plain = plain_scan(3, 2)
    one, two = silence(1), silence(2)
    assert sorted(set(done.durations)) == [plain, plain + one, plain + two]
    assert done.about("p0", 1) == (0, 0, 0)
    assert done.link.station_errors == {1: 0, 2: 0}
    assert done.codes == {(1, 1): 1, (2, 1): 2}


def test_a_register_of_the_count_stops_at_32767() -> None:
    scenario = link(2, 0, retries=0, seconds=0.5, faults=[fault_kinds.PowerOff("p1")])
    done = run(scenario)
    master = done.simulation.plcs["p0"].master
    assert master is not None
    master.status.counts[1] = 32_766
    done.simulation.run(2 * SECOND)
    totals = done.simulation.totals()
    assert totals.plcs[0].registers["D8204"] == 32_767


def test_a_detached_masters_counts_are_not_forgotten() -> None:
    # Its own STOP clears the registers; the run's totals go on.
    stop = fault(fault_kinds.Stop("p0"), 1.0, 0.2)
    done = run(link(2, 0, retries=0, seconds=2, faults=[fault_kinds.PowerOff("p1"), stop]))
    fails = done.link.failed_attempts[1][1]
    assert fails == len(done.record.failures) == done.link.station_errors[1]
    assert 0 < done.about("p0", 1)[0] < fails
    # A poll may be on the line at the end.
    assert done.link.polls - len(done.of("p0", "poll")) in (0, 1)
    assert [scan.number for scan in done.record.scans] == list(range(len(done.record.scans)))

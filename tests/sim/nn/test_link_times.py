from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from math import sqrt

import pytest

from bussim.plc.profiles import PROFILES, AbsentStation, Turnaround
from bussim.scenario import model
from tests.sim.build import (
    CHAR,
    GAP,
    JITTER,
    MS,
    OVERHEAD,
    PARAMETERS,
    POLL,
    TURNAROUND,
    data,
    link,
    run,
    steady,
)

#: Link scan times in ms (FX communication manual JY992D69901, chapter 4), by stations and mode.
PUBLISHED = {
    2: (18, 22, 34),
    3: (26, 32, 50),
    4: (33, 42, 66),
    5: (41, 52, 83),
    6: (49, 62, 99),
    7: (57, 72, 115),
    8: (65, 82, 131),
}
CELLS = [(stations, mode) for stations in PUBLISHED for mode in range(3)]


@pytest.mark.parametrize("profile", ["pw10", "fx2n"])
@pytest.mark.parametrize(("stations", "mode"), CELLS)
def test_the_published_table(profile: str, stations: int, mode: int) -> None:
    jittery = {station: {"scan": model.Scan(8 * MS, MS)} for station in range(stations)}
    done = run(link(stations, mode, profile=PROFILES[profile], others=jittery, seconds=1.5), traced=False)
    mean = sum(done.durations) / len(done.durations)
    assert abs(mean / MS - PUBLISHED[stations][mode]) <= 0.65
    # Each slave adds a uniform deviation; the mean of them all is that of the formula.
    sd = JITTER / sqrt(3) * sqrt((stations - 1) / len(done.durations))
    assert abs(mean - formula(stations, mode)) < 4 * sd + 1
    assert max(done.durations) <= formula(stations, mode) + (stations - 1) * JITTER
    assert min(done.durations) >= formula(stations, mode) - (stations - 1) * JITTER
    assert {scan.cause for scan in done.record.scans} == {""}


def formula(stations: int, mode: int, turnaround: int = TURNAROUND) -> int:
    """Gap, the master's data; for each slave gap, poll, turnaround, data; the overhead."""
    return GAP + data(mode) + (stations - 1) * (GAP + POLL + turnaround + data(mode)) + OVERHEAD


def test_the_formula_is_the_specifications_example() -> None:
    # 0.4175 + 22 × 0.2604 + 0.4175 + 5 × 0.2604 + 0.4175 + 22 × 0.2604 + 3.52 = 17.53 ms
    assert formula(2, 0) / MS == pytest.approx(17.53, abs=0.005)
    assert abs(CHAR / MS - 0.2604) < 0.00005


@pytest.mark.parametrize(
    ("profile", "stations", "mode"),
    [
        *(("pw10", *cell) for cell in (*CELLS, (2, 3), (8, 3), (2, 4), (8, 4))),
        *(("fx2n", *cell) for cell in CELLS),
        *((family, 5, 0) for family in ("fx3u", "fx1s")),
    ],
)
def test_without_jitter_every_scan_is_the_formula(profile: str, stations: int, mode: int) -> None:
    done = run(link(stations, mode, profile=steady(profile), seconds=0.8), traced=False)
    assert len(done.durations) >= 2
    assert set(done.durations) == {formula(stations, mode)}
    assert {scan.attempts for scan in done.record.scans} == {stations - 1}
    assert done.registers("p0")["D8201"] == round(formula(stations, mode) / MS)
    assert done.registers("p0")["D8202"] == round(formula(stations, mode) / MS)


def test_every_frame_is_at_its_tick() -> None:
    done = run(link(3, 1, seconds=0.2, others={0: {"phase": 5 * MS}}))
    chars = {"data": 6 + 2 * 12, "poll": 5, "parameters": 14}
    expected = []
    # The parameter frame once, one gap after the master's first END; then scan after scan.
    now = 5 * MS + GAP
    expected.append((now, now + PARAMETERS, "p0", "parameters", 0))
    now += PARAMETERS
    for number in range(10):
        now += GAP
        expected.append((now, now + data(1), "p0", "data", number))
        now += data(1)
        for slave in ("p1", "p2"):
            now += GAP
            expected.append((now, now + POLL, "p0", "poll", number))
            now += POLL + TURNAROUND
            expected.append((now, now + data(1), slave, "data", number))
            now += data(1)
        now += OVERHEAD
    found = [(f.start, f.end, f.sender, f.kind, f.counter % 16) for f in done.record.frames]
    assert len(found) > 20
    assert found == expected[: len(found)]
    assert all(len(frame.chars) == chars[frame.kind] for frame in done.record.frames)
    starts = [start for start, _, sender, kind, _ in found if (sender, kind) == ("p0", "data")]
    # A scan is over when the next data frame begins, which may still be on the line at the end.
    scans = done.record.scans
    assert len(scans) - len(starts) in (-1, 0)
    assert [scan.start for scan in scans] == starts[: len(scans)]
    assert done.durations[: len(starts) - 1] == [b - a for a, b in pairwise(starts)]


@pytest.mark.parametrize(
    ("changes", "extra"),
    [
        ({"master_gap": GAP + 1000}, 4 * 1000),
        ({"scan_overhead": OVERHEAD + 777}, 777),
        ({"turnaround": Turnaround(TURNAROUND + 50, 0)}, 3 * 50),
        ({"turnaround": Turnaround(0, 0, values=(TURNAROUND + 9,), weights=(2.0,))}, 3 * 9),
        ({"absent_station": AbsentStation.PROBE}, 0),
    ],
)
def test_every_time_of_a_profile_acts(changes: dict[str, object], extra: int) -> None:
    done = run(link(4, 0, profile=replace(steady(), **changes), seconds=0.5), traced=False)
    assert set(done.durations) == {formula(4, 0) + extra}


def test_measured_turnarounds_appear_as_given() -> None:
    law = Turnaround(0, 0, values=(20_000, 50_000), weights=(3.0, 1.0))
    done = run(link(2, 0, profile=steady(turnaround=law), seconds=8))
    found = [attempt.turnaround for attempt in done.record.attempts]
    assert set(found) == {20_000, 50_000}
    share, count = found.count(50_000) / len(found), len(found)
    assert abs(share - 0.25) < 4 * sqrt(0.25 * 0.75 / count)


def test_bus_load_is_the_share_of_time_with_a_driver_on() -> None:
    done = run(link(2, 2, seconds=3), traced=True)
    finished = sum(frame.end - frame.start for frame in done.record.frames)
    assert finished <= done.link.busy < finished + data(2)  # one may be on the line at the end
    load = (2 * data(2) + POLL) / formula(2, 2)
    assert done.link.busy / done.totals.duration == pytest.approx(load, abs=0.02)


def test_counts_of_a_healthy_link() -> None:
    done = run(link(4, 1, seconds=2))
    scans = len(done.record.scans)
    assert done.link.polls == len(done.of("p0", "poll"))
    assert 3 * scans <= done.link.polls <= 3 * scans + 3
    assert done.link.frames in (len(done.record.frames), len(done.record.frames) + 1)
    assert (done.link.collisions, done.link.undetected, done.record.failures) == (0, 0, [])
    assert done.link.failed_attempts == {}
    assert done.link.station_errors == {1: 0, 2: 0, 3: 0}
    assert [scan.number for scan in done.record.scans] == list(range(scans))
    # Healthy as soon as the last slave has replied for the first time.
    assert done.link.healthy_at == done.of("p3")[0].end
    assert [note.tick for note in done.notes("healthy")] == [done.link.healthy_at]
    assert (done.link.slaves, done.link.mode, done.link.retries, done.link.attempts) == (3, 1, 3, 4)
    assert done.link.timeout == 50 * MS

"""Outages against a master stepped through them, and deaths at random instants."""

from __future__ import annotations

import numpy as np
import pytest

from bussim.exact.link import LinkModel
from bussim.exact.scan.outages import RideThrough, clean_scan, dead_means, longest_scan
from bussim.exact.scan.outages import ride_through as ride_through_of
from bussim.exact.solve import Solved
from bussim.plc.profiles import Turnaround
from tests.exact.links import FULL, MS, PROBE, change, link, with_burst

CONSTANT = Turnaround(30_060, 0)


def survives(model: LinkModel, begin: int, length: int) -> bool:
    """Whether an outage (ticks) during which nothing gets through raises no station error.

    All stations reply after their turnaround; a frame that overlaps the outage is lost, a reply that
    had begun is cut off: its attempt fails two quiet characters after the cut.
    """
    end, now = begin + length, 0
    while now < end:
        now += model.data
        for station in model.stations:
            for _ in range(model.attempts):
                now += model.gap
                poll, now = now, now + model.poll
                reply = now + 30_060
                if poll < end and now > begin:
                    now += model.timeout
                    continue
                over = reply + station.reply
                if reply < end and over > begin:
                    if begin >= reply + model.character:
                        now = begin + model.quiet
                    else:
                        now += model.timeout
                    continue
                now = over
                break
            else:
                return False
        now += model.overhead + model.gap
    return True


def ride_through(model: LinkModel) -> RideThrough:
    return ride_through_of(model, model.attempts, np.full(1, float(model.timeout)))


@pytest.mark.parametrize("attempts", [1, 2, 3, 5])
def test_the_longest_silence_that_no_beginning_turns_into_an_error(attempts: int) -> None:
    model = link(2, mode=0, attempts=attempts, turnaround=CONSTANT)
    ride = int(ride_through(model).silence[0])
    scan = clean_scan(model, slowest=False)
    begins = [
        *range(scan, 2 * scan, 937),
        *(scan + model.data + model.replied(model.stations[0]) + 30_060 - d for d in range(40)),
    ]
    if ride:
        assert all(survives(model, begin, ride) for begin in begins)
    # One character longer, and some beginning is fatal: just before a reply's end.
    assert not all(survives(model, begin, ride + model.character) for begin in begins)


def test_corruption_of_replies_runs_out_of_attempts_sooner() -> None:
    model = link(2, mode=0, attempts=5)
    ride = ride_through(model)
    torn = model.replied(model.stations[0]) + 22_860 + model.quiet
    assert ride.silence == model.quiet + model.gap + 3 * model.silent_cost
    assert ride.corruption == model.quiet + model.gap + 3 * torn
    assert ride_through(link(2, attempts=1)).corruption == 0
    slow = change(model, 2, extra=400 * MS)
    assert ride_through(slow).corruption == ride.corruption  # the quicker one decides


def test_scans_without_and_with_nothing_but_errors() -> None:
    model = link(3)
    distribution = Solved(model).distribution
    assert (clean_scan(model, slowest=False), clean_scan(model, slowest=True)) == distribution.support
    worst = Solved(link(3, loss=1.0)).distribution
    assert longest_scan(model) == worst.support[1]
    dead = link(3, absent=PROBE).with_dead(1)
    assert clean_scan(dead, slowest=True) == Solved(dead).distribution.support[1]
    assert longest_scan(dead) == dead.base + 9 * dead.silent_cost + dead.parameters_cost


@pytest.mark.parametrize("absent", [FULL, PROBE])
@pytest.mark.parametrize("burst", [False, True])
def test_mean_scans_with_dead_stations(absent: object, burst: bool) -> None:
    model = change(link(3, ber=1e-4, absent=absent), 2, extra=10 * MS)  # type: ignore[arg-type]
    if burst:
        model = with_burst(model, 500, 20, 0, 5e-3)
    solved = Solved(model)
    for count, choices in ((1, [(1,), (2,), (3,)]), (2, [(1, 2), (1, 3), (2, 3)])):
        means = [Solved(model.with_dead(*chosen)).distribution.mean for chosen in choices]
        assert dead_means(solved, count) == pytest.approx(max(means), rel=1e-11)
    assert dead_means(solved, 4) is None


def test_without_noise_a_dead_station_costs_its_attempts_instead_of_its_slot() -> None:
    model = link(2)
    alive = Solved(model).distribution.mean
    slot = model.replied(model.stations[0]) + 30_060
    expected = alive - slot + 4 * model.silent_cost + model.gap + model.parameters
    assert dead_means(Solved(model), 1) == pytest.approx(expected, rel=1e-14)
    assert dead_means(Solved(link(2, absent=PROBE)), 1) == pytest.approx(
        expected - 3 * model.silent_cost, rel=1e-14
    )

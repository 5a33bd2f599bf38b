from __future__ import annotations

from bisect import bisect_right
from itertools import pairwise
from math import sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bussim.plc.scan import ScanCycle


def generator(seed: int = 1) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(seed))


def all_ends(cycle: ScanCycle, first: int, upto: int) -> list[int]:
    """Every END up to a tick, asked for one after the other."""
    ends = [first]
    while ends[-1] <= upto:
        ends.append(cycle.next_end(ends[-1] + 1, ends[-1]))
    return ends


MEAN, JITTER = 1000, 400


@given(
    began=st.integers(0, 10_000),
    phase=st.none() | st.integers(0, 3000),
    jitter=st.sampled_from([0, 1, JITTER, MEAN - 1]),
    seed=st.integers(0, 2**32),
    steps=st.lists(
        st.tuples(st.integers(0, 400_000), st.sampled_from(["latest", "next", "ahead", "count"])), max_size=40
    ),
    ahead=st.integers(0, 3_000_000),
)
def test_queries_give_the_same_as_the_whole_list(
    began: int,
    phase: int | None,
    jitter: int,
    seed: int,
    steps: list[tuple[int, str]],
    ahead: int,
) -> None:
    last = began + sum(step for step, _ in steps) + ahead + 10_000
    twin = ScanCycle(generator(seed))
    ends = all_ends(twin, twin.run(began, MEAN, jitter, phase), last)
    cycle = ScanCycle(generator(seed))
    assert cycle.run(began, MEAN, jitter, phase) == ends[0]
    now = began
    for step, query in steps:
        now += step
        index = bisect_right(ends, now)
        if query == "latest":
            assert cycle.latest_end(now) == (ends[index - 1] if index else None)
        elif query == "count":
            cycle.count_up_to(now)
            scans = [after - end for end, after in pairwise(ends[:index])]
            longest = max(scans, default=0)
            assert (cycle.count, cycle.total, cycle.longest) == (len(scans), sum(scans), longest)
        else:
            wanted = now + ahead if query == "ahead" else now
            assert cycle.next_end(wanted, now) == next(end for end in ends if end >= wanted)
            # A query about what lies ahead takes nothing away from the present.
            assert cycle.latest_end(now) == (ends[index - 1] if index else None)
            before = bisect_right(ends, now - 1)
            assert cycle.latest_end(now - 1) == (ends[before - 1] if before else None)


def test_memory_does_not_grow_with_time_nor_with_how_far_ahead_it_is_read() -> None:
    for ahead in (0, 100, 2_000_000):
        cycle = ScanCycle(generator())
        cycle.run(0, MEAN, JITTER, None)
        sizes = []
        for now in range(0, 60_000_000, 500_000):
            cycle.next_end(now + ahead, now)
            sizes.append(len(cycle._ends))
        assert max(sizes[60:]) <= max(sizes[:60])
        assert max(sizes) < 4000 + ahead // (MEAN - JITTER)


def test_scans_are_uniform_over_mean_and_jitter() -> None:
    cycle = ScanCycle(generator(3))
    ends = all_ends(cycle, cycle.run(0, MEAN, JITTER, 0), 5_000_000)
    scans = np.diff(ends)
    count = len(scans)
    assert scans.min() == MEAN - JITTER
    assert scans.max() == MEAN + JITTER
    # A uniform variable over a width w has the variance w²/12.
    sd = 2 * JITTER / sqrt(12)
    assert abs(scans.mean() - MEAN) < 4 * sd / sqrt(count)
    # The sample variance of a uniform variable has the relative deviation sqrt(0.8 / n).
    assert abs(scans.var() / sd**2 - 1) < 4 * sqrt(0.8 / count)
    # Neighbours are independent.
    correlation = np.corrcoef(scans[:-1], scans[1:])[0, 1]
    assert abs(correlation) < 4 / sqrt(count)


def test_a_random_phase_is_uniform_over_a_scan_and_a_fixed_one_comes_back_at_every_run() -> None:
    cycle = ScanCycle(generator(4))
    phases = []
    for number in range(2000):
        now = number * 10_000
        phases.append(cycle.run(now, MEAN, 0, None) - now)
        cycle.stop(now + 5000)
    assert min(phases) >= 1
    assert max(phases) <= MEAN
    assert abs(np.mean(phases) - MEAN / 2) < 4 * MEAN / sqrt(12 * len(phases))
    for number in range(3):
        now = number * 10_000
        assert cycle.run(now, MEAN, JITTER, 77) == now + 77


def test_stop_ends_the_scans_and_the_next_run_begins_anew() -> None:
    cycle = ScanCycle(generator())
    cycle.run(0, MEAN, 0, 100)  # ENDs at 100, 1100, 2100 …
    cycle.stop(2100)
    assert cycle.latest_end(50_000) == 2100
    assert (cycle.count, cycle.total, cycle.longest) == (2, 2000, 1000)
    cycle.run(60_000, 3 * MEAN, 0, 0)  # 60000, 63000 …
    assert cycle.latest_end(59_999) is None
    assert cycle.latest_end(62_999) == 60_000
    cycle.count_up_to(66_000)
    # Neither STOP nor the way from RUN to the first END is a scan.
    assert (cycle.count, cycle.total, cycle.longest) == (4, 8000, 3000)


def test_before_the_first_end_there_is_none() -> None:
    cycle = ScanCycle(generator())
    assert cycle.latest_end(5) is None
    cycle.run(10, MEAN, 0, 500)
    assert cycle.latest_end(509) is None
    assert cycle.latest_end(510) == 510
    assert cycle.next_end(510, 400) == 510
    assert cycle.next_end(511, 400) == 1510


@pytest.mark.parametrize("jitter", [0, 300])
def test_the_same_generator_gives_the_same_scans_however_they_are_asked_for(jitter: int) -> None:
    one, other = ScanCycle(generator(9)), ScanCycle(generator(9))
    first = one.run(0, MEAN, jitter, None)
    assert other.run(0, MEAN, jitter, None) == first
    whole = all_ends(one, first, 3_000_000)
    assert other.latest_end(2_900_000) == whole[bisect_right(whole, 2_900_000) - 1]
    other.count_up_to(2_950_000)
    one.count_up_to(2_950_000)
    assert (one.count, one.total, one.longest) == (other.count, other.total, other.longest)


# -- load -----------------------------------------------------------------------------------------


class Loads:
    """The same scans by the definition: every scan's drawn length, and the load when it began."""

    def __init__(self, ends: list[int]) -> None:
        self.scans = [after - end for end, after in pairwise(ends)]
        self.ends = [ends[0]]
        self.extra = 0

    def reach(self, tick: int) -> None:
        while self.ends[-1] <= tick:
            self.ends.append(self.ends[-1] + self.scans[len(self.ends) - 1] + self.extra)

    def latest(self, tick: int) -> int | None:
        self.reach(tick)
        index = bisect_right(self.ends, tick)
        return self.ends[index - 1] if index else None

    def load(self, end: int, extra: int) -> None:
        del self.ends[self.ends.index(end) + 1 :]
        self.extra = extra


@given(
    jitter=st.sampled_from([0, JITTER, MEAN - 1]),
    seed=st.integers(0, 2**32),
    steps=st.lists(
        st.tuples(
            st.integers(0, 3) | st.integers(0, 3 * 512 * MEAN),
            st.sampled_from(["load", "latest", "before", "ahead", "count"]),
            st.sampled_from([0, 0, 7, 200, 5000]),
            st.integers(0, 200_000),
        ),
        max_size=30,
    ),
)
def test_a_load_makes_the_scans_that_begin_under_it_longer(
    jitter: int, seed: int, steps: list[tuple[int, str, int, int]]
) -> None:
    until = sum(step for step, *_ in steps) + 300_000
    twin = ScanCycle(generator(seed))
    model = Loads(all_ends(twin, twin.run(5, MEAN, jitter, 100), until))
    cycle = ScanCycle(generator(seed))
    cycle.run(5, MEAN, jitter, 100)
    changed: list[int] = []
    cycle.on_change = changed.append
    now = 105
    for step, query, extra, ahead in steps:
        now += step
        if query == "load":
            now = cycle.next_end(now, now)
            model.reach(now)
            assert now in model.ends
            known = len(changed)
            cycle.set_load(now, extra)
            assert changed[known:] == ([now] if extra != model.extra else [])
            model.load(now, extra)
        elif query == "latest":
            assert cycle.latest_end(now) == model.latest(now)
        elif query == "before":
            assert cycle.latest_end(now - 1) == model.latest(now - 1)
        elif query == "ahead":
            model.reach(now + ahead)
            assert cycle.next_end(now + ahead, now) == next(end for end in model.ends if end >= now + ahead)
        else:
            model.reach(now)
            passed = model.ends[: bisect_right(model.ends, now)]
            scans = [after - end for end, after in pairwise(passed)]
            cycle.count_up_to(now)
            assert (cycle.count, cycle.total, cycle.longest) == (
                len(scans),
                sum(scans),
                max(scans, default=0),
            )


def test_the_load_ends_with_stop() -> None:
    cycle = ScanCycle(generator())
    cycle.run(0, MEAN, 0, 100)
    cycle.set_load(cycle.next_end(1100, 1100), 50)  # ENDs at 100, 1100, 2150, 3200
    cycle.stop(3200)
    assert cycle.latest_end(9000) == 3200
    assert (cycle.count, cycle.total, cycle.longest) == (3, 3100, 1050)
    cycle.run(10_000, MEAN, 0, 0)
    assert cycle.next_end(10_500, 10_000) == 11_000


def test_a_load_is_set_at_an_end_of_a_running_plc() -> None:
    cycle = ScanCycle(generator())
    with pytest.raises(ValueError, match="no END"):
        cycle.set_load(100, 5)
    cycle.run(0, MEAN, 0, 100)
    with pytest.raises(ValueError, match="tick 101 is no END"):
        cycle.set_load(101, 5)
    cycle.set_load(101, 0)  # no change, nothing to look for


def test_memory_does_not_grow_under_load() -> None:
    cycle = ScanCycle(generator())
    cycle.run(0, MEAN, JITTER, 100)
    sizes = []
    for number in range(3000):
        end = cycle.next_end(number * 20 * MEAN, number * 20 * MEAN)
        cycle.set_load(end, (number + 1) % 3 * 10)
        cycle.next_end(end + 100 * MEAN, end)
        sizes.append(len(cycle._ends) + len(cycle._drawn))
    assert max(sizes) < 2500

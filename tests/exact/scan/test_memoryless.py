"""The distribution of a scan without bursts against exact arithmetic, and against scans played out."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator
from fractions import Fraction
from itertools import product
from math import comb, factorial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bussim.exact.bursts.reading import ENDS, Reading, read
from bussim.exact.bursts.timeout_stacks import Scans, TimeoutStacks
from bussim.exact.link import LinkModel, frame_ticks
from bussim.exact.scan.memoryless import (
    fails_of,
    probabilities_of,
    scan_components,
    scan_distribution,
)
from bussim.exact.sizing.grid import evaluate
from bussim.exact.solve import Solved
from bussim.plc.profiles import Turnaround
from tests.exact.bounds import KOLMOGOROV, SIGMAS, kolmogorov, off_by
from tests.exact.links import FULL, MS, PROBE, change, link, with_burst, with_noise
from tests.exact.play import play
from tests.selection import quick

#: Link scan times in ms published for the FX series (JY992D69901 rev. E, chapter 4), by stations and mode.
PUBLISHED = {
    0: (18, 26, 33, 41, 49, 57, 65),
    1: (22, 32, 42, 52, 62, 72, 82),
    2: (34, 50, 66, 83, 99, 115, 131),
}


@pytest.mark.parametrize(("mode", "slaves"), list(product(PUBLISHED, range(1, 8))))
def test_the_published_table(mode: int, slaves: int) -> None:
    assert abs(scan_distribution(link(slaves, mode=mode)).mean / MS - PUBLISHED[mode][slaves - 1]) < 0.65


def test_no_noise_is_the_turnarounds_law() -> None:
    model = link(3)
    distribution = scan_distribution(model)
    assert distribution.weight.tolist() == [1.0]
    fixed = model.gap + model.data + model.overhead + 3 * (model.gap + model.poll + model.data)
    assert distribution.support == (fixed + 3 * 22_860, fixed + 3 * 37_260)
    assert distribution.mean == fixed + 3 * 30_060
    assert distribution.variance == pytest.approx(3 * 14_400**2 / 12)
    # Of three uniforms: P(sum > 2.5) = 0.5³ / 6.
    assert distribution.tail(fixed + 3 * 22_860 + 2.5 * 14_400) == pytest.approx(0.125 / 6, rel=1e-12)


def test_a_constant_turnaround_leaves_a_point() -> None:
    distribution = scan_distribution(link(2, turnaround=Turnaround(30_060, 0)))
    assert distribution.variance == 0
    assert distribution.quantile(1e-9) == distribution.mean == distribution.support[0]
    assert distribution.tail(distribution.mean) == 0
    assert distribution.tail(distribution.mean - 1) == 1


@pytest.mark.parametrize(("absent", "attempts"), [(FULL, 4), (PROBE, 1)])
def test_every_reply_lost_is_a_point(absent: object, attempts: int) -> None:
    model = link(2, loss=1.0, absent=absent)  # type: ignore[arg-type]
    distribution = scan_distribution(model)
    expected = model.base + 2 * attempts * model.silent_cost + model.gap + model.parameters
    assert distribution.support == (expected, expected)
    assert distribution.weight.sum() == 1
    assert [fails_of(probabilities, 4, model.absent).error for probabilities in probabilities_of(model)] == [
        1.0,
        1.0,
    ]


def test_one_slave_with_reply_loss() -> None:
    model = link(1, loss=0.25, turnaround=Turnaround(30_060, 0))
    distribution = scan_distribution(model)
    replied = model.base + model.replied(model.stations[0]) + 30_060
    loss = Fraction(1, 4)
    for failed in range(4):
        at = replied + failed * model.silent_cost
        expected = loss**failed * (1 - loss)
        assert distribution.tail(at - 1) - distribution.tail(at) == pytest.approx(float(expected), rel=1e-12)
    last = model.base + 4 * model.silent_cost + model.parameters_cost
    assert distribution.tail(last - 1) == pytest.approx(float(loss**4), rel=1e-15)


def test_attempt_probabilities_in_exact_fractions() -> None:
    p = Fraction(3, 4096)  # exact as a float
    model = with_noise(with_noise(link(2, ber=float(p), loss=0.125), "rx", 0, float(p)), "tx", 1, float(p))
    q = 1 - p
    twice = 1 - (q * q + p * p)  # on the wire, and in the master's receiver or on the sender's side
    thrice = 1 - ((1 - twice) * q + twice * p)
    poll, bits = q**50, model.data_bits
    kept = Fraction(7, 8)
    for probabilities, rate in zip(probabilities_of(model), (thrice, twice), strict=True):
        clean = 1 - rate
        headless = Fraction(reading(float(rate), bits // 10).headless[0, 0])
        assert probabilities.replied == pytest.approx(float(poll * kept * clean**bits), rel=1e-12)
        assert probabilities.torn == pytest.approx(
            float(poll * kept * (1 - clean**bits - headless)), rel=1e-11
        )
        assert probabilities.silent == pytest.approx(
            float((1 - poll) + poll * (1 - kept) + poll * kept * headless), rel=1e-12
        )


def reading(rate: float, characters: int) -> Reading:
    """What is read of a reply in which each bit is inverted with a probability; tested by itself."""
    return read(np.full((1, 1), 1 - rate), np.full((1, 1), rate), characters, zeros=True)


# -- every outcome of every attempt, enumerated ------------------------------------------------------


def uniform_tail(count: int, y: Fraction, width: int) -> Fraction:
    if count == 0:
        return Fraction(int(y < 0))
    t = count - y / width
    if t <= 0 or t >= count:
        return Fraction(int(t >= count))
    return sum(
        ((-1) ** k * comb(count, k) * (t - k) ** count for k in range(count + 1) if t > k), Fraction(0)
    ) / factorial(count)


def exchanges(
    model: LinkModel, chances: tuple[Fraction, Fraction, Fraction], attempts: int
) -> Iterator[tuple[Fraction, int, int, int, bool]]:
    """(probability, ticks, turnarounds, torn replies, in error) of every course of an exchange."""
    replied, silent, torn = chances
    whole = model.gap + model.poll + model.data + 22_860
    for failed in range(attempts + 1):
        for course in product((True, False), repeat=failed):
            weight, ticks = Fraction(1), 0
            for is_silent in course:
                weight *= silent if is_silent else torn
                ticks += model.silent_cost if is_silent else whole + frame_ticks(2)
            damaged = course.count(False)
            if failed < attempts:
                yield weight * replied, ticks + whole, damaged + 1, damaged, False
            else:
                yield weight, ticks, damaged, damaged, True


def enumerated_tail(
    model: LinkModel,
    chances: tuple[Fraction, Fraction, Fraction],
    ends: dict[int, Fraction],
    mixture: list[tuple[Fraction, int]],
    x: Fraction,
) -> Fraction:
    total = Fraction(0)
    alike: dict[tuple[int, int, int, bool], Fraction] = defaultdict(Fraction)
    for share, attempts in mixture:
        for weight, *what in exchanges(model, chances, attempts):
            alike[tuple(what)] += share * weight  # type: ignore[index]
    single = [(weight, *what) for what, weight in alike.items() if weight]
    shifts: list[dict[int, Fraction]] = [{0: Fraction(1)}]
    for course in product(single, repeat=len(model.stations)):
        weight = Fraction(1)
        for part in course:
            weight *= part[0]
        ticks = model.base + sum(part[1] for part in course)
        if any(part[4] for part in course):
            ticks += model.gap + model.parameters
        turnarounds, torn = sum(part[2] for part in course), sum(part[3] for part in course)
        while len(shifts) <= torn:
            more: dict[int, Fraction] = defaultdict(Fraction)
            for (shift, one), (end, other) in product(shifts[-1].items(), ends.items()):
                more[shift + end] += one * other
            shifts.append(more)
        for shift, chance in shifts[torn].items():
            if chance > Fraction(1, 10**15):
                total += weight * chance * uniform_tail(turnarounds, x - ticks - shift, 14_400)
    return total


LEVELS = (0.5, 1e-3, 1e-6, 1e-9, 1e-12)


@pytest.mark.parametrize(
    ("absent", "ber", "levels"),
    quick(1, [(FULL, 2.0**-13, (0.5, 1e-12)), *product((FULL, PROBE), (2.0**-20, 2.0**-13), [LEVELS])]),
)
def test_tails_down_to_1e_12_against_enumeration(
    absent: object, ber: float, levels: tuple[float, ...]
) -> None:
    model = link(2, mode=0, attempts=3, ber=ber, absent=absent)  # type: ignore[arg-type]
    distribution = scan_distribution(model)
    p = Fraction(ber)
    q = 1 - p
    poll, bits = q**50, model.data_bits
    found = reading(ber, bits // 10)
    headless, torn = Fraction(found.headless[0, 0]), Fraction(found.torn[0, 0] + found.shifted[0, 0])
    chances = (poll * q**bits, 1 - poll + poll * headless, poll * torn)
    ends = {1_875 * end: Fraction(found.ends[0, index]) / torn for index, end in enumerate(ENDS)}
    fail = 1 - chances[0]
    flagged = fail**3 / (1 - fail + fail**3) if absent is PROBE else Fraction(0)
    mixture = [(1 - flagged, 3), (flagged, 1)]
    seen = []
    for level in levels:
        x = distribution.quantile(level)
        expected = float(enumerated_tail(model, chances, ends, mixture, Fraction(x)))
        # Sums with ends of torn replies are read from a grid of 1 µs.
        assert float(distribution.tail(x)) == pytest.approx(expected, rel=1e-3)
        seen.append(expected)
    # The quantiles are where they should be, but for levels that fall between two components.
    assert seen[0] == pytest.approx(0.5, rel=1e-3)
    assert all(p <= level * 1.001 for p, level in zip(seen, levels, strict=True))


# -- properties --------------------------------------------------------------------------------------

links = st.builds(
    lambda slaves, mode, attempts, timeout, probe, exponent, loss: link(
        slaves,
        mode=mode,
        attempts=attempts,
        timeout=timeout,
        absent=PROBE if probe else FULL,
        ber=10.0**exponent,
        loss=loss,
    ),
    st.integers(1, 7),
    st.integers(0, 4),
    st.integers(1, 11),
    st.sampled_from([50, 60, 100, 2250]),
    st.booleans(),
    st.floats(-9, -2.5),
    st.sampled_from([0.0, 1e-6, 0.01, 0.4]),
)


@pytest.mark.slow
@settings(deadline=None, max_examples=60)
@given(links)
def test_properties_of_any_link(model: LinkModel) -> None:
    components = scan_components(model)
    distribution = components.distribution(model.timeout)
    assert distribution.weight.sum() == pytest.approx(1, abs=1e-11)
    assert np.all(distribution.weight > 0)
    probabilities = probabilities_of(model)
    assert all(sum(o) == pytest.approx(1, abs=1e-12) for o in probabilities)
    fails = [fails_of(o, model.attempts, model.absent) for o in probabilities]
    assert all(0 <= f.onset <= f.error <= 1 for f in fails)
    flag = -math.expm1(sum(math.log1p(-f.error) for f in fails))
    assert components.weight[components.flagged].sum() == pytest.approx(flag, rel=1e-9, abs=1e-29)
    # The mean from the components and that from the exchanges' moments.
    scans = Scans(TimeoutStacks(model, np.full(1, float(model.timeout))), model.attempts)
    assert distribution.mean == pytest.approx(float(scans.mean[0, 0]), rel=1e-10)
    x = np.linspace(*distribution.support, 300)
    tail = distribution.tail(x)
    assert np.all(np.diff(tail) <= 1e-15)
    assert tail[-1] == 0
    for q in (0.3, 1e-4, 1e-8):
        at = distribution.quantile(q)
        assert distribution.tail(at + 0.1) <= q * (1 + 1e-3)
        assert distribution.tail(at - 0.1) >= q * (1 - 1e-3)


@pytest.mark.slow
@settings(deadline=None, max_examples=80)
@given(
    st.integers(1, 3),
    st.integers(1, 11),
    st.booleans(),
    st.floats(-12, 0) | st.just(-0.3),
    st.sampled_from([0.0, 0.3, 0.999999, 1.0]),
    st.booleans(),
)
def test_no_probability_exceeds_1_however_bad_the_line(
    slaves: int, attempts: int, probe: bool, exponent: float, loss: float, bursts: bool
) -> None:
    model = link(slaves, attempts=attempts, absent=PROBE if probe else FULL, ber=10.0**exponent, loss=loss)
    if bursts:
        model = with_burst(model, 1_000, 500, 0, 0.5)
    solved = Solved(model)
    for fails in solved.fails:
        assert 0 <= fails.onset <= fails.error <= 1
        assert 0 <= fails.flagged <= 1
    least, most = solved.distribution.support
    assert np.all(solved.distribution.tail(np.linspace(least - 1, most, 50)) <= 1)
    if not bursts:
        assert all(0 <= o.failed <= 1 and 0 <= o.replied <= 1 for o in probabilities_of(model))
    grid = evaluate(model, (1, attempts), (50 * MS, 100 * MS), (1,))
    settled = grid.error_per_scan[:, grid.valid]
    assert np.all(settled <= slaves)
    assert np.all(grid.over[1][:, grid.valid] <= 1)


def test_a_stationary_flag_under_probe() -> None:
    # The chain of one station, stepped until it stands still.
    probabilities = probabilities_of(link(1, ber=1e-3))[0]
    on = 0.0
    for _ in range(2_000):
        on = on * probabilities.failed + (1 - on) * probabilities.failed**3
    assert fails_of(probabilities, 3, PROBE).error == pytest.approx(on, rel=1e-12)
    assert fails_of(probabilities, 3, PROBE).onset == pytest.approx(
        (1 - on) * probabilities.failed**3, rel=1e-12
    )


# -- scans played out --------------------------------------------------------------------------------

PLAYED = {
    "two different stations": change(change(link(2, ber=2e-4, attempts=2), 1, extra=5 * MS), 2, loss=0.1),
    "a slow station alone": change(
        link(3, ber=1e-4), 2, extra=20 * MS, turnaround=Turnaround(90_000, 54_000)
    ),
    "one dead": link(3, ber=3e-4, attempts=2).with_dead(2),
    "one dead, probed": link(3, ber=3e-4, attempts=3, absent=PROBE).with_dead(1),
    "noise in the master": with_noise(link(2, attempts=2), "rx", 0, 4e-4),
    "noise in a slave": with_noise(link(2, attempts=2), "rx", 2, 4e-3),
    "noise of a sender": with_noise(link(2, attempts=2, absent=PROBE), "tx", 1, 8e-4),
    "measured turnaround": link(
        3, ber=2e-4, turnaround=Turnaround(0, 0, (21_600, 72_000, 180_000), (5, 3, 1))
    ),
    "heavy": link(2, ber=1e-3, attempts=2, absent=PROBE),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", PLAYED)
def test_scans_played_out(name: str) -> None:
    model, scans = PLAYED[name], 10_000
    seen = play(model, scans, seed=sum(map(ord, name)))
    solved = Solved(model)
    assert kolmogorov(solved.distribution, seen.scans[::3]) < KOLMOGOROV
    for station, fails in zip(model.stations, solved.fails, strict=True):
        if station.alive:
            stay = probabilities_of(model)[station.number - 1].failed if model.absent is PROBE else 0.0
            overdispersion = (1 + stay) / (1 - stay)
            assert off_by(seen.errors.get(station.number, 0), scans, fails.error, overdispersion) < SIGMAS
            assert off_by(seen.onsets.get(station.number, 0), scans, fails.onset, overdispersion) < SIGMAS

"""Sums of turnarounds against exact fractions and other ways to compute them."""

from __future__ import annotations

import sys
import time
from fractions import Fraction
from itertools import product
from math import comb, factorial
from random import Random
from threading import Thread

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bussim.exact.scan import turnaround_sums
from bussim.exact.scan.turnaround_sums import DIGIT, TurnaroundSums, irwin_hall_excess, irwin_hall_tail
from bussim.plc.profiles import Turnaround

NARROW, WIDE = Turnaround(30_060, 7_200), Turnaround(90_000, 54_000)
MEASURED = Turnaround(0, 0, (21_600, 72_000, 180_000), (5.0, 3.0, 1.0))


def exact_tail(count: int, z: Fraction, power: int = 0) -> Fraction:
    """P(sum > z) of uniforms, or its integral for power 1, by the alternating sum."""
    t = Fraction(count) - z
    degree = count + power
    total = sum(
        ((-1) ** k * comb(count, k) * (t - k) ** degree for k in range(count + 1) if t > k), Fraction(0)
    )
    return total / factorial(degree)


@pytest.mark.parametrize("count", [1, 2, 3, 7, 8, 20, 40])
def test_tail_and_excess_are_exact_everywhere(count: int) -> None:
    z = np.array([count * k / 97 for k in range(97)] + [count - 10.0**-k for k in range(1, 6)])
    tails, excesses = irwin_hall_tail(count, z), irwin_hall_excess(count, z)
    for at, tail, excess in zip(z.tolist(), tails.tolist(), excesses.tolist(), strict=True):
        assert tail == pytest.approx(float(exact_tail(count, Fraction(at))), rel=1e-12)
        assert excess == pytest.approx(float(exact_tail(count, Fraction(at), 1)), rel=1e-12)


def test_the_far_tail_is_relatively_exact() -> None:
    # 1e-7 below the top of 40 uniforms: about 1e-328 / ..., far below where 1 - F is anything but 0.
    z = np.array([40 - 0.05])
    assert irwin_hall_tail(40, z)[0] == pytest.approx(
        float(Fraction(40.0) - Fraction(z[0])) ** 40 / factorial(40), rel=1e-12
    )
    assert irwin_hall_tail(40, z)[0] < 1e-90


def test_outside_the_support() -> None:
    z = np.array([-1.0, 0.0, 3.0, 4.0])
    assert irwin_hall_tail(3, z).tolist() == [1.0, 1.0, 0.0, 0.0]
    assert irwin_hall_excess(3, z).tolist() == [2.5, 1.5, 0.0, 0.0]
    assert irwin_hall_tail(0, z).tolist() == [1.0, 0.0, 0.0, 0.0]


@given(st.integers(1, 30), st.lists(st.floats(-1, 31), min_size=2, max_size=20))
def test_tails_fall_and_are_probabilities(count: int, z: list[float]) -> None:
    tails = irwin_hall_tail(count, np.array(sorted(z)))
    assert np.all((tails >= 0) & (tails <= 1 + 1e-12))
    assert np.all(np.diff(tails) <= 1e-12)


def test_moments_come_from_the_laws() -> None:
    sums = TurnaroundSums([NARROW, MEASURED, Turnaround(5, 0)])
    codes = np.array([2 * sums.unit(NARROW) + 3 * sums.unit(MEASURED)])
    values, weights = np.array(MEASURED.values) - 21_600.0, np.array(MEASURED.weights) / 9
    mean = float(values @ weights)
    assert sums.unit(Turnaround(5, 0)) == 0
    assert sums.means(codes)[0] == pytest.approx(2 * 7_200 + 3 * mean)
    assert sums.variances(codes)[0] == pytest.approx(
        2 * 14_400**2 / 12 + 3 * float((values - mean) ** 2 @ weights)
    )
    assert sums.widths(codes)[0] == 2 * 14_400 + 3 * 158_400


def test_discrete_sums_are_exact() -> None:
    sums = TurnaroundSums([MEASURED])
    values = [Fraction(v - 21_600) for v in MEASURED.values]
    weights = [Fraction(5, 9), Fraction(3, 9), Fraction(1, 9)]
    for y in (-1.0, 0.0, 50_399.0, 50_400.0, 158_400.0, 208_800.0, 475_199.0, 475_200.0):
        expected = Fraction(0)
        excess = Fraction(0)
        for picked in product(range(3), repeat=3):
            weight = weights[picked[0]] * weights[picked[1]] * weights[picked[2]]
            total = sum(values[p] for p in picked)
            expected += weight if total > Fraction(y) else 0
            excess += weight * max(Fraction(0), total - Fraction(y))
        assert sums.tail(3, np.array([y]))[0] == pytest.approx(float(expected), rel=1e-12, abs=1e-15)
        assert sums.excess(3, np.array([y]))[0] == pytest.approx(float(excess), rel=1e-12, abs=1e-9)


def test_sums_of_two_widths() -> None:
    # P(N + W > y) for uniforms of widths n < w by elementary geometry.
    sums = TurnaroundSums([NARROW, WIDE])
    n, w = 14_400.0, 108_000.0
    code = sums.unit(NARROW) + sums.unit(WIDE)
    y = np.linspace(0, n + w, 200)
    top = np.clip(n + w - y, 0, None)
    area = np.where(y < n, n * w - y * y / 2, np.where(y < w, n * (w - y) + n * n / 2, top * top / 2))
    assert sums.tail(code, y) == pytest.approx(area / (n * w), abs=2 * 72 / 14_400)
    assert float(np.trapezoid(sums.tail(code, y), y)) == pytest.approx((n + w) / 2, rel=1e-3)
    assert sums.excess(code, np.zeros(1))[0] == pytest.approx((n + w) / 2, rel=1e-9)


def test_sums_with_ends_of_torn_replies() -> None:
    # Against plain convolutions of the cells; the code of 9 turnarounds and 4 ends is made by way of others.
    ends = Turnaround(0, 0, (0, 1_875, 16_875, 20_625), (0.1, 0.2, 0.6, 0.1))
    sums = TurnaroundSums([NARROW], ends)
    single = np.zeros(288)
    for value, chance in zip(ends.values, ends.weights, strict=True):
        cell, part = divmod(value, 72)
        single[cell] += chance * (1 - part / 72)
        single[cell + 1] += chance * part / 72
    masses = np.ones(1)
    for part in [single] * 4 + [np.full(200, 1 / 200)] * 9:
        masses = np.convolve(masses, part)
    code, first = 9 * sums.unit(NARROW) + 4 * sums.torn, 9 * 36.0
    for cell in (0, 700, 1_500, 2_400, 2_900):
        beyond = masses[cell:]
        at = np.array([first + 72 * (cell - 0.5)])
        assert sums.tail(code, at)[0] == pytest.approx(beyond.sum(), rel=1e-12)
        excess = float(beyond @ (72 * (np.arange(beyond.size) + 0.5)))
        assert sums.excess(code, at)[0] == pytest.approx(excess, rel=1e-12)


def test_rough_tails_are_near() -> None:
    sums = TurnaroundSums([NARROW])
    y = np.linspace(-100, 9 * 14_400, 3_000)
    for code in (0, 1, 2, 7, 30):
        rough = sums.rough_tail(np.full(y.size, code), y)
        assert np.max(np.abs(rough - sums.tail(code, y))) < 3e-4 or code == 0


def test_more_kinds_than_fit() -> None:
    distributions = [Turnaround(100_000, jitter) for jitter in (100, 200, 300, 400, 500)]
    assert TurnaroundSums(distributions[:4]).unit(distributions[3]) == 1 << (3 * DIGIT)
    with pytest.raises(ValueError, match="5 kinds of turnaround, at most 4"):
        TurnaroundSums(distributions)


def test_what_is_kept_of_sums_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    """A fitted link has thousands of sums, which took gigabytes; whether they are kept changes none of them."""
    kinds = [
        Turnaround(0, 0, values=(0, 720, 2160), weights=(1, 2, 1)),
        Turnaround(0, 0, values=(0, 1440), weights=(1, 1)),
    ]
    codes = [a + (b << DIGIT) for a in range(12) for b in range(12)]

    def tails() -> list[float]:
        turnaround_sums._grid_of.cache_clear()
        sums = TurnaroundSums(kinds)
        return [
            float(each(code, np.array([2000.0]))[0]) for code in codes for each in (sums.tail, sums.excess)
        ]

    kept = tails()
    monkeypatch.setattr(turnaround_sums, "_KEPT_BYTES", 1000)
    assert tails() == kept
    grid = turnaround_sums._grid_of(tuple(TurnaroundSums(kinds)._kinds.items()))
    for store in (grid._sums, grid._tails, grid._excesses):
        assert sum(values.nbytes for _, values in store._found.values()) == store._bytes <= 1000


def test_threads_may_keep_and_look_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    # As the figures and the recommendation of one link are worked out beside each other.
    monkeypatch.setattr(turnaround_sums, "_KEPT_BYTES", 2_000)
    store, failed = turnaround_sums._Kept(), []
    before = sys.getswitchinterval()

    def work(seed: int) -> None:
        rng = Random(seed)
        try:
            for _ in range(3_000):
                code = rng.randrange(60)
                if store.get(code) is None:
                    time.sleep(0)  # meanwhile another thread works the same out
                    store.keep(code, (0.0, np.zeros(10)))
        except (KeyError, RuntimeError) as error:
            failed.append(error)

    threads = [Thread(target=work, args=(seed,)) for seed in range(4)]
    sys.setswitchinterval(1e-6)
    try:
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    finally:
        sys.setswitchinterval(before)
    assert failed == []
    assert sum(values.nbytes for _, values in store._found.values()) == store._bytes <= 2_000

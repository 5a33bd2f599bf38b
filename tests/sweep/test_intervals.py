from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np
import pytest

from bussim.sweep.intervals import mean_of, student_t

#: Two-sided 95 % and 99 % points of Student's t, as in every table.
TABLE = {
    1: (12.7062, 63.6567), 2: (4.3027, 9.9248), 3: (3.1824, 5.8409), 4: (2.7764, 4.6041),
    5: (2.5706, 4.0321), 9: (2.2622, 3.2498), 10: (2.2281, 3.1693), 19: (2.0930, 2.8609),
    30: (2.0423, 2.7500), 60: (2.0003, 2.6603), 120: (1.9799, 2.6174), 1000: (1.9623, 2.5808),
}  # fmt: skip


@pytest.mark.parametrize("degrees", TABLE)
def test_student_as_in_the_tables(degrees: int) -> None:
    for confidence, value in zip((0.95, 0.99), TABLE[degrees], strict=True):
        assert student_t(degrees, confidence) == pytest.approx(value, abs=5.1e-5)


def test_student_in_closed_form() -> None:
    for confidence in (0.5, 0.9, 0.999, 1 - 1e-6):
        assert student_t(1, confidence) == pytest.approx(math.tan(math.pi * confidence / 2), rel=1e-9)
        assert student_t(2, confidence) == pytest.approx(
            confidence * math.sqrt(2 / (1 - confidence**2)), rel=1e-9
        )


def test_student_falls_towards_the_normal_law() -> None:
    values = [student_t(degrees) for degrees in range(1, 400)]
    assert values == sorted(values, reverse=True)
    assert student_t(100_000) == pytest.approx(NormalDist().inv_cdf(0.975), rel=2e-5)
    for wrong in (0, -3):
        with pytest.raises(ValueError, match="degrees"):
            student_t(wrong)


@pytest.mark.parametrize("count", [2, 3, 5, 20])
def test_95_of_100_intervals_cover_the_true_mean(count: int) -> None:
    trials = 4000
    samples = np.random.default_rng(count).normal(50.0, 7.0, (trials, count)).tolist()
    means = [mean_of(sample) for sample in samples]
    covered = sum(m.low is not None and m.high is not None and m.low <= 50.0 <= m.high for m in means)
    # Binomial, within four standard deviations; the normal law's 1.96 would cover 70 % for two samples.
    assert abs(covered - 0.95 * trials) < 4 * math.sqrt(trials * 0.95 * 0.05)


def test_counts_are_covered_roughly_as_promised() -> None:
    trials, count = 4000, 10
    samples = np.random.default_rng(1).poisson(6.0, (trials, count)).tolist()
    covered = sum((m.low or 0) <= 6.0 <= (m.high or 0) for m in map(mean_of, samples))
    assert 0.93 < covered / trials < 0.965


def test_by_hand() -> None:
    mean = mean_of([1, 2, 3, 4])
    assert mean.mean == 2.5
    half = 3.182446305 * math.sqrt(5 / 3) / 2
    assert mean.high == pytest.approx(2.5 + half, rel=1e-9)
    assert mean.low == pytest.approx(2.5 - half, rel=1e-9)


def test_limits_of_what_cannot_be_negative_end_at_0() -> None:
    assert mean_of([0, 0, 0, 1]).low == 0.0
    below = mean_of([0, 0, 0, -1]).low
    assert below is not None
    assert below < -1


def test_what_cannot_be_said_is_not_said() -> None:
    assert mean_of([]) == mean_of([None, None]) == mean_of([1.0, None])
    assert mean_of([]).mean is None
    one = mean_of([7.0])
    assert (one.mean, one.low, one.high) == (7.0, None, None)
    never = mean_of([0, 0, 0], events=True)
    assert (never.mean, never.low, never.high) == (0.0, None, None)
    constant = mean_of([0.5] * 3)
    assert (constant.low, constant.high) == (0.5, 0.5)

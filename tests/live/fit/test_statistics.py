"""The formulas against mpmath, exact sums and simulation."""

from __future__ import annotations

import random
from math import comb, log1p

import mpmath
import pytest

from bussim.live.fit.outages import REPLIED, SILENT, Outcomes, losses
from bussim.live.fit.statistics import (
    Estimate,
    against_uniform,
    bit_error_rate,
    mean,
    proportion,
)


def covers(found: Estimate, value: float) -> bool:
    """Whether a value lies in the interval."""
    return found.low is not None and found.high is not None and found.low <= value <= found.high


@pytest.mark.parametrize(("hits", "trials"), [(0, 20), (1, 10), (7, 50), (50, 50), (13, 4000)])
def test_clopper_pearson_ends_where_each_tail_is_a_fortieth(hits: int, trials: int) -> None:
    """By its definition, with exact binomial sums."""
    found = proportion(hits, trials)
    assert found.low is not None
    assert found.high is not None

    def at_most(k: int, p: float) -> float:
        with mpmath.workdps(40):
            terms = (
                comb(trials, j) * mpmath.mpf(p) ** j * (1 - mpmath.mpf(p)) ** (trials - j)
                for j in range(k + 1)
            )
            return float(mpmath.fsum(terms))

    if hits:
        assert 1 - at_most(hits - 1, found.low) == pytest.approx(0.025, rel=1e-6)
    else:
        assert found.low == 0
    if hits < trials:
        assert at_most(hits, found.high) == pytest.approx(0.025, rel=1e-6)
    else:
        assert found.high == 1


def test_the_bit_error_rate_of_equal_frames_has_a_closed_form() -> None:
    bits, sound, damaged = 100, 9000, 1000
    found = bit_error_rate({bits: (sound, damaged)})
    assert found is not None
    expected = 1 - (sound / (sound + damaged)) ** (1 / bits)
    assert found.value == pytest.approx(expected, rel=1e-6)
    assert covers(found, expected)
    assert found.low is not None
    assert found.high is not None
    # As wide as the binomial's normal interval, roughly: 1.96 standard deviations of ln(1 - damaged share).
    spread = 1.96 * (damaged / (sound + damaged) / sound) ** 0.5 / bits
    assert found.high - found.low == pytest.approx(2 * spread, rel=0.1)


def test_the_interval_of_the_bit_error_rate_covers_as_often_as_it_says() -> None:
    rng, covered, runs, rate = random.Random(3), 0, 300, 2e-4
    for _ in range(runs):
        frames: dict[int, tuple[int, int]] = {}
        for bits, count in ((50, 400), (300, 200)):
            bad = sum(rng.random() < 1 - (1 - rate) ** bits for _ in range(count))
            frames[bits] = (count - bad, bad)
        found = bit_error_rate(frames)
        assert found is not None
        covered += covers(found, rate)
    # 95 % of 300: standard deviation 1.3 %; four of them.
    assert covered / runs > 0.95 - 4 * 0.0126


def test_without_damage_the_rate_is_bounded_and_without_frames_unknown() -> None:
    found = bit_error_rate({100: (1000, 0)})
    assert found is not None
    assert (found.value, found.low) == (0, 0)
    assert found.high is not None
    assert -100_000 * log1p(-found.high) == pytest.approx(1.92, rel=0.01)
    assert bit_error_rate({}) is None
    everything = bit_error_rate({100: (0, 5)})
    assert everything is not None
    assert everything.low is None


def test_a_sample_against_the_uniform_law() -> None:
    assert against_uniform([0.1, 0.3, 0.5, 0.7, 0.9], 0, 1).distance == pytest.approx(0.1)
    assert against_uniform([0.5] * 100, 0, 1).p < 1e-9


def test_means() -> None:
    found = mean([1, 2, 3, 4])
    assert found.value == 2.5
    assert covers(found, 2.5)
    assert mean([7]).low is None
    with pytest.raises(ValueError, match="no values"):
        mean([])


def test_losses_of_one_station_among_many_are_no_outages() -> None:
    """By the loss of all seven three in a row would be an outage; of such lines one in twenty has them."""
    outages = 0
    for seed in range(100):
        rng, stations = random.Random(seed), {number: Outcomes() for number in range(1, 8)}
        for number, seen in stations.items():
            for at in range(400):
                seen.add(SILENT if number == 2 and at and rng.random() < 0.05 else REPLIED, at, at)
        outages += bool(losses(stations)[2].outages)
    assert outages <= 1

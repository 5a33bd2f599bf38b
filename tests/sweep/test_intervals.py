from __future__ import annotations

import math
import re
from statistics import NormalDist

import numpy as np
import pytest

from bussim.sweep.intervals import (
    LEAST_REPEATS,
    NEVER,
    TOO_FEW,
    WITHIN,
    Mean,
    footnotes,
    mean_of,
    student_t,
    with_interval,
)

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
    assert (constant.low, constant.high, constant.needed) == (0.5, 0.5, LEAST_REPEATS)


@pytest.mark.slow
@pytest.mark.parametrize("rate", [0.3, 2.0, 40.0])
@pytest.mark.parametrize("count", [3, 10])
def test_intervals_of_rare_counts_cover_and_never_reach_below_0(rate: float, count: int) -> None:
    trials = 3000
    samples = np.random.default_rng(round(10 * rate) + count).poisson(rate, (trials, count)).tolist()
    means = [mean_of(sample, events=True) for sample in samples]
    known = [each for each in means if each.low is not None and each.high is not None]
    assert all(0 < (each.low or 0) < (each.mean or 0) < (each.high or 0) for each in known)
    missed = sum(not (each.low or 0) <= rate <= (each.high or 0) for each in known)
    # The spread is at least that of Poisson's distribution: within four standard deviations of 95 %.
    assert missed <= 0.05 * trials + 4 * math.sqrt(trials * 0.05 * 0.95)
    # What never occurred has no interval, with Poisson's probability.
    never = math.exp(-rate * count)
    assert abs(trials - len(known) - never * trials) <= 4 * math.sqrt(trials * never * (1 - never)) + 1e-9


def test_clustered_events_have_an_interval_of_their_own_spread() -> None:
    # 40 at once, or nothing: Poisson's law of the sum alone would give 12 to 15.
    mean = mean_of([0, 40, 0, 0, 40, 0], events=True)
    assert mean.low is not None
    assert mean.high is not None
    assert (mean.low < 4, mean.high > 50) == (True, True)


def test_by_hand_of_one_event() -> None:
    # Of (1, 0, 0) mean and spread are 1/3 and √(1/3); Student's t with 2 degrees of freedom is 4.3027.
    mean = mean_of([1, 0, 0], events=True)
    factor = math.exp(4.302653 * math.sqrt(1 / 3) / math.sqrt(3) * 3)
    assert mean.low == pytest.approx(1 / 3 / factor, rel=1e-5)
    assert mean.high == pytest.approx(factor / 3, rel=1e-5)
    share = mean_of([0.5, 0.9], events=True)
    assert share.high == 1.0


def test_repeats_that_are_needed_are_those_with_which_the_interval_is_within_10_percent() -> None:
    rng = np.random.default_rng(5)
    for count in (2, 3, 4, 9, 30):
        for spread in (0.1, 1.0, 3.0, 9.0, 40.0):
            values = np.abs(rng.normal(50.0, spread, count)).tolist()
            mean = mean_of(values)
            assert mean.needed is not None
            assert mean.needed >= LEAST_REPEATS
            s = float(np.std(values, ddof=1))
            within = student_t(mean.needed - 1) * s / math.sqrt(mean.needed)
            assert within <= WITHIN * float(np.mean(values)) * (1 + 1e-9)
            if mean.needed > LEAST_REPEATS:
                fewer = student_t(mean.needed - 2) * s / math.sqrt(mean.needed - 1)
                assert fewer > WITHIN * float(np.mean(values))
            assert mean.too_few(count) == (mean.needed > count)


def test_a_count_needs_as_many_repeats_as_its_own_chance_takes() -> None:
    # Three equal counts of 1 have no spread; a Poisson mean of 1 takes (1.96 / 0.1)² of them, all the same.
    needed = mean_of([1, 1, 1], events=True).needed
    assert needed is not None
    assert 384 <= needed <= 390
    assert mean_of([0, 0, 0]).needed is None
    assert mean_of([0.0, 0.0], events=True).needed is None
    assert mean_of([7.0]).needed is None


def printed(*values: float | None, events: bool = False) -> str:
    return with_interval(mean_of(values, events=events), values)


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ((50.42, 50.44, 50.41), "50.423 ± 0.038"),
        ((43.375, 43.375, 43.375), "43.38 ± 0"),
        ((1000.0, 1001.0, 1002.0), "1,001.0 ± 2.5"),
        ((56.1, 140.0, 83.4), "56.10–140*"),
        ((66.82, 66.82), "66.82*"),  # two are too few, whatever they say
        ((7.25,), "7.25"),
        ((7.25, None), "–"),
        ((), "–"),
        ((0.00012, 0.00012, 0.00012), "0.00012 ± 0"),
    ],
)
def test_a_mean_is_told_with_its_interval_or_not_at_all(values: tuple[float, ...], text: str) -> None:
    assert printed(*values) == text


def test_counts_are_told_by_what_was_seen() -> None:
    assert printed(0, 2, 1, events=True) == "0–2*"
    assert printed(0, 0, 0, events=True) == "0°"
    assert printed(0, events=True) == "0"
    assert printed(0, 0, 0) == "0 ± 0"
    assert re.fullmatch(r"4\d\d ± \d\d", printed(412, 390, 425, 401, 433, 405, events=True))


def test_no_printed_interval_is_narrower_than_the_true_one_or_wider_than_a_tenth() -> None:
    rng = np.random.default_rng(7)
    told_at_all = 0
    for scale in (0.003, 0.9, 50.0, 4321.0):
        for spread in (1e-7, 1e-4, 0.01, 0.05, 0.3):
            for count in (2, 3, 5, 20):
                values = np.abs(rng.normal(scale, scale * spread, count)).round(9).tolist()
                mean = mean_of(values)
                text = with_interval(mean, values)
                found = re.fullmatch(r"([0-9.,]+) ± ([0-9.,]+)", text)
                assert (found is None) == mean.too_few(count) == text.endswith(TOO_FEW)
                if found is None:
                    continue
                told_at_all += 1
                number, half = (float(part.replace(",", "")) for part in found.groups())
                assert mean.mean is not None
                assert mean.high is not None
                assert half >= mean.high - mean.mean - 1e-9
                assert number == pytest.approx(
                    mean.mean, abs=0.5 * 10 ** -len(found[1].partition(".")[2]) + 1e-9
                )
                assert half <= 0.1 * number * 1.1 or half < 1e-5
    assert told_at_all > 30


def test_marks_are_explained_where_they_are() -> None:
    assert footnotes("50.4 ± 0.1", 3) == []
    few, never = footnotes(f"1–2{TOO_FEW} 0{NEVER}", 3, {"longest scan": 1234})
    assert few == (
        "* least and greatest run: 3 repeats are too few for a mean within ±10 %; it takes at least 1,234 "
        "(longest scan)"
    )
    # 0.64³ = 0.047: with a chance above 64 % less than one time in twenty no run of three has it.
    assert never == "° in none of 3 runs; with 95 % confidence in at most 64 % of all"
    assert (1 - 0.64) ** 3 <= 0.05 < (1 - 0.63) ** 3


def test_a_table_of_an_earlier_version_has_means_all_the_same() -> None:
    assert with_interval(Mean(5.25, 5.0, 5.5), [5.0, 5.5, 5.25]) == "5.25 ± 0.25"

from __future__ import annotations

from bisect import bisect_right
from fractions import Fraction
from itertools import accumulate, pairwise
from math import exp, sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bussim.line.noise import (
    BitNoise,
    BurstRate,
    ConstantRate,
    ErrorRate,
    ImpulseRate,
    Run,
    hit_probability,
)
from bussim.line.random_streams import Streams

BIT = Fraction(1875)
#: Bits that do not last a whole number of ticks: 57600 bps with a clock 137 ppm fast.
ODD_BIT = Fraction(1250) / (1 + Fraction(137, 1_000_000))
#: A difference of this many standard deviations comes once in 16,000 tests.
SIGMAS = 4


def spread(runs: list[Run]) -> list[float]:
    """The probability of each bit."""
    return [rate for count, rate in runs for _ in range(count)]


def centres(start: int, bits: int, bit: Fraction) -> list[Fraction]:
    return [start + (2 * number + 1) * bit / 2 for number in range(bits)]


def burst(good: int, bad: int, seed: int = 1) -> BurstRate:
    return BurstRate(good, bad, 0.25, 0.75, Streams(seed).uniforms("state"))


class Steps:
    """A rate that changes once, half way through the frame's 60 bits."""

    def runs(self, start: int, bits: int, bit: Fraction, begun: int | None = None) -> list[Run]:
        del start, bit, begun
        return [(bits // 2, 0.02), (5, 0.0), (bits - bits // 2 - 5, 0.3)]


# -- which bits are at risk ------------------------------------------------------------------------


@given(
    start=st.integers(0, 200_000),
    bits=st.integers(1, 120),
    bit=st.sampled_from([BIT, ODD_BIT]),
    every=st.integers(1000, 90_000),
    width=st.integers(1, 30_000),
    first=st.integers(0, 150_000),
)
def test_an_impulse_hits_the_bits_whose_centres_it_covers(
    start: int, bits: int, bit: Fraction, every: int, width: int, first: int
) -> None:
    rate = ImpulseRate(every, min(width, every), 0.5, first)
    covered = [
        0.5 if centre >= first and (centre - first) % every < min(width, every) else 0.0
        for centre in centres(start, bits, bit)
    ]
    assert spread(rate.runs(start, bits, bit)) == covered


@settings(deadline=None)
@given(
    frames=st.lists(st.tuples(st.integers(0, 60_000), st.integers(1, 100)), min_size=1, max_size=30),
    seed=st.integers(0, 1000),
    bit=st.sampled_from([BIT, ODD_BIT]),
)
def test_a_burst_has_one_state_at_each_instant_for_all_queries(
    frames: list[tuple[int, int]], seed: int, bit: Fraction
) -> None:
    starts = np.cumsum([gap for gap, _ in frames]).tolist()
    # The states over time, from a twin that is asked once, for bits of one tick each. (State changes
    # are whole ticks: a centre has the state of the tick that it lies in.)
    history = burst(9000, 4000, seed).runs(0, starts[-1] + 200_000, Fraction(1))
    changes = list(accumulate(count for count, _ in history))
    rate = burst(9000, 4000, seed)
    for start, (_, bits) in zip(starts, frames, strict=True):
        states = [history[bisect_right(changes, int(centre))][1] for centre in centres(start, bits, bit)]
        assert spread(rate.runs(start, bits, bit)) == states


@settings(deadline=None)
@given(
    pieces=st.lists(st.tuples(st.integers(0, 60_000), st.integers(1, 60)), min_size=2, max_size=4),
    other=st.integers(0, 50_000),
    seed=st.integers(0, 1000),
)
def test_a_frame_with_pauses_has_the_state_of_each_instant_and_so_has_one_that_begins_in_a_pause(
    pieces: list[tuple[int, int]], other: int, seed: int
) -> None:
    history = burst(9000, 4000, seed).runs(0, 1_500_000, Fraction(1))
    changes = list(accumulate(count for count, _ in history))
    starts = [7000]
    for (_, bits), (pause, _) in pairwise(pieces):
        starts.append(starts[-1] + bits * int(BIT) + pause)
    rate = burst(9000, 4000, seed)
    for at, bits, begun in (
        *((at, bits, starts[0]) for at, (_, bits) in zip(starts, pieces, strict=True)),
        (starts[0] + other, 50, None),
    ):
        states = [history[bisect_right(changes, int(centre))][1] for centre in centres(at, bits, BIT)]
        assert spread(rate.runs(at, bits, BIT, begun)) == states


def test_noise_of_a_window_hits_the_bits_that_a_pause_moves_into_it() -> None:
    noise = BitNoise("n", ImpulseRate(10**9, 50 * 1875, 1.0, 100_000), Streams(1), since=0, until=10**8)
    pieces = [(0, 10), (100_000 - 5 * 1875, 20)]
    assert noise.inverted(0, 30, BIT, "k", pieces) == tuple(range(15, 30))
    assert noise.inverted(0, 30, BIT, "k") == ()


@given(
    start=st.integers(0, 100_000),
    bits=st.integers(1, 100),
    since=st.integers(0, 200_000),
    length=st.none() | st.integers(1, 100_000),
    seed=st.integers(0, 100),
)
def test_outside_of_its_window_a_noise_does_nothing(
    start: int, bits: int, since: int, length: int | None, seed: int
) -> None:
    until = None if length is None else since + length
    # With certainty every bit inside is hit, and none outside.
    noise = BitNoise("n", ConstantRate(1.0), Streams(seed), since, until)
    inside = tuple(
        number
        for number, centre in enumerate(centres(start, bits, BIT))
        if centre >= since and (until is None or centre < until)
    )
    assert noise.inverted(start, bits, BIT, "k") == inside


# -- exact probabilities ---------------------------------------------------------------------------


@given(st.lists(st.tuples(st.integers(1, 20), st.sampled_from([0.0, 1e-3, 0.1, 0.5, 1.0])), max_size=6))
def test_the_chance_of_a_hit_is_one_less_every_bit_missed(runs: list[Run]) -> None:
    missed = 1.0
    for rate in spread(runs):
        missed *= 1 - rate
    assert hit_probability(runs) == pytest.approx(1 - missed, abs=1e-12)


@pytest.mark.parametrize("ber", [1e-18, 1e-12, 1e-9])
def test_the_chance_of_a_hit_is_exact_where_it_is_tiny(ber: float) -> None:
    # 1 - (1 - p)^n = n p - n (n - 1) p² / 2 + …
    assert hit_probability([(540, ber)]) == pytest.approx(540 * ber * (1 - 539 * ber / 2), rel=1e-12)


@pytest.mark.parametrize(
    ("rate", "bits", "frames"),
    [
        (ConstantRate(1e-3), 540, 20_000),
        (ConstantRate(0.05), 50, 8000),
        (Steps(), 60, 6000),
        (ImpulseRate(40_000, 9000, 0.2, 12_345), 60, 6000),
    ],
)
def test_every_bit_has_its_own_probability_and_no_memory(rate: ErrorRate, bits: int, frames: int) -> None:
    chances = np.array(spread(rate.runs(0, bits, BIT)))
    noise = BitNoise("n", rate, Streams(3))
    hits = np.zeros((frames, bits), dtype=bool)
    for frame in range(frames):
        hits[frame, list(noise.inverted(0, bits, BIT, "k"))] = True
    # Whole frames: binomial with the exact probability.
    chance = hit_probability(rate.runs(0, bits, BIT))
    assert abs(hits.any(axis=1).sum() - frames * chance) < SIGMAS * sqrt(frames * chance * (1 - chance))
    # Each bit: binomial; the largest of so many deviations is allowed a little more.
    counts = hits.sum(axis=0)
    sd = np.sqrt(frames * chances * (1 - chances))
    assert (counts[chances == 0] == 0).all()
    possible = chances > 0
    assert (np.abs(counts - frames * chances)[possible] / sd[possible]).max() < SIGMAS + 1
    # All of them together: the sum of squares has as many degrees of freedom as there are possible bits.
    squares = (((counts - frames * chances)[possible] / sd[possible]) ** 2).sum()
    free = int(possible.sum())
    assert abs(squares - free) < SIGMAS * sqrt(2 * free)
    # Independence: the number of errors in a frame has the variance of independent bits.
    errors = hits.sum(axis=1)
    variance = (chances * (1 - chances)).sum()
    fourth = (chances * (1 - chances) * (1 - 3 * chances * (1 - chances))).sum() + 3 * variance**2
    assert abs(errors.var() - variance) < SIGMAS * sqrt((fourth - variance**2) / frames)
    # And neighbours in time know nothing of each other.
    assert abs(np.corrcoef(errors[:-1], errors[1:])[0, 1]) < SIGMAS / sqrt(frames)


@pytest.mark.parametrize("rate", [0.0, 1.0])
def test_never_and_always(rate: float) -> None:
    noise = BitNoise("n", ConstantRate(rate), Streams(1))
    for _ in range(100):
        assert noise.inverted(0, 30, BIT, "k") == (tuple(range(30)) if rate else ())


def test_each_key_and_each_noise_has_its_own_random_stream() -> None:
    def draws(noise: BitNoise, keys: str) -> dict[str, list[tuple[int, ...]]]:
        found: dict[str, list[tuple[int, ...]]] = {}
        for key in keys:
            found.setdefault(key, []).append(noise.inverted(0, 200, BIT, key))
        return found

    both = draws(BitNoise("n", ConstantRate(0.02), Streams(1)), "ab" * 50)
    one = draws(BitNoise("n", ConstantRate(0.02), Streams(1)), "a" * 50)
    assert both["a"] == one["a"]
    assert both["a"] != both["b"]
    assert draws(BitNoise("m", ConstantRate(0.02), Streams(1)), "a" * 50) != one


# -- bursts: share and sojourns --------------------------------------------------------------------


def test_a_burst_is_bad_for_its_stationary_share_of_time() -> None:
    good, bad = 300_000, 100_000
    rate = burst(good, bad, 5)
    step, count = 40_000, 20_000
    states = np.array([rate.runs(number * step, 1, Fraction(2))[0][1] > 0.5 for number in range(count)])
    share = bad / (good + bad)
    # A two-state chain forgets with the rate 1/good + 1/bad.
    memory = exp(-step * (1 / good + 1 / bad))
    variance = share * (1 - share) / count * (1 + memory) / (1 - memory)
    assert abs(states.mean() - share) < SIGMAS * sqrt(variance)
    # The correlation of neighbours is that memory.
    correlation = np.corrcoef(states[:-1], states[1:])[0, 1]
    assert abs(correlation - memory) < SIGMAS * sqrt((1 - memory**2) / count) + 2 / count


def test_sojourns_are_exponential_with_their_means() -> None:
    good, bad = 50_000, 20_000
    rate = burst(good, bad, 6)
    # Bits of one tick show every change.
    span = 4_000_000
    runs: list[Run] = []
    for number in range(15):
        runs += rate.runs(number * span, span, Fraction(1))
    lengths: dict[float, list[int]] = {0.25: [], 0.75: []}
    joined: list[list[float]] = []
    for count, state in runs:
        if joined and joined[-1][1] == state:
            joined[-1][0] += count
        else:
            joined.append([count, state])
    for length, state in joined[1:-1]:
        lengths[state].append(int(length))
    for state, mean in ((0.25, good), (0.75, bad)):
        sojourns = np.array(lengths[state])
        count = len(sojourns)
        assert count > 500
        # Exponential: deviation and mean are equal, and the median is mean × ln 2.
        assert abs(sojourns.mean() - mean) < SIGMAS * mean / sqrt(count)
        assert abs((sojourns > mean * np.log(2)).mean() - 0.5) < SIGMAS * 0.5 / sqrt(count)
        assert abs((sojourns > 3 * mean).mean() - exp(-3)) < SIGMAS * sqrt(exp(-3) / count)


def test_frames_are_hit_by_bursts_with_the_exact_probability() -> None:
    good, bad, bits = 3000, 1000, 4
    law = np.array([[-1 / good, 1 / good], [1 / bad, -1 / bad]])
    # From one bit's centre to the next: the two-state chain over 1875 ticks.
    stationary = np.array([good, bad]) / (good + bad)
    forget = exp(-1875 * (1 / good + 1 / bad))
    chain = forget * np.eye(2) + (1 - forget) * np.outer(np.ones(2), stationary)
    assert np.allclose(stationary @ law, 0)
    missed = np.diag([1 - 0.05, 1 - 0.6])
    unhurt = stationary @ missed
    for _ in range(bits - 1):
        unhurt = unhurt @ chain @ missed
    chance = 1 - unhurt.sum()
    # Frames so far apart that nothing connects them.
    noise = BitNoise("n", BurstRate(good, bad, 0.05, 0.6, Streams(2).uniforms("state")), Streams(2))
    frames = 20_000
    hits = sum(bool(noise.inverted(number * 40_000, bits, BIT, "k")) for number in range(frames))
    assert abs(hits - frames * chance) < SIGMAS * sqrt(frames * chance * (1 - chance))


def test_a_burst_begins_in_the_stationary_state() -> None:
    count = 3000
    bad = sum(burst(900, 300, seed).runs(0, 1, Fraction(1))[0][1] > 0.5 for seed in range(count))
    assert abs(bad - count / 4) < SIGMAS * sqrt(count * 0.25 * 0.75)

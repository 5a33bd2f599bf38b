"""The chain from scan to scan: bursts, flags, and agreement with the closed form where both hold."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bussim.exact.bursts.channel import Line
from bussim.exact.bursts.exchange import line_of
from bussim.exact.bursts.scan_chain import ScanChain
from bussim.exact.link import LineNoise, LinkModel, NoiseSource
from bussim.exact.scan.memoryless import fails_of, probabilities_of, scan_distribution
from bussim.exact.solve import Solved
from tests.exact.bounds import KOLMOGOROV, SIGMAS, kolmogorov, off_by
from tests.exact.links import FULL, MS, PROBE, link, with_burst, with_noise
from tests.exact.play import play

BURST = LineNoise((NoiseSource("bus", None, 1e-3, 0.2, chain=0),), ((4_000.0, 9_000.0),))


def test_two_states_move_as_their_rates_say() -> None:
    line = Line(BURST, 1875.0)
    assert line.stationary == pytest.approx([4 / 13, 9 / 13])
    half = line.after(700.0)
    assert half @ half == pytest.approx(line.after(1_400.0), rel=1e-12)
    assert line.stationary @ half == pytest.approx(line.stationary, rel=1e-12)
    assert (half - np.eye(2)) / 700 == pytest.approx(
        np.array([[-1 / 4_000, 1 / 4_000], [1 / 9_000, -1 / 9_000]]), rel=0.15
    )
    assert line.after(1e9) == pytest.approx(np.array([line.stationary] * 2), rel=1e-12)


def test_a_frames_outcome_by_every_pattern_of_its_bits() -> None:
    line, bits = Line(BURST, 1875.0), 4
    rates, step = np.array([1e-3, 0.2]), line.after(1875.0)
    clean, hit = np.zeros((2, 2)), np.zeros((2, 2))
    for start in range(2):
        for states in product(range(2), repeat=bits):
            for pattern in product(range(2), repeat=bits):
                weight, at = 1.0, start
                for state, inverted in zip(states, pattern, strict=True):
                    weight *= step[at, state] * (rates[state] if inverted else 1 - rates[state])
                    at = state
                (hit if any(pattern) else clean)[start, at] += weight
    outcome = line.outcome(BURST.sources, bits)
    assert outcome.clean == pytest.approx(clean, rel=1e-12)
    assert outcome.hit == pytest.approx(hit, rel=1e-12)


def test_a_hit_is_exact_however_rare() -> None:
    noise = LineNoise((NoiseSource("bus", None, 0.0, 1e-15, chain=0),), ((72e7, 72e3),))
    line = Line(noise, 1875.0)
    expected = 500 * 1e-15 * line.stationary[1]
    assert float((line.stationary @ line.outcome(noise.sources, 500).hit).sum()) == pytest.approx(
        expected, rel=1e-9
    )


@settings(deadline=None, max_examples=10)
@given(st.floats(0, 0.3), st.floats(0, 0.3), st.floats(0, 0.3), st.integers(6, 9))
def test_a_replys_outcomes_are_all_that_can_happen(
    wire: float, master: float, receiver: float, characters: int
) -> None:
    noise = LineNoise(
        (NoiseSource("bus", None, wire), NoiseSource("rx", 0, master), NoiseSource("rx", 2, receiver))
    )
    line = Line(noise, 1875.0)
    bits = 10 * characters
    outcome = line.reply(noise.sources[:1], noise.sources[1:2], noise.sources[2:], characters)
    every = [float(matrix[0, 0]) for pair in outcome[:4] for matrix in pair]
    assert sum(every) == pytest.approx(1, abs=1e-11)
    alone = line.outcome((noise.sources[0], noise.sources[1]), bits)
    assert every[0] + every[1] == pytest.approx(float(alone.clean[0, 0]), rel=1e-9)
    heard = line.outcome((noise.sources[0], noise.sources[2]), bits)
    assert every[0] + every[2] + every[4] + every[6] == pytest.approx(float(heard.clean[0, 0]), rel=1e-9)


def test_noise_twice_over_is_right_again() -> None:
    noise = LineNoise((NoiseSource("bus", None, 1.0), NoiseSource("rx", 1, 1.0)))
    line = Line(noise, 1875.0)
    assert line.outcome(noise.sources, 50).clean[0, 0] == 1
    assert line.outcome(noise.sources[:1], 50).clean[0, 0] == 0


@settings(deadline=None, max_examples=10)
@given(
    st.integers(1, 4),
    st.integers(1, 5),
    st.booleans(),
    st.floats(-6, -3),
    st.sampled_from([0.0, 0.05]),
    st.booleans(),
)
def test_without_bursts_it_is_the_closed_form(
    slaves: int, attempts: int, probe: bool, exponent: float, loss: float, dead: bool
) -> None:
    model = link(slaves, attempts=attempts, absent=PROBE if probe else FULL, ber=10.0**exponent, loss=loss)
    if dead:
        model = model.with_dead(1)
    closed, chain = scan_distribution(model), ScanChain(model)
    distribution = chain.distribution()
    x = np.linspace(closed.support[0], closed.quantile(1e-9), 40)
    assert distribution.tail(x) == pytest.approx(closed.tail(x), rel=1e-6, abs=1e-15)
    assert distribution.mean == pytest.approx(closed.mean, rel=1e-11)
    for probabilities, fails in zip(probabilities_of(model), chain.fails(), strict=True):
        expected = fails_of(probabilities, model.attempts, model.absent)
        assert fails.error == pytest.approx(expected.error, rel=1e-9)
        if probabilities.replied:
            assert fails.onset == pytest.approx(expected.onset, rel=1e-9)


def test_a_burst_that_never_changes_anything_is_none() -> None:
    plain = link(2, ber=2e-4)
    same = with_burst(link(2), 30, 50, 2e-4, 2e-4)
    assert ScanChain(same).distribution().mean == pytest.approx(scan_distribution(plain).mean, rel=1e-12)


def test_two_bursts_are_independent_chains() -> None:
    one = with_burst(link(2, attempts=2), 100, 20, 0, 5e-3)
    both = with_burst(one, 40, 10, 0, 0.0)
    assert line_of(both).states == 4
    assert ScanChain(both).distribution().mean == pytest.approx(ScanChain(one).distribution().mean, rel=1e-10)


def test_the_start_of_scans_stands_still() -> None:
    chain = ScanChain(with_burst(link(3, attempts=2, absent=PROBE), 300, 60, 1e-5, 5e-3))
    start = chain.start
    again = chain._pass(start).end
    assert again == pytest.approx(start, rel=1e-9)
    assert start.sum() == pytest.approx(1)
    # Scans in a burst last longer, so fewer of them begin in one than its share of the time.
    assert start[:, 1].sum() < 60 / 360


PLAYED = {
    "short bursts": with_burst(link(2, attempts=2), 300, 20, 0, 1e-2),
    "long bursts": with_burst(link(2, attempts=3, ber=1e-5), 2_000, 300, 0, 3e-3),
    "long bursts, probed": with_burst(link(2, attempts=3, absent=PROBE), 2_000, 300, 0, 4e-3),
    "bursts in the master": with_burst(link(3, attempts=2), 200, 30, 0, 1e-2, "rx", 0),
    "two bursts": with_burst(with_burst(link(2, attempts=2), 400, 20, 0, 1e-2), 90, 6, 0, 3e-2, "rx", 1),
    "bursts and a dead one": with_burst(
        with_noise(link(3, attempts=2), "rx", 0, 1e-4), 500, 40, 0, 8e-3
    ).with_dead(2),
}


def _batches(values: list[int], size: int) -> float:
    """Variance of the sum of a series over that of an independent one, from batches."""
    series = np.array(values[: len(values) // size * size], dtype=np.float64)
    return float(series.reshape(-1, size).sum(axis=1).var() / (size * max(series.var(), 1e-12)))


@pytest.mark.slow
@pytest.mark.parametrize("name", PLAYED)
def test_scans_played_out(name: str) -> None:
    model, scans = PLAYED[name], 8_000
    seen = play(model, scans, seed=sum(map(ord, name)))
    solved = Solved(model)
    # Neighbouring scans share a burst: only every so many are compared.
    longest = max(sum(means) for means in model.noise.chains) / MS
    apart = 2 + int(3 * longest / (solved.distribution.mean / MS))
    assert kolmogorov(solved.distribution, seen.scans[::apart]) < KOLMOGOROV
    long = [int(scan > solved.distribution.quantile(0.05)) for scan in seen.scans]
    overdispersion = max(1.0, _batches(long, 250))
    for station, fails in zip(model.stations, solved.fails, strict=True):
        if station.alive:
            assert off_by(seen.errors.get(station.number, 0), scans, fails.error, 2 * overdispersion) < SIGMAS
            assert off_by(seen.onsets.get(station.number, 0), scans, fails.onset, 2 * overdispersion) < SIGMAS


def test_impossible_links_have_no_law() -> None:
    late: LinkModel = link(2, mode=4, timeout=30)
    with pytest.raises(ValueError, match="late replies"):
        Solved(late)

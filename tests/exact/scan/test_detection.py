"""The time to notice a death, against deaths at random instants of scans played out, and its bounds."""

from __future__ import annotations

import random
from bisect import bisect_right

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bussim.exact.link import LinkModel
from bussim.exact.metrics import Request, figures_of
from bussim.exact.scan.detection import detection
from bussim.exact.scan.outages import clean_scan
from bussim.exact.solve import Solved
from tests.exact.links import FULL, MS, PROBE, link, with_burst, with_noise
from tests.exact.play import play

LEVELS = (0.5, 0.1, 0.01)


def noticed(model: LinkModel, number: int, scans: int, seed: int) -> np.ndarray:
    """Times from deaths at random instants of played scans to the station's next error, in ticks.

    After the death no attempt succeeds; those of a scan up to the death, and the other stations', are as
    they were played.
    """
    attempts = [made[1:] for made in play(model, scans, seed).attempts if made[0] == number]
    begins = [begin for begin, *_ in attempts]
    # Of each attempt, how many more follow in its exchange if all fail; an exchange ends with a reply.
    left, allowed, made, flagged = [], [], 0, False
    for *_, good in attempts:
        made += 1
        most = model.attempts_at(flagged=flagged)
        left.append(most - made)
        over = good or made == most
        flagged = not good if over else flagged
        allowed.append(model.attempts_at(flagged=flagged))
        made = 0 if over else made
    rng, times = random.Random(seed), []
    for _ in range(60_000):
        at = rng.uniform(begins[0], begins[-20])
        index = bisect_right(begins, at) - 1
        begin, end, reply, _ = attempts[index]
        if at >= end:
            times.append(begins[index + 1] - at + allowed[index] * model.silent_cost)
            continue
        after = left[index] * model.silent_cost
        if reply is None or end - begin == model.silent_cost or at < reply[0] + model.character:
            times.append(begin + model.silent_cost - at + after)
        elif at < reply[1]:
            rest = model.character - (at - reply[0]) % model.character
            times.append(rest + model.quiet + after)
        else:
            times.append(end - at + after)
    return np.array(times)


PLAYED = {
    "bit errors": link(2, ber=2e-4, attempts=3),
    "one attempt, replies lost": link(1, attempts=1, loss=0.2),
    "noise in a receiver": with_noise(link(3, attempts=2), "rx", 2, 4e-3),
    "probed": link(2, attempts=3, loss=0.4, absent=PROBE),
    "bursts": with_burst(link(2, attempts=2), 300, 40, 0, 2e-2),
    "one dead": link(3, ber=3e-4, attempts=2).with_dead(1),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", PLAYED)
def test_deaths_at_random_instants(name: str) -> None:
    model, scans = PLAYED[name], 12_000
    station = model.alive[-1]
    found = detection(Solved(model), station)
    times = noticed(model, station.number, scans, sum(map(ord, name)))
    # Deaths within one scan are not independent: as many as there are scans, fewer with bursts.
    many = scans / (10 if model.noise.chains else 1)
    assert abs(times.mean() - found.mean) < 4.5 * times.std() / np.sqrt(many)
    for level in LEVELS:
        share = float((times > found.quantiles([level])[0]).mean())
        assert abs(share - level) < 4.5 * np.sqrt(level * (1 - level) / many)


def test_half_the_replies_lost_and_one_attempt() -> None:
    # By elementary geometry: scans of two lengths, in which the rest before the next deadline is uniform.
    figures = figures_of(link(1, attempts=1, loss=0.2), Request(levels={"10": 0.1, "1": 0.01}, refresh=False))
    assert figures.detect_mean == pytest.approx(36.14 * MS, abs=0.05 * MS)
    assert figures.detect["10"] == pytest.approx(66.32 * MS, abs=0.05 * MS)
    assert figures.detect["1"] == pytest.approx(71.69 * MS, abs=0.05 * MS)
    assert figures.worst_case == pytest.approx(73.78 * MS, abs=0.01 * MS)


def test_without_noise_the_longest_is_the_quantile_of_never() -> None:
    model = link(3)
    found = detection(Solved(model), model.stations[1])
    own = model.replied(model.stations[1]) + model.stations[1].slowest
    longest = clean_scan(model, slowest=True) - own + 4 * model.silent_cost
    assert figures_of(model, Request(refresh=False)).detect_longest == longest
    assert found.quantiles([1e-9])[0] == pytest.approx(longest, abs=0.1 * MS)
    assert found.quantiles([1e-9])[0] <= longest + 2
    assert float(found.tail(np.zeros(1))[0]) == pytest.approx(1, rel=1e-12)
    # The mean is the integral of the tail.
    x = np.linspace(0, longest, 20_001)
    assert float(np.trapezoid(found.tail(x), x)) == pytest.approx(found.mean, rel=1e-5)


@pytest.mark.slow
@settings(deadline=None, max_examples=25)
@given(
    st.integers(1, 4),
    st.integers(1, 4),
    st.booleans(),
    st.floats(-6, -1),
    st.sampled_from([0.0, 0.3, 1.0]),
    st.booleans(),
    st.booleans(),
)
def test_no_quantile_exceeds_its_bound(
    slaves: int, attempts: int, probe: bool, exponent: float, loss: float, dead: bool, bursts: bool
) -> None:
    model = link(slaves, attempts=attempts, absent=PROBE if probe else FULL, ber=10.0**exponent, loss=loss)
    if bursts:
        model = with_burst(model, 100, 50, 0, 0.1)
    if dead and slaves > 1:
        model = model.with_dead(1)
    levels = {str(level): level for level in (0.5, 1e-2, 1e-5, 1e-9, 1e-15)}
    figures = figures_of(model, Request(levels=levels, refresh=False))
    assert figures.worst_case is not None
    assert figures.detect_mean is not None
    assert figures.detect_mean <= figures.worst_case
    assert list(figures.detect.values()) == sorted(figures.detect.values())
    assert all(x <= figures.worst_case for x in (*figures.detect.values(), *figures.quantiles.values()))

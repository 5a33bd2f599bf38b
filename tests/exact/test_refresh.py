"""The time between refreshes against identities that any such process obeys, and scans played out."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bussim.exact.link import MASTER, LinkModel
from bussim.exact.metrics import figures_of
from bussim.exact.refresh import gap_distribution, gap_distributions, pairs
from bussim.exact.scan.memoryless import scan_distribution
from bussim.exact.solve import Solved
from tests.exact.bounds import KOLMOGOROV, SIGMAS, kolmogorov, off_by
from tests.exact.links import FULL, MS, PROBE, link, with_burst, with_noise
from tests.exact.play import play
from tests.selection import quick


def test_pairs() -> None:
    model = link(3).with_dead(2)
    assert pairs(model) == [(0, 1), (0, 3), (1, 0), (1, 3), (3, 0), (3, 1)]


def test_without_noise_every_gap_is_a_scan() -> None:
    solved = Solved(link(3))
    x = np.linspace(*solved.distribution.support, 50)
    for gap in gap_distributions(solved).values():
        assert gap.per_scan == 1
        assert gap.distribution.tail(x) == pytest.approx(solved.distribution.tail(x), abs=1e-12)


def test_the_masters_frame_is_missed_scan_by_scan() -> None:
    # Noise in one listener alone: the master notices nothing, so scans stay plain, and the number of
    # scans in a gap is geometric.
    model = with_noise(link(2), "rx", 2, 1e-3)
    solved = Solved(model)
    gap = gap_distribution(solved, MASTER, 2)
    hit = 1 - (1 - 1e-3) ** model.data_bits
    assert gap.per_scan == pytest.approx(1 - hit, rel=1e-12)
    unpolled = scan_distribution(model)
    low = unpolled.support[0]
    for scans in range(1, 6):
        # Between so many scans and one more (a scan is never twice as long as another unless a poll fails).
        beyond = float(gap.distribution.tail(low * (scans + 1) - 1))
        assert beyond >= hit**scans * (1 - 1e-9)
    assert gap.distribution.mean == pytest.approx(unpolled.mean / (1 - hit), rel=1e-9)


links = st.builds(
    lambda slaves, attempts, probe, bus, receiver, own, loss, dead: _some_link(
        slaves, attempts, PROBE if probe else FULL, bus, receiver, own, loss, dead
    ),
    st.integers(2, 4),
    st.integers(1, 4),
    st.booleans(),
    st.floats(-7, -3.5),
    st.floats(-7, -3.5),
    st.floats(-7, -3.5),
    st.sampled_from([0.0, 0.02]),
    st.booleans(),
)


def _some_link(
    slaves: int,
    attempts: int,
    absent: object,
    bus: float,
    receiver: float,
    own: float,
    loss: float,
    dead: bool,
) -> LinkModel:
    model = link(slaves, attempts=attempts, absent=absent, ber=10**bus, loss=loss)  # type: ignore[arg-type]
    model = with_noise(with_noise(model, "rx", slaves, 10**receiver), "rx", 0, 10**own)
    return model.with_dead(1) if dead else model


@pytest.mark.slow
@settings(deadline=None, max_examples=12)
@given(links)
def test_gaps_fill_the_time(model: LinkModel) -> None:
    # Whatever the distribution: receptions a scan × mean gap = mean scan.
    solved = Solved(model)
    for gap in gap_distributions(solved).values():
        assert gap.distribution.lost < 1e-9
        assert gap.per_scan * gap.distribution.mean == pytest.approx(solved.distribution.mean, rel=1e-8)
        tail = gap.distribution.tail(np.linspace(*gap.distribution.support, 100))
        assert np.all(np.diff(tail) <= 1e-14)


@pytest.mark.slow
@pytest.mark.parametrize("absent", quick(1, (PROBE, FULL)))
def test_gaps_fill_the_time_with_bursts(absent: object) -> None:
    model = with_burst(link(2, attempts=2, absent=absent), 2_000, 60, 0, 5e-3)  # type: ignore[arg-type]
    solved = Solved(with_noise(model, "rx", 1, 1e-5))
    for gap in gap_distributions(solved).values():
        assert gap.per_scan * gap.distribution.mean == pytest.approx(solved.distribution.mean, rel=1e-8)


def test_laws_are_shared_only_where_they_are_the_same() -> None:
    solved = Solved(link(4, ber=1e-4, attempts=1))
    every = gap_distributions(solved)
    assert every[1, 2].distribution is every[1, 3].distribution
    assert every[1, 2].distribution is not every[2, 3].distribution
    x = solved.distribution.support[0] + np.arange(0, 8 * 72_000, 720.0)
    # The parameter frame after an error of station 1 falls into its own gap, but before that of station 4.
    assert np.max(np.abs(every[1, 0].distribution.tail(x) - every[4, 0].distribution.tail(x))) > 1e-2
    # One for the master's frame, two for each slave's: heard by the master and by a listener.
    assert len({id(gap.distribution) for gap in every.values()}) == 9
    assert len({id(gap.distribution) for gap in gap_distributions(solved, by_position=False).values()}) == 3


PLAYED = {
    "bus": link(2, ber=3e-4, attempts=2),
    "probed": link(2, ber=2e-4, loss=0.3, attempts=2, absent=PROBE),
    "one receiver": with_noise(link(3, ber=1e-5, attempts=2), "rx", 2, 8e-4),
    "the master's receiver": with_noise(link(2, attempts=3), "rx", 0, 6e-4),
    "a dead one before": with_noise(link(3, attempts=1, ber=1e-4), "rx", 3, 1e-3).with_dead(1),
    "a deaf receiver": with_noise(link(3, attempts=2, mode=0, loss=0.1), "rx", 3, 6e-3),
    "a deaf receiver, probed": with_noise(link(2, attempts=2, mode=0, absent=PROBE), "rx", 1, 5e-3),
    "bursts in a receiver": with_burst(link(3, attempts=2, mode=0), 300, 100, 0, 2e-2, "rx", 2),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", PLAYED)
def test_gaps_played_out(name: str) -> None:
    model, scans = PLAYED[name], 6_000
    seen = play(model, scans, seed=sum(map(ord, name)))
    for (source, receiver), gap in gap_distributions(Solved(model)).items():
        sample = seen.gaps[source, receiver]
        clumping = 20.0 if model.noise.chains else 2.0
        assert kolmogorov(gap.distribution, sample[:: int(clumping)]) < KOLMOGOROV
        if gap.per_scan < 1 - 1e-9:
            assert off_by(len(sample), scans, gap.per_scan, clumping) < SIGMAS


def test_a_reply_is_refused_where_its_poll_was_missed_and_what_would_have_made_up_for_it() -> None:
    # Noise in station 3 alone. It takes station 2's reply if it heard that poll; else no poll may be open,
    # and a frame of this scan's counter heard. Before that poll: the data frame and station 1's poll missed,
    # or that poll heard and its reply missed.
    model = with_noise(link(3), "rx", 3, 1e-3)
    data, poll = 1 - (1 - 1e-3) ** model.data_bits, 1 - (1 - 1e-3) ** model.poll_bits
    before = data * poll + (1 - poll) * data
    taken = gap_distribution(Solved(model), 2, 3).per_scan
    assert taken == pytest.approx((1 - data) * (1 - before * poll), rel=1e-5)
    # The parameter frame of a scan with a flag on brings the counter as well: one in 200,000 here.
    assert taken > (1 - data) * (1 - before * poll)
    # Station 1's reply is refused where its poll and the data frame were missed.
    assert gap_distribution(Solved(model), 1, 3).per_scan == pytest.approx(
        (1 - data) * (1 - data * poll), rel=1e-5
    )
    # Station 1 is dead: its poll, if heard, stays open.
    dead = gap_distribution(Solved(model.with_dead(1)), 2, 3).per_scan
    assert dead < (1 - data) * (1 - (1 - poll) * poll)
    assert dead == pytest.approx((1 - data) * (1 - (1 - poll + data * poll * poll) * poll), rel=3e-3)


def test_noise_that_all_receivers_share_makes_no_listener_refuse() -> None:
    # A reply tells that its poll was heard by all: what arrives is taken.
    model = link(3, ber=1e-3, attempts=1)
    poll, reply = (1 - 1e-3) ** model.poll_bits, (1 - 1e-3) ** model.data_bits
    for receiver in (0, 1, 3):
        assert gap_distribution(Solved(model), 2, receiver).per_scan == pytest.approx(poll * reply, rel=1e-9)


@pytest.mark.slow
def test_gaps_that_are_not_worked_out_keep_their_mean() -> None:
    never = figures_of(with_burst(link(2, mode=0), 1, 1, 1.0, 0.0))
    refresh = never.refresh["p1->p2"]
    assert refresh.mean is not None
    assert refresh.mean > 1_000 * MS
    assert refresh.heartbeat is None
    assert set(refresh.quantiles.values()) == {None}
    assert any("a probability of at most its mean over that time" in said for said in never.in_words())
    lost = figures_of(link(2, loss=1.0))
    assert (lost.refresh["p1->p2"].mean, lost.refresh["p1->p2"].heartbeat) == (None, None)
    assert lost.refresh["p0->p1"].mean == pytest.approx(lost.mean)
    assert any(
        "practically no block arrives: p1->p0, p1->p2, p2->p0, p2->p1" in said for said in lost.in_words()
    )

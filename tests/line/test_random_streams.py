from __future__ import annotations

import subprocess
import sys
from itertools import islice
from math import sqrt

import numpy as np

from bussim.line.random_streams import Streams
from bussim.plc.profiles import Turnaround
from bussim.plc.turnaround import Turnarounds


def first(streams: Streams, *name: str | int, count: int = 200) -> list[float]:
    return list(islice(streams.uniforms(*name), count))


def test_a_stream_depends_on_the_seed_and_its_name_alone() -> None:
    one = Streams(7)
    first(one, "something", "else")  # nor on what was made before it
    assert first(one, "noise", "a") == first(Streams(7), "noise", "a")
    assert first(one, "noise", "a") != first(one, "noise", "b")
    assert first(one, "noise", "a") != first(one, "noisea")
    assert first(one, "noise", "a") != first(Streams(8), "noise", "a")


def test_the_same_numbers_in_another_process() -> None:
    program = (
        "from itertools import islice; from bussim.line.random_streams import Streams; "
        "print(list(islice(Streams(7).uniforms('noise', 'a'), 200)))"
    )
    # Another hash seed: names must not pass through hash().
    found = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        check=True,
        text=True,
        env={"PYTHONHASHSEED": "12345", "PYTHONPATH": ":".join(sys.path)},
    ).stdout
    assert found.strip() == repr(first(Streams(7), "noise", "a"))


def test_streams_of_neighbouring_names_and_seeds_are_uncorrelated() -> None:
    count = 4000
    streams = [first(Streams(seed), "turnaround", name, count=count) for seed in (1, 2) for name in "ab"]
    correlations = np.corrcoef(streams)
    assert np.abs(correlations - np.eye(4)).max() < 4 / sqrt(count)


def test_turnarounds_are_every_tick_of_mean_and_jitter_alike() -> None:
    turnarounds = Turnarounds(Turnaround(100, 3), Streams(5), "press")
    count = 14_000
    found = np.bincount([turnarounds.draw() for _ in range(count)])
    assert np.flatnonzero(found).tolist() == list(range(97, 104))
    # Each of seven values: binomial with p = 1/7.
    assert np.abs(found[97:] - count / 7).max() < 4 * sqrt(count * (1 / 7) * (6 / 7))


def test_measured_turnarounds_come_with_their_weights() -> None:
    law = Turnaround(0, 0, values=(10, 500, 20), weights=(1.0, 2.0, 5.0))
    turnarounds = Turnarounds(law, Streams(6), "press")
    count = 16_000
    found = [turnarounds.draw() for _ in range(count)]
    for value, weight in zip(law.values, law.weights, strict=True):
        share = weight / 8
        assert abs(found.count(value) - count * share) < 4 * sqrt(count * share * (1 - share))
    assert set(found) == {10, 20, 500}
    assert law.longest == 500
    assert law.average == (10 + 1000 + 100) / 8

"""A simulation against a recording: one law agrees, another differs and says in what."""

from __future__ import annotations

import random
from collections.abc import Callable

import pytest

from bussim.live.fit.comparison import Behaviour, Comparison, compare
from bussim.units import TICKS_PER_MS

Draw = Callable[[random.Random], float]


def behaviour(seed: int, law: Draw, count: int = 400, failed: int = 20) -> Behaviour:
    """Times of a law in ms."""
    rng = random.Random(seed)
    times = [round(law(rng) * TICKS_PER_MS) for _ in range(count)]
    return Behaviour(times, times, failed, 2 * count, again=None, station_errors=0)


def usual(rng: random.Random) -> float:
    return rng.uniform(20, 22) + (50 if rng.random() < 0.03 else 0)


def names(found: Comparison) -> set[str]:
    return {figure.name for figure in found.differs}


def test_two_samples_of_one_law_agree() -> None:
    """Differs at p < 0.01 whatever the number of figures: more than three of 40 once in 1000 times."""
    differ = sum(
        compare(behaviour(seed, usual), behaviour(1000 + seed, usual)).verdict == "differs"
        for seed in range(40)
    )
    assert differ <= 3


@pytest.mark.parametrize(
    ("law", "figure"),
    [
        (lambda rng: usual(rng) + 1, "distribution"),
        (lambda rng: usual(rng) + 2, "mean_ms"),
        (lambda rng: rng.uniform(20, 22) + (50 if rng.random() < 0.2 else 0), "beyond_90.0%"),
        (lambda rng: rng.uniform(20, 22), "longest_ms"),
    ],
)
def test_what_differs_is_named(law: Draw, figure: str) -> None:
    # The longest times of a recording are in many of its blocks, and in none of the simulation.
    found = compare(behaviour(1, usual, 4000), behaviour(2, law, 4000))
    assert figure in names(found)
    assert found.verdict == "differs"


def test_failures_that_differ_are_named_unless_they_come_in_groups() -> None:
    few, many = behaviour(1, usual, failed=20), behaviour(2, usual, failed=60)
    assert names(compare(few, many)) == {"failed_attempts"}
    one, two = (
        Behaviour(each.times, each.distances, each.failed, each.attempts, again=0.95) for each in (few, many)
    )
    assert not names(compare(one, two))


def test_times_that_differ_by_less_than_the_clock_shows_agree() -> None:
    one = Behaviour([1_440_000] * 200, [1_440_000] * 200, 0, 400, None)
    two = Behaviour([1_441_000] * 200, [1_441_000] * 200, 0, 400, None)
    assert compare(one, two).verdict == "agrees"
    far = Behaviour([1_460_000] * 200, [1_460_000] * 200, 0, 400, None)
    assert compare(one, far).verdict == "differs"
    assert compare(one, far, resolution=20_000).verdict == "agrees"


def test_few_times_have_no_tail_and_none_cannot_be_compared() -> None:
    found = compare(behaviour(1, usual, 60, 3), behaviour(2, usual, 60, 3))
    assert not found.tail
    assert not any(figure.name.startswith(("beyond", "longest")) for figure in found.figures)
    with pytest.raises(ValueError, match="no times"):
        compare(behaviour(1, usual, 0, 0), behaviour(2, usual))

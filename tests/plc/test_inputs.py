"""Stimuli: their changes, levels and next changes agree."""

from __future__ import annotations

import random
from collections.abc import Callable

from hypothesis import given
from hypothesis import strategies as st

from bussim.plc.inputs import NEVER, Pulse, Random, Square, Stimulus, Times

FAR = 400

ticks = st.integers(0, 60)
pulses = st.integers(1, 20).flatmap(
    lambda width: st.builds(
        Pulse,
        width=st.just(width),
        at=ticks,
        every=st.none() | st.integers(width + 1, 40),
        times=st.none() | st.integers(1, 5),
    )
)
squares = st.builds(Square, period=st.integers(2, 41), at=ticks)
lists = st.lists(st.integers(0, 300), unique=True).map(lambda found: Times(tuple(sorted(found))))


def randoms(seed: int) -> Random:
    rng = random.Random(seed)
    return Random(7, 11, iter(rng.random, None))


# Made anew for each query: a random one forgets what lies before the latest.
makers = st.one_of(
    (pulses | squares | lists).map(lambda stimulus: lambda: stimulus),
    st.integers(0, 1000).map(lambda seed: lambda: randoms(seed)),
)


@given(makers, st.integers(0, 300))
def test_the_next_change_is_the_first_of_the_changes(make: Callable[[], Stimulus], tick: int) -> None:
    changes = make().changes(tick, tick + FAR)
    following = make().next_change(tick)
    if changes:
        assert following == changes[0][0]
    else:
        assert following > tick + FAR
    if isinstance(make(), Times | Pulse) and not changes:
        assert following == NEVER


@given(makers, st.lists(st.integers(0, 25), min_size=1, max_size=20))
def test_asking_when_it_changes_next_changes_nothing(make: Callable[[], Stimulus], steps: list[int]) -> None:
    asked, unasked = make(), make()
    since = 0
    for step in steps:
        until = since + step
        assert asked.changes(since, until) == unasked.changes(since, until)
        asked.next_change(until)
        assert asked.level(until) == unasked.level(until)
        since = until


@given(makers, st.integers(0, 200), st.integers(0, 100))
def test_levels_follow_the_changes(make: Callable[[], Stimulus], since: int, span: int) -> None:
    level = make().level(since)
    changes = make().changes(since, since + span)
    assert [at for at, _ in changes] == sorted({at for at, _ in changes})
    for _, after in changes:
        assert after == level ^ 1
        level = after
    assert make().level(since + span) == level

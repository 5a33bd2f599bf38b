from __future__ import annotations

from collections import Counter

from hypothesis import given
from hypothesis import strategies as st

from bussim.results.meters.histogram import BIN_TICKS
from bussim.results.meters.refresh import RefreshMeter

NODES = 5


class NaiveMeter:
    """What the meter means: one last reception and one list of gaps for every pair."""

    def __init__(self) -> None:
        self.last: dict[tuple[int, int], int] = {}
        self.gaps: dict[tuple[int, int], list[int]] = {}

    def refreshed(self, source: int, tick: int, heard: tuple[int, ...] | None) -> None:
        listeners = range(NODES) if heard is None else heard
        for receiver in listeners:
            if receiver == source:
                continue
            pair = (source, receiver)
            if self.last.get(pair) != tick and pair in self.last:
                self.gaps.setdefault(pair, []).append(tick - self.last[pair])
            self.last[pair] = tick


def assert_same(meter: RefreshMeter, naive: NaiveMeter) -> None:
    for source in range(NODES):
        for receiver in range(NODES):
            if source == receiver:
                continue
            pair = meter.pair("link", source, receiver)
            gaps = naive.gaps.get((source, receiver), [])
            bins = Counter((2 * gap + BIN_TICKS) // (2 * BIN_TICKS) for gap in gaps)
            assert pair.gaps.bins == bins
            assert pair.gaps.count == len(gaps)
            assert pair.gaps.total == sum(gaps)
            assert pair.gaps.maximum == max(gaps, default=None)
            assert pair.last == naive.last.get((source, receiver))


@st.composite
def receptions(draw: st.DrawFn) -> list[tuple[int, int, tuple[int, ...] | None]]:
    steps = draw(
        st.lists(
            st.tuples(
                st.integers(0, NODES - 1),
                st.one_of(st.just(0), st.integers(1, 5_000)),
                st.one_of(
                    st.none(),
                    st.lists(st.integers(0, NODES - 1), unique=True, max_size=NODES).map(tuple),
                ),
            ),
            max_size=60,
        )
    )
    tick, calls = 0, []
    for source, pause, heard in steps:
        tick += pause
        calls.append((source, tick, heard if heard is None else tuple(r for r in heard if r != source)))
    return calls


@given(receptions())
def test_every_pair_has_the_gaps_of_the_naive_meter(
    calls: list[tuple[int, int, tuple[int, ...] | None]],
) -> None:
    meter, naive = RefreshMeter(), NaiveMeter()
    for source, tick, heard in calls:
        meter.refreshed("link", source, tick, heard)
        naive.refreshed(source, tick, heard)
    assert_same(meter, naive)


@given(
    st.lists(
        st.tuples(
            st.integers(1, 3_000), st.sampled_from([None, None, (2, 3, 4), (2, 4), (3,), (2, 3), (), (4, 3)])
        ),
        max_size=200,
    )
)
def test_long_runs_of_one_source_with_joins_and_leaves(
    steps: list[tuple[int, tuple[int, ...] | None]],
) -> None:
    meter, naive, tick = RefreshMeter(), NaiveMeter(), 0
    for pause, heard in steps:
        tick += pause
        meter.refreshed("link", 1, tick, heard)
        naive.refreshed(1, tick, heard)
    assert_same(meter, naive)


def test_memory_does_not_grow_with_a_run() -> None:
    meter, tick = RefreshMeter(), 0
    for round_ in range(5_000):
        for heard in (None, (1, 2, 3), (1, 3), None):
            tick += 3_600 + 7 * (round_ % 11)
            meter.refreshed("link", 0, tick, heard)
    source = meter._sources["link", 0]
    assert len(source._pending) < 512
    assert sorted(source.named) == [1, 2, 3]
    assert all(len(pair.gaps.bins) < 100 for pair in (*source.named.values(), source.others))


def test_a_pair_that_never_was_refreshed() -> None:
    pair = RefreshMeter().pair("link", 0, 1)
    assert (pair.gaps.count, pair.last) == (0, None)

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from bussim.sim.nn.block_history import BlockHistory

POSITIONS, STATIONS = 4, 2
HORIZON = 12


class NaiveHistory:
    """Everything that each position ever received, written down for each of them."""

    def __init__(self) -> None:
        self.received: dict[tuple[int, int], list[tuple[int, bytes]]] = {}

    def add(self, station: int, tick: int, image: bytes, plc_names: set[int]) -> None:
        for position in plc_names:
            self.received.setdefault((position, station), []).append((tick, image))

    def forget(self, position: int) -> None:
        for station in range(STATIONS):
            self.received.pop((position, station), None)

    def visible(self, position: int, end: int) -> dict[int, bytes]:
        found = {}
        for station in range(STATIONS):
            before = [image for tick, image in self.received.get((position, station), []) if tick <= end]
            if before:
                found[station] = before[-1]
        return found


plc_names = st.integers(0, POSITIONS - 1)
stations = st.integers(0, STATIONS - 1)
operations = st.one_of(
    st.tuples(st.just("heard"), stations, st.just(frozenset[int]())),
    st.tuples(st.just("heard"), stations, st.frozensets(plc_names, max_size=POSITIONS - 1)),
    st.tuples(st.just("alone"), stations, st.frozensets(plc_names, min_size=1, max_size=1)),
    st.tuples(st.just("forget"), st.just(0), st.frozensets(plc_names, min_size=1, max_size=1)),
)


@given(
    st.lists(
        st.tuples(
            # Two frames of one station never end at one tick.
            st.integers(1, HORIZON),
            operations,
            st.lists(st.tuples(plc_names, st.integers(0, HORIZON - 1)), max_size=4),
        ),
        max_size=40,
    )
)
def test_every_position_sees_what_it_received(
    steps: list[tuple[int, tuple[str, int, frozenset[int]], list[tuple[int, int]]]],
) -> None:
    block_history, naive = BlockHistory(HORIZON), NaiveHistory()
    now = 0
    for number, (step, (what, station, who), queries) in enumerate(steps):
        now += step
        image = b"%d" % number
        if what == "heard":
            block_history.received(station, now, image, who)
            naive.add(station, now, image, set(range(POSITIONS)) - who)
        elif what == "alone":
            (position,) = who
            block_history.received_by(position, station, now, image)
            naive.add(station, now, image, {position})
        else:
            (position,) = who
            block_history.forget(position)
            naive.forget(position)
        for position, back in queries:
            # A PLC's latest END lies less than its longest scan back.
            assert dict(block_history.visible(position, now - back)) == naive.visible(position, now - back)


@given(st.lists(st.tuples(stations, st.frozensets(plc_names)), min_size=1, max_size=12))
def test_memory_does_not_grow(pattern: list[tuple[int, frozenset[int]]]) -> None:
    block_history = BlockHistory(HORIZON)

    def size() -> int:
        kept = 0
        for histories in block_history._stations.values():
            kept += len(histories.common) + sum(map(len, histories.own.values()))
            kept += sum(len(earlier) for _, earlier in histories.before.values())
        return kept

    now = 0
    for _ in range(40):
        for station, missed in pattern:
            now += 1
            if len(missed) == POSITIONS:
                block_history.received_by(0, station, now, b"x")
            else:
                block_history.received(station, now, b"x", missed)
        # No station keeps more than its longest scan's worth, twice over for those that joined late.
        assert size() <= STATIONS * (1 + 2 * POSITIONS) * (HORIZON + 2)

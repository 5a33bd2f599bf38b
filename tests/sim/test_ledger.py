from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from bussim.sim.nn.block_history import Ledger

SEATS, STATIONS = 4, 2
HORIZON = 12


class NaiveLedger:
    """Everything that each seat ever received, written down for each of them."""

    def __init__(self) -> None:
        self.received: dict[tuple[int, int], list[tuple[int, bytes]]] = {}

    def add(self, station: int, tick: int, image: bytes, seats: set[int]) -> None:
        for seat in seats:
            self.received.setdefault((seat, station), []).append((tick, image))

    def forget(self, seat: int) -> None:
        for station in range(STATIONS):
            self.received.pop((seat, station), None)

    def visible(self, seat: int, end: int) -> dict[int, bytes]:
        found = {}
        for station in range(STATIONS):
            before = [image for tick, image in self.received.get((seat, station), []) if tick <= end]
            if before:
                found[station] = before[-1]
        return found


seats = st.integers(0, SEATS - 1)
stations = st.integers(0, STATIONS - 1)
operations = st.one_of(
    st.tuples(st.just("heard"), stations, st.just(frozenset[int]())),
    st.tuples(st.just("heard"), stations, st.frozensets(seats, max_size=SEATS - 1)),
    st.tuples(st.just("alone"), stations, st.frozensets(seats, min_size=1, max_size=1)),
    st.tuples(st.just("forget"), st.just(0), st.frozensets(seats, min_size=1, max_size=1)),
)


@settings(max_examples=150, deadline=None)
@given(
    st.lists(
        st.tuples(
            # Two frames of one station never end at one tick.
            st.integers(1, HORIZON),
            operations,
            st.lists(st.tuples(seats, st.integers(0, HORIZON - 1)), max_size=4),
        ),
        max_size=40,
    )
)
def test_every_seat_sees_what_it_received(
    steps: list[tuple[int, tuple[str, int, frozenset[int]], list[tuple[int, int]]]],
) -> None:
    ledger, naive = Ledger(HORIZON), NaiveLedger()
    now = 0
    for number, (step, (what, station, who), questions) in enumerate(steps):
        now += step
        image = b"%d" % number
        if what == "heard":
            ledger.heard(station, now, image, who)
            naive.add(station, now, image, set(range(SEATS)) - who)
        elif what == "alone":
            (seat,) = who
            ledger.heard_alone(station, now, image, seat)
            naive.add(station, now, image, {seat})
        else:
            (seat,) = who
            ledger.forget(seat)
            naive.forget(seat)
        for seat, back in questions:
            # A PLC's latest END lies less than its longest scan back.
            assert dict(ledger.visible(seat, now - back)) == naive.visible(seat, now - back)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(stations, st.frozensets(seats)), min_size=1, max_size=12))
def test_memory_does_not_grow(pattern: list[tuple[int, frozenset[int]]]) -> None:
    ledger = Ledger(HORIZON)

    def size() -> int:
        kept = 0
        for histories in ledger._stations.values():
            kept += len(histories.common) + sum(map(len, histories.apart.values()))
            kept += sum(len(earlier) for _, earlier in histories.before.values())
        return kept

    now = 0
    for _ in range(40):
        for station, missed in pattern:
            now += 1
            if len(missed) == SEATS:
                ledger.heard_alone(station, now, b"x", 0)
            else:
                ledger.heard(station, now, b"x", missed)
        # Nobody keeps more than its longest scan's worth, twice over for those that joined late.
        assert size() <= STATIONS * (1 + 2 * SEATS) * (HORIZON + 2)

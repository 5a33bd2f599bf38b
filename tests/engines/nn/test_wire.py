"""Links with random damage: given whole frames or every character, all nodes end up the same."""

from __future__ import annotations

from collections.abc import Collection

from hypothesis import given
from hypothesis import strategies as st

from bussim.engines.nn.events import ScanEnded
from bussim.engines.nn.frames import DATA
from bussim.engines.nn.master import Master
from tests.engines.wire import CHAR, GAP, MS, TURNAROUND, Node, Tx, Wire, master_node, slave_node

SLAVES, SCANS = 3, 6
#: At most three bits: fewer than it takes for one frame to become another (see test_patterns).
damage = st.tuples(
    st.sampled_from([None, "master", "slave1", "slave2", "slave3"]),  # the node that hears it so; None: all
    st.sets(st.integers(0, 219), min_size=1, max_size=3),
)
turnarounds = st.lists(
    st.sampled_from([TURNAROUND] * 8 + [50 * MS - 22 * CHAR, 46 * MS, 52 * MS, 53 * MS, 75 * MS, 120 * MS]),
    max_size=6,
)


@st.composite
def links(draw: st.DrawFn) -> dict[str, object]:
    return {
        "attempts": draw(st.integers(1, 3)),
        "probe": draw(st.booleans()),
        "on_edge": draw(st.booleans()),
        "damaged": draw(st.dictionaries(st.integers(0, 60), damage, max_size=6)),
        "lost": {k: draw(st.sets(st.integers(0, 8), max_size=3)) for k in range(1, SLAVES + 1)},
        "turnarounds": {k: draw(turnarounds) for k in range(1, SLAVES + 1)},
        "stops": draw(
            st.lists(st.tuples(st.integers(1, SLAVES), st.integers(0, 200), st.integers(1, 200)), max_size=2)
        ),
        "noise": draw(
            st.lists(st.tuples(st.integers(0, 250), st.binary(min_size=1, max_size=8)), max_size=2)
        ),
    }


def run(plan: dict[str, object], *, whole: bool) -> Wire:
    attempts, probe, on_edge = plan["attempts"], bool(plan["probe"]), bool(plan["on_edge"])
    damaged, lost, slow = plan["damaged"], plan["lost"], plan["turnarounds"]
    assert isinstance(attempts, int)
    assert isinstance(damaged, dict)
    assert isinstance(lost, dict)
    assert isinstance(slow, dict)
    nodes = [master_node(SLAVES, attempts=attempts, probe=probe, on_edge=on_edge)]
    nodes += [slave_node(k, *slow[k], on_edge=on_edge) for k in range(1, SLAVES + 1)]
    wire = Wire(*nodes, whole=whole)

    def damage(tx: Tx, node: Node) -> Collection[int]:
        who, bits = damaged.get(wire.sent.index(tx), ("none", ()))
        return bits if who in (None, node.name) else ()

    wire.damage = damage
    for k, node in enumerate(nodes):
        wire.at(0, lambda node=node: node.start(0))
        if k:
            node.vanishes = lost[k].__contains__
    stops = plan["stops"]
    assert isinstance(stops, list)
    for k, at, off in stops:
        node = nodes[k]
        wire.at(at * MS, lambda node=node: node.stop(wire.now) if node.on else None)
        wire.at((at + off) * MS, lambda node=node: None if node.on else node.start(wire.now))
    noise = plan["noise"]
    assert isinstance(noise, list)
    for at, chars in noise:
        wire.inject(at * MS + 7, bytes(char & 127 for char in chars))
    wire.run_scans(SCANS)
    wire.run(wire.now + 22 * CHAR)
    return wire


@given(plan=links())
def test_whole_frames_and_characters_come_to_the_same_on_a_whole_link(plan: dict[str, object]) -> None:
    one, other = run(plan, whole=True), run(plan, whole=False)
    assert [(tx.start, tx.end, tx.chars, tx.cut) for tx in one.sent] == [
        (tx.start, tx.end, tx.chars, tx.cut) for tx in other.sent
    ]
    for node, same in zip(one.nodes, other.nodes, strict=True):
        assert node.events == same.events
        assert node.stored == same.stored
        a, b = node.engine.status, same.engine.status
        assert (a.counts, a.codes, a.flags, a.running) == (b.counts, b.codes, b.flags, b.running)
        assert (a.current, a.longest, a.longest_at) == (b.current, b.longest, b.longest_at)


@given(plan=links())
def test_what_holds_on_every_link(plan: dict[str, object]) -> None:
    wire = run(plan, whole=True)
    master = wire.nodes[0]
    sent = {(tx.frame.station, tx.frame.data) for tx in wire.sent if tx.frame and tx.frame.kind == DATA}
    scans = {event.duration for event in master.events if isinstance(event, ScanEnded)}
    for number, node in enumerate(wire.nodes):
        status = node.engine.status
        # No station counts or flags itself; what is stored was sent by its station.
        assert status.counts[number] == 0
        assert not status.flags[number]
        assert status.codes[number] in ((0, 0x31) if number else (0,))
        assert all((station, data) in sent for _, station, data in node.stored)
        assert number not in {station for _, station, _ in node.stored}
        # A slave measures the master's scans, or nothing.
        assert status.current is None or status.current in scans
        assert status.longest is None or status.longest in scans
    # The master leaves its gap before every frame, and one frame at a time.
    for before, after in zip(master.sent, master.sent[1:], strict=False):
        assert after.start >= before.end + GAP
    engine = master.engine
    assert isinstance(engine, Master)
    for station in range(1, SLAVES + 1):
        errors, failed = engine.station_errors[station], sum(engine.failed_attempts.get(station, {}).values())
        assert errors <= failed
        assert engine.status.counts[station] == errors or (plan["on_edge"] and errors)
        assert engine.status.counts[station] <= errors
        assert (engine.status.codes[station] != 0) == (errors > 0)

"""Links on the scripted wire, what can happen to them, and what their nodes have noted."""

from __future__ import annotations

from collections.abc import Collection

from bussim.engines.nn.events import ScanEnded
from bussim.engines.nn.frames import encode_poll
from bussim.engines.nn.slave import Slave
from tests.engines.wire import (
    CHAR,
    GAP,
    OVERHEAD,
    POLL_TICKS,
    TIMEOUT_UNIT,
    TURNAROUND,
    Node,
    Tx,
    Wire,
    master_node,
    slave_node,
)

#: The scan (and counter) in which the table's disturbances happen.
SCAN = 2
#: Entries of one node: station -> (count, code). A station that is not named has 0 and 0.
Entries = dict[int, tuple[int, int]]
HEADER, BODY = 3, 53  # a bit of the first character, one of the sixth


DATA_TICKS = 22 * CHAR
TIMEOUT = 5 * TIMEOUT_UNIT
#: A slave's slot and a scan's fixed part, in mode 0.
SLOT = GAP + POLL_TICKS + TURNAROUND + DATA_TICKS
FIXED = GAP + DATA_TICKS + OVERHEAD
WATCHDOG = 2 * TIMEOUT + (TURNAROUND + 7_200) + DATA_TICKS


def link(
    slaves: int = 3, *, whole: bool, attempts: int = 1, probe: bool = False, on_edge: bool = False
) -> Wire:
    """A link on which all stations are in RUN from the start."""
    nodes = [master_node(slaves, attempts=attempts, probe=probe, on_edge=on_edge)]
    nodes += [slave_node(station, on_edge=on_edge) for station in range(1, slaves + 1)]
    wire = Wire(*nodes, whole=whole)
    for node in nodes:
        wire.at(0, lambda node=node: node.start(0))
    return wire


def lose(wire: Wire, station: int, *, attempts: Collection[int] = range(99)) -> None:
    """This station's replies of the disturbed scan, by attempt, are lost."""
    heard = [0]

    def vanishes(_reply: int) -> bool:
        if wire.scans != SCAN + 1:
            return False
        heard[0] += 1
        return heard[0] - 1 in attempts

    wire.nodes[station].vanishes = vanishes


def damage(
    wire: Wire,
    kind: int,
    station: int,
    bits: Collection[int],
    *,
    at: Collection[str] | None = None,
    attempts: Collection[int] = range(99),
) -> None:
    """Frames of one kind from (polls: to) a station in the disturbed scan arrive damaged.

    ``at`` names the node that hears them so (None: all), ``attempts`` which of them are meant.
    """
    before, seen = wire.damage, []

    def hook(tx: Tx, node: Node) -> Collection[int]:
        frame = tx.frame
        if frame is None or (frame.kind, frame.station, frame.counter) != (kind, station, SCAN):
            return before(tx, node)
        if tx not in seen:
            seen.append(tx)
        hit = seen.index(tx) in attempts and (at is None or node.name in at)
        return bits if hit else before(tx, node)

    wire.damage = hook


def in_attempt(
    wire: Wire, station: int, after: int, chars: bytes, *, attempts: Collection[int] = range(99)
) -> None:
    """Characters from nowhere, so long after the end of this station's polls in the disturbed scan."""
    poll = encode_poll(station, SCAN).chars
    before = wire.damage

    def hook(tx: Tx, node: Node) -> Collection[int]:
        if tx.chars == poll and tx.frame is not None and tx not in done:
            if len(done) in attempts:
                wire.inject(tx.end + after, chars)
            done.append(tx)
        return before(tx, node)

    done: list[Tx] = []
    wire.damage = hook


def noted(node: Node) -> Entries:
    status = node.engine.status
    return {
        station: (count, code)
        for station, (count, code) in enumerate(zip(status.counts, status.codes, strict=True))
        if count or code
    }


def slave_of(node: Node) -> Slave:
    assert isinstance(node.engine, Slave)
    return node.engine


def scans(wire: Wire) -> list[ScanEnded]:
    return [event for event in wire.nodes[0].events if isinstance(event, ScanEnded)]


def of(node: Node, kind: type) -> list[object]:
    return [event for event in node.events if type(event) is kind]


def silence(node: Node, *, on: bool) -> None:
    """All its replies are lost, or none."""
    node.vanishes = lambda _reply: on

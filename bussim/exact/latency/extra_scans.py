"""How many scans more than one the programs of a latency's way take, for the meter of latencies.

The steps are those of :mod:`bussim.exact.latency.path_search`, counted in scans. Where a signal has several ways the
quickest counts, for the source's and for the target's program separately: earlier it cannot be there.
"""

from __future__ import annotations

from heapq import heappop, heappush
from itertools import count

from bussim.exact.latency.path_search import Hop, Search, Side, State
from bussim.plc.memory import BlockPlace
from bussim.scenario.model import Scenario
from bussim.scenario.signals.paths import Way, net_of, ways
from bussim.scenario.signals.reachability import signals_of

#: Scans of the source's program and of the target's, each for a signal that goes off and one that goes on.
Delays = tuple[tuple[int, int], tuple[int, int]]


def delays_of(scenario: Scenario) -> dict[str, Delays]:
    """Of all entries of ``latency`` between bits, by name; 0 where the texts lead nowhere."""
    return {way.entry.name: _delays(scenario, way) for way in ways(scenario) if not way.word}


def _delays(scenario: Scenario, way: Way) -> Delays:
    if way.bus is None:
        return _through(way, None, 0)
    net = net_of(scenario, way.bus)
    source, target = net.named(way.source.name), net.named(way.target.name)
    own, copy = net.block(source, source), net.block(source, target)
    if own is None or copy is None:
        return (0, 0), (0, 0)
    return _through(way, own, copy.word - own.word)


def _through(way: Way, block: BlockPlace | None, shift: int) -> Delays:
    plcs = (way.source,) if block is None else (way.source, way.target)
    # A scan counts as one: the costs of the steps are numbers of scans then.
    sides = tuple(Side(plc.name, 1, signals_of(plc.program)) for plc in plcs)
    search = Search.along(way, sides, block, shift)
    starts = [search.starts([level]) for level in (0, 1)]
    edges = [search.relevant(each) for each in starts]
    return (
        (_least(search, starts[0], edges[0], 0), _least(search, starts[1], edges[1], 0)),
        (_least(search, starts[0], edges[0], 1), _least(search, starts[1], edges[1], 1)),
    )


def _least(search: Search, starts: list[State], edges: list[Hop], place: int) -> int:
    """The fewest scans that any way spends in one of the two programs."""
    out: dict[State, list[Hop]] = {}
    for edge in edges:
        out.setdefault(edge.start, []).append(edge)
    order = count()  # states themselves have no order
    waiting = [(0, next(order), state) for state in starts]
    passed = set[State]()
    while waiting:
        cost, _, state = heappop(waiting)
        if search.arrives(state):
            return cost
        if state in passed:
            continue
        passed.add(state)
        for edge in out.get(state, ()):
            spent = edge.cost if state.place == place else 0
            heappush(waiting, (cost + spent, next(order), edge.end))
    return 0

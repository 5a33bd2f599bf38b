"""How long programs take to pass a signal on, as far as their texts tell: for the bounds of latencies.

The steps of :mod:`bussim.exact.latency.path_search` in the source's program, over the link's block, and in the
target's program. What any way from source to target waits for that no text tells (a timer, a latch, a
feedback) is a reason why there is no bound, and so is whatever else writes a device on the way: it may
overrule the signal. What must let the signal through is a gate; and every rung that stands in front of the
one whose result it reads costs a scan of its PLC more. All times in ticks.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from bussim.exact.latency.path_search import Hop, Search, Side, State
from bussim.plc.memory import BlockPlace
from bussim.scenario.model import Edge
from bussim.scenario.signals.paths import Way
from bussim.scenario.signals.reachability import Lead, signals_of


@dataclass(frozen=True, slots=True)
class ProgramDelay:
    """``scans``: ticks of the scans that the programs take beyond the one that reads the signal."""

    scans: int = 0
    reasons: tuple[str, ...] = ()
    gates: tuple[str, ...] = ()


def program_delay_of(
    way: Way,
    block: BlockPlace | None,
    shift: int = 0,
    linked: Sequence[Sequence[BlockPlace]] = ((), ()),
) -> ProgramDelay:
    """How the programs of a way pass its bit on; ``block`` is the source's own, None within one PLC.

    The target keeps the block's words ``shift`` addresses further on. ``linked`` are the blocks that the
    link writes in the source's PLC and in the target's.
    """
    plcs = (way.source,) if way.bus is None else (way.source, way.target)
    sides = tuple(
        Side(plc.name, plc.longest_scan, signals_of(plc.program), blocks)
        for plc, blocks in zip(plcs, linked, strict=False)
    )
    search = Search.along(way, sides, block, shift)
    starts = search.starts({Edge.RISING: (1,), Edge.FALLING: (0,)}.get(way.entry.edge, (0, 1)))
    edges = search.relevant(starts)
    if not any(search.arrives(state) for state in starts) and not edges:
        return ProgramDelay(reasons=(_nothing(way),))
    reasons = dict.fromkeys(edge.reason for edge in reversed(edges) if edge.reason)
    letters = {edge.end.point.key.letter for edge in edges if edge.end.point.key is not None}
    for side in sides:
        for at in side.signals.indexed:
            if any(operand.index and operand.letter in letters for operand in at.operands):
                reasons[f"an index register says where {at.name} at line {at.line} writes ({side.plc})"] = (
                    None
                )
    reasons |= dict.fromkeys(_overruled(search, edges))
    longest = _longest(edges)
    if longest is None:
        reasons[_loop(edges)] = None
    gates = dict.fromkeys(gate for edge in reversed(edges) for gate in edge.gates)
    return ProgramDelay(longest or 0, tuple(reasons), tuple(gates))


def _overruled(search: Search, edges: list[Hop]) -> Iterator[str]:
    """What else writes the devices on the way, so that they need not follow the signal.

    What is kept until something else changes it (SET) says so itself: of it the others are not told.
    """
    read: dict[State, set[bool]] = {}
    for edge in reversed(edges):
        side, (key, number, _) = search.sides[edge.end.place], edge.end.point
        start = edge.start.point
        if edge.start.place == 0 and start.key == search.source and start.number >= 0 and edge.end.place == 0:
            read.setdefault(edge.end, set()).add(edge.cost > 0)
        if key is None or edge.reason:
            continue
        for at in side.signals.written(key):
            if at.number != number:
                yield f"{at.name} at line {at.line} writes {key} too ({side.plc})"
        if number >= 0 and any(block.holds(key.device) for block in side.linked):
            yield f"the link writes {key} too ({side.plc})"
    # A change of the source is one that an END leaves; between two that write it, it may have another level.
    if any(len(costs) > 1 for costs in read.values()):
        source = search.source
        lines = [f"{at.name} at line {at.line}" for at in search.sides[0].signals.written(source)]
        yield f"{source} is read between those that write it: {', '.join(lines)} ({search.sides[0].plc})"


def _nothing(way: Way) -> str:
    """Why no way was found that takes a known time."""
    source, target = f"{way.entry.source} of {way.source.name}", f"{way.entry.target} of {way.target.name}"
    match way.finding.lead:
        case Lead.ROUND:
            return f"{source} leads to {target} over other stations only"
        case Lead.UNKNOWN:
            return (
                f"no text tells how {source} leads to {target}: ports, jumps, flags or index registers might"
            )
    why = f": {way.finding.why}" if way.finding.why else ""
    if way.bus is None:
        ends = f"from {way.entry.source} to {way.entry.target}"
        return f"nothing in the program of {way.source.name} leads {ends}{why}"
    return f"nothing leads from {source} over its block to {target}{why}"


def _longest(edges: list[Hop]) -> int | None:
    """The most that a way costs; None if a way comes back to where it was."""
    out: dict[State, list[Hop]] = {}
    missing: dict[State, int] = {}
    for edge in edges:
        out.setdefault(edge.start, []).append(edge)
        missing[edge.end] = missing.get(edge.end, 0) + 1
    cost = dict.fromkeys((*out, *missing), 0)
    ready = [state for state in cost if not missing.get(state)]
    passed, most = 0, 0
    while ready:
        state = ready.pop()
        passed += 1
        most = max(most, cost[state])
        for edge in out.get(state, ()):
            cost[edge.end] = max(cost[edge.end], cost[state] + edge.cost)
            missing[edge.end] -= 1
            if not missing[edge.end]:
                ready.append(edge.end)
    return most if passed == len(cost) else None


def _loop(edges: list[Hop]) -> str:
    """Which device comes back to itself."""
    out: dict[State, list[State]] = {}
    for edge in edges:
        out.setdefault(edge.start, []).append(edge.end)
    for state in out:
        if state.point.key is None:
            continue
        seen, waiting = set[State](), list(out[state])
        while waiting:
            each = waiting.pop()
            if each == state:
                return f"{state.point.key} acts on itself: it may hold its level"
            if each not in seen:
                seen.add(each)
                waiting += out.get(each, [])
    return "what is on the way acts on itself"

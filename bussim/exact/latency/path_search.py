"""The ways of a signal through the programs of two PLCs and over the link's block between them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from bussim.plc.memory import BlockPlace, parse_device
from bussim.scenario.signals.paths import Way
from bussim.scenario.signals.program_signals import Key, Point, Signals, Step


class State(NamedTuple):
    """A point in one of the two programs (0: the source's, 1: the target's, or the only one)."""

    place: int
    point: Point


@dataclass(slots=True)
class Side:
    """One PLC: its longest scan in ticks, its program, and the blocks that the link writes in it."""

    plc: str
    scan: int
    signals: Signals
    linked: Sequence[BlockPlace] = ()


@dataclass(slots=True)
class Hop:
    """From one state to the next: what it costs in ticks, why none can tell, what must let it through."""

    start: State
    end: State
    cost: int = 0
    reason: str = ""
    gates: tuple[str, ...] = ()


@dataclass(slots=True)
class Search:
    """All that a signal can do on its way from ``source`` to ``target``."""

    way: Way
    sides: tuple[Side, ...]
    block: BlockPlace | None
    shift: int
    source: Key
    target: Key

    @classmethod
    def along(cls, way: Way, sides: tuple[Side, ...], block: BlockPlace | None, shift: int) -> Search:
        """From the way's source to its target, through the programs of ``sides``."""
        source, target = (
            Key.of(parse_device(name, observed=True)) for name in (way.entry.source, way.entry.target)
        )
        return cls(way, sides, block, shift, source, target)

    def starts(self, levels: Sequence[int]) -> list[State]:
        """Where a change of the source to one of these levels begins: at its writers, or beside a program."""
        written = [at.number for at in self.sides[0].signals.written(self.source)]
        if not written or self.way.entry.source in self.way.source.sources:
            written.append(-1)
        return [State(0, Point(self.source, number, level)) for number in written for level in levels]

    def next_hops(self, state: State) -> Iterator[Hop]:
        """Where it can go from a state."""
        side, (key, number, level) = self.sides[state.place], state.point
        if state.place == 0 and key is not None and self._shared(key):
            # The other PLC has it before its scan begins.
            there = key._replace(address=key.address + self.shift) if key.word else key
            yield Hop(state, State(1, Point(there, -1, level)))
        # An END tells what something else than the program has left: the program reads it in the scan after.
        waits = state.place == 0 and key == self.source and number < 0 and key.letter != "X"
        for step in side.signals.steps(state.point):
            # What comes back to the source is a change of its own.
            if state.place or step.to.key != self.source:
                yield self._hop(state, side, step, waits=waits)

    def _hop(self, state: State, side: Side, step: Step, *, waits: bool) -> Hop:
        return Hop(
            state,
            State(state.place, step.to),
            side.scan * (step.later + waits),
            f"{step.reason} ({side.plc})" if step.reason else "",
            tuple(f"{gate} ({side.plc})" for gate in step.gates),
        )

    def _shared(self, key: Key) -> bool:
        return self.block is not None and key.word is (key.letter == "D") and self.block.holds(key.device)

    def arrives(self, state: State) -> bool:
        """Whether it is at its target."""
        return state.place == len(self.sides) - 1 and state.point.key == self.target

    def relevant(self, starts: list[State]) -> list[Hop]:
        """The edges that lie on a way from a start to the target."""
        seen, waiting = set(starts), list(starts)
        into: dict[State, list[Hop]] = {}
        while waiting:
            state = waiting.pop()
            for edge in self.next_hops(state):
                into.setdefault(edge.end, []).append(edge)
                if edge.end not in seen:
                    seen.add(edge.end)
                    waiting.append(edge.end)
        useful = [state for state in seen if self.arrives(state)]
        kept, found = set(useful), []
        while useful:
            for edge in into.get(useful.pop(), ()):
                found.append(edge)
                if edge.start not in kept:
                    kept.add(edge.start)
                    useful.append(edge.start)
        return found

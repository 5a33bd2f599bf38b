"""The waveform as level changes on lanes, in microseconds.

Each bus is a lane: what a receiver on it sees, damaged bits inverted, and low where any of several
transmitters pulls it low (a 0 wins, assumed). Each transmitter is a lane: what its own driver puts
out, free of noise and of others, so that the difference to the bus's lane is what the wire did to
it. A receiver with damage of its own (noise in one receiver) is a lane ``NAME_rx``.
Edges are rounded to the nearest microsecond one by one, so that errors do not add up.
"""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from bussim.export.heard import lows_of
from bussim.export.source import Selection, Survey, in_order
from bussim.trace import FrameRecord
from bussim.units import TICKS_PER_US

# What neither a VCD nor sigrok's command line takes in the name of a channel.
_UNFIT = re.compile(r"[\s,:=@\x00-\x1f\x7f]+")


class Lane(NamedTuple):
    """One line of the picture. ``scope`` is its bus, ``name`` unique in all of the file."""

    scope: str
    name: str


class Change(NamedTuple):
    """A lane has a new level from ``us`` on."""

    us: int
    lane: int
    level: int


def microseconds(ticks: int) -> int:
    """Ticks as the nearest whole number of microseconds, a half upwards."""
    return (2 * ticks + TICKS_PER_US) // (2 * TICKS_PER_US)


class Lanes:
    """The lanes of a selection, and their changes in order. All lanes begin high (idle)."""

    def __init__(self, selection: Selection, survey: Survey) -> None:
        self._selection = selection
        self._lateness = survey.lateness
        #: All lanes: each bus, then its transmitters in cable order, then its receivers.
        self.lanes: list[Lane] = []
        self._bus: dict[str, int] = {}
        self._sender: dict[tuple[str, str], int] = {}
        self._receivers: dict[str, list[tuple[str, int]]] = {}
        taken: set[str] = set()
        several = len(survey.buses) > 1
        for bus in survey.buses.values():
            self._bus[bus.name] = self._add(bus.name, bus.name, taken)
            for node in bus.nodes:
                name = f"{bus.name}/{node}" if several else node
                self._sender[bus.name, node] = self._add(bus.name, name, taken)
            self._receivers[bus.name] = []
            for node in bus.receivers:
                name = f"{bus.name}/{node}_rx" if several else f"{node}_rx"
                self._receivers[bus.name].append((node, self._add(bus.name, name, taken)))
        #: First and last microsecond of the picture; behind the last frame the line is seen idle.
        self.begin = 0 if selection.start is None else microseconds(selection.start)
        idle = max(microseconds(bus.timing.characters(4)) for bus in survey.buses.values())
        self.end = microseconds(survey.end) + idle
        if selection.stop is not None:
            self.end = min(self.end, microseconds(selection.stop))

    def name_of(self, bus: str) -> str:
        """The name of a bus's own lane."""
        return self.lanes[self._bus[bus]].name

    def _add(self, bus: str, wanted: str, taken: set[str]) -> int:
        name = stem = _UNFIT.sub("_", wanted) or "_"
        number = 1
        while name in taken:
            number += 1
            name = f"{stem}-{number}"
        taken.add(name)
        self.lanes.append(Lane(bus, name))
        return len(self.lanes) - 1

    def changes(self) -> Iterator[Change]:
        """Every change of level inside the picture, by time; what is low as it begins, changes then."""
        low = [0] * len(self.lanes)  # how many pull each lane low
        pending: list[tuple[int, ...]] = []
        for frame in in_order(self._selection.frames(), self._lateness):
            # No later frame begins before this one: what lies before it is settled.
            begun = microseconds(frame.start)
            if pending and pending[0][0] < begun:
                pending.sort()
                settled = bisect_left(pending, (begun,))
                yield from self._levels(pending[:settled], low)
                del pending[:settled]
            pending += self._events(frame)
        pending.sort()
        yield from self._levels(pending, low)

    def _events(self, frame: FrameRecord) -> Iterator[tuple[int, ...]]:
        """Who begins (+1) and ends (-1) to pull what low, and when."""
        clean = lows_of(frame, ())
        sender = self._sender[frame.bus, frame.sender]
        damaged = lows_of(frame, frame.damaged_bits) if frame.damaged_bits else clean
        lanes = [(sender, clean), (self._bus[frame.bus], damaged)]
        for node, lane in self._receivers[frame.bus]:
            own = frame.damaged_at.get(node)
            # A bit inverted on the wire and again in the receiver is right once more.
            seen = lows_of(frame, sorted(set(frame.damaged_bits) ^ set(own))) if own else damaged
            if node != frame.sender:  # deaf while its own driver is on
                lanes.append((lane, seen))
        begin, end = self.begin, self.end
        for lane, lows in lanes:
            for first, last in lows:
                since, until = max(microseconds(first), begin), min(microseconds(last), end)
                if since < until:
                    yield since, lane, 1
                    yield until, lane, -1

    def _levels(self, events: Sequence[tuple[int, ...]], low: list[int]) -> Iterator[Change]:
        """The changes of level that events make which are sorted; at one time -1 comes before +1."""
        at, count = 0, len(events)
        while at < count:
            us, lane, step = events[at]
            at += 1
            before = low[lane]
            now = before + step
            while at < count and events[at][0] == us and events[at][1] == lane:
                now += events[at][2]
                at += 1
            low[lane] = now
            if (before > 0) is not (now > 0):
                yield Change(us, lane, 0 if now > 0 else 1)


def by_scope(lanes: Iterable[Lane]) -> dict[str, list[int]]:
    """The numbers of the lanes of each bus."""
    found: dict[str, list[int]] = {}
    for number, lane in enumerate(lanes):
        found.setdefault(lane.scope, []).append(number)
    return found

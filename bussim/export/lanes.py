"""The waveform as level changes on lanes, in microseconds.

Each bus is a lane: what a receiver on it sees, damaged bits inverted, and where several drivers are on what
its ``contention`` makes of them. Each transmitter is a lane: what its own driver puts
out, free of noise and of others, so that the difference to the bus's lane is what the wire did to
it. A receiver with damage of its own (noise in one receiver) is a lane ``NAME_rx``.
Edges are rounded to the nearest microsecond one by one, so that errors do not add up.
"""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import NamedTuple

from bussim.export.selection import Job, Selection, Survey, Written, in_order
from bussim.line.contention import Disputed, Driver, line_lows
from bussim.line.wave import Interval, clip
from bussim.trace.levels import driver_of
from bussim.trace.records import FrameRecord
from bussim.units import TICKS_PER_US

# What neither a VCD nor sigrok's command line takes in the name of a channel.
_UNFIT = re.compile(r"[\s,:=@\x00-\x1f\x7f]+")


class Lane(NamedTuple):
    """One line of the picture. ``scope`` is its bus, ``name`` unique in all of the file."""

    scope: str
    name: str


#: A lane has a new level: microsecond, number of the lane, level. A plain tuple: there are hundreds a frame.
Change = tuple[int, int, int]


def unspaced(name: str) -> str:
    """A name without what neither format takes in one: white space and some punctuation."""
    return _UNFIT.sub("_", name) or "_"


def microseconds(ticks: int) -> int:
    """Ticks as the nearest whole number of microseconds, a half upwards."""
    return (2 * ticks + TICKS_PER_US) // (2 * TICKS_PER_US)


class Lanes:
    """The lanes of a selection, and their changes in order. All lanes begin high (idle)."""

    def __init__(self, selection: Selection, survey: Survey) -> None:
        self._selection = selection
        self._survey = survey
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
        # A decoder needs the falling edge of the first start bit: where a frame begins with the picture, the
        # line is idle before it, and all is later by that.
        self._later = idle if survey.start is not None and microseconds(survey.start) == self.begin else 0
        self.end = microseconds(survey.end) + idle
        if selection.stop is not None:
            self.end = min(self.end, microseconds(selection.stop))
        self.end += self._later

    def decoders(self) -> Iterator[str]:
        """What PulseView needs to decode the lanes, as lines for the user."""
        for bus in self._survey.buses.values():
            lane = self.lanes[self._bus[bus.name]].name
            yield f"PulseView: decoder UART, lane {lane}: {bus.timing.baud} {bus.timing.format}"
            if "modbus-rtu" in bus.protocols:
                yield (
                    f"PulseView: for Modbus on {lane} give UART the slave's lane as RX and the "
                    "master's as TX, and stack Modbus on it"
                )

    def _add(self, bus: str, wanted: str, taken: set[str]) -> int:
        name = stem = unspaced(wanted)
        number = 1
        while name in taken:
            number += 1
            name = f"{stem}-{number}"
        taken.add(name)
        self.lanes.append(Lane(bus, name))
        return len(self.lanes) - 1

    def changes(self) -> Iterator[Change]:
        """Every change of levels inside the picture, by time; what is low as it begins, changes then."""
        low = [0] * len(self.lanes)
        pending: list[_Event] = []
        driven = {name: _Driven(bus.disputed) for name, bus in self._survey.buses.items()}
        for frame in in_order(self._selection.frames(), self._survey.lateness):
            # No later frame begins before this one: what lies before it is settled.
            for each in driven.values():
                for lanes, lows in each.up_to(frame.start):
                    pending += self._events(lanes, lows)
            pending.sort()
            settled = bisect_left(pending, (microseconds(frame.start) + self._later,))
            if settled:
                yield from _changes(low, pending[:settled])
                del pending[:settled]
            driven[frame.bus].frames.append(list(self._drivers(frame)))
        for each in driven.values():
            for lanes, lows in each.up_to(None):
                pending += self._events(lanes, lows)
        pending.sort()
        yield from _changes(low, pending)

    def _drivers(self, frame: FrameRecord) -> Iterator[tuple[tuple[int, ...], Driver]]:
        sender = self._sender[frame.bus, frame.sender]
        alike = [self._bus[frame.bus]]
        for node, lane in self._receivers[frame.bus]:
            own = frame.damaged_at.get(node)
            if node == frame.sender:
                continue  # it receives nothing while its own driver is on
            if own:
                # A bit inverted on the wire and again in the receiver is right once more.
                yield (lane,), driver_of(frame, sorted(set(frame.damaged_bits) ^ set(own)))
            else:
                alike.append(lane)
        clean = driver_of(frame, ())
        if frame.damaged_bits:
            yield (sender,), clean
            yield tuple(alike), driver_of(frame, frame.damaged_bits)
        else:
            yield (sender, *alike), clean

    def _events(self, lanes: tuple[int, ...], lows: Sequence[Interval]) -> Iterator[_Event]:
        """When lanes begin (+1) and end (-1) to be pulled low, inside the picture."""
        later, half, whole = self._later, TICKS_PER_US // 2, TICKS_PER_US
        begin, end = self.begin, self.end - later
        for first, last in lows:
            since, until = (first + half) // whole, (last + half) // whole
            if since < begin or until > end:
                since, until = max(since, begin), min(until, end)
            if since < until:
                yield since + later, 1, lanes
                yield until + later, -1, lanes


class _Driven:
    """The drivers of one bus that are on: of each frame, its driver as some lanes have it."""

    def __init__(self, disputed: Disputed) -> None:
        self._disputed = disputed
        self._at = 0
        self.frames: list[list[tuple[tuple[int, ...], Driver]]] = []

    def up_to(self, tick: int | None) -> Iterator[tuple[tuple[int, ...], Sequence[Interval]]]:
        """Where lanes are low from the last such tick up to this one (None: to the end)."""
        frames, since = self.frames, self._at
        if len(frames) == 1:
            for lanes, driver in frames[0]:
                whole = since <= driver.since and (tick is None or driver.until <= tick)
                yield lanes, driver.lows if whole else clip(driver.lows, since, tick)
        else:
            drivers: dict[int, list[Driver]] = {}
            for frame in frames:
                for lanes, driver in frame:
                    for lane in lanes:
                        drivers.setdefault(lane, []).append(driver)
            for lane, several in drivers.items():
                yield (lane,), clip(line_lows(several, self._disputed), since, tick)
        if tick is not None:
            self._at = tick
            frames[:] = [frame for frame in frames if frame[0][1].until > tick]


#: A time in microseconds, +1 or -1, and the lanes that are pulled low or let go.
_Event = tuple[int, int, tuple[int, ...]]


def _changes(low: list[int], events: Iterable[_Event]) -> Iterator[Change]:
    """The changes of level that sorted events make; ``low`` counts the drivers that pull each lane low."""
    for us, at_once in groupby(events, itemgetter(0)):
        before: dict[int, int] = {}
        for _, step, lanes in at_once:
            for lane in lanes:
                before.setdefault(lane, low[lane])
                low[lane] += step
        for lane, was in before.items():
            if (was > 0) is not (low[lane] > 0):
                yield us, lane, 0 if low[lane] else 1


def by_scope(lanes: Iterable[Lane]) -> dict[str, list[int]]:
    """The numbers of the lanes of each bus."""
    found: dict[str, list[int]] = {}
    for number, lane in enumerate(lanes):
        found.setdefault(lane.scope, []).append(number)
    return found


def write_lanes(path: Path, job: Job, write: Callable[[Path, Lanes, str], None]) -> Written:
    """Write the lanes of a job in a format that has waveforms; ``write`` gets the job's comment."""
    lanes = Lanes(job.selection, job.survey)
    write(path, lanes, job.comment)
    return Written(job.survey.frames, tuple(job.survey.buses), tuple(lanes.decoders()))

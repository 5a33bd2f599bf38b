"""What is exported: some buses of a trace, some time of it, and what there is in that."""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

from bussim.errors import UsageError
from bussim.line.characters import LineTiming
from bussim.line.contention import Disputed
from bussim.trace.file import Trace
from bussim.trace.levels import disputed_of, timing_of
from bussim.trace.records import FrameRecord
from bussim.units import format_time, seconds
from bussim.words.values import suggest


@dataclass(frozen=True, slots=True)
class Selection:
    """A trace, the bus (None: all) and the window ``start <= tick < stop`` (None: no limit)."""

    trace: Trace
    bus: str | None = None
    start: int | None = None
    stop: int | None = None

    def __post_init__(self) -> None:
        known = [bus.name for bus in self.trace.header.buses]
        if self.bus is not None and self.bus not in known:
            raise UsageError(f"the trace has no bus {self.bus!r}; {suggest(self.bus, known)}")

    def frames(self) -> Iterator[FrameRecord]:
        """The frames that touch the window, in the order of the trace."""
        return self.trace.of(FrameRecord, bus=self.bus, start=self.start, stop=self.stop)

    @property
    def buses(self) -> list[str]:
        """Names of the buses that are exported, as the trace's header has them."""
        return [bus.name for bus in self.trace.header.buses if self.bus in (None, bus.name)]


@dataclass(frozen=True)
class Job:
    """What a writer of a format needs. ``encapsulation`` is how pcapng wraps Modbus RTU: serial or udp."""

    selection: Selection
    comment: str = ""
    encapsulation: str = "serial"

    @cached_property
    def survey(self) -> Survey:
        """What a first reading of the frames finds; raises as :func:`survey`."""
        return survey(self.selection)


class Written(NamedTuple):
    """What a writer has written: how many frames (Perfetto: events) of which buses, and how to open it."""

    items: int
    buses: tuple[str, ...]
    hints: tuple[str, ...] = ()


@dataclass(slots=True)
class BusSurvey:
    """One bus: its rate and format, the nodes on it (in cable order), and its protocols.

    ``stations`` are station numbers by node, ``receivers`` the nodes in whose receiver alone something
    was damaged, ``disputed`` how bits were decided on which drivers disagreed.
    """

    name: str
    timing: LineTiming
    nodes: list[str]
    stations: dict[str, int]
    receivers: list[str] = field(default_factory=list)
    protocols: list[str] = field(default_factory=list)
    disputed: Disputed = None


@dataclass(slots=True)
class Survey:
    """What a first reading of the frames finds.

    ``lateness`` is how many ticks a frame's start may lie before the latest start of the frames before it:
    a trace has frames in the order in which they ended.
    """

    buses: dict[str, BusSurvey]
    frames: int = 0
    start: int | None = None
    end: int = 0
    lateness: int = 0


def survey(selection: Selection) -> Survey:
    """Read the frames once. Raises UsageError where there is none, or a rate or format is nonsense."""
    buses: dict[str, BusSurvey] = {}
    for bus in selection.trace.header.buses:
        if bus.name in selection.buses:
            timing = timing_of(bus.baud, bus.format, 0.0)
            disputed = disputed_of(selection.trace.header, bus.name)
            buses[bus.name] = BusSurvey(
                bus.name, timing, list(bus.nodes), dict(bus.stations), disputed=disputed
            )
    found = Survey(buses)
    newest = 0
    for frame in selection.frames():
        timing = timing_of(frame.baud, frame.format, frame.ppm)
        seen = buses.get(frame.bus)
        if seen is None:
            seen = buses[frame.bus] = BusSurvey(frame.bus, timing, [], {})
        if frame.sender not in seen.nodes:
            seen.nodes.append(frame.sender)
        if frame.protocol not in seen.protocols:
            seen.protocols.append(frame.protocol)
        if frame.damaged_at:
            seen.receivers += [name for name in frame.damaged_at if name not in seen.receivers]
        found.start = frame.start if found.start is None else min(found.start, frame.start)
        found.end = max(found.end, frame.end)
        found.frames += 1
        newest = max(newest, frame.start)
        found.lateness = max(found.lateness, newest - frame.start)
    if not found.frames:
        raise UsageError(nothing_there(selection, "no frame"))
    return found


def nothing_there(selection: Selection, what: str) -> str:
    """The message for an empty selection; names what the trace has instead."""
    where = f" on the bus {selection.bus!r}" if selection.bus is not None else ""
    if selection.start is None and selection.stop is None:
        return f"the trace has {what}{where}; there is nothing to export"
    since = format_time(selection.start or 0)
    until = "the end" if selection.stop is None else format_time(selection.stop)
    begin, end = None, 0
    for frame in selection.trace.of(FrameRecord, bus=selection.bus):
        begin, end = frame.start if begin is None else min(begin, frame.start), max(end, frame.end)
    there = (
        "and no frame at another time"
        if begin is None
        else f"its frames are between {seconds(begin):.3f} s and {seconds(end):.3f} s"
    )
    return f"the trace has {what}{where} from {since} to {until}; {there}"


def in_order(frames: Iterable[FrameRecord], lateness: int) -> Iterator[FrameRecord]:
    """Frames by their starts; those with the same start in the order of the trace."""
    heap: list[tuple[int, int, FrameRecord]] = []
    newest = 0
    for number, frame in enumerate(frames):
        heapq.heappush(heap, (frame.start, number, frame))
        newest = max(newest, frame.start)
        while heap and heap[0][0] < newest - lateness:
            yield heapq.heappop(heap)[2]
    while heap:
        yield heapq.heappop(heap)[2]

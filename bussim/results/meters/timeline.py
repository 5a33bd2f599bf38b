"""What a run looked like over its time, in bounded memory: scan times and stations in error."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Any, NamedTuple

from bussim.trace.records import NoteRecord
from bussim.units import TICKS_PER_MS

#: Most cells of a timeline: more than a plot has columns.
MOST_CELLS = 2048
_FIRST_WIDTH = 10 * TICKS_PER_MS

#: Most spans that are kept of one bus before neighbours are joined.
MOST_SPANS = 512


class Cell(NamedTuple):
    """The link scans that began within one stretch of a run. Times in ticks."""

    start: int  # of the first of them
    scans: int
    total: int
    shortest: int
    longest: int


class Timeline:
    """Scan times over the run, in at most :data:`MOST_CELLS` cells of equal width.

    When the run outgrows the cells, their width doubles and neighbours are joined.
    """

    __slots__ = ("_cells", "_width")

    def __init__(self) -> None:
        self._width = _FIRST_WIDTH
        self._cells: dict[int, Cell] = {}

    def add(self, start: int, duration: int) -> None:
        """Take in a scan; starts never decrease."""
        place = start // self._width
        while place >= MOST_CELLS:
            self._double()
            place = start // self._width
        self._put(place, Cell(start, 1, duration, duration, duration))

    @property
    def cells(self) -> list[Cell]:
        """The cells that have scans, in time order."""
        return list(self._cells.values())

    def _put(self, place: int, new: Cell) -> None:
        old = self._cells.get(place)
        if old is not None:
            new = Cell(
                old.start,
                old.scans + new.scans,
                old.total + new.total,
                min(old.shortest, new.shortest),
                max(old.longest, new.longest),
            )
        self._cells[place] = new

    def _double(self) -> None:
        self._width *= 2
        cells, self._cells = self._cells, {}
        for place, cell in cells.items():
            self._put(place // 2, cell)


class Span(NamedTuple):
    """When something lasted, in ticks; ``end`` is None for what lasts beyond the run's end."""

    start: int
    end: int | None


class Spans:
    """When each of several things (stations in error) was on; at most :data:`MOST_SPANS` spans.

    Beyond that, spans of one thing that are less than :attr:`joined_within` ticks apart become one.
    """

    __slots__ = ("_on", "_spans", "joined_within")

    def __init__(self) -> None:
        self.joined_within = 0
        self._on: dict[int, int] = {}
        self._spans: dict[int, list[Span]] = {}

    def on(self, what: int, tick: int) -> None:
        """It begins; nothing happens if it is on already."""
        self._on.setdefault(what, tick)

    def off(self, what: int, tick: int) -> None:
        """It ends; nothing happens if it is not on."""
        start = self._on.pop(what, None)
        if start is None:
            return
        self._append(self._spans.setdefault(what, []), Span(start, tick))
        while sum(map(len, self._spans.values())) > MOST_SPANS:
            self._thin()

    def all_off(self, tick: int) -> None:
        """Everything that is on ends."""
        for what in list(self._on):
            self.off(what, tick)

    def all(self) -> dict[int, list[Span]]:
        """Every thing's spans in time order, things in ascending order."""
        spans = {what: list(past) for what, past in self._spans.items()}
        for what, start in self._on.items():
            spans.setdefault(what, []).append(Span(start, None))
        return dict(sorted(spans.items()))

    def _append(self, past: list[Span], new: Span) -> None:
        last = past[-1] if past else None
        if last is not None and last.end is not None and new.start - last.end < self.joined_within:
            past[-1] = Span(last.start, new.end)
        else:
            past.append(new)

    def _thin(self) -> None:
        self.joined_within = 2 * self.joined_within or TICKS_PER_MS
        for what, past in self._spans.items():
            self._spans[what] = []
            for span in past:
                self._append(self._spans[what], span)


def fault_spans(notes: Iterable[NoteRecord], places: Collection[str]) -> list[tuple[str, Span]]:
    """Each fault's words and when it acted, from its notes "fault" and "fault_over" of one name.

    A note that tells its PLC or bus counts only there, any other one everywhere.
    """
    spans: list[tuple[str, Span]] = []
    acting: dict[str, int] = {}
    for note in notes:
        place = note.detail.get("node", note.detail.get("bus"))
        if note.kind not in ("fault", "fault_over") or (place is not None and place not in places):
            continue
        if note.kind == "fault":
            # Of a fault that hits a number of frames only its beginning is known.
            counted = "count" in note.detail
            if not counted:
                acting[note.where] = len(spans)
            spans.append((note.text, Span(note.tick, note.tick if counted else None)))
        elif note.where in acting:
            number = acting.pop(note.where)
            text, span = spans[number]
            spans[number] = (text, Span(span.start, note.tick))
    return spans


def cells_to_json(cells: list[Cell]) -> list[list[int]]:
    """Cells as plain lists of numbers, in the order of their fields."""
    return [list(cell) for cell in cells]


def cells_from_json(data: list[list[int]]) -> list[Cell]:
    """The cells of :func:`cells_to_json`. Raises TypeError or ValueError for anything else."""
    return [Cell(*map(int, numbers)) for numbers in data]


def spans_to_json(spans: Mapping[int, list[Span]]) -> dict[str, Any]:
    """Spans by number as plain data."""
    return {str(what): [list(span) for span in past] for what, past in spans.items()}


def spans_from_json(data: Mapping[str, Any]) -> dict[int, list[Span]]:
    """The spans of :func:`spans_to_json`. Raises TypeError or ValueError for anything else."""
    return {
        int(what): [Span(int(start), None if end is None else int(end)) for start, end in past]
        for what, past in data.items()
    }

"""Scan times and stations in error over the time of a run, in bounded memory."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import TYPE_CHECKING, NamedTuple

from bussim.trace.records import NoteRecord
from bussim.units import TICKS_PER_MS, seconds

if TYPE_CHECKING:
    import numpy as np

#: Most cells of a timeline: more than a plot has columns.
MOST_CELLS = 2048
_FIRST_WIDTH = 10 * TICKS_PER_MS

#: Most spans that are kept of one bus before neighbours are joined.
MOST_SPANS = 512


class Cell(NamedTuple):
    """The link scans that began within one part of a run. Times in ticks."""

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

    def add(self, starts: np.ndarray, durations: np.ndarray) -> None:
        """Take in scans; starts never decrease."""
        import numpy as np

        if not len(starts):
            return
        while int(starts[-1]) // self._width >= MOST_CELLS:
            self._double()
        columns = starts // self._width
        first = np.flatnonzero(columns[1:] != columns[:-1]) + 1
        first = np.concatenate(([0], first))
        cells = zip(
            starts[first].tolist(),
            np.diff(first, append=len(columns)).tolist(),
            *(how.reduceat(durations, first).tolist() for how in (np.add, np.minimum, np.maximum)),
            strict=True,
        )
        for column, cell in zip(columns[first].tolist(), cells, strict=True):
            self._put(column, Cell(*cell))

    @property
    def cells(self) -> list[Cell]:
        """The cells that have scans, in time order."""
        return list(self._cells.values())

    def _put(self, column: int, new: Cell) -> None:
        old = self._cells.get(column)
        if old is not None:
            new = Cell(
                old.start,
                old.scans + new.scans,
                old.total + new.total,
                min(old.shortest, new.shortest),
                max(old.longest, new.longest),
            )
        self._cells[column] = new

    def _double(self) -> None:
        self._width *= 2
        cells, self._cells = self._cells, {}
        for column, cell in cells.items():
            self._put(column // 2, cell)


class Span(NamedTuple):
    """A time from ``start`` to ``end`` in ticks; ``end`` is None where it lasts beyond the run's end."""

    start: int
    end: int | None


class Spans:
    """When each of several flags (of stations in error) was on; at most :data:`MOST_SPANS` spans.

    Beyond that, spans of one flag that are less than :attr:`joined_within` ticks apart become one.
    """

    __slots__ = ("_on", "_spans", "joined_within")

    def __init__(self) -> None:
        self.joined_within = 0
        self._on: dict[int, int] = {}
        self._spans: dict[int, list[Span]] = {}

    def on(self, what: int, tick: int) -> None:
        """Switch one on; no change if it is on already."""
        self._on.setdefault(what, tick)

    def off(self, what: int, tick: int) -> None:
        """Switch one off; no change if it is off."""
        start = self._on.pop(what, None)
        if start is None:
            return
        self._append(self._spans.setdefault(what, []), Span(start, tick))
        while sum(map(len, self._spans.values())) > MOST_SPANS:
            self._join()

    def all_off(self, tick: int) -> None:
        """Switch off all that are on."""
        for what in list(self._on):
            self.off(what, tick)

    def all(self) -> dict[int, list[Span]]:
        """The spans of each in time order, by ascending numbers."""
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

    def _join(self) -> None:
        self.joined_within = 2 * self.joined_within or TICKS_PER_MS
        for what, past in self._spans.items():
            self._spans[what] = []
            for span in past:
                self._append(self._spans[what], span)


def fault_spans(notes: Iterable[NoteRecord], subjects: Collection[str]) -> list[tuple[str, Span]]:
    """Each fault's text and when it acted, from its notes "fault" and "fault_over" of one name.

    Of notes that name a PLC or bus only those count that name one of ``subjects``.
    """
    spans: list[tuple[str, Span]] = []
    acting: dict[str, int] = {}
    for note in notes:
        subject = note.detail.get("node", note.detail.get("bus"))
        if note.kind not in ("fault", "fault_over") or (subject is not None and subject not in subjects):
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


def time_on(spans: Iterable[Span], duration: int) -> float:
    """How long all of the spans lasted within a run of ``duration`` ticks, in seconds."""
    return seconds(sum((duration if span.end is None else span.end) - span.start for span in spans))

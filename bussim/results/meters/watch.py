"""Chosen devices over time, as a monitor of a programming tool shows them. Times in ticks."""

from bisect import bisect_right
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from bussim.results.meters.timeline import Spans
from bussim.results.numbers import s
from bussim.trace.blocks import RecordBlock
from bussim.trace.records import IN_RUN, LEFT_RUN, WITHOUT_SUPPLY, DeviceValueRecord, NoteRecord, Record


@dataclass(slots=True)
class Watched:
    """One device of ``width`` bits, with its comment, "" for none.

    ``ticks`` and ``values`` are its changes; 0 before the first.
    """

    plc: str
    device: str
    width: int
    comment: str = ""
    ticks: list[int] = field(default_factory=list)
    values: list[int] = field(default_factory=list)

    @property
    def bit(self) -> bool:
        """Whether it is a bit, not a word."""
        return self.width == 1

    @property
    def name(self) -> str:
        """As a scenario names it: ``press1.D8201``."""
        return f"{self.plc}.{self.device}"

    def at(self, tick: int) -> int:
        """Its value at a tick."""
        number = bisect_right(self.ticks, tick)
        return self.values[number - 1] if number else 0

    def between(self, begin: int, end: int) -> list[tuple[int, int]]:
        """Its changes after ``begin`` and before ``end``."""
        first, last = bisect_right(self.ticks, begin), bisect_right(self.ticks, end - 1)
        return list(zip(self.ticks[first:last], self.values[first:last], strict=True))


class Watch:
    """Takes the values of some devices from a run's records."""

    def __init__(self, watched: Sequence[Watched]) -> None:
        self.watched = tuple(watched)
        self._by_name = {(each.plc, each.device): each for each in self.watched}
        #: When a PLC worked on another's data from before one of them was away: PLC, source, from, to.
        self.stale: list[tuple[str, str, int, int]] = []
        self._supply: dict[str, Spans] = {each.plc: Spans() for each in watched}

    def take_many(self, block: RecordBlock, breaks: Iterable[int] = ()) -> None:
        """Ignore frames, attempts and link scans."""

    def take(self, record: Record) -> None:
        """Keep a record if it is a new value of one of the devices, or of its PLC's supply."""
        if (
            isinstance(record, NoteRecord)
            and record.kind in (IN_RUN, LEFT_RUN)
            and record.where in self._supply
        ):
            spans = self._supply[record.where]
            (spans.on if record.text == WITHOUT_SUPPLY else spans.off)(0, record.tick)
        if isinstance(record, DeviceValueRecord):
            found = self._by_name.get((record.plc, record.device))
            if found is not None:
                found.ticks.append(record.tick)
                found.values.append(record.value)

    def without_supply(self, begin: int, end: int) -> list[tuple[str, int, int]]:
        """When PLCs had no supply between two ticks: PLC, from, to."""
        return [
            (plc, max(span.start, begin), min(end if span.end is None else span.end, end))
            for plc, spans in self._supply.items()
            for span in spans.all().get(0, ())
            if span.start < end and (span.end is None or span.end > begin)
        ]

    def rows(self, begin: int, end: int) -> Iterator[tuple[int, list[int]]]:
        """A row for the beginning, and one for every tick at which something changed: all the values."""
        values = [each.at(begin) for each in self.watched]
        yield begin, list(values)
        changes = sorted(
            (
                (tick, index, value)
                for index, each in enumerate(self.watched)
                for tick, value in each.between(begin, end)
            ),
            key=lambda change: change[:2],  # of two at one tick the later one counts
        )
        for number, (tick, index, value) in enumerate(changes):
            values[index] = value
            if number + 1 == len(changes) or changes[number + 1][0] != tick:
                yield tick, list(values)

    def to_json(self, begin: int, end: int) -> dict[str, Any]:
        """Each device: its kind, its value at the beginning, its changes as pairs of seconds and value."""
        return {
            each.name: {
                "kind": "bit" if each.bit else "word",
                **({"comment": each.comment} if each.comment else {}),
                "start": each.at(begin),
                "changes": [[s(tick), value] for tick, value in each.between(begin, end)],
            }
            for each in self.watched
        }

"""Records that come many at once: where they are alike but for some fields, those come as arrays."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, repeat, zip_longest
from typing import Any, TypeVar

from bussim.trace.records import AttemptRecord, FrameRecord, ScanRecord

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Alike:
    """Some records in order that differ in some fields alone.

    ``varying`` has an array of these fields' values by name, the others are those of ``pattern``. A frame has
    no damage in any receiver.
    """

    pattern: FrameRecord | AttemptRecord | ScanRecord
    varying: dict[str, Any]

    @property
    def record(self) -> Any:
        """A record whose varying fields are arrays."""
        return self.pattern._replace(**self.varying)

    def records(self) -> Iterator[FrameRecord | AttemptRecord | ScanRecord]:
        """Each by itself."""
        common = {name: repeat(value) for name, value in self.pattern._asdict().items()}
        varying = {name: values.tolist() for name, values in self.varying.items()}
        return map(type(self.pattern)._make, zip(*{**common, **varying}.values(), strict=False))


#: Records that take turns: see :func:`in_turn`.
RecordBlock = Sequence[Alike]


def in_turn(columns: Iterable[Iterable[T]]) -> Iterator[T]:
    """The first of each column, the second, and so on; none is empty, the last columns may have one less."""
    return filter(None, chain.from_iterable(zip_longest(*columns)))


def pieces(items: Iterable[T], breaks: Iterable[int]) -> Iterator[list[T]]:
    """The items up to each of some indexes, and the rest.

    The next index is asked for when the piece before it has been taken.
    """
    whole, first = list(items), 0
    for last in breaks:
        yield whole[first:last]
        first = last
    yield whole[first:]

"""Register maps made of address ranges: what all device models share."""

from abc import ABC, abstractmethod
from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from bussim.engines.modbus.codes import ExceptionCode
from bussim.engines.modbus.pdu import FUNCTIONS, STANDARD_LIMITS, Limits
from bussim.engines.modbus.server import Space

ADDRESSES = 0x10000
#: The address spaces by the keys of a scenario file.
SECTIONS = {
    "coils": Space.COILS,
    "inputs": Space.INPUTS,
    "input_registers": Space.INPUT_REGISTERS,
    "registers": Space.HOLDING,
}
#: Those that Modbus can write.
WRITABLE = (Space.COILS, Space.HOLDING)


@dataclass(frozen=True, slots=True)
class Area:
    """Addresses ``start`` … ``start + count - 1`` of a space, under one name.

    ``width`` addresses make one item (2: a 32-bit value); an access that splits an item is refused.
    """

    space: Space
    start: int
    count: int
    name: str
    writable: bool = True
    width: int = 1

    @property
    def end(self) -> int:
        """The first address behind it."""
        return self.start + self.count


class Part(NamedTuple):
    """What a request touches of one area: ``size`` addresses from ``offset`` on."""

    area: Area
    offset: int
    size: int


class AreaMap(ABC):
    """A :class:`~bussim.engines.modbus.server.RegisterMap` over areas.

    Raises ValueError for areas that overlap, leave 0…65535 or do not hold whole items. Addresses of
    no area, writes to what is not writable and split items are refused with exception 02. A write is
    checked whole before anything is stored.
    """

    def __init__(
        self, areas: Iterable[Area], functions: frozenset[int] = FUNCTIONS, limits: Limits = STANDARD_LIMITS
    ) -> None:
        self.areas = tuple(sorted(areas, key=lambda area: (area.space.value, area.start)))
        #: The function codes that it serves, and how many coils or registers one request may name.
        self.functions, self.limits = functions, limits
        self._by_space = {space: [a for a in self.areas if a.space is space] for space in Space}
        self._starts = {space: [a.start for a in areas] for space, areas in self._by_space.items()}
        for areas in self._by_space.values():
            _check(areas)

    def parts(self, space: Space, address: int, count: int) -> list[Part] | None:
        """The areas that ``count`` (≥ 1) addresses lie in, in order.

        None if some lie in no area or split an item.
        """
        areas = self._by_space[space]
        index = bisect_right(self._starts[space], address) - 1
        found: list[Part] = []
        at, end = address, address + count
        while at < end:
            if not 0 <= index < len(areas):
                return None
            area = areas[index]
            offset, taken = at - area.start, min(end, last := area.end) - at
            if offset < 0 or at >= last or offset % area.width or taken % area.width:
                return None
            found.append(Part(area, offset, taken))
            at += taken
            index += 1
        return found

    def read(self, space: Space, address: int, count: int, now: int) -> Sequence[int] | ExceptionCode:
        """See the protocol."""
        parts = self.parts(space, address, count)
        if parts is None:
            return ExceptionCode.ILLEGAL_ADDRESS
        values: list[int] = []
        for part in parts:
            fetched = self._fetch(part, now)
            if isinstance(fetched, ExceptionCode):
                return fetched
            values += fetched
        return values

    def alike_until(self, now: int) -> int:
        """Until when reads change nothing and are carried out or refused as they would be now."""
        return 1 << 62

    def write(self, space: Space, address: int, values: Sequence[int], now: int) -> ExceptionCode | None:
        """See the protocol."""
        parts = self.parts(space, address, len(values))
        if parts is None or not all(part.area.writable for part in parts):
            return ExceptionCode.ILLEGAL_ADDRESS
        split: list[tuple[Part, Sequence[int]]] = []
        at = 0
        for part in parts:
            split.append((part, values[at : at + part.size]))
            at += part.size
        for part, own in split:
            refused = self._refuse(part, own, now)
            if refused is not None:
                return refused
        for part, own in split:
            self._store(part, own, now)
        return None

    def _refuse(self, part: Part, values: Sequence[int], now: int) -> ExceptionCode | None:
        """Why these values cannot be stored there; None if they can."""
        return None

    @abstractmethod
    def _fetch(self, part: Part, now: int) -> Sequence[int] | ExceptionCode:
        """The values of a part, one an address."""

    @abstractmethod
    def _store(self, part: Part, values: Sequence[int], now: int) -> None:
        """Store values, one an address."""


def _check(areas: Sequence[Area]) -> None:
    end, before = 0, ""
    for area in areas:
        if area.count < 1 or area.start < 0 or area.end > ADDRESSES:
            raise ValueError(f"{area.name}: addresses {area.start}…{area.end - 1}, allowed 0…65535")
        if area.count % area.width:
            raise ValueError(f"{area.name}: items of {area.width} do not fill {area.count}")
        if area.start < end:
            raise ValueError(f"{area.name} overlaps {before} at address {area.start}")
        end, before = area.end, area.name

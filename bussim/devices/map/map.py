"""A register map that a scenario defines: fixed values, ramps, noise, functions, and plain memory."""

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from bussim.devices.areas import WRITABLE, Area, AreaMap, Part
from bussim.devices.map.values import Computed, Fixed, Value
from bussim.engines.modbus.codes import ExceptionCode
from bussim.engines.modbus.pdu import FUNCTIONS
from bussim.engines.modbus.server import Space
from bussim.errors import RunError

_ZERO = Fixed(0)


@dataclass(frozen=True, slots=True)
class Entry:
    """``count`` items of one kind from ``address`` (from 0) on.

    An item is a bit or ``words`` registers (1 or 2), two of them low word first unless ``high_first``.
    What is written to a ``writable`` item stays and takes the place of ``value``; ``low`` … ``high``
    (unsigned; None: whatever fits) are what may be written, anything else is exception 03.
    """

    space: Space
    address: int
    value: Value = _ZERO
    count: int = 1
    name: str = ""
    writable: bool = False
    words: int = 1
    high_first: bool = False
    low: int | None = None
    high: int | None = None


@dataclass(frozen=True, slots=True)
class ValueFailed:
    """The function behind an item failed: the response to the read was exception 04."""

    tick: int
    name: str
    error: str


class UserMap(AreaMap):
    """The map. Raises ValueError for entries that overlap, leave 0…65535 or cannot be.

    ``functions`` are the function codes that it serves.
    """

    def __init__(self, entries: Iterable[Entry], functions: frozenset[int] = FUNCTIONS) -> None:
        unknown = sorted(functions - FUNCTIONS)
        if unknown:
            raise ValueError(f"functions {', '.join(map(str, unknown))} are not known")
        self._entries = {_area(entry): entry for entry in entries}
        super().__init__(self._entries, functions)
        self._written: dict[tuple[Space, int], int] = {}
        self._failures: deque[ValueFailed] = deque()

    def poll(self) -> ValueFailed | None:
        """The next failure of a function, None when there is none."""
        return self._failures.popleft() if self._failures else None

    def alike_until(self, now: int) -> int:
        """See the base class; a function may fail at any time."""
        fails = any(isinstance(entry.value, Computed) for entry in self._entries.values())
        return now if fails else super().alike_until(now)

    def _item(self, area: Area, address: int, now: int) -> int:
        written = self._written.get((area.space, address))
        value = self._entries[area].value.value(now) if written is None else written
        return (1 if value else 0) if area.space.is_bit else value & ((1 << 16 * area.width) - 1)

    def _fetch(self, part: Part, now: int) -> Sequence[int] | ExceptionCode:
        area, width = part.area, part.area.width
        first = area.start + part.offset
        values: list[int] = []
        try:
            for address in range(first, first + part.size, width):
                values += _words(self._entries[area], self._item(area, address, now))
        except SystemExit as error:
            raise RunError(f"the function of {area.name} called sys.exit({error.code})") from error
        except Exception as error:
            # A user's function may raise anything; for the master its device has failed.
            self._failures.append(ValueFailed(now, area.name, f"{type(error).__name__}: {error}"))
            return ExceptionCode.DEVICE_FAILURE
        return values

    def _refuse(self, part: Part, values: Sequence[int], now: int) -> ExceptionCode | None:
        entry = self._entries[part.area]
        low = 0 if entry.low is None else entry.low
        high = (1 << 16 * entry.words) - 1 if entry.high is None else entry.high
        if all(low <= item <= high for item in _items(entry, values)):
            return None
        return ExceptionCode.ILLEGAL_VALUE

    def _store(self, part: Part, values: Sequence[int], now: int) -> None:
        area = part.area
        first = area.start + part.offset
        for number, item in enumerate(_items(self._entries[area], values)):
            self._written[area.space, first + number * area.width] = item


def _area(entry: Entry) -> Area:
    space, name = entry.space, entry.name or f"{entry.space.value} address {entry.address}"
    if entry.words not in (1, 2) or (space.is_bit and entry.words == 2):
        raise ValueError(f"{name}: items of {entry.words} words; bits have 1, registers 1 or 2")
    if entry.writable and space not in WRITABLE:
        raise ValueError(f"{name}: Modbus cannot write {space.value}, only coils and holding registers")
    size = entry.count * entry.words
    return Area(space, entry.address, size, name, entry.writable, entry.words)


def _words(entry: Entry, value: int) -> tuple[int, ...]:
    if entry.words == 1:
        return (value,)
    low, high = value & 0xFFFF, value >> 16
    return (high, low) if entry.high_first else (low, high)


def _items(entry: Entry, values: Sequence[int]) -> list[int]:
    if entry.words == 1:
        return list(values)
    pairs = zip(values[::2], values[1::2], strict=True)
    return [a << 16 | b if entry.high_first else b << 16 | a for a, b in pairs]

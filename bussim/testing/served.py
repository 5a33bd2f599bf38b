"""A served bus as tests see it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from operator import index
from typing import SupportsIndex

from bussim.devices.v80.map import V80, V80_ITEMS
from bussim.engines.modbus.adu import FIRST_STATION, LAST_STATION, Mode
from bussim.engines.modbus.events import RequestServed
from bussim.engines.modbus.server import Space
from bussim.line.characters import CharFormat
from bussim.live.faults import Injected, ReplyFault
from bussim.live.options import PortOptions
from bussim.live.served import ServedSlave
from bussim.units import TICKS_PER_SECOND, parse_time, seconds
from bussim.wording import counted

#: Items that a repr shows.
_SHOWN = 20


class Items:
    """The coils or registers of a station, by address from 0: ``items[5] = 17``, ``items[5:8] = [1, 2, 3]``.

    A list of fixed length: coils are 0 or 1, registers 0…65535, and slices have as many values as addresses.
    Raises IndexError for an address that the station lacks, ValueError for other values.
    """

    def __init__(self, device: V80, space: Space) -> None:
        self._device, self._space = device, space

    def __len__(self) -> int:
        return V80_ITEMS

    def __iter__(self) -> Iterator[int]:
        return (self._device.get(self._space, at) for at in range(len(self)))

    def __getitem__(self, address: SupportsIndex | slice) -> int | list[int]:
        if isinstance(address, slice):
            return [self._device.get(self._space, each) for each in range(*address.indices(len(self)))]
        return self._device.get(self._space, self._checked(address))

    def __setitem__(
        self, address: SupportsIndex | slice, value: SupportsIndex | Iterable[SupportsIndex]
    ) -> None:
        if isinstance(address, slice) is not isinstance(value, Iterable):
            raise TypeError("one address takes one whole number, a slice as many as it has addresses")
        whole = address if isinstance(address, slice) else slice(at := self._checked(address), at + 1)
        where = range(len(self))[whole]
        values = [index(each) for each in (value if isinstance(value, Iterable) else [value])]
        if len(where) != len(values):
            raise ValueError(f"{counted(len(values), 'value')} for {counted(len(where), 'address')}")
        most = 1 if self._space.is_bit else 0xFFFF
        for each in values:
            if not 0 <= each <= most:
                raise ValueError(f"value {each}, allowed 0…{most}")
        for at, each in zip(where, values, strict=True):
            self._device.set(self._space, at, each)

    def __repr__(self) -> str:
        held = [f"{at}: {value}" for at, value in enumerate(self) if value]
        more = f", … {len(held) - _SHOWN} more" if len(held) > _SHOWN else ""
        return f"<{counted(len(self), 'item')}, all 0 but {{{', '.join(held[:_SHOWN])}{more}}}>"

    def _checked(self, address: SupportsIndex) -> int:
        if not 0 <= (at := index(address)) < len(self):
            raise IndexError(f"address {at}, allowed 0…{len(self) - 1}")
        return at


@dataclass(frozen=True, slots=True)
class Asked:
    """A request as the bus received it. ``address``, ``count``, ``values`` are None where it was malformed.

    ``exception`` is 0 where it was carried out, ``absent``: no such station is on the bus. ``time_s`` are
    seconds from the bus's start to the request's last stop bit.
    """

    station: int
    function: int
    address: int | None
    count: int | None
    values: tuple[int, ...] | None
    exception: int
    absent: bool
    broadcast: bool
    time_s: float


class Station:
    """One slave: ``coils``, ``inputs``, ``input_registers`` and ``registers`` (holding registers)."""

    def __init__(self, device: V80) -> None:
        self.coils = Items(device, Space.COILS)
        self.inputs = Items(device, Space.INPUTS)
        self.input_registers = Items(device, Space.INPUT_REGISTERS)
        self.registers = Items(device, Space.HOLDING)

    def __repr__(self) -> str:
        return ", ".join(f"{name}={items!r}" for name, items in vars(self).items() if any(items)) or "all 0"


class ServedBus(ServedSlave):
    """Modbus slaves on a new pseudo-terminal (or another URL) until :meth:`close`.

    ``stations`` are their numbers, ``mode`` is "rtu" or "ascii", ``baud`` matters for the silence
    that ends an RTU request, ``delay`` (seconds, or "10 ms") is from a request to its reply. ``paced`` spaces
    bytes at the baud rate, as a wire does. Raises ValueError or UsageError for what cannot be.
    """

    def __init__(
        self,
        *,
        url: str = "pty",
        stations: Iterable[int] = (1,),
        mode: str = "rtu",
        baud: int = 115200,
        delay: float | str = 0.0,
        paced: bool = False,
    ) -> None:
        devices = {number: V80() for number in stations}
        for number in devices:
            if not FIRST_STATION <= number <= LAST_STATION:
                raise ValueError(f"station {number}, allowed {FIRST_STATION}…{LAST_STATION}")
        if not devices:
            raise ValueError("a bus needs a station")
        if baud < 1:
            raise ValueError(f"baud {baud}, at least 1")
        self._stations = {number: Station(device) for number, device in devices.items()}
        super().__init__(
            url,
            devices,
            mode=Mode(mode),
            baud=baud,
            fmt=CharFormat(8, "N", 1),
            delay=_ticks(delay),
            options=PortOptions(paced=paced),
        )
        first = next(iter(self._stations.values()))
        #: Items of the first station.
        self.coils, self.inputs = first.coils, first.inputs
        self.input_registers, self.registers = first.input_registers, first.registers

    def station(self, number: int) -> Station:
        """A slave by its station number. Raises KeyError if it is not on the bus."""
        return self._stations[number]

    @property
    def asked(self) -> list[Asked]:
        """The requests on the bus in order, those to absent stations too: the first 10,000."""
        return [
            Asked(
                each.station,
                each.function,
                each.request and each.request.address,
                each.request and each.request.quantity,
                each.request and each.request.values,
                each.exception,
                absent=not each.number,
                broadcast=each.broadcast,
                time_s=round(seconds(each.end), 6),
            )
            for each in super().requests
        ]

    @property
    def requests(self) -> list[RequestServed]:
        """The requests that were carried out or refused, in order: the first of them. Times are ticks."""
        return [each for each in super().requests if each.number]

    def __repr__(self) -> str:
        stations = "; ".join(f"{number}: {station!r}" for number, station in self._stations.items())
        return (
            f"<bus on {self.device}, stations {{{stations}}}, "
            f"{counted(len(self.asked), 'request')}, {counted(self.pending_faults, 'fault')} to come>"
        )

    # -- faults --------------------------------------------------------------------------------

    def drop_reply(self, count: int = 1, *, station: int | None = None) -> None:
        """The next ``count`` replies are never sent; their requests are carried out."""
        self._inject(Injected(ReplyFault.DROP, station=station), count)

    def corrupt_check(self, count: int = 1, *, station: int | None = None) -> None:
        """The CRC or LRC of the next replies is wrong."""
        self._inject(Injected(ReplyFault.CORRUPT, station=station), count)

    def truncate(self, count: int = 1, *, station: int | None = None) -> None:
        """The second half of the next replies is missing."""
        self._inject(Injected(ReplyFault.TRUNCATE, station=station), count)

    def delay(self, by: float | str, count: int = 1, *, station: int | None = None) -> None:
        """The next replies come so much later: seconds, or "10 ms"."""
        self._inject(Injected(ReplyFault.DELAY, by=_ticks(by), station=station), count)

    def wrong_station(self, count: int = 1, *, station: int | None = None) -> None:
        """The next replies carry the number of the next station."""
        self._inject(Injected(ReplyFault.WRONG_STATION, station=station), count)

    def exception(self, code: int, count: int = 1, *, station: int | None = None) -> None:
        """The next requests are refused with this code (1–255), and not carried out."""
        if not 1 <= code <= 255:
            raise ValueError(f"exception code {code}, allowed 1…255")
        self._inject(Injected(ReplyFault.EXCEPTION, code=code, station=station), count)

    def no_faults(self) -> None:
        """Forget the faults that have not happened yet."""
        self.faults.clear()

    @property
    def pending_faults(self) -> int:
        """Faults that have not happened yet: 0 where a test has used up all of them."""
        return self.faults.waiting

    def _inject(self, fault: Injected, count: int) -> None:
        if fault.station is not None and fault.station not in self._stations:
            raise ValueError(f"station {fault.station} is not on the bus, which has {list(self._stations)}")
        if count < 1:
            raise ValueError(f"count {count}, at least 1")
        self.faults.inject(fault, count)


def _ticks(time: float | str) -> int:
    ticks = parse_time(time) if isinstance(time, str) else round(time * TICKS_PER_SECOND)
    if not 0 <= ticks <= 3600 * TICKS_PER_SECOND:
        raise ValueError(f"{time} seconds, allowed 0…3600")
    return ticks

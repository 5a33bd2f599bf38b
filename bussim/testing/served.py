"""A served bus as tests see it."""

from __future__ import annotations

from collections.abc import Iterable

from bussim.devices.v80.map import V80
from bussim.engines.modbus.adu import FIRST_STATION, LAST_STATION, Mode
from bussim.engines.modbus.server import Space
from bussim.line.characters import CharFormat
from bussim.live.faults import Injected, ReplyFault
from bussim.live.options import PortOptions
from bussim.live.served import ServedSlave
from bussim.units import TICKS_PER_SECOND


class Items:
    """The coils or registers of a station, by address from 0: ``items[5] = 17``, ``items[5:8]``.

    Raises IndexError for an address that the station lacks.
    """

    def __init__(self, device: V80, space: Space) -> None:
        self._device, self._space = device, space

    def __getitem__(self, address: int | slice) -> int | list[int]:
        if isinstance(address, slice):
            return [self._get(each) for each in self._range(address)]
        return self._get(address)

    def __setitem__(self, address: int | slice, value: int | Iterable[int]) -> None:
        if isinstance(address, slice):
            if isinstance(value, int):
                raise TypeError("a slice takes as many values as it has addresses")
            for number, each in enumerate(value, address.start or 0):
                self[number] = each
        elif isinstance(value, int):
            self._device.set(self._space, self._checked(address), value)
        else:
            raise TypeError("one address takes one value")

    def _get(self, address: int) -> int:
        return self._device.get(self._space, self._checked(address))

    @staticmethod
    def _checked(address: int) -> int:
        if address < 0:
            raise IndexError(f"address {address}, they count from 0")
        return address

    @staticmethod
    def _range(address: slice) -> range:
        if address.stop is None:
            raise IndexError("a slice of addresses needs an end")
        return range(address.start or 0, address.stop, address.step or 1)


class Station:
    """One slave: ``coils``, ``inputs``, ``input_registers`` and ``registers`` (holding registers)."""

    def __init__(self, device: V80) -> None:
        self.coils = Items(device, Space.COILS)
        self.inputs = Items(device, Space.INPUTS)
        self.input_registers = Items(device, Space.INPUT_REGISTERS)
        self.registers = Items(device, Space.HOLDING)


class ServedBus(ServedSlave):
    """Modbus slaves on a new pseudo-terminal (or another URL) until :meth:`close`.

    ``stations`` are their numbers, ``mode`` is "rtu" or "ascii", ``baud`` matters for the silence
    that ends an RTU request, ``delay`` (seconds) is from a request to its reply. ``paced`` spaces
    bytes at the baud rate, as a wire does. Raises ValueError or UsageError for what cannot be.
    """

    def __init__(
        self,
        *,
        url: str = "pty",
        stations: Iterable[int] = (1,),
        mode: str = "rtu",
        baud: int = 115200,
        delay: float = 0.0,
        paced: bool = False,
    ) -> None:
        devices = {number: V80() for number in stations}
        for number in devices:
            if not FIRST_STATION <= number <= LAST_STATION:
                raise ValueError(f"station {number}, allowed {FIRST_STATION}…{LAST_STATION}")
        if not devices:
            raise ValueError("a bus needs a station")
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

    # -- faults --------------------------------------------------------------------------------

    def drop_reply(self, count: int = 1) -> None:
        """The next ``count`` replies are never sent; their requests are carried out."""
        self._inject(Injected(ReplyFault.DROP), count)

    def corrupt_check(self, count: int = 1) -> None:
        """The CRC or LRC of the next replies is wrong."""
        self._inject(Injected(ReplyFault.CORRUPT), count)

    def truncate(self, count: int = 1) -> None:
        """The second half of the next replies is missing."""
        self._inject(Injected(ReplyFault.TRUNCATE), count)

    def delay(self, seconds: float, count: int = 1) -> None:
        """The next replies come so much later."""
        self._inject(Injected(ReplyFault.DELAY, by=_ticks(seconds)), count)

    def wrong_station(self, count: int = 1) -> None:
        """The next replies carry the number of the next station."""
        self._inject(Injected(ReplyFault.WRONG_STATION), count)

    def exception(self, code: int, count: int = 1) -> None:
        """The next replies are exceptions with this code (1–255)."""
        if not 1 <= code <= 255:
            raise ValueError(f"exception code {code}, allowed 1…255")
        self._inject(Injected(ReplyFault.EXCEPTION, code=code), count)

    def no_faults(self) -> None:
        """Forget the faults that have not happened yet."""
        self.faults.clear()

    @property
    def pending_faults(self) -> int:
        """Faults that have not happened yet: 0 where a test has used up all of them."""
        return self.faults.waiting

    def _inject(self, fault: Injected, count: int) -> None:
        if count < 1:
            raise ValueError(f"count {count}, at least 1")
        self.faults.inject(fault, count)


def _ticks(seconds: float) -> int:
    if not 0 <= seconds <= 3600:
        raise ValueError(f"{seconds} seconds, allowed 0…3600")
    return round(seconds * TICKS_PER_SECOND)

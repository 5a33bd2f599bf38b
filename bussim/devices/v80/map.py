"""A V80 or PPC controller as Modbus slave (V80/PPC Modbus protocol, version 1.2)."""

from array import array
from collections.abc import Sequence
from fractions import Fraction

from bussim.devices.areas import WRITABLE, Area, AreaMap, Part
from bussim.devices.serial_settings import DevicePort
from bussim.engines.modbus.codes import ExceptionCode
from bussim.engines.modbus.gaps import GapRule
from bussim.engines.modbus.pdu import FUNCTIONS, Limits
from bussim.engines.modbus.server import Space

#: "More than four and a half characters" (manual, section 1.2), at every rate.
V80_PORT = DevicePort("v80", gaps=GapRule(end=Fraction(9, 2), inner=Fraction(9, 2), fast_character=None))
#: 1024 coils in one read (manual, section 2.1; the same for inputs, assumed), 125 registers (section 2.2).
V80_LIMITS = Limits(read_coils=1024, read_inputs=1024)
#: Items of each space: what four-digit reference numbers reach (assumed; the manual gives no sizes).
V80_ITEMS = 9999


class V80(AreaMap):
    """Coils 0xxxx, inputs 1xxxx, input registers 3xxxx and holding registers 4xxxx, all 0 at first.

    Reference numbers count from 1, addresses from 0: coil 00127 is address 126. Inputs and input
    registers cannot be written by Modbus; :meth:`set` does. All eight functions are served; another
    value than FF00 or 0000 in function 05 leaves the coil alone (exception 03), and reads to station
    0 are ignored.
    """

    def __init__(self, items: int = V80_ITEMS) -> None:
        super().__init__(
            [Area(space, 0, items, space.value, space in WRITABLE) for space in Space], FUNCTIONS, V80_LIMITS
        )
        self._items = {space: array("H", bytes(2 * items)) for space in Space}

    def get(self, space: Space, address: int) -> int:
        """One item: 0/1 or 0…65535. Raises IndexError for an address that it lacks."""
        return self._items[space][address]

    def set(self, space: Space, address: int, value: int) -> None:
        """Set one item from inside (its program): a bit (any value but 0 is 1) or the low 16 bits."""
        self._items[space][address] = bool(value) if space.is_bit else value & 0xFFFF

    def _fetch(self, part: Part, now: int) -> Sequence[int] | ExceptionCode:
        return self._items[part.area.space][part.offset : part.offset + part.size]

    def _store(self, part: Part, values: Sequence[int], now: int) -> None:
        for address, value in enumerate(values, part.offset):
            self.set(part.area.space, address, value)

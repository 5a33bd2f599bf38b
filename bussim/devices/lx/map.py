"""A PLC as Modbus slave: its device memory under the addresses of the LX slave note.

=================  =======  =====    ====================  =======  ======
coils              start    count    registers             start    count
=================  =======  =====    ====================  =======  ======
M0–M3071           0x0000   3072     D0–D8255              0x0000   8256
M8000–M8255        0x1F40   256      T0–T255               0xF000   256
S0–S999            0xE000   1000     C0–C199               0xF400   200
T0–T255            0xF000   256      C200–C255 (32 bits)   0xF700   56 × 2
C0–C255            0xF400   256
X0–X377 (octal)    0xF800   256
Y0–Y377 (octal)    0xFC00   256
=================  =======  =====    ====================  =======  ======

The note prints X0–255 and M8000–8256; the devices are those of the PLC's memory.
"""

from collections.abc import Sequence

from bussim.devices.areas import Area, AreaMap, Part
from bussim.devices.serial_settings import DevicePort
from bussim.engines.modbus.pdu import Limits
from bussim.engines.modbus.server import Space
from bussim.plc.memory import FIRST_LONG_COUNTER, FIRST_SPECIAL, Device, Memory

LX_PORT = DevicePort("lx")
#: 01 03 05 06 0F 10 (LX slave note, chapter 1).
LX_FUNCTIONS = frozenset((0x01, 0x03, 0x05, 0x06, 0x0F, 0x10))
#: 1968 coils and 120 registers in one write (LX slave note, sections 1.5 and 1.6), else the standard's.
LX_LIMITS = Limits(write_coils=1968, write_registers=120)


def _range(
    space: Space, start: int, count: int, letter: str, first: int = 0, *, width: int = 1
) -> tuple[Area, Device]:
    device, last = Device(letter, first), Device(letter, first + count - 1)
    return Area(space, start, count * width, f"{device}–{last}", letter != "X", width), device


#: The areas with the first device of each.
LX_AREAS = dict(
    (
        _range(Space.COILS, 0x0000, 3072, "M"),
        _range(Space.COILS, 0x1F40, 256, "M", 8000),
        _range(Space.COILS, 0xE000, 1000, "S"),
        _range(Space.COILS, 0xF000, 256, "T"),
        _range(Space.COILS, 0xF400, 256, "C"),
        _range(Space.COILS, 0xF800, 256, "X"),
        _range(Space.COILS, 0xFC00, 256, "Y"),
        _range(Space.HOLDING, 0x0000, 8256, "D"),
        _range(Space.HOLDING, 0xF000, 256, "T"),
        _range(Space.HOLDING, 0xF400, FIRST_LONG_COUNTER, "C"),
        _range(Space.HOLDING, 0xF700, 256 - FIRST_LONG_COUNTER, "C", FIRST_LONG_COUNTER, width=2),
    )
)


class LxMap(AreaMap):
    """The devices of one PLC's memory. X can only be read.

    A 32-bit counter is two registers, low word first (assumed, as this family's 32-bit pairs of D; the
    note does not say). Function 06 never fits one: exception 02.
    """

    def __init__(self, memory: Memory) -> None:
        super().__init__(LX_AREAS, LX_FUNCTIONS, LX_LIMITS)
        self.memory = memory

    def _fetch(self, part: Part, now: int) -> Sequence[int]:
        memory, width = self.memory, part.area.width
        letter, number = LX_AREAS[part.area]
        if letter in "MD" and number + part.offset + part.size > FIRST_SPECIAL and memory.refresh_specials:
            memory.refresh_specials(now)
        numbers = range(number + part.offset // width, number + (part.offset + part.size) // width)
        if part.area.space is Space.COILS:
            return [memory.get(Device(letter, number)) for number in numbers]
        words = [memory.word(letter, number) for number in numbers]
        return words if width == 1 else [half for word in words for half in (word & 0xFFFF, word >> 16)]

    def _store(self, part: Part, values: Sequence[int], now: int) -> None:
        memory, width = self.memory, part.area.width
        letter, number = LX_AREAS[part.area]
        if width == 2:
            values = [high << 16 | low for low, high in zip(values[::2], values[1::2], strict=True)]
        for at, value in enumerate(values, number + part.offset // width):
            if part.area.space is Space.COILS:
                memory.set(Device(letter, at), value)
            else:
                memory.set_word(letter, at, value)

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

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from bussim.devices.areas import Area, AreaMap, Part
from bussim.devices.port import DevicePort
from bussim.engines.modbus.pdu import Function, Limits
from bussim.engines.modbus.server import Space
from bussim.plc.memory import FIRST_LONG_COUNTER, Device, Memory

LX_PORT = DevicePort("lx")
#: 01 03 05 06 0F 10 (LX slave note, chapter 1).
LX_FUNCTIONS = frozenset(
    (
        int(Function.READ_COILS),
        int(Function.READ_HOLDING),
        int(Function.WRITE_COIL),
        int(Function.WRITE_REGISTER),
        int(Function.WRITE_COILS),
        int(Function.WRITE_REGISTERS),
    )
)
#: 1968 coils and 120 registers in one write (LX slave note, sections 1.5 and 1.6), else the standard's.
LX_LIMITS = Limits(write_coils=1968, write_registers=120)


@dataclass(frozen=True, slots=True)
class DeviceArea(Area):
    """An area that is a range of devices: ``letter``, from number ``first`` on."""

    letter: str = ""
    first: int = 0


def _coils(start: int, count: int, letter: str, first: int = 0) -> DeviceArea:
    name = f"{Device(letter, first)}–{Device(letter, first + count - 1)}"
    return DeviceArea(Space.COILS, start, count, name, letter != "X", 1, letter, first)


def _registers(start: int, count: int, letter: str, first: int = 0, width: int = 1) -> DeviceArea:
    name = f"{letter}{first}–{letter}{first + count - 1}"
    return DeviceArea(Space.HOLDING, start, count * width, name, True, width, letter, first)  # noqa: FBT003 - the field's place


LX_AREAS = (
    _coils(0x0000, 3072, "M"),
    _coils(0x1F40, 256, "M", 8000),
    _coils(0xE000, 1000, "S"),
    _coils(0xF000, 256, "T"),
    _coils(0xF400, 256, "C"),
    _coils(0xF800, 256, "X"),
    _coils(0xFC00, 256, "Y"),
    _registers(0x0000, 8256, "D"),
    _registers(0xF000, 256, "T"),
    _registers(0xF400, FIRST_LONG_COUNTER, "C"),
    _registers(0xF700, 256 - FIRST_LONG_COUNTER, "C", FIRST_LONG_COUNTER, 2),
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
        del now
        area, offset, count = part
        assert isinstance(area, DeviceArea)  # noqa: S101 - narrows the type; all areas here are
        memory, letter = self.memory, area.letter
        if area.space is Space.COILS:
            first = area.first + offset
            return [memory.get(Device(letter, number)) for number in range(first, first + count)]
        first = area.first + offset // area.width
        words = [memory.word(letter, number) for number in range(first, first + count // area.width)]
        if area.width == 1:
            return words
        return [half for word in words for half in (word & 0xFFFF, word >> 16)]

    def _store(self, part: Part, values: Sequence[int], now: int) -> None:
        del now
        area, offset, _ = part
        assert isinstance(area, DeviceArea)  # noqa: S101 - narrows the type; all areas here are
        memory, letter = self.memory, area.letter
        if area.space is Space.COILS:
            for number, bit in enumerate(values, area.first + offset):
                memory.set(Device(letter, number), bit)
        elif area.width == 1:
            for number, word in enumerate(values, area.first + offset):
                memory.set_word(letter, number, word)
        else:
            pairs = zip(values[::2], values[1::2], strict=True)
            for number, (low, high) in enumerate(pairs, area.first + offset // 2):
                memory.set_word(letter, number, high << 16 | low)

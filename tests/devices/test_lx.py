"""The PLC as Modbus slave: every row of its tables, by name and address."""

from __future__ import annotations

import pytest

from bussim.devices.lx.map import LX_AREAS, LxMap
from bussim.engines.modbus.pdu import (
    Request,
    write_coil,
    write_coils,
    write_register,
    write_registers,
)
from bussim.engines.modbus.server import Space
from bussim.plc.memory import Device, Memory, parse_device
from tests.devices.ask import ask, code

# Name of the first and last device, address of the first, number of devices.
COILS = [
    ("M0", "M3071", 0x0000, 3072),
    ("M8000", "M8255", 0x1F40, 256),
    ("S0", "S999", 0xE000, 1000),
    ("T0", "T255", 0xF000, 256),
    ("C0", "C255", 0xF400, 256),
    ("X0", "X377", 0xF800, 256),
    ("Y0", "Y377", 0xFC00, 256),
]
REGISTERS = [
    ("D0", "D8255", 0x0000, 8256),
    ("T0", "T255", 0xF000, 256),
    ("C0", "C199", 0xF400, 200),
    ("C200", "C255", 0xF700, 56),
]


def lx() -> LxMap:
    return LxMap(Memory())


def test_the_tables_are_complete() -> None:
    assert len(LX_AREAS) == len(COILS) + len(REGISTERS)
    assert 8000 == 0x1F40
    for areas, table in [
        ([a for a in LX_AREAS if a.space is Space.COILS], COILS),
        ([a for a in LX_AREAS if a.space is Space.HOLDING], REGISTERS),
    ]:
        rows = [(f"{first}–{last}", start, count) for first, last, start, count in table]
        assert [(a.name, a.start, a.count // a.width) for a in areas] == rows


@pytest.mark.parametrize(("first", "last", "start", "count"), COILS)
def test_coils_by_name_and_address(first: str, last: str, start: int, count: int) -> None:
    device = lx()
    end = start + count - 1
    for name, address in [(first, start), (last, end)]:
        device.memory.set(parse_device(name), 1)
        assert ask(device, Request(1, address, 1)) == (1,)
    # Neighbours outside the area are refused, the whole of it can be read (2000 coils at a time).
    assert code(device, Request(1, end + 1, 1)) == 2
    assert code(device, Request(1, end, 2)) == 2
    if start:
        assert code(device, Request(1, start - 1, 1)) == 2
    assert code(device, Request(1, start, min(count, 2000))) == 0
    # Writing: everything but X.
    expected = 2 if first.startswith("X") else 0
    device.memory.set(parse_device(first), 0)
    assert code(device, write_coil(start, on=True)) == expected
    assert device.memory.get(parse_device(first)) == (0 if expected else 1)
    assert code(device, write_coils(end - 1, (1, 0))) == expected
    assert device.memory.get(parse_device(last)) == (1 if expected else 0)


@pytest.mark.parametrize(("letter", "start", "count"), [(row[0][0], *row[2:]) for row in REGISTERS[:3]])
def test_registers_by_name_and_address(letter: str, start: int, count: int) -> None:
    device = lx()
    memory, end = device.memory, start + count - 1
    for number, address, value in [(0, start, 0x1234), (count - 1, end, 0xFEDC)]:
        memory.set_word(letter, number, value)
        assert ask(device, Request(3, address, 1)) == (value,)
        assert code(device, write_register(address, 0x4321)) == 0
        assert memory.word(letter, number) == 0x4321
    assert code(device, Request(3, end + 1, 1)) == 2
    assert code(device, Request(3, end, 2)) == 2
    if start:
        assert code(device, Request(3, start - 1, 1)) == 2
    assert code(device, write_registers(end - 1, (5, 6))) == 0
    assert (memory.word(letter, count - 2), memory.word(letter, count - 1)) == (5, 6)


def test_x_is_octal() -> None:
    device = lx()
    device.memory.set(parse_device("X10"), 1)
    assert ask(device, Request(1, 0xF808, 1)) == (1,)


# -- 32-bit counters -------------------------------------------------------------------------------


def test_c205_to_c208_is_address_f70a_quantity_8() -> None:
    device = lx()
    for number in range(205, 209):
        device.memory.set_word("C", number, number << 16 | number + 1000)
    expected = [half for number in range(205, 209) for half in (number + 1000, number)]
    assert ask(device, Request(3, 0xF70A, 8)) == tuple(expected)


def test_both_ends_of_the_counters() -> None:
    device = lx()
    assert code(device, Request(3, 0xF700, 112)) == 0
    assert code(device, write_registers(0xF700 + 110, (0xFFFF, 0x7FFF))) == 0
    assert device.memory.word("C", 255) == 0x7FFF_FFFF
    assert code(device, Request(3, 0xF700 + 110, 4)) == 2
    assert code(device, Request(3, 0xF6FE, 2)) == 2


@pytest.mark.parametrize("address", [0xF700, 0xF701, 0xF76E, 0xF76F])
def test_function_06_never_fits_a_counter(address: int) -> None:
    assert code(lx(), write_register(address, 1)) == 2


@pytest.mark.parametrize(("address", "quantity"), [(0xF700, 1), (0xF700, 3), (0xF701, 2), (0xF701, 1)])
def test_splitting_a_counter_is_refused(address: int, quantity: int) -> None:
    device = lx()
    assert code(device, Request(3, address, quantity)) == 2
    assert code(device, write_registers(address, (1,) * quantity)) == 2
    assert device.memory.word("C", 200) == 0


# -- limits and functions ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("request_", "expected"),
    [
        (Request(1, 0, 2000), 0),
        (Request(1, 0, 2001), 3),
        (Request(3, 0, 125), 0),
        (Request(3, 0, 126), 3),
        (write_coils(0, (1,) * 1968), 0),
        (write_coils(0, (1,) * 1969), 3),
        (write_registers(0, (1,) * 120), 0),
        (write_registers(0, (1,) * 121), 3),
        (Request(1, 0, 0), 3),
        (Request(3, 0, 0), 3),
    ],
)
def test_limits(request_: Request, expected: int) -> None:
    assert code(lx(), request_) == expected


@pytest.mark.parametrize("function", [2, 4])
def test_functions_that_it_lacks(function: int) -> None:
    assert code(lx(), Request(function, 0, 1)) == 1


@pytest.mark.parametrize("word", [0x0001, 0x00FF, 0xFF01, 0xFFFF, 0x1234])
def test_function_05_with_another_value(word: int) -> None:
    device = lx()
    assert code(device, Request(5, 0, 1, (word,))) == 3
    assert device.memory.get(Device("M", 0)) == 0


def test_ramps_across_a_byte_border_keep_their_order() -> None:
    device = lx()
    bits = (1, 0, 1, 1, 0, 0, 1, 1, 0, 1, 1)
    assert code(device, write_coils(1000, bits)) == 0
    assert tuple(device.memory.get(Device("M", 1000 + k)) for k in range(11)) == bits
    assert ask(device, Request(1, 1000, 11)) == bits

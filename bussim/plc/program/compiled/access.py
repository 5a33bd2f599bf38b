"""Reads and writes operands: closures bound to a machine's memory.

Words are read as patterns of bits (0…65535, or 0…2³²−1 in a D form). Addresses that an index register moves
out of their range raise OperationError.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable
from struct import Struct

from bussim.plc.memory import FIRST_LONG_COUNTER
from bussim.plc.program.machine import Machine, OperationError
from bussim.plc.program.text.operands import Operand, range_of

Reader = Callable[[], int]
Writer = Callable[[int], None]

_AS_DIGITS = bytes((0x30, 0x31)) + bytes(254)
#: The eight bits of each byte, lowest first, one byte each.
_BITS_OF = [bytes(value >> bit & 1 for bit in range(8)) for value in range(256)]
# Reading four or eight bits as one number and looking up what they mean is the fastest way there is.
_FOUR, _EIGHT = Struct("=I"), Struct("=Q")
_OF_FOUR = {_FOUR.unpack(pattern[:4]): value for value, pattern in enumerate(_BITS_OF[:16])}
_OF_EIGHT = {_EIGHT.unpack(pattern): value for value, pattern in enumerate(_BITS_OF)}


def _offset(machine: Machine, operand: Operand) -> Callable[[], int] | None:
    if operand.index is None:
        return None
    letter, number = operand.index
    register = machine.words[letter]
    return lambda: (register[number] ^ 0x8000) - 0x8000


def finder(machine: Machine, operand: Operand, *, word: bool) -> Callable[[int], int]:
    """Finds the operand's address with its index; so many devices from it on must exist.

    They must lie in the same range as the address that is written: an index cannot lead from M3071
    to M8000, nor from a 16-bit counter to a 32-bit one.
    """
    base, offset = operand.address, _offset(machine, operand)
    bounds = range_of(operand.letter, base, word=word, family=operand.family)
    if bounds is None:
        raise ValueError(f"there is no {operand.text}")  # a program that was read has none such
    first, end = bounds

    def find(span: int) -> int:
        at = base + offset() if offset is not None else base
        if first <= at <= end - span + 1:
            return at
        raise OperationError

    return find


def locate(machine: Machine, operand: Operand, span: int, *, word: bool) -> Callable[[], int]:
    """The same for a number of devices that never changes."""
    find = finder(machine, operand, word=word)
    if operand.index is None:
        index = find(span)
        return lambda: index
    return lambda: find(span)


def word_of(machine: Machine, operand: Operand) -> tuple[array[int], int]:
    """The array and index of a 16-bit word that never moves: a device without index, or a constant."""
    if operand.index is not None or operand.groups:
        raise ValueError(f"{operand.text} is no single word")
    if operand.kind == "K":
        return array("H", [operand.address & 0xFFFF]), 0
    return machine.words[operand.letter], operand.address


def reader(machine: Machine, operand: Operand, *, wide: bool = False) -> Reader:
    """Reads an operand's pattern."""
    if operand.kind == "K":
        return _constant(machine, operand, 0xFFFFFFFF if wide else 0xFFFF)
    if operand.groups:
        return _group_reader(machine, operand)
    if wide:
        return _pair_reader(machine, operand)
    words, at = machine.words[operand.letter], operand.address
    if operand.index is None:
        return lambda: words[at]
    find = locate(machine, operand, 1, word=True)
    return lambda: words[find()]


def value_reader(machine: Machine, operand: Operand, *, wide: bool = False) -> Reader:
    """Reads an operand's signed value."""
    read = reader(machine, operand, wide=wide)
    half = 0x80000000 if wide else 0x8000
    if operand.constant is not None:
        value = (read() ^ half) - half
        return lambda: value
    return lambda: (read() ^ half) - half


def writer(machine: Machine, operand: Operand, *, wide: bool = False) -> Writer:
    """Writes a value's low bits into an operand."""
    if operand.groups:
        return _group_writer(machine, operand)
    if wide:
        return _pair_writer(machine, operand)
    words, at = machine.words[operand.letter], operand.address
    if operand.index is None:

        def write(value: int) -> None:
            words[at] = value & 0xFFFF

        return write
    find = locate(machine, operand, 1, word=True)

    def write_found(value: int) -> None:
        words[find()] = value & 0xFFFF

    return write_found


def _constant(machine: Machine, operand: Operand, mask: int) -> Reader:
    value = operand.address & mask
    offset = _offset(machine, operand)
    if offset is None:
        return lambda: value
    return lambda: (value + offset()) & mask


# -- pairs of words, 32-bit counters ---------------------------------------------------------------


def _is_long(operand: Operand) -> bool:
    return operand.kind == "C" and operand.address >= FIRST_LONG_COUNTER


def _pair_reader(machine: Machine, operand: Operand) -> Reader:
    words = machine.words[operand.letter]
    if operand.kind == "Z":
        high, number = machine.words["V"], operand.address
        return lambda: words[number] | high[number] << 16
    if _is_long(operand):
        find = locate(machine, operand, 1, word=True)
        return lambda: words[find()]
    if operand.index is None:
        low, above = operand.address, operand.address + 1
        return lambda: words[low] | words[above] << 16
    find = locate(machine, operand, 2, word=True)

    def read() -> int:
        at = find()
        return words[at] | words[at + 1] << 16

    return read


def _pair_writer(machine: Machine, operand: Operand) -> Writer:
    words = machine.words[operand.letter]
    if operand.kind == "Z":
        high, number = machine.words["V"], operand.address

        def write_registers(value: int) -> None:
            words[number] = value & 0xFFFF
            high[number] = value >> 16 & 0xFFFF

        return write_registers
    long = _is_long(operand)
    find = locate(machine, operand, 1 if long else 2, word=True)
    if long:

        def write_counter(value: int) -> None:
            words[find()] = value & 0xFFFFFFFF

        return write_counter

    def write(value: int) -> None:
        at = find()
        words[at] = value & 0xFFFF
        words[at + 1] = value >> 16 & 0xFFFF

    return write


# -- groups of bits --------------------------------------------------------------------------------


def pack(bits: bytearray) -> int:
    """Bits as a number, the first one lowest."""
    return int(bits[::-1].translate(_AS_DIGITS), 2)


def spread(value: int, count: int) -> bytes:
    """The lowest bits of a number, the lowest first."""
    if count <= 8:
        return _BITS_OF[value & 0xFF][:count]
    found = b"".join([_BITS_OF[value >> bit & 0xFF] for bit in range(0, count, 8)])
    return found[:count]


def _group_reader(machine: Machine, operand: Operand) -> Reader:
    bits, at = machine.bits[operand.letter], operand.address
    count = 4 * operand.groups
    if operand.index is None:
        end = at + count
        four, eight, of_four, of_eight = _FOUR.unpack_from, _EIGHT.unpack_from, _OF_FOUR, _OF_EIGHT
        if count == 4:
            return lambda: of_four[four(bits, at)]
        if count == 8:
            return lambda: of_eight[eight(bits, at)]
        if count == 16:
            above = at + 8
            return lambda: of_eight[eight(bits, at)] | of_eight[eight(bits, above)] << 8
        return lambda: int(bits[at:end][::-1].translate(_AS_DIGITS), 2)
    find = locate(machine, operand, count, word=False)

    def read() -> int:
        first = find()
        return pack(bits[first : first + count])

    return read


def _group_writer(machine: Machine, operand: Operand) -> Writer:
    bits, at = machine.bits[operand.letter], operand.address
    count = 4 * operand.groups
    if operand.index is None:
        # A view's slice takes bytes in a fifth of the time that the array's own takes.
        view, group = memoryview(bits), slice(at, at + count)
        if count <= 8:
            table = [pattern[:count] for pattern in _BITS_OF]

            def write_few(value: int) -> None:
                view[group] = table[value & 0xFF]

            return write_few

        def write(value: int) -> None:
            view[group] = spread(value, count)

        return write
    find = locate(machine, operand, count, word=False)

    def write_found(value: int) -> None:
        first = find()
        bits[first : first + count] = spread(value, count)

    return write_found

"""ADD SUB MUL DIV INC DEC NEG CMP ZCP on signed 16- and 32-bit values.

FX programming manual, FNC 10, 11, 20–25 and 29.
ADD and SUB set M8020 (0 is stored), M8021 (the result is below the least value) and M8022 (above the
greatest). A result beyond a limit keeps the sign of that limit: what follows 32767 is 0, 1, 2 …, and what
lies below -32768 is 0, -1, -2 … (notes on ADD, and its comparison with INC and DEC). INC and DEC wrap round
and touch no flag. DIV drops the fraction; the remainder has the sign of the dividend. A division by 0, or
of the least value by -1, is an error (6706).
"""

from collections.abc import Callable

from bussim.plc.memory import FIRST_LONG_COUNTER
from bussim.plc.program.compiled.access import Writer, locate, reader, value_reader, writer
from bussim.plc.program.machine import BORROW, CARRY, ZERO, Act, Machine, OperationError
from bussim.plc.program.text.catalog import Instruction
from bussim.plc.program.text.operands import Operand


def add(machine: Machine, at: Instruction) -> Act:
    """ADD and SUB."""
    wide, sign = at.form.wide, 1 if at.spec.name == "ADD" else -1
    first, second = (value_reader(machine, operand, wide=wide) for operand in at.operands[:2])
    write = writer(machine, at.operands[2], wide=wide)
    flags = machine.bits["M"]
    most = 0x7FFFFFFF if wide else 0x7FFF

    def act() -> None:
        total = first() + sign * second()
        write(_kept(total, most))  # where it does not fit, the flags stay as they are
        stored(flags, total, most)

    return act


def _kept(total: int, most: int) -> int:
    if total > most:
        return total - most - 1
    return total + most + 2 if total < -most - 1 else total


def stored(flags: bytearray, total: int, most: int = 0x7FFF) -> int:
    """What ADD and SUB store of a result, whose greatest value is ``most``; sets the flags."""
    kept = _kept(total, most)
    flags[ZERO] = not kept
    flags[BORROW] = total < -most - 1
    flags[CARRY] = total > most
    return kept


def step(machine: Machine, at: Instruction) -> Act:
    """INC and DEC."""
    target = at.operands[0]
    by = 1 if at.spec.name == "INC" else -1
    read = reader(machine, target, wide=at.form.wide)
    write = writer(machine, target, wide=at.form.wide)
    return lambda: write(read() + by)


def negate(machine: Machine, at: Instruction) -> Act:
    """NEG: two's complement; the least value stays as it is."""
    read = reader(machine, at.operands[0], wide=at.form.wide)
    write = writer(machine, at.operands[0], wide=at.form.wide)
    return lambda: write(-read())


def multiply(machine: Machine, at: Instruction) -> Act:
    """MUL: a product of twice the width, low word first; of a group's destination the bits that fit it."""
    wide = at.form.wide
    first, second = (value_reader(machine, operand, wide=wide) for operand in at.operands[:2])
    target = at.operands[2]
    write = (
        writer(machine, target, wide=True) if target.groups else _double_writer(machine, target, wide=wide)
    )
    return lambda: write(first() * second())


def divide(machine: Machine, at: Instruction) -> Act:
    """DIV: quotient, then remainder; a group's destination takes the quotient only."""
    wide = at.form.wide
    first, second = (value_reader(machine, operand, wide=wide) for operand in at.operands[:2])
    target = at.operands[2]
    bits = 32 if wide else 16
    if target.groups:
        write, kept = writer(machine, target, wide=wide), 0
    else:
        write, kept = _double_writer(machine, target, wide=wide), 1
    mask = (1 << bits) - 1

    def act() -> None:
        dividend, divisor = first(), second()
        if not divisor:
            raise OperationError
        quotient = abs(dividend) // abs(divisor)
        if (dividend < 0) != (divisor < 0):
            quotient = -quotient
        if quotient > mask >> 1:
            raise OperationError
        remainder = dividend - quotient * divisor
        write(quotient & mask | (remainder & mask) << bits if kept else quotient)

    return act


def _double_writer(machine: Machine, target: Operand, *, wide: bool) -> Writer:
    """Writes a pattern of twice the width into consecutive words, or into two 32-bit counters."""
    words = machine.words[target.letter]
    size = 32 if target.kind == "C" and target.address >= FIRST_LONG_COUNTER else 16
    count = (64 if wide else 32) // size
    mask = (1 << size) - 1
    find = locate(machine, target, count, word=True)

    def write(pattern: int) -> None:
        at = find()
        for number in range(count):
            words[at + number] = pattern >> size * number & mask

    return write


def compare(machine: Machine, at: Instruction) -> Act:
    """CMP: three bits say whether the first value is above, equal to or below the second."""
    first, second = (value_reader(machine, operand, wide=at.form.wide) for operand in at.operands[:2])
    set_bits = _three_bits(machine, at.operands[2])

    def act() -> None:
        one, other = first(), second()
        set_bits(one > other, one == other, one < other)

    return act


def compare_zone(machine: Machine, at: Instruction) -> Act:
    """ZCP: three bits say whether a value is below, within or above two limits (both included).

    Where the lower limit is above the upper one, the upper one counts as the same.
    """
    wide = at.form.wide
    lower, upper, source = (value_reader(machine, operand, wide=wide) for operand in at.operands[:3])
    set_bits = _three_bits(machine, at.operands[3])

    def act() -> None:
        low, high, value = lower(), upper(), source()
        high = max(low, high)
        set_bits(value < low, low <= value <= high, value > high)

    return act


def _three_bits(machine: Machine, target: Operand) -> Callable[[int, int, int], None]:
    bits = machine.bits[target.letter]
    find = locate(machine, target, 3, word=False)

    def set_bits(first: int, second: int, third: int) -> None:
        first_bit = find()
        bits[first_bit], bits[first_bit + 1], bits[first_bit + 2] = first, second, third

    return set_bits

"""ROR ROL SFTR SFTL ALT ZRST: bits in words and in rows (FX, FNC 30, 31, 34, 35, 40, 66)."""

from array import array

from bussim.plc.program.compiled.access import locate, reader, writer
from bussim.plc.program.instructions.coils import reset
from bussim.plc.program.machine import CARRY, Act, Machine
from bussim.plc.program.text.catalog import Instruction


def rotate(machine: Machine, at: Instruction) -> Act:
    """ROR and ROL: rotate a word by n bits; M8022 is the last bit that went round."""
    target, amount = at.operands
    wide = at.form.wide
    size = 32 if wide else 16
    mask = (1 << size) - 1
    turns = amount.address % size
    left = turns if at.spec.name == "ROL" else (size - turns) % size
    # The last bit that went round has come in at the other end.
    carry = 0 if at.spec.name == "ROL" else size - 1
    read, write = reader(machine, target, wide=wide), writer(machine, target, wide=wide)
    flags = machine.bits["M"]

    def act() -> None:
        pattern = read()
        pattern = (pattern << left | pattern >> size - left) & mask
        write(pattern)
        flags[CARRY] = pattern >> carry & 1

    return act


def shift(machine: Machine, at: Instruction) -> Act:
    """SFTR and SFTL: a row of n1 bits moves by n2, and n2 bits from the source follow.

    SFTR: towards the lowest address, the source coming in at the top; SFTL: towards the highest.
    """
    source, target, length, step = at.operands
    entering, row = machine.bits[source.letter], machine.bits[target.letter]
    count, by = length.address, step.address
    find_source = locate(machine, source, by, word=False)
    find_row = locate(machine, target, count, word=False)
    right = at.spec.name == "SFTR"
    spent, time = machine.spent, machine.times.each * count

    def act() -> None:
        first, begin = find_source(), find_row()
        new = entering[first : first + by]
        if right:
            row[begin : begin + count] = row[begin + by : begin + count] + new
        else:
            row[begin : begin + count] = new + row[begin : begin + count - by]
        spent[0] += time

    return act


def alternate(machine: Machine, at: Instruction) -> Act:
    """ALT: a bit changes over, in every scan in which the condition is on (ALTP: once)."""
    target = at.operands[0]
    bits = machine.bits[target.letter]
    find = locate(machine, target, 1, word=False)

    def act() -> None:
        bit = find()
        bits[bit] ^= 1

    return act


def reset_zone(machine: Machine, at: Instruction) -> Act:
    """ZRST: everything from one device to another; only the first one where it lies above the last."""
    first, last = at.operands
    start, end = first.address, max(first.address, last.address)
    spent, time = machine.spent, machine.times.each * (end - start + 1)
    if first.kind in ("T", "C"):
        clear = reset(machine, first.letter, start, end)
    elif first.kind == "D":
        words, zeros = machine.words[first.letter], array("H", bytes(2 * (end - start + 1)))

        def clear() -> None:
            words[start : end + 1] = zeros

    else:
        bits, nothing = machine.bits[first.letter], bytes(end - start + 1)

        def clear() -> None:
            bits[start : end + 1] = nothing

    def act() -> None:
        clear()
        spent[0] += time

    return act

"""MOV CML XCH BMOV FMOV BCD BIN and the logic of words (FX programming manual, FNC 12–19, 26–28).

Not simulated: M8160, which makes XCH swap bytes. Where the manual is silent, assumed: a BMOV that M8024
reverses has the limits of one that is written the other way round, and X cannot be its destination.
"""

import operator
from collections.abc import Callable

from bussim.plc.memory import FIRST_LONG_COUNTER
from bussim.plc.program.compiled.access import finder, pack, reader, spread, value_reader, writer
from bussim.plc.program.machine import BACKWARDS, Act, Machine, OperationError
from bussim.plc.program.text.catalog import Instruction
from bussim.plc.program.text.operands import Operand


def move(machine: Machine, at: Instruction) -> Act:
    """MOV: the source into the destination; CML: all its bits inverted."""
    source, target = at.operands
    wide = at.form.wide
    inverted = 0 if at.spec.name == "MOV" else (0xFFFFFFFF if wide else 0xFFFF)
    if source.groups >= target.groups > 0 and not inverted and source.index is None and target.index is None:
        return _copy_group(machine, source, target)
    read, write = reader(machine, source, wide=wide), writer(machine, target, wide=wide)
    if inverted:
        return lambda: write(read() ^ inverted)
    return lambda: write(read())


def _copy_group(machine: Machine, source: Operand, target: Operand) -> Act:
    bits, view = machine.bits[source.letter], memoryview(machine.bits[target.letter])
    count = 4 * target.groups
    here, there = (slice(operand.address, operand.address + count) for operand in (source, target))

    def copy() -> None:
        view[there] = bits[here]

    return copy


def exchange(machine: Machine, at: Instruction) -> Act:
    """XCH: two words change places."""
    first, second = at.operands
    wide = at.form.wide
    read_first, read_second = reader(machine, first, wide=wide), reader(machine, second, wide=wide)
    write_first, write_second = writer(machine, first, wide=wide), writer(machine, second, wide=wide)

    def act() -> None:
        one, other = read_first(), read_second()
        write_first(other)
        write_second(one)

    def register_last() -> None:
        one, other = read_first(), read_second()
        write_second(one)
        write_first(other)

    # A register that the other operand is indexed with must not move it half-way.
    return register_last if first.kind in ("V", "Z") else act


def logic(machine: Machine, at: Instruction) -> Act:
    """WAND WOR WXOR."""
    wide = at.form.wide
    combine = _LOGIC[at.spec.name]
    first, second = (reader(machine, operand, wide=wide) for operand in at.operands[:2])
    write = writer(machine, at.operands[2], wide=wide)
    return lambda: write(combine(first(), second()))


_LOGIC: dict[str, Callable[[int, int], int]] = {
    "WAND": operator.and_,
    "WOR": operator.or_,
    "WXOR": operator.xor,
}


def to_bcd(machine: Machine, at: Instruction) -> Act:
    """BCD: a value 0…9999 (D form: 0…99999999) into decimal digits of four bits; others are errors."""
    wide = at.form.wide
    read = value_reader(machine, at.operands[0], wide=wide)
    write = writer(machine, at.operands[1], wide=wide)
    limit = 99_999_999 if wide else 9999

    def act() -> None:
        value = read()
        if not 0 <= value <= limit:
            raise OperationError
        write(int(str(value), 16))

    return act


def from_bcd(machine: Machine, at: Instruction) -> Act:
    """BIN: decimal digits of four bits into their value; a digit over 9 is an error."""
    wide = at.form.wide
    read = reader(machine, at.operands[0], wide=wide)
    write = writer(machine, at.operands[1], wide=wide)

    def act() -> None:
        digits = f"{read():x}"
        if not digits.isdecimal():
            raise OperationError
        write(int(digits))

    return act


# -- blocks ----------------------------------------------------------------------------------------


def count_reader(machine: Machine, operand: Operand, low: int, high: int) -> Callable[[], int]:
    """Reads a count; one beyond its limits is an error."""
    read = value_reader(machine, operand)

    def count() -> int:
        number = read()
        if low <= number <= high:
            return number
        raise OperationError

    return count


def block_reader(machine: Machine, operand: Operand, *, wide: bool = False) -> Callable[[int], list[int]]:
    """Reads so many patterns from an operand on: consecutive words or pairs, or groups one after another."""
    if operand.groups:
        bits, size = machine.bits[operand.letter], 4 * operand.groups
        find_bits = finder(machine, operand, word=False)

        def read_groups(count: int) -> list[int]:
            start = find_bits(size * count)
            return [pack(bits[at : at + size]) for at in range(start, start + size * count, size)]

        return read_groups
    words = machine.words[operand.letter]
    paired = wide and not (operand.kind == "C" and operand.address >= FIRST_LONG_COUNTER)
    find = finder(machine, operand, word=True)

    def read(count: int) -> list[int]:
        start = find(2 * count if paired else count)
        if paired:
            return [words[at] | words[at + 1] << 16 for at in range(start, start + 2 * count, 2)]
        return words[start : start + count].tolist()

    return read


def block_writer(machine: Machine, operand: Operand, *, wide: bool = False) -> Callable[[list[int]], None]:
    """Writes patterns from an operand on; nothing where the last one does not fit."""
    if operand.groups:
        bits, size = machine.bits[operand.letter], 4 * operand.groups
        find_bits = finder(machine, operand, word=False)

        def write_groups(patterns: list[int]) -> None:
            start = find_bits(size * len(patterns))
            image = b"".join([spread(pattern, size) for pattern in patterns])
            bits[start : start + len(image)] = image

        return write_groups
    words = machine.words[operand.letter]
    paired = wide and not (operand.kind == "C" and operand.address >= FIRST_LONG_COUNTER)
    mask = 0xFFFFFFFF if wide and not paired else 0xFFFF
    find = finder(machine, operand, word=True)

    def write(patterns: list[int]) -> None:
        start = find(len(patterns) * (2 if paired else 1))
        if paired:
            for number, pattern in enumerate(patterns):
                words[start + 2 * number] = pattern & 0xFFFF
                words[start + 2 * number + 1] = pattern >> 16
        else:
            for number, pattern in enumerate(patterns, start):
                words[number] = pattern & mask

    return write


def move_block(machine: Machine, at: Instruction) -> Act:
    """BMOV: n words (or groups) on, as if all were read before the first is written; M8024: backwards."""
    source, target, count = at.operands
    onwards, back = (_move_block(machine, *pair, count) for pair in ((source, target), (target, source)))
    flags = machine.bits["M"]

    def act() -> None:
        if flags[BACKWARDS]:
            if source.letter == "X":
                raise OperationError
            back()
        else:
            onwards()

    return act


def _move_block(machine: Machine, source: Operand, target: Operand, count: Operand) -> Act:
    counted = count_reader(machine, count, 1, 512)
    read, write = block_reader(machine, source), block_writer(machine, target)
    spent, each = machine.spent, machine.times.each

    def act() -> None:
        number = counted()
        write(read(number))
        spent[0] += each * number

    return act


def fill(machine: Machine, at: Instruction) -> Act:
    """FMOV: one value into n words (D form: pairs) or groups."""
    source, target, count = at.operands
    wide = at.form.wide
    counted = count_reader(machine, count, 1, 512)
    read, write = reader(machine, source, wide=wide), block_writer(machine, target, wide=wide)
    spent, each = machine.spent, machine.times.each

    def act() -> None:
        number = counted()
        write([read()] * number)
        spent[0] += each * number

    return act


def mean(machine: Machine, at: Instruction) -> Act:
    """MEAN: the mean of n values, its fraction dropped (towards 0, as DIV drops it)."""
    source, target, count = at.operands
    wide = at.form.wide
    half = 0x80000000 if wide else 0x8000
    counted = count_reader(machine, count, 1, 64)
    read, write = block_reader(machine, source, wide=wide), writer(machine, target, wide=wide)
    spent, each = machine.spent, machine.times.each

    def act() -> None:
        number = counted()
        total = sum((pattern ^ half) - half for pattern in read(number))
        write(total // number if total >= 0 else -(-total // number))
        spent[0] += each * number

    return act

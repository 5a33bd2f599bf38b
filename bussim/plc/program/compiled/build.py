"""Binds a program to a machine: its blocks as functions on the memory's arrays."""

import operator
from collections.abc import Callable
from typing import Any

from bussim.plc.program.compiled.access import locate, value_reader
from bussim.plc.program.compiled.code import ARRAYS, WORD_ARRAYS, compiled, is_bound_coil, needs_function
from bussim.plc.program.instructions import arithmetic, coils, moves, serial, shifts
from bussim.plc.program.machine import Act, Machine, OperationError, Take
from bussim.plc.program.program import Program
from bussim.plc.program.text.catalog import Flow, Instruction
from bussim.plc.program.text.operand_checks import INDEXED_COILS

#: Carries a block out; returns the number of the next one, or END.
Block = Callable[[], int]

#: Bind an instruction to a machine; of an applied one only what it does while it is on.
APPLIED: dict[str, Callable[[Machine, Instruction], Act]] = {
    "MOV": moves.move,
    "CML": moves.move,
    "XCH": moves.exchange,
    "BMOV": moves.move_block,
    "FMOV": moves.fill,
    "BCD": moves.to_bcd,
    "BIN": moves.from_bcd,
    "WAND": moves.logic,
    "WOR": moves.logic,
    "WXOR": moves.logic,
    "MEAN": moves.mean,
    "ADD": arithmetic.add,
    "SUB": arithmetic.add,
    "MUL": arithmetic.multiply,
    "DIV": arithmetic.divide,
    "INC": arithmetic.step,
    "DEC": arithmetic.step,
    "NEG": arithmetic.negate,
    "CMP": arithmetic.compare,
    "ZCP": arithmetic.compare_zone,
    "ROR": shifts.rotate,
    "ROL": shifts.rotate,
    "SFTR": shifts.shift,
    "SFTL": shifts.shift,
    "ALT": shifts.alternate,
    "ZRST": shifts.reset_zone,
    "RS": serial.drive,
    "RS2": serial.drive,
    "CPAVL": serial.set_up,
}

_COMPARE: dict[str, Callable[[int, int], bool]] = {
    "=": operator.eq,
    "<>": operator.ne,
    ">": operator.gt,
    "<": operator.lt,
    "<=": operator.le,
    ">=": operator.ge,
}


def blocks(program: Program, machine: Machine, **flow: object) -> list[Block]:
    """A program's blocks on a machine. ``flow``: what its jumps use (call, calls, loops, watch)."""
    arrays = {WORD_ARRAYS[letter]: words for letter, words in machine.words.items()}
    state = {name: getattr(machine, name) for name in ARRAYS if hasattr(machine, name)}
    names: dict[str, Any] = machine.bits | arrays | state | flow | {"stored": arithmetic.stored}
    for at in program.instructions:
        names |= _functions(machine, at)
    # The text is made of numbers and of names that this package chooses.
    exec(compiled(program, machine.times), names)  # noqa: S102
    return [names[f"block_{number}"] for number in range(len(program.blocks))]


def _functions(machine: Machine, at: Instruction) -> dict[str, Callable[..., object]]:
    """What the blocks call of an instruction, by its name there."""
    if at.spec.is_applied and needs_function(at):
        act = APPLIED[at.spec.name](machine, at)
        return {f"act_{at.number}": _guarded(machine, at, act)}
    if at.spec.group == "comparison" and needs_function(at):
        first, second = (value_reader(machine, operand, wide=at.form.wide) for operand in at.operands)
        compare = _COMPARE[at.spec.test]
        return {f"test_{at.number}": _guarded(machine, at, lambda: compare(first(), second()))}
    if at.spec.test and at.spec.group == "basic" and at.operands[0].index is not None:
        find, bits = locate(machine, at.operands[0], 1, word=False), machine.bits[at.operands[0].letter]
        off = at.spec.test == "off"
        return {f"test_{at.number}": _guarded(machine, at, lambda: bits[find()] ^ off)}
    if at.spec.flow is Flow.FOR:
        return {f"count_{at.number}": _guarded(machine, at, value_reader(machine, at.operands[0]))}
    if at.name in INDEXED_COILS and at.operands[0].index is not None:
        return {f"take_{at.number}": _indexed_coil(machine, at)}
    return {f"take_{at.number}": coils.bind(machine, at)} if is_bound_coil(at) else {}


def _indexed_coil(machine: Machine, at: Instruction) -> Take:
    find, bits = locate(machine, at.operands[0], 1, word=False), machine.bits[at.operands[0].letter]

    def take(on: int) -> None:
        try:
            if on or at.name == "OUT":
                bits[find()] = at.name != "RST" and on
        except OperationError as error:
            machine.fail(error.code, at.step)

    return take


def _guarded(machine: Machine, at: Instruction, function: Callable[[], object]) -> Callable[[], object]:
    """A function whose operation error is the machine's, and then returns 0; itself if it has none."""
    if not at.spec.fallible and all(operand.index is None for operand in at.operands):
        return function

    def guarded() -> object:
        try:
            return function()
        except OperationError as error:
            machine.fail(error.code, at.step)
            return 0

    return guarded

"""Printed step numbers against those that the instructions themselves make."""

from itertools import pairwise
from typing import NamedTuple

from bussim.plc.memory import FIRST_SPECIAL
from bussim.plc.program.text.catalog import Instruction
from bussim.plc.program.text.unsimulated import SKIPPED

#: The first M with which a contact or coil takes more steps on some PLCs (from memory, assumed).
_FIRST_LONG_M = 1536


class Printed(NamedTuple):
    """A step number as a line has it, and the number of the instruction behind it."""

    step: int
    instruction: int
    line: int
    column: int


def misnumbered(printed: list[Printed], program: list[Instruction]) -> tuple[Printed, int] | None:
    """The first printed step that is not the one that follows, and that one; None where there is none.

    Numbers of lines, all as far apart, are no steps. Behind an instruction whose steps are assumed the
    count begins anew at the next printed number.
    """
    apart = {after.step - before.step for before, after in pairwise(printed)}
    if not printed or (len(apart) == 1 and printed[0].step <= max(apart)):
        return None
    offset = before = 0
    for each in printed:
        step = program[each.instruction].step if each.instruction < len(program) else None
        if step is None:
            break
        if any(_is_assumed(at) for at in program[before : each.instruction]):
            offset = each.step - step
        elif each.step != step + offset:
            return each, step + offset
        before = each.instruction
    return None


def _is_assumed(at: Instruction) -> bool:
    """Whether its number of steps is assumed: what is skipped, and what only some PLCs have."""
    return at.spec.name == SKIPPED.name or any(
        operand.kind == "D.b"
        or (at.spec.group == "basic" and operand.index is not None)
        or (operand.letter == "M" and _FIRST_LONG_M <= operand.address < FIRST_SPECIAL)
        or (operand.letter == "S" and operand.address >= 1000)
        for operand in at.operands
    )

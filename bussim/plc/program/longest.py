"""The longest time that one scan of a program can take, as far as its text determines it."""

from bussim.plc.program.compiled.code import standing_time, time_when_on
from bussim.plc.program.instruction_times import InstructionTimes, ticks_of
from bussim.plc.program.program import Program
from bussim.plc.program.text.catalog import Instruction
from bussim.plc.program.text.operand_checks import slots_of

_BY_DEVICES = frozenset(("BMOV", "FMOV", "MEAN", "SFTR", "SFTL", "ZRST"))


def longest_scan(program: Program, times: InstructionTimes) -> int | None:
    """Ticks that the instructions of one scan take at most: all of them carried out, once each.

    Jumps forwards leave some out. None for a program with loops, subroutines or a jump backwards, whose
    time only the watchdog bounds.
    """
    flows = [at.spec.flow for at in program.instructions]
    if any(flow is not None and flow.returns for flow in flows):
        return None
    for here, block in enumerate(program.blocks):
        at = block.exit
        if at is not None and at.flow.has_target and 0 <= block.target <= here:
            return None
    total = sum(
        max(standing_time(times, at), time_when_on(times, at)) + times.each * _devices(at)
        for at in program.instructions
    )
    return ticks_of(total)


def _devices(at: Instruction) -> int:
    """How many devices an instruction is charged for, at most."""
    if at.spec.name not in _BY_DEVICES:
        return 0
    if at.spec.name == "ZRST":
        first, last = at.operands
        return max(1, last.address - first.address + 1)
    counts = {"BMOV": "n", "FMOV": "n", "MEAN": "n", "SFTR": "n1", "SFTL": "n1"}
    for slot, operand in zip(slots_of(at.form, at.operands), at.operands, strict=True):
        if slot.name == counts[at.spec.name]:
            most = slot.limits[1] if slot.limits is not None else 0
            return operand.constant if operand.constant is not None else most
    return 0

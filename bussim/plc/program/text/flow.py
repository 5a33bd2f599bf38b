"""Where a program jumps: labels, CJ, CALL and SRET, FOR and NEXT, FEND and END.

The checks, and the program cut into blocks that are carried out from their head to their end.
"""

from dataclasses import dataclass, field
from typing import assert_never

from bussim.errors import Problem
from bussim.plc.program.text.catalog import Flow, Instruction
from bussim.plc.program.text.ladder import Control, Rung
from bussim.plc.program.text.operands import END_LABEL
from bussim.words.language import say

#: FX programming manual: FOR and CALL may be nested five deep.
MAX_LOOPS = 5
MAX_CALLS = 5


class FlowCheck:
    """What is wrong with a program's jumps, as ``problems``."""

    def __init__(self, instructions: list[Instruction], name: str) -> None:
        self.problems: list[Problem] = []
        self._name = name
        self._instructions = instructions
        self._main_end = next((at.number for at in instructions if at.spec.flow is Flow.FEND), None)
        self._ends()
        self._jumps(self._labels())
        self._loops()

    def _wrong(self, at: Instruction, message: str) -> None:
        self.problems.append(Problem(self._name, at.line, at.column, message))

    def _ends(self) -> None:
        program = self._instructions
        end = next((at.number for at in program if at.spec.flow is Flow.END), None)
        if end is None:
            last = program[-1] if program else None
            position = (last.line, last.column) if last is not None else (1, 1)
            message = say("program_no_end" if program else "program_empty")
            self.problems.append(Problem(self._name, *position, message))
        elif end + 1 < len(program):
            self._wrong(program[end + 1], say("program_after_end", program=program[end + 1].name))

    def _labels(self) -> dict[int, Instruction]:
        labels: dict[int, Instruction] = {}
        for at in self._instructions:
            if at.spec.flow is not Flow.LABEL or not at.operands:
                continue
            number = at.operands[0].address
            if number == END_LABEL:
                self._wrong(at, say("program_p63", label=END_LABEL))
            elif number in labels:
                self._wrong(at, say("program_label_twice", label=number, line=_line(labels[number])))
            else:
                labels[number] = at
        return labels

    def _jumps(self, labels: dict[int, Instruction]) -> None:
        for at in self._instructions:
            flow = at.spec.flow
            if flow is Flow.SRET and (self._main_end is None or at.number < self._main_end):
                self._wrong(at, say("program_sret"))
            if flow is None or not flow.has_target or not at.operands:
                continue
            number = at.operands[0].address
            target = labels.get(number)
            if number == END_LABEL and not flow.returns:
                continue
            if target is None:
                known = ", ".join(f"P{label}" for label in sorted(labels)) or say("program_none")
                self._wrong(at, say("program_no_label", at=at.name, number=number, known=known))
            elif flow.returns:
                self._subroutine(at, target)

    def _subroutine(self, call: Instruction, label: Instruction) -> None:
        what = say("program_subroutine", call=call.name, label=call.operands[0].address, line=_line(label))
        if self._main_end is None or label.number < self._main_end:
            self._wrong(call, say("program_between", what=what))
        elif all(at.spec.flow is not Flow.SRET for at in self._instructions[label.number :]):
            self._wrong(call, say("program_no_sret", what=what))

    def _loops(self) -> None:
        loops: list[Instruction] = []
        for at in self._instructions:
            match at.spec.flow:
                case Flow.FOR:
                    loops.append(at)
                    if len(loops) > MAX_LOOPS:
                        self._wrong(at, say("program_for_deep", loops=len(loops), max_loops=MAX_LOOPS))
                case Flow.NEXT:
                    if not loops:
                        self._wrong(at, say("program_next"))
                    else:
                        loops.pop()
                case Flow.FEND | Flow.END | Flow.SRET:
                    for opened in loops:
                        self._wrong(opened, say("program_for", at=at.name))
                    loops.clear()
                case (
                    None
                    | Flow.CJ
                    | Flow.CALL
                    | Flow.WDT
                    | Flow.MC
                    | Flow.MCR
                    | Flow.LABEL
                    | Flow.STL
                    | Flow.RET
                ):
                    pass
                case flow:
                    assert_never(flow)


def _line(at: Instruction) -> str:
    return f"at line {at.line}"


@dataclass(slots=True)
class BasicBlock:
    """Rungs that are carried out one after the other, and what then decides where to go on.

    ``exit`` is None where the program goes on with the next block. ``target`` is the block that
    the exit names: of a jump its label, of FOR what follows its NEXT, of NEXT what follows its FOR;
    of STL the next step or RET; -1 is the end of the scan. ``instructions`` are all of the block's, for
    their times.
    """

    rungs: list[Rung | Control] = field(default_factory=list)
    exit: Control | None = None
    target: int = -1
    instructions: list[Instruction] = field(default_factory=list)


def cut(items: list[Rung | Control], instructions: list[Instruction]) -> list[BasicBlock]:
    """A checked program in blocks, in the order of its text. The first one begins the scan."""
    blocks = [BasicBlock()]
    labels: dict[int, int] = {END_LABEL: -1}
    loops: list[int] = []
    steps: list[int] = []  # the blocks that an STL ends and whose next step was not met yet
    opened: dict[int, int] = {}  # of each NEXT's block, its FOR's
    cuts = []  # (number of the first instruction of the next block)
    for item in items:
        if isinstance(item, Rung):
            blocks[-1].rungs.append(item)
            continue
        at, here = item.instruction, len(blocks) - 1
        match item.flow:
            case Flow.MC | Flow.MCR:
                blocks[here].rungs.append(item)
                continue
            case Flow.LABEL:
                cuts.append(at.number)
                blocks.append(BasicBlock())
                labels[at.operands[0].address] = here + 1
                continue
            case Flow.STL | Flow.RET:
                cuts.append(at.number)
                blocks.append(BasicBlock())
                here += 1
                if item.level is None or item.flow is Flow.RET:
                    for step in steps:
                        blocks[step].target = here
                    steps.clear()
                steps.append(here)
            case Flow.FOR:
                loops.append(here)
            case Flow.NEXT:
                opened[here] = loops.pop()
            case Flow.CJ | Flow.CALL | Flow.WDT | Flow.SRET | Flow.FEND | Flow.END:
                pass
            case flow:
                assert_never(flow)
        blocks[here].exit = item
        cuts.append(at.number + 1)
        blocks.append(BasicBlock())
    for block in blocks:
        if block.exit is not None and block.exit.flow.has_target:
            block.target = labels[block.exit.instruction.operands[0].address]
    for here, start in opened.items():
        blocks[here].target = start + 1
        blocks[start].target = here + 1
    bounds = [0, *cuts, len(instructions)]
    for block, first, end in zip(blocks, bounds, bounds[1:], strict=False):
        block.instructions = instructions[first:end]
    return blocks

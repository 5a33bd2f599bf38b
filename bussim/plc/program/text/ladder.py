"""Turns the contacts of an instruction list into conditions, and says where the ladder is broken.

An instruction list is a ladder read for a machine with one accumulator and two stacks: LD pushes the
accumulator and loads a contact, ANB and ORB pop and combine, MPS MRD MPP keep it for branches. An
output leaves it as it was, so that further outputs and contacts may follow on the same rung; the LD
after an output begins a new rung, unless an ANB or ORB asks for what was there before.
Carried out here once, on expressions instead of values.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import assert_never

from bussim.errors import Problem
from bussim.plc.program.text.catalog import FORMS, Flow, Instruction, LadderRole
from bussim.plc.program.text.operands import parse_operand
from bussim.words.language import say

#: FX programming manual: at most eight LD blocks wait for ANB or ORB, eleven MPS for MPP.
MAX_BLOCKS = 8
MAX_BRANCHES = 11
#: The level of rungs in a step, beside those of MC.
STEP_LEVEL = 8
#: The contact of a rung that begins at its step; M8000 is always on.
_ALWAYS = (parse_operand("M8000", 0),)
#: Contacts of one condition, ours: far beyond what a screen shows, and Python's brackets nest no deeper.
MAX_CONTACTS = 200


@dataclass(frozen=True, slots=True)
class Contact:
    """A contact of a device, or a comparison, as its instruction says."""

    instruction: Instruction


@dataclass(frozen=True, slots=True)
class Not:
    """INV."""

    part: Condition


@dataclass(frozen=True, slots=True)
class Both:
    """A series of two."""

    first: Condition
    second: Condition


@dataclass(frozen=True, slots=True)
class Either:
    """Two in parallel."""

    first: Condition
    second: Condition


@dataclass(frozen=True, slots=True, eq=False)
class Saved:
    """What the condition of an earlier rung was when it was carried out."""

    rung: Rung


Condition = Contact | Not | Both | Either | Saved


@dataclass(slots=True, eq=False)
class Rung:
    """Outputs with one condition, in order.

    ``level``: the MC that it stands under, or STEP_LEVEL; ``steps``: the states of the step then.
    """

    condition: Condition
    level: int | None
    outputs: list[Instruction] = field(default_factory=list)
    steps: tuple[int, ...] = ()


@dataclass(slots=True, eq=False)
class Control:
    """An instruction that ends or begins a block of the program: a jump, a label, FOR, END and the like."""

    instruction: Instruction
    condition: Condition | None
    level: int | None

    @property
    def flow(self) -> Flow:
        """What it is to the program's course."""
        found = self.instruction.spec.flow
        if found is None:
            raise ValueError(f"{self.instruction.name} does not change the program's course")
        return found

    @property
    def driven_by(self) -> Condition:
        """The condition of one that has one."""
        if self.condition is None:
            raise ValueError(f"{self.instruction.name} has no condition")
        return self.condition


class Ladder:
    """The rungs and jumps of a program in order (``items``), and what is wrong with its ladder."""

    def __init__(self, instructions: list[Instruction], gaps: set[int], name: str) -> None:
        self.items: list[Rung | Control] = []
        self.problems: list[Problem] = []
        self._name = name
        self._accumulator: Condition | None = None
        self._finished = False  # an output has used the accumulator
        self._before: Condition | None = None  # the finished one that the latest LD left behind
        self._branches_before = 0  # how many branches were open then
        self._blocks: list[tuple[Condition, Instruction]] = []
        self._branches: list[tuple[Condition, Instruction]] = []
        self._idle: Instruction | None = None  # the first contact that has driven nothing yet
        self._length = 0  # contacts of the accumulator since it was last kept
        self._unsure = False  # a line could not be read: blame nothing on it
        self._levels: list[tuple[int, Instruction]] = []
        self._steps: tuple[int, ...] = ()
        self._step: Instruction | None = None  # the latest STL, in front of its RET
        for instruction in instructions:
            if instruction.number in gaps:
                self._unsure = True
            self._take(instruction)
        if self._step is not None:
            self._wrong(self._step, say("program_stl"))
        for _, opened in self._levels:
            self._wrong(opened, say("program_mc"))

    def _wrong(self, instruction: Instruction, message: str) -> None:
        if not self._unsure:
            self.problems.append(Problem(self._name, instruction.line, instruction.column, message))

    @property
    def _level(self) -> int | None:
        if self._step is not None:
            return STEP_LEVEL
        return self._levels[-1][0] if self._levels else None

    def _take(self, instruction: Instruction) -> None:
        match instruction.spec.role:
            case LadderRole.CONTACT:
                self._contact(instruction)
            case LadderRole.BLOCK:
                self._block(instruction)
            case LadderRole.OUTPUT:
                self._output(instruction)
            case LadderRole.BARE:
                self._bare(instruction)
            case LadderRole.NOTHING:
                pass
            case role:
                assert_never(role)

    # -- contacts ----------------------------------------------------------------------------------

    def _longer(self, instruction: Instruction) -> None:
        self._length += 1
        if self._length == MAX_CONTACTS + 1:
            self._wrong(instruction, say("program_contacts", max_contacts=MAX_CONTACTS))

    def _contact(self, instruction: Instruction) -> None:
        self._longer(instruction)
        contact = Contact(instruction)
        join = instruction.spec.join
        if join == "LD":
            self._load(contact, instruction)
        elif self._accumulator is None:
            self._wrong(instruction, say("program_needs_ld", instruction=instruction.name))
            self._accumulator = contact
        elif join == "AND":
            self._accumulator = Both(self._accumulator, contact)
        else:
            self._accumulator = Either(self._accumulator, contact)
        self._finished = False
        if self._idle is None:
            self._idle = instruction

    def _load(self, contact: Contact, instruction: Instruction) -> None:
        if self._finished:
            self._unsure = False  # a new rung, whatever was before
            self._before, self._branches_before = self._accumulator, len(self._branches)
            self._length = 1
        elif self._accumulator is not None:
            self._blocks.append((self._accumulator, instruction))
            if len(self._blocks) > MAX_BLOCKS:
                self._wrong(instruction, say("program_wait", max_blocks=MAX_BLOCKS))
        self._accumulator = contact

    def _block(self, instruction: Instruction) -> None:
        name = instruction.name
        if name in ("ANB", "ORB"):
            self._combine(instruction)
        elif name in ("MRD", "MPP"):
            self._branch(instruction)
        elif self._accumulator is None:
            self._wrong(instruction, say("program_needs_contact", name=name))
        elif name == "INV":
            self._longer(instruction)
            self._accumulator, self._finished = Not(self._accumulator), False
        else:
            if len(self._branches) >= MAX_BRANCHES:
                self._wrong(instruction, say("program_mps_open", max_branches=MAX_BRANCHES))
            self._keep()
            self._branches.append((self._accumulator, instruction))
            self._finished, self._idle, self._length = False, None, 0

    def _combine(self, instruction: Instruction) -> None:
        latest = self._accumulator
        if latest is not None and self._blocks:
            earlier = self._blocks.pop()[0]
        elif latest is not None and self._before is not None:
            earlier, self._before = self._before, None
        else:
            self._wrong(instruction, say("program_two_blocks", instruction=instruction.name))
            return
        self._accumulator = Both(earlier, latest) if instruction.name == "ANB" else Either(earlier, latest)

    def _branch(self, instruction: Instruction) -> None:
        if not self._branches:
            self._wrong(instruction, say("program_without_mps", instruction=instruction.name))
            return
        self._nothing_idle()
        self._accumulator = self._branches[-1][0]
        if instruction.name == "MPP":
            self._branches.pop()
        self._finished, self._before, self._length = False, None, 0
        self._blocks.clear()

    # -- outputs -----------------------------------------------------------------------------------

    def _keep(self) -> None:
        """Make the accumulator something that can be asked for again: its value, not its contacts."""
        if self._accumulator is not None and not isinstance(self._accumulator, Saved):
            rung = Rung(self._accumulator, self._level, steps=self._steps)
            self.items.append(rung)
            self._accumulator = Saved(rung)

    def _output(self, instruction: Instruction) -> None:
        self._close_rungs(instruction)
        if self._accumulator is None:
            self._wrong(instruction, say("program_needs_such", instruction=instruction.name))
            return
        flow = instruction.spec.flow
        if flow is not None:
            self._keep()
            self.items.append(Control(instruction, self._accumulator, self._level))
        else:
            self._drive(instruction, self._accumulator)
        self._finished, self._idle, self._length = True, None, 0
        if flow is Flow.MC:
            self._master(instruction)

    def _drive(self, instruction: Instruction, accumulator: Condition) -> None:
        last = self.items[-1] if self.items else None
        if isinstance(accumulator, Saved):
            if not isinstance(last, Rung) or (
                last is not accumulator.rung and last.condition is not accumulator
            ):
                last = Rung(accumulator, self._level, steps=self._steps)
                self.items.append(last)
        else:
            last = Rung(accumulator, self._level, steps=self._steps)
            self.items.append(last)
            self._accumulator = Saved(last)
        last.outputs.append(instruction)

    def _close_rungs(self, instruction: Instruction) -> None:
        """At an output: every block must be joined, and the rung before must have closed its branches."""
        if self._blocks:
            count = len(self._blocks)
            self._wrong(
                instruction,
                say("program_block" if count == 1 else "program_blocks", count=count, name=instruction.name),
            )
            self._blocks.clear()
        if self._before is not None:
            for _, opened in self._branches[: self._branches_before]:
                self._wrong(opened, say("program_mps"))
            del self._branches[: self._branches_before]
            self._before = None

    def _master(self, instruction: Instruction) -> None:
        if instruction.operands:
            level = instruction.operands[0].address
            if self._levels and level <= self._levels[-1][0]:
                self._wrong(instruction, say("program_mc_inside", level=level, outer=self._levels[-1][0]))
            self._levels.append((level, instruction))
        self._reset()

    # -- what stands on the bus --------------------------------------------------------------------

    def _nothing_idle(self) -> None:
        if self._idle is not None:
            self._wrong(self._idle, say("program_idle"))
            self._idle = None

    def _reset(self) -> None:
        self._nothing_idle()
        for _, opened in self._branches:
            self._wrong(opened, say("program_mps"))
        self._branches.clear()
        self._blocks.clear()
        self._accumulator, self._before, self._finished, self._length = None, None, False, 0
        # A line that could not be read right in front of this may have been the output that is missed.
        self._unsure = False

    def _bare(self, instruction: Instruction) -> None:
        self._reset()
        if instruction.spec.flow is Flow.MCR:
            if instruction.operands:
                level = instruction.operands[0].address
                if all(opened != level for opened, _ in self._levels):
                    self._wrong(instruction, say("program_mcr", level=level))
                self._levels = [(opened, at) for opened, at in self._levels if opened < level]
            else:
                self._levels.clear()
        if instruction.name == "STL":
            self._begin_step(instruction)
            return
        if instruction.name == "RET":
            if self._step is None:
                self._wrong(instruction, say("program_ret"))
            self._step, self._steps = None, ()
        self.items.append(Control(instruction, None, self._level))

    def _begin_step(self, instruction: Instruction) -> None:
        """STL: right behind another one both states must be on; its rungs may begin without a contact."""
        joined = self._step is not None and self._step.number + 1 == instruction.number
        self.items.append(Control(instruction, None, STEP_LEVEL if joined else None))
        states = tuple(operand.address for operand in instruction.operands)
        self._step, self._steps = instruction, (*self._steps, *states) if joined else states
        always = replace(instruction, name="LD", form=FORMS["LD"], operands=_ALWAYS)
        self._accumulator, self._finished = Contact(always), True


def parts(condition: Condition) -> tuple[list[Instruction], list[Rung]]:
    """The contacts of a condition, and the earlier rungs whose level it takes."""
    contacts: list[Instruction] = []
    rungs: list[Rung] = []
    waiting = [condition]
    while waiting:
        match part := waiting.pop():
            case Contact(at):
                contacts.append(at)
            case Saved(rung):
                rungs.append(rung)
            case Not(inner):
                waiting.append(inner)
            case Both(first, second) | Either(first, second):
                waiting += [second, first]
            case _:
                assert_never(part)
    return contacts, rungs


def contacts_of(condition: Condition) -> list[Instruction]:
    """The contacts of a condition, those of the earlier rungs included whose level it takes."""
    contacts, waiting = [], [condition]
    while waiting:
        found, rungs = parts(waiting.pop(0))
        contacts += found
        waiting += [rung.condition for rung in rungs]
    return contacts

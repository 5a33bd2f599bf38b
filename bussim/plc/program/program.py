"""A checked program: its instructions, cut into blocks, with warnings."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import partial

from bussim.errors import Problem, ProgramError
from bussim.plc.memory import Device, Family
from bussim.plc.program.machine import BACKWARDS
from bussim.plc.program.text.catalog import Flow, Instruction
from bussim.plc.program.text.flow import BasicBlock, FlowCheck, cut
from bussim.plc.program.text.ladder import Ladder, Rung, contacts_of
from bussim.plc.program.text.operand_checks import Extent, extents
from bussim.plc.program.text.source import Source
from bussim.plc.program.text.specials import not_simulated
from bussim.plc.system_devices import CLOCK
from bussim.words.language import say

#: The bit under which an FX takes its link settings over, if its contact is the program's first step.
LINK_SETTINGS = 8038
#: What an FX1S lacks of the applied instructions (table of FX programming, from memory: assumed).
_NOT_OF_AN_FX1S = ("CML", "FMOV", "XCH", "NEG", "ROR", "ROL", "MEAN")


@dataclass(frozen=True)
class Program:
    """A program that can run. Two are equal if their text and name are.

    ``kind`` is what its file was taken for, "" where it has none. ``skips``: instructions that are not
    simulated are left out. ``family``: whose devices the PLC has.
    """

    text: str = field(repr=False)
    name: str
    instructions: tuple[Instruction, ...] = field(repr=False, compare=False)
    blocks: tuple[BasicBlock, ...] = field(repr=False, compare=False)
    warnings: tuple[Problem, ...] = field(repr=False, compare=False)
    kind: str = field(default="", compare=False)
    skips: bool = False
    family: Family = Family.FX2N

    @classmethod
    def parse(
        cls, text: str, source_name: str, *, skips: bool = False, family: Family = Family.FX2N
    ) -> Program:
        """Read a program. ``source_name`` stands in messages: the file as the user named it.

        With ``skips`` instructions that are known and not simulated become warnings.

        Raises ProgramError with every mistake.
        """
        source = Source(text, source_name, skip=skips, family=family)
        ladder = Ladder(source.instructions, source.gaps, source_name)
        problems = source.problems + ladder.problems
        # A text that was not read to its end seems to lack its END and its labels.
        if source.whole:
            problems += FlowCheck(source.instructions, source_name).problems
        if problems:
            raise ProgramError(problems)
        instructions = source.instructions
        warnings = (*source.warnings, *_warnings(instructions, source_name, family))
        blocks = tuple(cut(ladder.items, instructions))
        return cls(text, source_name, tuple(instructions), blocks, warnings, skips=skips, family=family)

    def __reduce__(self) -> tuple[object, tuple[str, str]]:
        # Another process reads the text again: faster than sending what was made of it.
        return partial(Program.parse, skips=self.skips, family=self.family), (self.text, self.name)

    @property
    def steps(self) -> int:
        """Program steps, as a programming tool counts them."""
        from bussim.plc.program.text.catalog import steps_of

        last = self.instructions[-1]
        return last.step + steps_of(last.form, last.operands)

    @property
    def uses_ports(self) -> bool:
        """Whether it has an RS, RS2 or CPAVL."""
        return any(at.spec.group == "serial" for at in self.instructions)

    @property
    def uses_rs(self) -> bool:
        """Whether it has an RS, so that the special devices of its port live."""
        return any(at.name == "RS" for at in self.instructions)

    @property
    def sets_link_at_step_0(self) -> bool:
        """Whether its first step is a contact of M8038, as an FX wants it for its link settings."""
        wanted = Device("M", LINK_SETTINGS)
        return any(at.name == "LD" and at.operands[0].device == wanted for at in self.instructions[:1])

    @property
    def link_settings(self) -> Program:
        """Its rung under M8038 as the contact of its first step, and nothing else; no rung without that."""
        first = self.instructions[0]
        rungs = [
            item
            for item in (self.blocks[0].rungs if self.sets_link_at_step_0 else ())
            if isinstance(item, Rung) and first in contacts_of(item.condition)
        ]
        count = rungs[-1].outputs[-1].number + 1 if rungs else 0
        kept, blocks = self.instructions[:count], (BasicBlock([*rungs]),)
        return replace(self, name=f"{self.name}: its rung under M8038", instructions=kept, blocks=blocks)

    @property
    def turns_bmov(self) -> bool:
        """Whether it sets M8024, which makes BMOV write its source."""
        return any(
            extent.writes and extent.holds("M", BACKWARDS, word=False)
            for at in self.instructions
            if at.name not in ("RST", "ZRST")
            for extent in extents(at)
        )

    def writes(self) -> tuple[Extent, ...]:
        """What the program's instructions write, where no index register decides."""
        both = self.turns_bmov
        return tuple(
            extent for at in self.instructions for extent in extents(at, backwards=both) if extent.writes
        )


def _line(at: Instruction) -> str:
    return f"at line {at.line}"


def _warnings(instructions: list[Instruction], name: str, family: Family) -> Iterator[Problem]:
    """What a PLC would accept and its programmer hardly means."""

    def warn(at: Instruction, message: str) -> Problem:
        return Problem(name, at.line, at.column, message)

    with_rs = any(at.name == "RS" for at in instructions)
    coils: dict[Device, list[tuple[Instruction, int | None]]] = {}
    step: int | None = None  # the state whose step it is
    idle: dict[str, Instruction] = {}
    for at in instructions:
        if family is Family.FX1S and at.spec.name in _NOT_OF_AN_FX1S and idle.setdefault(at.name, at) is at:
            yield warn(at, say("program_fx1s", at=at.name))
        if at.spec.flow in (Flow.STL, Flow.RET):
            step = at.operands[0].address if at.operands else None
        for extent in extents(at):
            if at.name in ("RST", "ZRST") and extent.letter != "C":
                continue
            for message in not_simulated(extent, with_rs=with_rs, family=family):
                if idle.setdefault(message, at) is at:
                    yield warn(at, message)
            if extent.writes and idle.get("clock") is None:
                clock = [address for address in CLOCK if extent.holds("D", address, word=True)]
                for address in clock[:1]:
                    idle["clock"] = at
                    text = say("program_clock", address=address)
                    yield warn(at, say("program_no_effect", what=text, at=at.name))
        if at.name in ("OUT", "PLS", "PLF") and at.operands[0].kind != "D.b" and not at.operands[0].index:
            device = at.operands[0].device
            others = coils.setdefault(device, [])
            # In different steps of a step ladder one device may be driven: they are on one after the other.
            both = (other for other, its in others if its is None or step is None or its == step)
            if other := next(both, None):
                yield warn(at, say("program_twice", device=device, line=_line(other)))
            others.append((at, step))
        elif at.number and any(
            operand.device == Device("M", LINK_SETTINGS) for operand in at.operands if operand.kind == "M"
        ):
            yield warn(at, say("program_m8038"))
    for at in instructions:
        if at.name in ("OUT", "PLS", "PLF", "SET", "RST", "ZRST"):
            continue
        for extent in extents(at):
            if not extent.writes or extent.word:
                continue
            for device, ((coil, _), *_) in coils.items():
                if extent.holds(device.letter, device.address, word=False):
                    yield warn(
                        at,
                        say("program_written", at=at.name, device=device, coil=coil.name, line=_line(coil)),
                    )

"""Which devices a signal may reach: over the shared blocks of an N:N link and through programs.

The search follows each contact and operand to all that its rung or instruction may write. Nothing is carried
out: it may find too much. Too little it finds only where a program's text does not say (jumps, index
registers) or where no text is (serial ports): there it is :attr:`Reachability.UNKNOWN`, so that
:attr:`Reachability.NONE` is never wrong.
"""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import reduce
from typing import assert_never

from bussim.engines.nn.frames import MODES
from bussim.plc.link_registers import D_MODE, D_SLAVES, D_STATION, bad_parameters, setting_values
from bussim.plc.memory import FIRST_SPECIAL, BlockRange, Device, block_range
from bussim.plc.program.program import Program
from bussim.plc.program.text.catalog import Flow, Instruction
from bussim.plc.program.text.ladder import Both, Condition, Contact, Either, Not, Rung, Saved, parts
from bussim.plc.program.text.operand_checks import READ_ONLY_BITS, Extent, extents
from bussim.scenario.model import Plc
from bussim.words.language import say

#: More devices than any letter has: R of an FX3U goes to R32767.
_MARKS = 32768
#: Jumps past a rung that are looked at, the latest ones.
MAX_PAST = 16

#: The level of a condition, or the contacts that decide it.
Remaining = bool | list[Instruction]


class Reachability(StrEnum):
    """Whether one device leads to another."""

    DIRECT = "direct"
    UNKNOWN = "unknown"
    NONE = "none"


@dataclass(frozen=True, slots=True)
class Node:
    """A rung, or (with ``at``) one of its outputs: what it depends on and what it may change.

    The level of a rung is an extent as well, of the letter "".
    """

    reads: list[Extent]
    writes: list[Extent]
    condition: Condition
    at: Instruction | None = None


class Marks(dict[str, bytearray]):
    """Devices of one PLC by letter, 1 for those reached. T and C are contact and current value at once."""

    def __init__(self, rungs: int) -> None:
        super().__init__({letter: bytearray(_MARKS) for letter in "XYMSTCDRZ"})
        self["V"] = self["Z"]  # a pair of 32 bits has both names
        self[""] = bytearray(rungs)

    def hold(self, extent: Extent) -> bool:
        """Whether any device of an extent is reached."""
        return 1 in self[extent.letter][extent.first : extent.last + 1]

    def spread(self, nodes: Sequence[Node]) -> None:
        """Follow a program until nothing new is reached."""
        found = True
        while found:
            found, waiting = False, []
            for node in nodes:
                if any(map(self.hold, node.reads)):
                    found = True
                    for extent in node.writes:
                        count = extent.last + 1 - extent.first
                        self[extent.letter][extent.first : extent.last + 1] = b"\1" * count
                else:
                    waiting.append(node)
            nodes = waiting[::-1]  # rungs that stand in reverse order need no pass each


class Network:
    """The PLCs on one N:N link in the order of the cable, or one PLC alone.

    ``mode`` is the refresh mode, None without a working master; ``slaves`` the number of slaves it polls.
    """

    def __init__(self, plcs: tuple[Plc, ...]) -> None:
        self.plcs = plcs
        self.mode: int | None = None
        self.slaves = 0
        #: Station numbers of the PLCs whose settings are valid, by name.
        self.numbers: dict[str, int] = {}
        for plc in plcs:
            values = setting_values(plc.profile, plc.registers)
            if plc.link is None or bad_parameters(plc.profile, values):
                continue
            self.numbers[plc.name] = values[D_STATION]
            if values[D_STATION] == 0 and self.mode is None:
                self.mode, self.slaves = values[D_MODE], values[D_SLAVES]
        self._levels: dict[Rung, Extent] = {}
        #: Rungs and outputs of the programs by PLC, without what jumps.
        self.nodes = {plc.name: list(self._nodes(plc.program)) for plc in plcs}

    def _nodes(self, program: Program | None) -> Iterator[Node]:
        if program is None:
            return
        turns = program.turns_bmov
        for item in (item for block in program.blocks for item in block.rungs):
            if not isinstance(item, Rung):
                continue
            number = len(self._levels)
            level = Extent("", number, number, word=False, writes=True)
            yield Node(self.reads(item.condition), [level], item.condition)
            self._levels[item] = level
            for at in item.outputs:
                touched = extents(at, backwards=turns)
                writes = [extent for extent in touched if extent.writes]
                yield Node([*touched, level], writes, item.condition, at)

    def reads(self, condition: Condition) -> list[Extent]:
        """What the level of a condition depends on."""
        contacts, rungs = parts(condition)
        found = [extent for at in contacts for extent in extents(at)]
        return found + [self._levels[rung] for rung in rungs]

    def block(self, owner: Plc, keeper: Plc) -> BlockRange | None:
        """Where one station keeps the block of another or its own; None if it never receives it."""
        number = self.numbers.get(owner.name)
        if self.mode is None or number is None or number > self.slaves or keeper.name not in self.numbers:
            return None
        if self.mode not in owner.profile.modes or self.mode not in keeper.profile.modes:
            return None
        kind = MODES[self.mode]
        return block_range(number, kind.bits, kind.words, keeper.profile.word_spacing)

    def shared(self, plc: Plc) -> str:
        """What a station shares with the others, in words."""
        block = self.block(plc, plc)
        if block is None:
            return say("path_shares_nothing", plc=plc.name)
        span = say("path_range", first=f"D{block.word}", last=f"D{block.word + block.words - 1}")
        blocks = [span]
        if block.bits:
            blocks.insert(0, say("path_range", first=f"M{block.bit}", last=f"M{block.bit + block.bits - 1}"))
        return say("path_shares", mode=self.mode, plc=plc.name, blocks=blocks)

    def reached(self, source: Plc, start: Device, *, specials: bool = False) -> dict[str, Marks]:
        """All that a device may reach over the blocks of all stations, by PLC.

        ``specials``: also what any special device may, but those that the clock and RUN alone set.
        """
        found = {plc.name: Marks(len(self._levels)) for plc in self.plcs}
        found[source.name][start.letter[0]][start.address] = 1
        for marks in found.values() if specials else ():
            for letter in "MD":
                marks[letter][FIRST_SPECIAL:] = b"\1" * (_MARKS - FIRST_SPECIAL)
            for address in READ_ONLY_BITS:
                marks["M"][address] = 0
        moved = True
        while moved:
            for plc in self.plcs:
                found[plc.name].spread(self.nodes[plc.name])
            routes = ((a, b) for a in self.plcs for b in self.plcs if a is not b)
            moved = sum(self._share(*route, found) for route in routes) > 0
        return found

    def _share(self, sender: Plc, receiver: Plc, found: dict[str, Marks]) -> bool:
        """Mark what the link copies from one PLC to another; returns whether any of it is new."""
        own, copy = self.block(sender, sender), self.block(sender, receiver)
        if own is None or copy is None:
            return False
        moved = False
        for letter, first, there, count in (
            ("M", own.bit, copy.bit, own.bits),
            ("D", own.word, copy.word, own.words),
        ):
            sent = found[sender.name][letter][first : first + count]
            kept = found[receiver.name][letter]
            for at in (at for at in range(count) if 1 in sent and sent[at] > kept[there + at]):
                kept[there + at] = moved = True
        return moved

    def reachability(self, source: Plc, start: Device, target: Plc, end: Device) -> Reachability:
        """Whether a device of one PLC leads to a device of another or the same one."""
        letter, address = end.letter[0], end.address
        if self.reached(source, start)[target.name][letter][address]:
            return Reachability.DIRECT
        vague = any(plc.ports or next(vague_instructions(plc), None) for plc in self.plcs)
        if vague or self.reached(source, start, specials=True)[target.name][letter][address]:
            return Reachability.UNKNOWN
        return Reachability.NONE


def vague_instructions(plc: Plc) -> Iterator[Instruction]:
    """The instructions of a PLC that jump, switch rungs off, or use an index register or a serial port."""
    for at in () if plc.program is None else plc.program.instructions:
        vague = at.spec.group == "serial" or (at.spec.flow is not None and at.spec.flow.is_vague)
        if vague or any(operand.index is not None for operand in at.operands):
            yield at


def rungs_of(program: Program) -> Iterator[tuple[list[Condition], list[Instruction]]]:
    """Each rung with its outputs, and each jump: all conditions that must be on for it to be carried out.

    They are those of the MC around it, that of the latest jumps past it (off) and its own.
    """
    masters: dict[int | None, list[Condition]] = {}
    past: deque[Condition] = deque(maxlen=MAX_PAST)
    for block in program.blocks:
        if any(at.spec.flow in (Flow.LABEL, Flow.STL, Flow.RET) for at in block.instructions):
            past.clear()  # other ways lead there
        for item in (*block.rungs, block.exit):
            if item is None or item.condition is None:
                continue
            conditions = [*masters.get(item.level, []), item.condition]
            outputs = item.outputs if isinstance(item, Rung) else [item.instruction]
            yield [*past, *conditions], outputs
            first = outputs[0] if outputs else None
            if first is not None and first.name == "MC":
                masters[first.operands[0].address] = conditions
            elif first is not None and first.name == "CJ":
                past.append(Not(reduce(Both, conditions)))


def remaining(
    condition: Condition, level: Callable[[Instruction], bool | None], earlier: dict[int, Remaining]
) -> Remaining:
    """The level of a condition, or the contacts on which it depends, if ``level`` knows some of them.

    ``earlier`` keeps what was found of rungs whose level others take, by their id.
    """
    match condition:
        case Contact(at):
            known = level(at)
            return [at] if known is None else known
        case Saved(rung):
            if id(rung) not in earlier:
                earlier[id(rung)] = remaining(rung.condition, level, earlier)
            return earlier[id(rung)]
        case Not(part):
            inner = remaining(part, level, earlier)
            return not inner if isinstance(inner, bool) else inner
        case Both(first, second) | Either(first, second):
            decides = isinstance(condition, Either)
            sides = [remaining(side, level, earlier) for side in (first, second)]
            if any(side is decides for side in sides):
                return decides
            return [at for side in sides if isinstance(side, list) for at in side] or not decides
        case _:
            assert_never(condition)

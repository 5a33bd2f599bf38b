"""Which devices a signal may reach: over the shared blocks of an N:N link and through programs.

The search follows each contact and operand to all that its rung or instruction may write. Nothing is carried
out: it may find too much. Too little it finds only where a program's text does not say (jumps, index
registers) or where no text is (serial ports): there the answer is :attr:`Reachability.UNKNOWN`, so that
:attr:`Reachability.NONE` is never wrong.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

from bussim.engines.nn.frames import MODES
from bussim.plc.link_registers import D_MODE, D_SLAVES, D_STATION, bad_parameters, setting_values
from bussim.plc.memory import BlockPlace, Device, block_place
from bussim.plc.program.program import Program
from bussim.plc.program.text.catalog import Instruction
from bussim.plc.program.text.check import READ_ONLY_BITS, Extent, extents
from bussim.plc.program.text.ladder import Condition, Contact, Control, Not, Rung, Saved
from bussim.scenario.model import Plc

#: Special devices begin here (FX programming manual).
FIRST_SPECIAL = 8000
_LAST = 8255
#: Instructions that decide what is carried out, or whose data no text tells.
_VAGUE = frozenset(("CJ", "CALL", "FOR", "RS2", "CPAVL"))


class Reachability(StrEnum):
    """How one device leads to another."""

    DIRECT = "direct"  # within one PLC, or over the source's own block
    UNKNOWN = "unknown"  # over other stations, or by what no text tells
    NONE = "none"


@dataclass(frozen=True, slots=True, eq=False)
class Node:
    """A rung, or (with ``at``) one of its outputs.

    It depends on the devices in ``reads`` and on the level of the rungs ``after``, and may change ``writes``.
    """

    rung: Rung | Control
    at: Instruction | None
    reads: list[Extent]
    after: list[Rung | Control]
    writes: list[Extent]

    @property
    def key(self) -> Rung | Control | Node:
        """What stands for it among the :attr:`Marks.live`."""
        return self.rung if self.at is None else self


class Marks(dict[str, bytearray]):
    """Devices of one PLC, by letter: those reached are 1. T and C are contact and current value at once."""

    def __init__(self) -> None:
        super().__init__({letter: bytearray(_LAST + 1) for letter in "XYMSTCDZ"})
        self["V"] = self["Z"]  # a pair of 32 bits has both names
        #: Rungs whose level depends on a device that is reached, and outputs that do.
        self.live: set[Rung | Control | Node] = set()

    def hold(self, extent: Extent) -> bool:
        """Whether any device of an extent is reached."""
        return 1 in self[extent.letter][extent.first : extent.last + 1]

    def has(self, device: Device) -> bool:
        """Whether a device is reached."""
        return bool(self[device.letter[0]][device.address])

    def spread(self, nodes: list[Node]) -> None:
        """Follow a program until nothing new is reached."""
        found = True
        while found:
            found = False
            nodes = [node for node in nodes if node.key not in self.live]
            for node in nodes:
                if not self.live.isdisjoint(node.after) or any(map(self.hold, node.reads)):
                    self.live.add(node.key)
                    for extent in node.writes:
                        count = extent.last + 1 - extent.first
                        self[extent.letter][extent.first : extent.last + 1] = b"\1" * count
                    found = True
            nodes.reverse()  # rungs that stand in reverse order need no pass each


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
        self.nodes = {plc.name: list(_nodes(plc.program)) for plc in plcs}

    def block(self, owner: Plc, keeper: Plc) -> BlockPlace | None:
        """Where one station keeps the block of another or its own; None if it never receives it."""
        number = self.numbers.get(owner.name)
        if self.mode is None or number is None or number > self.slaves or keeper.name not in self.numbers:
            return None
        if self.mode not in owner.profile.modes or self.mode not in keeper.profile.modes:
            return None
        kind = MODES[self.mode]
        return block_place(number, kind.bits, kind.words, keeper.profile.word_spacing)

    def shared(self, plc: Plc) -> str:
        """What a station shares with the others, in words."""
        block = self.block(plc, plc)
        if block is None:
            return f"{plc.name} shares nothing"
        bits = f"M{block.bit} to M{block.bit + block.bits - 1} and " if block.bits else ""
        words = f"D{block.word} to D{block.word + block.words - 1}"
        return f"in refresh mode {self.mode} {plc.name} shares {bits}{words}"

    def reached(
        self, source: Plc, start: Device, target: Plc | None = None, *, specials: bool = False
    ) -> dict[str, Marks]:
        """All that a device may reach, by PLC.

        With ``target`` over the source's block to that PLC only, else over the blocks of all stations.
        ``specials``: also by any special device but those that the clock and RUN alone set.
        """
        found = {plc.name: Marks() for plc in self.plcs}
        found[source.name][start.letter[0]][start.address] = 1
        for marks in found.values() if specials else ():
            for letter in "MD":
                marks[letter][FIRST_SPECIAL:] = b"\1" * (_LAST + 1 - FIRST_SPECIAL)
            for address in READ_ONLY_BITS:
                marks["M"][address] = 0
        routes = [(a, b) for a in self.plcs for b in self.plcs if a is not b]
        if target is not None:
            routes = [(source, target)] if source is not target else []
        moved = True
        while moved:
            for plc in self.plcs:
                found[plc.name].spread(self.nodes[plc.name])
            moved = sum(self._share(*route, found) for route in routes) > 0
        return found

    def _share(self, sender: Plc, hearer: Plc, found: dict[str, Marks]) -> bool:
        """Mark what the link copies from one PLC to another; returns whether any of it is new."""
        own, copy = self.block(sender, sender), self.block(sender, hearer)
        if own is None or copy is None:
            return False
        moved = False
        for letter, first, there, count in (
            ("M", own.bit, copy.bit, own.bits),
            ("D", own.word, copy.word, own.words),
        ):
            sent = found[sender.name][letter][first : first + count]
            kept = found[hearer.name][letter]
            for at in (at for at in range(count) if 1 in sent and sent[at] > kept[there + at]):
                kept[there + at] = moved = True
        return moved

    def reachability(self, source: Plc, start: Device, target: Plc, end: Device) -> Reachability:
        """How a device of one PLC leads to a device of another or the same one."""
        if self.reached(source, start, target)[target.name].has(end):
            return Reachability.DIRECT
        vague = any(plc.ports or any(map(is_vague, instructions(plc))) for plc in self.plcs)
        if vague or self.reached(source, start, specials=True)[target.name].has(end):
            return Reachability.UNKNOWN
        return Reachability.NONE


def is_vague(at: Instruction) -> bool:
    """Whether an instruction jumps, or uses an index register or a serial port."""
    return at.spec.name in _VAGUE or any(operand.index is not None for operand in at.operands)


def instructions(plc: Plc) -> tuple[Instruction, ...]:
    """The instructions of a PLC's program, if it has one."""
    return () if plc.program is None else plc.program.instructions


def _nodes(program: Program | None) -> Iterator[Node]:
    masters: dict[int | None, Control] = {}
    blocks = () if program is None else program.blocks
    both_ways = program is not None and program.turns_bmov
    for item in (item for block in blocks for item in block.rungs):
        if item.condition is None:
            continue  # MCR
        contacts, after = parts(item.condition)
        after += [masters[item.level]] if item.level in masters else []
        yield Node(item, None, [extent for at in contacts for extent in extents(at)], after, [])
        if isinstance(item, Control):
            masters[item.instruction.operands[0].address] = item
        for at in item.outputs if isinstance(item, Rung) else (item.instruction,):
            touched = extents(at, both_ways=both_ways)
            yield Node(item, at, touched, [item], [extent for extent in touched if extent.writes])


def parts(condition: Condition) -> tuple[list[Instruction], list[Rung | Control]]:
    """The contacts of a condition, and the earlier rungs whose level it takes."""
    contacts: list[Instruction] = []
    rungs: list[Rung | Control] = []
    waiting = [condition]
    while waiting:
        part = waiting.pop()
        if isinstance(part, Contact):
            contacts.append(part.instruction)
        elif isinstance(part, Saved):
            rungs.append(part.rung)
        elif isinstance(part, Not):
            waiting.append(part.part)
        else:
            waiting += [part.second, part.first]
    return contacts, rungs

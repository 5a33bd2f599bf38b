"""Where a program's text leads a signal: what each bit and word is made of, and what that may wait for.

A conservative reading, without carrying anything out. A step leads from a device to the value of a rung,
from there to later parts of the same rung, and to what its outputs write. It may cost a scan (the rung
stands in front of the one that writes what it reads), it may have a *gate* (a device that must let the
signal through) or a *reason* why its time cannot be told from the text: timers, counters, pulses, what
keeps its value, comparisons and arithmetic. Single bits of a word are not told apart.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from bussim.plc.memory import Device
from bussim.plc.program.program import Program
from bussim.plc.program.text.catalog import Instruction
from bussim.plc.program.text.check import Extent, extents
from bussim.plc.program.text.ladder import Both, Condition, Contact, Either, Not, Rung, Saved

#: Always on and always off (FX programming manual).
_ALWAYS = {("M", 8000): True, ("M", 8001): False}
#: Gates of one rung that are named; the rest are "…".
_MOST_GATES = 4
#: Extents of more devices are looked through, not listed device by device.
_FEW = 64
_COPIES = frozenset(("MOV", "CML", "BMOV", "FMOV"))
_KEEPS = frozenset(("SET", "RST", "ZRST"))
_PULSES = frozenset(("PLS", "PLF", "ALT"))


class Key(NamedTuple):
    """A bit (of T and C the contact) or a word."""

    letter: str
    address: int
    word: bool

    @classmethod
    def of(cls, device: Device) -> Key:
        """That of a device by its bare name: T0 a contact, TN0 a timer's current value."""
        return cls(device.letter.removesuffix("N"), device.address, device.is_word)

    @property
    def device(self) -> Device:
        """The device as whoever observes it names it."""
        current = "N" if self.word and self.letter in ("T", "C") else ""
        return Device(self.letter + current, self.address)

    def __str__(self) -> str:
        return str(self.device)


class Point(NamedTuple):
    """A level somewhere in the program: of a device as written by instruction ``number``, or of a rung.

    ``number`` is -1 where something else than the program has written it, before the scan began. A rung
    has no ``key``; ``number`` is then its place in the program.
    """

    key: Key | None
    number: int
    level: int


class Step(NamedTuple):
    """From one point to the next: whether a scan later, why its time cannot be told, what gates it."""

    to: Point
    later: bool = False
    reason: str = ""
    gates: tuple[str, ...] = ()


class _Leaf(NamedTuple):
    """A contact or an earlier rung in a condition; what else must be on (off) for its level to decide."""

    part: Contact | Saved
    flips: bool
    if_on: tuple[Condition, ...]
    if_off: tuple[Condition, ...]


@dataclass(slots=True)
class _Rung:
    condition: Condition
    outputs: list[Instruction]
    place: int
    block: int
    leaves: list[_Leaf] = field(default_factory=list)
    constant: bool | None = None
    used_by: list[tuple[int, _Leaf]] = field(default_factory=list)


class Signals:
    """The steps that signals take through one program. Without a program there are none."""

    def __init__(self, program: Program | None) -> None:
        self._rungs: list[_Rung] = []
        self._places: dict[Rung, int] = {}
        self._contacts: dict[Key, list[tuple[int, _Leaf]]] = {}
        self._reads: dict[Key, list[tuple[int, Instruction]]] = {}
        self._wide: list[tuple[Extent, int, Instruction]] = []
        self._writes: list[tuple[Extent, Instruction]] = []
        #: Instructions that write where an index register decides.
        self.indexed: list[Instruction] = []
        self._jumps: list[tuple[int, int, Instruction]] = []
        #: Rungs (their places) and words that decide where the program goes on, or how often.
        self.steering: set[int | Key] = set()
        #: Whether a BMOV may write its source.
        self._turns = program is not None and program.turns_bmov
        if program is not None:
            self._read(program)

    # -- reading the text --------------------------------------------------------------------------

    def _read(self, program: Program) -> None:
        masters: dict[int, Rung] = {}
        for here, block in enumerate(program.blocks):
            for item in block.rungs:
                if isinstance(item, Rung):
                    self._add(item, masters, here)
                elif item.instruction.spec.name == "MC":
                    under = Rung(item.driven_by, item.level)
                    masters[item.instruction.operands[0].address] = under
                    self._add(under, masters, here)
                    self._writing(item.instruction)
            at = block.exit
            if at is None:
                continue
            if at.condition is not None:
                self.steering.add(len(self._rungs))
                self._add(Rung(at.condition, at.level), masters, here)
            self.steering.update(key for extent in extents(at.instruction) for key in _keys(extent))
            if at.instruction.spec.name == "CJ":
                end = block.target if block.target >= 0 else len(program.blocks)
                self._jumps.append((here, end, at.instruction))

    def _add(self, rung: Rung, masters: dict[int, Rung], block: int) -> None:
        condition = rung.condition
        if rung.level is not None and rung.level in masters:
            condition = Both(condition, Saved(masters[rung.level]))
        place = len(self._rungs)
        self._places[rung] = place
        known = _Rung(condition, rung.outputs, place, block)
        self._rungs.append(known)
        known.constant = self._constant(condition)
        for leaf in _leaves(condition):
            if isinstance(leaf.part, Saved):
                self._rungs[self._places[leaf.part.rung]].used_by.append((place, leaf))
                continue
            for extent in extents(leaf.part.instruction):
                for key in _keys(extent):
                    self._contacts.setdefault(key, []).append((place, leaf))
        for at in rung.outputs:
            self._reading(at, place)
            self._writing(at)

    def _reading(self, at: Instruction, place: int) -> None:
        for extent in extents(at):
            # INC and the like read what they write.
            alone = at.spec.name in (*_COPIES, *_KEEPS, *_PULSES, "OUT")
            if extent.writes and alone and not self._turned(at):
                continue
            if extent.last - extent.first >= _FEW:
                self._wide.append((extent, place, at))
                continue
            for key in _keys(extent):
                self._reads.setdefault(key, []).append((place, at))

    def _writing(self, at: Instruction) -> None:
        if any(
            operand.index is not None and slot.writes
            for slot, operand in zip(at.spec.slots, at.operands, strict=False)
        ):
            self.indexed.append(at)
        self._writes += [(extent, at) for extent in extents(at, both_ways=self._turns) if extent.writes]

    def _turned(self, at: Instruction) -> bool:
        return self._turns and at.spec.name == "BMOV"

    def _constant(self, condition: Condition) -> bool | None:
        match condition:
            case Contact(instruction):
                if instruction.spec.test not in ("on", "off"):
                    return None
                device = instruction.operands[0].device
                known = _ALWAYS.get((device.letter, device.address))
                return known if known is None else known is (instruction.spec.test == "on")
            case Saved(rung):
                return self._rungs[self._places[rung]].constant
            case Not(part):
                found = self._constant(part)
                return None if found is None else not found
            case Both(first, second):
                both = (self._constant(first), self._constant(second))
                return False if False in both else (True if both == (True, True) else None)
            case Either(first, second):
                both = (self._constant(first), self._constant(second))
                return True if True in both else (False if both == (False, False) else None)

    # -- where signals go --------------------------------------------------------------------------

    def written(self, key: Key) -> list[Instruction]:
        """The instructions that write a device, as far as the text tells."""
        return [at for extent, at in self._writes if extent.holds(key.letter, key.address, word=key.word)]

    @property
    def reads(self) -> set[Key]:
        """All that the program reads, as far as the text tells."""
        wide = {key for extent, _, _ in self._wide for key in _keys(extent)}
        return {*self._contacts, *self._reads, *wide}

    @property
    def writes(self) -> set[Key]:
        """All that the program writes, as far as the text tells."""
        return {key for extent, _ in self._writes for key in _keys(extent)}

    def steps(self, point: Point) -> Iterator[Step]:
        """What follows from a level next."""
        if point.key is None:
            yield from self._from_rung(self._rungs[point.number], point.level)
            return
        for place, leaf in self._contacts.get(point.key, ()):
            yield self._through(leaf, place, point)
        wide = [
            (place, at)
            for extent, place, at in self._wide
            if extent.holds(point.key.letter, point.key.address, word=point.key.word)
        ]
        for place, at in [*self._reads.get(point.key, ()), *wide]:
            yield from self._data(at, self._rungs[place], point)

    def _through(self, leaf: _Leaf, place: int, point: Point | None, level: int = 0) -> Step:
        reason = ""
        later = False
        if point is not None and isinstance(leaf.part, Contact):
            at = leaf.part.instruction
            later, level = at.number < point.number, point.level
            if at.spec.test in ("rise", "fall"):
                reason = f"{at.name} {at.operands[0].text} at line {at.line} is on for one scan only"
            elif at.spec.test not in ("on", "off"):
                reason = f"{at.name} at line {at.line} compares values"
        level ^= leaf.flips
        gates = self._names(part for part in (leaf.if_on if level else leaf.if_off))
        return Step(Point(None, place, level), later, reason, gates)

    def _from_rung(self, rung: _Rung, level: int) -> Iterator[Step]:
        for place, leaf in rung.used_by:
            yield self._through(leaf, place, None, level)
        for at in rung.outputs:
            reason, name, line = "", at.spec.name, at.line
            if name == "OUT" and at.operands[0].kind in ("T", "C"):
                what = "timer" if at.operands[0].kind == "T" else "counter"
                reason = f"{at.operands[0].text} at line {line} is a {what}"
            elif name in _PULSES or at.form.pulse:
                reason = f"{at.name} {at.operands[0].text} at line {line} acts once for each change"
            elif name in _KEEPS:
                reason = (
                    f"{at.name} {at.operands[0].text} at line {line} is kept until something else changes it"
                )
            elif name != "OUT":
                reason = f"what {at.name} at line {line} has written is kept while its condition is off"
            jumped = self._jumped(rung, at)
            for extent in extents(at):
                if extent.writes:
                    for key in _keys(extent):
                        yield Step(Point(key, at.number, level), reason=reason, gates=jumped)

    def _data(self, at: Instruction, rung: _Rung, point: Point) -> Iterator[Step]:
        """What an instruction makes of the devices that it reads."""
        if rung.constant is False:
            return
        later = at.number <= point.number
        gates = self._jumped(rung, at)
        if rung.constant is None:
            gates = (*self._names((rung.condition,)), *gates)
        reason = ""
        if at.form.pulse:
            reason = f"{at.name} at line {at.line} acts once for each change of its condition"
        elif at.spec.name == "OUT":
            reason = f"{at.operands[0].text} at line {at.line} has it as its preset"
        elif self._turned(at):
            reason = f"M8024 may turn BMOV at line {at.line} round"
        elif at.spec.name not in _COPIES:
            reason = f"{at.name} at line {at.line} makes another value of it"
        level = point.level ^ (at.spec.name == "CML")
        for key in self._copied(at, point.key):
            yield Step(Point(key, at.number, level), later, reason, gates)

    def _copied(self, at: Instruction, read: Key | None) -> Iterator[Key]:
        found = extents(at)
        if self._turned(at):
            for extent in found:
                yield from _keys(extent)
            return
        sources = [extent for extent in found if not extent.writes]
        targets = [extent for extent in found if extent.writes]
        if at.spec.name in ("MOV", "CML", "BMOV") and len(targets) == 1 and sources and read is not None:
            source, target = sources[0], targets[0]
            if source.word is target.word:
                offset = read.address - source.first
                if 0 <= offset <= target.last - target.first:
                    yield Key(target.letter, target.first + offset, target.word)
                return
        for target in targets:
            yield from _keys(target)

    def _jumped(self, rung: _Rung, at: Instruction) -> tuple[str, ...]:
        return tuple(
            f"{jump.name} {jump.operands[0].text} at line {jump.line}"
            for here, end, jump in self._jumps
            if here < rung.block < end and jump.number < at.number
        )

    def _names(self, conditions: Iterable[Condition]) -> tuple[str, ...]:
        found: dict[str, None] = {}
        waiting = list(conditions)
        while waiting:
            part = waiting.pop(0)
            if self._constant(part) is not None:
                continue
            if len(found) > _MOST_GATES:
                return (*list(found)[:_MOST_GATES], "…")
            match part:
                case Contact(instruction):
                    if instruction.spec.group == "basic":
                        found[str(instruction.operands[0].device)] = None
                    else:
                        found[f"{instruction.name} at line {instruction.line}"] = None
                case Not(inner):
                    waiting.append(inner)
                case Saved(rung):
                    waiting.append(self._rungs[self._places[rung]].condition)
                case Both(first, second) | Either(first, second):
                    waiting += [first, second]
        return tuple(found)


def _keys(extent: Extent) -> Iterator[Key]:
    for address in range(extent.first, extent.last + 1):
        yield Key(extent.letter, address, extent.word)


def _leaves(condition: Condition) -> list[_Leaf]:
    match condition:
        case Contact(instruction):
            return [_Leaf(condition, instruction.spec.test == "off", (), ())]
        case Saved():
            return [_Leaf(condition, False, (), ())]  # noqa: FBT003 - fields in their order
        case Not(part):
            return [_Leaf(at, not flips, off, on) for at, flips, on, off in _leaves(part)]
        case Both(first, second):
            pairs = ((first, second), (second, first))
            return [
                leaf._replace(if_on=(*leaf.if_on, other)) for one, other in pairs for leaf in _leaves(one)
            ]
        case Either(first, second):
            pairs = ((first, second), (second, first))
            return [
                leaf._replace(if_off=(*leaf.if_off, other)) for one, other in pairs for leaf in _leaves(one)
            ]

"""Conditions as closures that answer 0 or 1 (or False and True).

Contacts in series or parallel are asked only until the answer is known. Edges and comparisons with an
index register must be asked every time (they remember, or may fail), so they are asked first.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable
from dataclasses import dataclass
from typing import assert_never

from bussim.plc.program.access import plain, reader
from bussim.plc.program.catalog import Instruction
from bussim.plc.program.ladder import Both, Condition, Contact, Either, Not, Rung, Saved
from bussim.plc.program.machine import Machine, OperationError

Test = Callable[[], int]


@dataclass(frozen=True, slots=True)
class Atom:
    """A bit of a device, ``inverted`` (0 or 1) by an exclusive or."""

    bits: bytearray
    at: int
    inverted: int


@dataclass(frozen=True, slots=True)
class Asked:
    """A condition that is a closure already; ``always`` where it must be asked every time."""

    test: Test
    always: bool = False


@dataclass(frozen=True, slots=True)
class _Many:
    """A series (``every``) or parallels of parts."""

    parts: tuple[_Part, ...]
    every: bool


_Part = Atom | Asked | _Many


class Conditions:
    """Builds the conditions of one program for one machine."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._places: dict[int, int] = {}

    def place_of(self, rung: Rung) -> int | None:
        """Where the condition of a rung is kept for later; None if nothing asks for it."""
        return self._places.get(id(rung))

    def reserve(self, condition: Condition) -> None:
        """Find the rungs whose conditions are asked for again, and give each a place."""
        match condition:
            case Saved(rung):
                if id(rung) not in self._places:
                    self._places[id(rung)] = len(self._machine.saved)
                    self._machine.saved.append(0)
            case Not(part):
                self.reserve(part)
            case Both(first, second) | Either(first, second):
                self.reserve(first)
                self.reserve(second)
            case Contact():
                pass

    def build(self, condition: Condition, level: int | None) -> Atom | Asked:
        """The condition, and that of the MC around it."""
        part = self._part(condition)
        if level is not None:
            part = _Many((Atom(self._machine.levels, level, 0), part), every=True)
        return part if isinstance(part, Atom | Asked) else _join(part)

    def _part(self, condition: Condition) -> _Part:
        match condition:
            case Contact(instruction):
                return contact(self._machine, instruction)
            case Saved(rung):
                return Atom(self._machine.saved, self._places[id(rung)], 0)
            case Not(part):
                return _inverse(self._part(part))
            case Both(first, second):
                return _Many((*self._flat(first, every=True), *self._flat(second, every=True)), every=True)
            case Either(first, second):
                return _Many((*self._flat(first, every=False), *self._flat(second, every=False)), every=False)
        assert_never(condition)

    def _flat(self, condition: Condition, *, every: bool) -> tuple[_Part, ...]:
        part = self._part(condition)
        return part.parts if isinstance(part, _Many) and part.every is every else (part,)


def contact(machine: Machine, instruction: Instruction) -> Atom | Asked:
    """The contact of one instruction."""
    spec = instruction.spec
    if spec.group == "comparison":
        return _comparison(machine, instruction)
    operand = instruction.operands[0]
    bits, at = machine.bits[operand.letter], operand.address
    if spec.test in ("on", "off"):
        return Atom(bits, at, int(spec.test == "off"))
    earlier, number = machine.earlier, instruction.number
    if spec.test == "rise":

        def rises() -> bool:
            now, before = bits[at], earlier[number]
            earlier[number] = now
            return now > before

        return Asked(rises, always=True)

    def falls() -> bool:
        now, before = bits[at], earlier[number]
        earlier[number] = now
        return now < before

    return Asked(falls, always=True)


def _comparison(machine: Machine, instruction: Instruction) -> Asked:
    first, second = instruction.operands
    wide = instruction.form.wide
    one, other = plain(machine, first), plain(machine, second)
    if not wide and one is not None and other is not None:
        return Asked(_compare_words(instruction.spec.test, *one, *other))
    half = 0x80000000 if wide else 0x8000
    test = _compare(
        instruction.spec.test, reader(machine, first, wide=wide), reader(machine, second, wide=wide), half
    )
    if first.index is None and second.index is None:
        return Asked(test)

    def guarded() -> int:
        try:
            return test()
        except OperationError as error:
            machine.fail(error.code, instruction.step)
            return 0

    return Asked(guarded, always=True)


def _compare_words(test: str, a: array[int], i: int, b: array[int], j: int) -> Test:
    # An exclusive or with the sign bit puts patterns into the order of their values.
    match test:
        case "=":
            return lambda: a[i] == b[j]
        case "<>":
            return lambda: a[i] != b[j]
        case ">":
            return lambda: (a[i] ^ 0x8000) > (b[j] ^ 0x8000)
        case "<":
            return lambda: (a[i] ^ 0x8000) < (b[j] ^ 0x8000)
        case "<=":
            return lambda: (a[i] ^ 0x8000) <= (b[j] ^ 0x8000)
        case _:
            return lambda: (a[i] ^ 0x8000) >= (b[j] ^ 0x8000)


def _compare(test: str, one: Test, other: Test, half: int) -> Test:
    match test:
        case "=":
            return lambda: one() == other()
        case "<>":
            return lambda: one() != other()
        case ">":
            return lambda: (one() ^ half) > (other() ^ half)
        case "<":
            return lambda: (one() ^ half) < (other() ^ half)
        case "<=":
            return lambda: (one() ^ half) <= (other() ^ half)
        case _:
            return lambda: (one() ^ half) >= (other() ^ half)


def _inverse(part: _Part) -> _Part:
    match part:
        case Atom(bits, at, inverted):
            return Atom(bits, at, 1 - inverted)
        case Asked(test, always):
            return Asked(lambda: not test(), always)
        case _Many():
            return _inverse(_join(part))


def as_test(part: Atom | Asked) -> Test:
    """A condition as a closure."""
    if isinstance(part, Asked):
        return part.test
    bits, at = part.bits, part.at
    if part.inverted:
        return lambda: bits[at] ^ 1
    return lambda: bits[at]


# -- series and parallels --------------------------------------------------------------------------


def _join(many: _Many) -> Asked:
    parts = [part if isinstance(part, Atom | Asked) else _join(part) for part in many.parts]
    always = [part.test for part in parts if isinstance(part, Asked) and part.always]
    quick = [part for part in parts if isinstance(part, Atom) or not part.always]
    if not always:
        return Asked(_chain(quick, every=many.every))
    test = always[0]
    for following in always[1:]:
        test = _ask_both(test, following, every=many.every)
    if quick:
        test = _ask_first(test, _chain(quick, every=many.every), every=many.every)
    return Asked(test, always=True)


def _ask_both(first: Test, second: Test, *, every: bool) -> Test:
    def series() -> int:
        on = first()
        return second() and on

    def parallel() -> int:
        on = first()
        return second() or on

    return series if every else parallel


def _ask_first(first: Test, rest: Test, *, every: bool) -> Test:
    return (lambda: first() and rest()) if every else (lambda: first() or rest())


def _chain(parts: list[Atom | Asked], *, every: bool) -> Test:
    """Parts in order, up to four contacts a closure: a call costs more than a contact."""
    rest: Test | None = None
    end = len(parts)
    while True:
        last = parts[end - 1]
        if isinstance(last, Asked):
            rest = last.test if rest is None else _ask_first(last.test, rest, every=every)
            end -= 1
        else:
            start = end - 1
            while start and end - start < (4 if rest is None else 3) and isinstance(parts[start - 1], Atom):
                start -= 1
            atoms = [part for part in parts[start:end] if isinstance(part, Atom)]
            rest = (_series if every else _parallel)(atoms, rest)
            end = start
        if not end:
            return rest


def _series(atoms: list[Atom], rest: Test | None) -> Test:
    first = atoms[0]
    a, i, x = first.bits, first.at, first.inverted
    if len(atoms) == 1:
        return as_test(first) if rest is None else (lambda: a[i] ^ x and rest())
    b, j, y = atoms[1].bits, atoms[1].at, atoms[1].inverted
    if len(atoms) == 2:
        return (lambda: a[i] ^ x and b[j] ^ y) if rest is None else (lambda: a[i] ^ x and b[j] ^ y and rest())
    c, k, z = atoms[2].bits, atoms[2].at, atoms[2].inverted
    if len(atoms) == 3:
        if rest is None:
            return lambda: a[i] ^ x and b[j] ^ y and c[k] ^ z
        return lambda: a[i] ^ x and b[j] ^ y and c[k] ^ z and rest()
    d, m, w = atoms[3].bits, atoms[3].at, atoms[3].inverted
    return lambda: a[i] ^ x and b[j] ^ y and c[k] ^ z and d[m] ^ w


def _parallel(atoms: list[Atom], rest: Test | None) -> Test:
    first = atoms[0]
    a, i, x = first.bits, first.at, first.inverted
    if len(atoms) == 1:
        return as_test(first) if rest is None else (lambda: a[i] ^ x or rest())
    b, j, y = atoms[1].bits, atoms[1].at, atoms[1].inverted
    if len(atoms) == 2:
        return (lambda: a[i] ^ x or b[j] ^ y) if rest is None else (lambda: a[i] ^ x or b[j] ^ y or rest())
    c, k, z = atoms[2].bits, atoms[2].at, atoms[2].inverted
    if len(atoms) == 3:
        if rest is None:
            return lambda: a[i] ^ x or b[j] ^ y or c[k] ^ z
        return lambda: a[i] ^ x or b[j] ^ y or c[k] ^ z or rest()
    d, m, w = atoms[3].bits, atoms[3].at, atoms[3].inverted
    return lambda: a[i] ^ x or b[j] ^ y or c[k] ^ z or d[m] ^ w

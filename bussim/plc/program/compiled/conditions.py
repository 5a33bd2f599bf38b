"""Conditions as closures that return 0 or 1 (or False and True).

A program is run some hundred times a simulated second, so its conditions are not interpreted: each is
bound once to the memory's bytearrays as a closure, whose variables are faster to reach than attributes.
Contacts in series or parallel are evaluated only until the value is known. Edges and comparisons with an
index register must be evaluated in every scan (they remember, or may fail), so they come first.
"""

from __future__ import annotations

import operator
from array import array
from collections.abc import Callable
from dataclasses import dataclass
from typing import assert_never, cast

from bussim.plc.program.compiled.access import plain, reader
from bussim.plc.program.compiled.shapes import SHAPES, Atom, Step, Test, ToAct, ToCoil
from bussim.plc.program.machine import Machine, OperationError
from bussim.plc.program.text.catalog import Instruction
from bussim.plc.program.text.ladder import Both, Condition, Contact, Either, Not, Rung, Saved


@dataclass(frozen=True, slots=True)
class Evaluated:
    """A condition that is a closure already; ``always`` where it must be evaluated in every scan."""

    test: Test
    always: bool = False


@dataclass(frozen=True, slots=True)
class Many:
    """A series (``every``) or parallels of parts; if it has a shape, its ``form`` and its contacts."""

    parts: tuple[Part, ...]
    every: bool
    form: str = ""
    atoms: tuple[Atom, ...] = ()


Part = Atom | Evaluated | Many


def many(parts: tuple[Part, ...], *, every: bool) -> Many:
    """A series or parallels, the most complex parts in front."""
    forms = [_form(part) for part in parts]
    if not all(forms):
        return Many(parts, every)
    order = sorted(range(len(parts)), key=lambda number: -len(forms[number]))
    parts = tuple(parts[number] for number in order)
    form = ("&(" if every else "|(") + "".join(forms[number] for number in order) + ")"
    if form not in SHAPES:
        return Many(parts, every)
    return Many(parts, every, form, tuple(atom for part in parts for atom in _atoms(part)))


def _form(part: Part) -> str:
    if isinstance(part, Many):
        return part.form
    return "*" if isinstance(part, Atom) else ""


def _atoms(part: Part) -> tuple[Atom, ...]:
    if isinstance(part, Many):
        return part.atoms
    return (part,) if isinstance(part, Atom) else ()


class Conditions:
    """Builds the conditions of one program for one machine."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._places: dict[int, int] = {}

    def place_of(self, rung: Rung) -> int | None:
        """Where the condition of a rung is kept for later; None if no other rung uses it."""
        return self._places.get(id(rung))

    def reserve(self, condition: Condition) -> None:
        """Find the rungs whose conditions are used again, and give each a place."""
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

    def build(self, condition: Condition, level: int | None) -> Part:
        """The condition, and that of the MC around it."""
        part = self._part(condition)
        if level is None:
            return part
        parts = part.parts if isinstance(part, Many) and part.every else (part,)
        return many((Atom(self._machine.levels, level, 0), *parts), every=True)

    def _part(self, condition: Condition) -> Part:
        match condition:
            case Contact(instruction):
                return contact(self._machine, instruction)
            case Saved(rung):
                return Atom(self._machine.saved, self._places[id(rung)], 0)
            case Not(part):
                return _inverse(self._part(part))
            case Both(first, second):
                return many((*self._flat(first, every=True), *self._flat(second, every=True)), every=True)
            case Either(first, second):
                return many((*self._flat(first, every=False), *self._flat(second, every=False)), every=False)
        assert_never(condition)

    def _flat(self, condition: Condition, *, every: bool) -> tuple[Part, ...]:
        part = self._part(condition)
        return part.parts if isinstance(part, Many) and part.every is every else (part,)


def contact(machine: Machine, instruction: Instruction) -> Atom | Evaluated:
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

        return Evaluated(rises, always=True)

    def falls() -> bool:
        now, before = bits[at], earlier[number]
        earlier[number] = now
        return now < before

    return Evaluated(falls, always=True)


def _comparison(machine: Machine, instruction: Instruction) -> Evaluated:
    first, second = instruction.operands
    wide = instruction.form.wide
    one, other = plain(machine, first), plain(machine, second)
    if not wide and one is not None and other is not None:
        return Evaluated(_compare_words(instruction.spec.test, *one, *other))
    half = 0x80000000 if wide else 0x8000
    test = _compare(
        instruction.spec.test, reader(machine, first, wide=wide), reader(machine, second, wide=wide), half
    )
    if first.index is None and second.index is None:
        return Evaluated(test)

    def guarded() -> int:
        try:
            return test()
        except OperationError as error:
            machine.fail(error.code, instruction.step)
            return 0

    return Evaluated(guarded, always=True)


_COMPARE: dict[str, Callable[[int, int], bool]] = {
    "=": operator.eq,
    "<>": operator.ne,
    ">": operator.gt,
    "<": operator.lt,
    "<=": operator.le,
    ">=": operator.ge,
}


def _compare_words(test: str, a: array[int], i: int, b: array[int], j: int) -> Test:
    # An exclusive or with the sign bit puts patterns into the order of their values.
    compare = _COMPARE[test]
    return lambda: compare(a[i] ^ 0x8000, b[j] ^ 0x8000)


def _compare(test: str, one: Test, other: Test, half: int) -> Test:
    compare = _COMPARE[test]
    return lambda: compare(one() ^ half, other() ^ half)


def _inverse(part: Part) -> Part:
    match part:
        case Atom(bits, at, inverted):
            return Atom(bits, at, 1 - inverted)
        case Evaluated(test, always):
            return Evaluated(lambda: not test(), always)
        case Many(parts, every):
            # De Morgan: what is left is contacts again, for which there may be a shape.
            return many(tuple(_inverse(inner) for inner in parts), every=not every)


def as_test(part: Part) -> Test:
    """A condition as a closure that returns its value."""
    return part.test if isinstance(part, Evaluated) else _evaluated(part).test


def as_step(part: Part, use: ToCoil | ToAct) -> Step:
    """A condition and what it drives as one closure, or two."""
    form = _form(part)
    if form in SHAPES:
        return cast("Step", SHAPES[form](_atoms(part), use))
    test = as_test(part)
    if isinstance(use, ToCoil):
        bits, at = use.bits, use.at

        def coil() -> None:
            bits[at] = test()

        return coil
    act, spent, extra = use.act, use.spent, use.extra

    def step() -> None:
        if test():
            spent[0] += extra
            act()

    return step


# -- series and parallels --------------------------------------------------------------------------


def _evaluated(part: Part) -> Evaluated:
    if isinstance(part, Evaluated):
        return part
    form = _form(part)
    if form in SHAPES:
        return Evaluated(cast("Test", SHAPES[form](_atoms(part), None)))
    # A contact alone has a shape: this has parts.
    return _joined(part.parts, every=part.every) if isinstance(part, Many) else Evaluated(lambda: 0)


def _joined(parts: tuple[Part, ...], *, every: bool) -> Evaluated:
    """Parts of any kind: first those that must be evaluated, then contacts, then what takes longer."""
    atoms = [part for part in parts if isinstance(part, Atom)]
    others = [_evaluated(part) for part in parts if not isinstance(part, Atom)]
    rest: Test | None = None
    for other in reversed([other for other in others if not other.always]):
        rest = other.test if rest is None else _then(other.test, rest, every=every)
    while atoms:
        count = min(len(atoms), 2 if rest is not None else 4)
        rest = _atoms_then(atoms[-count:], rest, every=every)
        del atoms[-count:]
    always = [other.test for other in others if other.always]
    if not always:
        return Evaluated(rest if rest is not None else lambda: every)
    test = always[0]
    for following in always[1:]:
        test = _both_then(test, following, every=every)
    return Evaluated(test if rest is None else _then(test, rest, every=every), always=True)


def _then(first: Test, rest: Test, *, every: bool) -> Test:
    return (lambda: first() and rest()) if every else (lambda: first() or rest())


def _both_then(first: Test, second: Test, *, every: bool) -> Test:
    """Both are evaluated, whatever the first one's value."""

    def series() -> int:
        on = first()
        return second() and on

    def parallel() -> int:
        on = first()
        return second() or on

    return series if every else parallel


def _atoms_then(atoms: list[Atom], rest: Test | None, *, every: bool) -> Test:
    """Up to four contacts, or up to two and what follows them."""
    if rest is None:
        form = "*" if len(atoms) == 1 else ("&(" if every else "|(") + "*" * len(atoms) + ")"
        return cast("Test", SHAPES[form](atoms, None))
    a, i, x = atoms[0]
    if len(atoms) == 1:
        return (lambda: a[i] ^ x and rest()) if every else (lambda: a[i] ^ x or rest())
    b, j, y = atoms[1]
    if every:
        return lambda: a[i] ^ x and b[j] ^ y and rest()
    return lambda: a[i] ^ x or b[j] ^ y or rest()

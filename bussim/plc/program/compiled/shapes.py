"""The commonest conditions together with what they drive, in one closure each.

A call costs as much as three contacts, and nine rungs in ten of a real program are one of these: every
arrangement of up to four contacts. Their common value is worked out once, for all of their levels, as a
tree of pairs: the first contact's level picks one of two branches, the next one's goes on from there.
Looking contacts up in it takes no longer on the average than evaluating them one after another until the
value is known, whatever the arrangement, and it makes a closure depend on their number only. Each number
comes in three uses: a condition that returns its value, a coil, an action while the condition is on.
What has no shape here is put together from closures by ``conditions``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Any, NamedTuple

Test = Callable[[], int]
Step = Callable[[], None]


class Atom(NamedTuple):
    """A bit of a device, ``inverted`` (0 or 1) by an exclusive or."""

    bits: bytearray
    at: int
    inverted: int


@dataclass(frozen=True, slots=True)
class ToCoil:
    """The condition's value goes into a bit."""

    bits: bytearray
    at: int


@dataclass(frozen=True, slots=True)
class ToAct:
    """Something is done while the condition is on, at a cost added to ``spent``."""

    act: Step
    spent: list[int]
    extra: int


Use = ToCoil | ToAct | None
#: Makes a closure of a shape's contacts in order: a Test without use, else a Step.
Maker = Callable[[Sequence[Atom], Use], Callable[[], int | None]]
#: A pair of trees for the level of a contact; of none left: 0 or 1.
Tree = Any


def _one(tree: Tree, atoms: Sequence[Atom], use: Use) -> Callable[[], int | None]:
    ((a, i, _),) = atoms
    if isinstance(use, ToCoil):
        bits, at = use.bits, use.at

        def coil() -> None:
            bits[at] = tree[a[i]]

        return coil
    if isinstance(use, ToAct):
        act, spent, extra = use.act, use.spent, use.extra

        def step() -> None:
            if tree[a[i]]:
                spent[0] += extra
                act()

        return step
    return lambda: tree[a[i]]


def _two(tree: Tree, atoms: Sequence[Atom], use: Use) -> Callable[[], int | None]:
    (a, i, _), (b, j, _) = atoms
    if isinstance(use, ToCoil):
        bits, at = use.bits, use.at

        def coil() -> None:
            bits[at] = tree[a[i]][b[j]]

        return coil
    if isinstance(use, ToAct):
        act, spent, extra = use.act, use.spent, use.extra

        def step() -> None:
            if tree[a[i]][b[j]]:
                spent[0] += extra
                act()

        return step
    return lambda: tree[a[i]][b[j]]


def _three(tree: Tree, atoms: Sequence[Atom], use: Use) -> Callable[[], int | None]:
    (a, i, _), (b, j, _), (c, k, _) = atoms
    if isinstance(use, ToCoil):
        bits, at = use.bits, use.at

        def coil() -> None:
            bits[at] = tree[a[i]][b[j]][c[k]]

        return coil
    if isinstance(use, ToAct):
        act, spent, extra = use.act, use.spent, use.extra

        def step() -> None:
            if tree[a[i]][b[j]][c[k]]:
                spent[0] += extra
                act()

        return step
    return lambda: tree[a[i]][b[j]][c[k]]


def _four(tree: Tree, atoms: Sequence[Atom], use: Use) -> Callable[[], int | None]:
    (a, i, _), (b, j, _), (c, k, _), (d, m, _) = atoms
    if isinstance(use, ToCoil):
        bits, at = use.bits, use.at

        def coil() -> None:
            bits[at] = tree[a[i]][b[j]][c[k]][d[m]]

        return coil
    if isinstance(use, ToAct):
        act, spent, extra = use.act, use.spent, use.extra

        def step() -> None:
            if tree[a[i]][b[j]][c[k]][d[m]]:
                spent[0] += extra
                act()

        return step
    return lambda: tree[a[i]][b[j]][c[k]][d[m]]


_BY_NUMBER = (_one, _two, _three, _four)


def _make(form: str, atoms: Sequence[Atom], use: Use) -> Callable[[], int | None]:
    tree = _tree(form, tuple(atom.inverted for atom in atoms))
    return _BY_NUMBER[len(atoms) - 1](tree, atoms, use)


@cache
def _tree(form: str, inverted: tuple[int, ...], levels: tuple[int, ...] = ()) -> Tree:
    """The values of a form's contacts, behind those whose ``levels`` are known."""
    if len(levels) < len(inverted):
        return _tree(form, inverted, (*levels, 0)), _tree(form, inverted, (*levels, 1))
    signs = iter(form)
    asked = (level ^ turned for level, turned in zip(levels, inverted, strict=True))
    return _value(next(signs), signs, asked)


def _value(sign: str, signs: Iterator[str], asked: Iterator[int]) -> int:
    """The value of the part of a form that begins with ``sign``."""
    if sign == "*":
        return next(asked)
    next(signs)  # the bracket
    values = []
    while (inner := next(signs)) != ")":
        values.append(_value(inner, signs, asked))
    return int(all(values) if sign == "&" else any(values))


#: The shapes by their form: ``*`` a contact, ``&(…)`` a series, ``|(…)`` parallels, the more complex
#: parts in front (contacts may change places: reading one changes nothing).
SHAPES: dict[str, Maker] = {
    form: partial(_make, form)
    for form in (
        *("*", "&(**)", "|(**)"),
        *("&(***)", "&(|(**)*)", "|(***)", "|(&(**)*)"),
        *("&(****)", "&(|(**)**)", "&(|(***)*)", "&(|(**)|(**))", "&(|(&(**)*)*)"),
        *("|(****)", "|(&(**)**)", "|(&(***)*)", "|(&(**)&(**))", "|(&(|(**)*)*)"),
    )
}

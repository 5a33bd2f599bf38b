"""The commonest conditions together with what they drive, in one closure each.

A call costs as much as three contacts, and nine rungs in ten of a real program are one of these: up
to four contacts in series or parallel, a self-holding contact with its interlocks, two branches. Each
shape comes in three uses: a condition that is asked, a coil, an action while the condition is on.
What has no shape here is put together from closures by ``conditions``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

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


def _one(atoms: Sequence[Atom], use: Use) -> Callable[[], int | None]:
    ((a, i, x),) = atoms
    if isinstance(use, ToCoil):
        bits, at = use.bits, use.at

        def coil() -> None:
            bits[at] = a[i] ^ x

        return coil
    if isinstance(use, ToAct):
        act, spent, extra = use.act, use.spent, use.extra

        def step() -> None:
            if a[i] ^ x:
                spent[0] += extra
                act()

        return step
    return (lambda: a[i] ^ 1) if x else (lambda: a[i])


def _series_2(atoms: Sequence[Atom], use: Use) -> Callable[[], int | None]:
    (a, i, x), (b, j, y) = atoms
    if isinstance(use, ToCoil):
        bits, at = use.bits, use.at

        def coil() -> None:
            bits[at] = a[i] ^ x and b[j] ^ y

        return coil
    if isinstance(use, ToAct):
        act, spent, extra = use.act, use.spent, use.extra

        def step() -> None:
            if a[i] ^ x and b[j] ^ y:
                spent[0] += extra
                act()

        return step
    return lambda: a[i] ^ x and b[j] ^ y


def _series_3(atoms: Sequence[Atom], use: Use) -> Callable[[], int | None]:
    (a, i, x), (b, j, y), (c, k, z) = atoms
    if isinstance(use, ToCoil):
        bits, at = use.bits, use.at

        def coil() -> None:
            bits[at] = a[i] ^ x and b[j] ^ y and c[k] ^ z

        return coil
    if isinstance(use, ToAct):
        act, spent, extra = use.act, use.spent, use.extra

        def step() -> None:
            if a[i] ^ x and b[j] ^ y and c[k] ^ z:
                spent[0] += extra
                act()

        return step
    return lambda: a[i] ^ x and b[j] ^ y and c[k] ^ z


def _series_4(atoms: Sequence[Atom], use: Use) -> Callable[[], int | None]:
    (a, i, x), (b, j, y), (c, k, z), (d, m, w) = atoms
    if isinstance(use, ToCoil):
        bits, at = use.bits, use.at

        def coil() -> None:
            bits[at] = a[i] ^ x and b[j] ^ y and c[k] ^ z and d[m] ^ w

        return coil
    if isinstance(use, ToAct):
        act, spent, extra = use.act, use.spent, use.extra

        def step() -> None:
            if a[i] ^ x and b[j] ^ y and c[k] ^ z and d[m] ^ w:
                spent[0] += extra
                act()

        return step
    return lambda: a[i] ^ x and b[j] ^ y and c[k] ^ z and d[m] ^ w


def _parallel_2(atoms: Sequence[Atom], use: Use) -> Callable[[], int | None]:
    (a, i, x), (b, j, y) = atoms
    if isinstance(use, ToCoil):
        bits, at = use.bits, use.at

        def coil() -> None:
            bits[at] = a[i] ^ x or b[j] ^ y

        return coil
    if isinstance(use, ToAct):
        act, spent, extra = use.act, use.spent, use.extra

        def step() -> None:
            if a[i] ^ x or b[j] ^ y:
                spent[0] += extra
                act()

        return step
    return lambda: a[i] ^ x or b[j] ^ y


def _parallel_3(atoms: Sequence[Atom], use: Use) -> Callable[[], int | None]:
    (a, i, x), (b, j, y), (c, k, z) = atoms
    if isinstance(use, ToCoil):
        bits, at = use.bits, use.at

        def coil() -> None:
            bits[at] = a[i] ^ x or b[j] ^ y or c[k] ^ z

        return coil
    if isinstance(use, ToAct):
        act, spent, extra = use.act, use.spent, use.extra

        def step() -> None:
            if a[i] ^ x or b[j] ^ y or c[k] ^ z:
                spent[0] += extra
                act()

        return step
    return lambda: a[i] ^ x or b[j] ^ y or c[k] ^ z


def _parallel_4(atoms: Sequence[Atom], use: Use) -> Callable[[], int | None]:
    (a, i, x), (b, j, y), (c, k, z), (d, m, w) = atoms
    if isinstance(use, ToCoil):
        bits, at = use.bits, use.at

        def coil() -> None:
            bits[at] = a[i] ^ x or b[j] ^ y or c[k] ^ z or d[m] ^ w

        return coil
    if isinstance(use, ToAct):
        act, spent, extra = use.act, use.spent, use.extra

        def step() -> None:
            if a[i] ^ x or b[j] ^ y or c[k] ^ z or d[m] ^ w:
                spent[0] += extra
                act()

        return step
    return lambda: a[i] ^ x or b[j] ^ y or c[k] ^ z or d[m] ^ w


def _held(atoms: Sequence[Atom], use: Use) -> Callable[[], int | None]:
    (a, i, x), (b, j, y), (c, k, z) = atoms
    if isinstance(use, ToCoil):
        bits, at = use.bits, use.at

        def coil() -> None:
            bits[at] = (a[i] ^ x or b[j] ^ y) and c[k] ^ z

        return coil
    if isinstance(use, ToAct):
        act, spent, extra = use.act, use.spent, use.extra

        def step() -> None:
            if (a[i] ^ x or b[j] ^ y) and c[k] ^ z:
                spent[0] += extra
                act()

        return step
    return lambda: (a[i] ^ x or b[j] ^ y) and c[k] ^ z


def _held_twice(atoms: Sequence[Atom], use: Use) -> Callable[[], int | None]:
    (a, i, x), (b, j, y), (c, k, z), (d, m, w) = atoms
    if isinstance(use, ToCoil):
        bits, at = use.bits, use.at

        def coil() -> None:
            bits[at] = (a[i] ^ x or b[j] ^ y) and c[k] ^ z and d[m] ^ w

        return coil
    if isinstance(use, ToAct):
        act, spent, extra = use.act, use.spent, use.extra

        def step() -> None:
            if (a[i] ^ x or b[j] ^ y) and c[k] ^ z and d[m] ^ w:
                spent[0] += extra
                act()

        return step
    return lambda: (a[i] ^ x or b[j] ^ y) and c[k] ^ z and d[m] ^ w


def _three_held(atoms: Sequence[Atom], use: Use) -> Callable[[], int | None]:
    (a, i, x), (b, j, y), (c, k, z), (d, m, w) = atoms
    if isinstance(use, ToCoil):
        bits, at = use.bits, use.at

        def coil() -> None:
            bits[at] = (a[i] ^ x or b[j] ^ y or c[k] ^ z) and d[m] ^ w

        return coil
    if isinstance(use, ToAct):
        act, spent, extra = use.act, use.spent, use.extra

        def step() -> None:
            if (a[i] ^ x or b[j] ^ y or c[k] ^ z) and d[m] ^ w:
                spent[0] += extra
                act()

        return step
    return lambda: (a[i] ^ x or b[j] ^ y or c[k] ^ z) and d[m] ^ w


def _set_or_held(atoms: Sequence[Atom], use: Use) -> Callable[[], int | None]:
    (a, i, x), (b, j, y), (c, k, z) = atoms
    if isinstance(use, ToCoil):
        bits, at = use.bits, use.at

        def coil() -> None:
            bits[at] = (a[i] ^ x and b[j] ^ y) or c[k] ^ z

        return coil
    if isinstance(use, ToAct):
        act, spent, extra = use.act, use.spent, use.extra

        def step() -> None:
            if (a[i] ^ x and b[j] ^ y) or c[k] ^ z:
                spent[0] += extra
                act()

        return step
    return lambda: (a[i] ^ x and b[j] ^ y) or c[k] ^ z


def _set_or_either(atoms: Sequence[Atom], use: Use) -> Callable[[], int | None]:
    (a, i, x), (b, j, y), (c, k, z), (d, m, w) = atoms
    if isinstance(use, ToCoil):
        bits, at = use.bits, use.at

        def coil() -> None:
            bits[at] = (a[i] ^ x and b[j] ^ y) or c[k] ^ z or d[m] ^ w

        return coil
    if isinstance(use, ToAct):
        act, spent, extra = use.act, use.spent, use.extra

        def step() -> None:
            if (a[i] ^ x and b[j] ^ y) or c[k] ^ z or d[m] ^ w:
                spent[0] += extra
                act()

        return step
    return lambda: (a[i] ^ x and b[j] ^ y) or c[k] ^ z or d[m] ^ w


def _series_or_held(atoms: Sequence[Atom], use: Use) -> Callable[[], int | None]:
    (a, i, x), (b, j, y), (c, k, z), (d, m, w) = atoms
    if isinstance(use, ToCoil):
        bits, at = use.bits, use.at

        def coil() -> None:
            bits[at] = (a[i] ^ x and b[j] ^ y and c[k] ^ z) or d[m] ^ w

        return coil
    if isinstance(use, ToAct):
        act, spent, extra = use.act, use.spent, use.extra

        def step() -> None:
            if (a[i] ^ x and b[j] ^ y and c[k] ^ z) or d[m] ^ w:
                spent[0] += extra
                act()

        return step
    return lambda: (a[i] ^ x and b[j] ^ y and c[k] ^ z) or d[m] ^ w


def _branches(atoms: Sequence[Atom], use: Use) -> Callable[[], int | None]:
    (a, i, x), (b, j, y), (c, k, z), (d, m, w) = atoms
    if isinstance(use, ToCoil):
        bits, at = use.bits, use.at

        def coil() -> None:
            bits[at] = (a[i] ^ x and b[j] ^ y) or (c[k] ^ z and d[m] ^ w)

        return coil
    if isinstance(use, ToAct):
        act, spent, extra = use.act, use.spent, use.extra

        def step() -> None:
            if (a[i] ^ x and b[j] ^ y) or (c[k] ^ z and d[m] ^ w):
                spent[0] += extra
                act()

        return step
    return lambda: (a[i] ^ x and b[j] ^ y) or (c[k] ^ z and d[m] ^ w)


def _pairs(atoms: Sequence[Atom], use: Use) -> Callable[[], int | None]:
    (a, i, x), (b, j, y), (c, k, z), (d, m, w) = atoms
    if isinstance(use, ToCoil):
        bits, at = use.bits, use.at

        def coil() -> None:
            bits[at] = (a[i] ^ x or b[j] ^ y) and (c[k] ^ z or d[m] ^ w)

        return coil
    if isinstance(use, ToAct):
        act, spent, extra = use.act, use.spent, use.extra

        def step() -> None:
            if (a[i] ^ x or b[j] ^ y) and (c[k] ^ z or d[m] ^ w):
                spent[0] += extra
                act()

        return step
    return lambda: (a[i] ^ x or b[j] ^ y) and (c[k] ^ z or d[m] ^ w)


def _set_held(atoms: Sequence[Atom], use: Use) -> Callable[[], int | None]:
    (a, i, x), (b, j, y), (c, k, z), (d, m, w) = atoms
    if isinstance(use, ToCoil):
        bits, at = use.bits, use.at

        def coil() -> None:
            bits[at] = ((a[i] ^ x and b[j] ^ y) or c[k] ^ z) and d[m] ^ w

        return coil
    if isinstance(use, ToAct):
        act, spent, extra = use.act, use.spent, use.extra

        def step() -> None:
            if ((a[i] ^ x and b[j] ^ y) or c[k] ^ z) and d[m] ^ w:
                spent[0] += extra
                act()

        return step
    return lambda: ((a[i] ^ x and b[j] ^ y) or c[k] ^ z) and d[m] ^ w


#: The shapes by their form: ``*`` a contact, ``&(…)`` a series, ``|(…)`` parallels, the more complex
#: parts in front (contacts may change places: asking one changes nothing).
SHAPES: dict[str, Maker] = {
    "*": _one,
    "&(**)": _series_2,
    "&(***)": _series_3,
    "&(****)": _series_4,
    "|(**)": _parallel_2,
    "|(***)": _parallel_3,
    "|(****)": _parallel_4,
    "&(|(**)*)": _held,
    "&(|(**)**)": _held_twice,
    "&(|(***)*)": _three_held,
    "|(&(**)*)": _set_or_held,
    "|(&(**)**)": _set_or_either,
    "|(&(***)*)": _series_or_held,
    "|(&(**)&(**))": _branches,
    "&(|(**)|(**))": _pairs,
    "&(|(&(**)*)*)": _set_held,
}

"""Shapes of conditions: every arrangement of up to four contacts, in each use, against plain logic."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import pytest

from bussim.plc.program.compiled.shapes import SHAPES, Atom, ToAct, ToCoil

#: Each form as logic.
SAYS: dict[str, Callable[..., object]] = {
    "*": lambda a: a,
    "&(**)": lambda a, b: a and b,
    "|(**)": lambda a, b: a or b,
    "&(***)": lambda a, b, c: a and b and c,
    "|(***)": lambda a, b, c: a or b or c,
    "&(|(**)*)": lambda a, b, c: (a or b) and c,
    "|(&(**)*)": lambda a, b, c: (a and b) or c,
    "&(****)": lambda a, b, c, d: a and b and c and d,
    "|(****)": lambda a, b, c, d: a or b or c or d,
    "&(|(**)**)": lambda a, b, c, d: (a or b) and c and d,
    "|(&(**)**)": lambda a, b, c, d: (a and b) or c or d,
    "&(|(***)*)": lambda a, b, c, d: (a or b or c) and d,
    "|(&(***)*)": lambda a, b, c, d: (a and b and c) or d,
    "&(|(**)|(**))": lambda a, b, c, d: (a or b) and (c or d),
    "|(&(**)&(**))": lambda a, b, c, d: (a and b) or (c and d),
    "&(|(&(**)*)*)": lambda a, b, c, d: ((a and b) or c) and d,
    "|(&(|(**)*)*)": lambda a, b, c, d: ((a or b) and c) or d,
}


@pytest.mark.parametrize("form", SHAPES)
def test_a_shape_says_what_its_contacts_say(form: str) -> None:
    count = form.count("*")
    bits, out, spent, acts = bytearray(count), bytearray(1), [0], []
    for inverted in itertools.product((0, 1), repeat=count):
        atoms = [Atom(bits, at, turned) for at, turned in enumerate(inverted)]
        test, coil = SHAPES[form](atoms, None), SHAPES[form](atoms, ToCoil(out, 0))
        act = SHAPES[form](atoms, ToAct(lambda: acts.append(1), spent, 7))
        for levels in itertools.product((0, 1), repeat=count):
            bits[:] = bytes(levels)
            asked = [level ^ turned for level, turned in zip(levels, inverted, strict=True)]
            expected = int(bool(SAYS[form](*asked)))
            spent[0] = 0
            acts.clear()
            coil()
            act()
            assert (test(), out[0], spent[0], len(acts)) == (expected, expected, 7 * expected, expected)


def arrangements(count: int, sign: str) -> set[tuple[object, ...]]:
    """Series (parallels) of so many contacts, of parts that are contacts or parallels (series)."""
    other = "|" if sign == "&" else "&"
    found = set()
    for parts in range(2, count + 1):
        for sizes in itertools.combinations_with_replacement(range(1, count), parts):
            if sum(sizes) != count:
                continue
            choices = [["*"] if size == 1 else sorted(arrangements(size, other), key=str) for size in sizes]
            found |= {(sign, *sorted(chosen, key=str)) for chosen in itertools.product(*choices)}
    return found


def test_every_arrangement_of_up_to_four_contacts_has_a_shape() -> None:
    """1 of one contact, 2 of two, 4 of three, 10 of four."""
    numbers = [sum(form.count("*") == count for form in SHAPES) for count in range(1, 5)]
    assert numbers == [1, *(len(arrangements(count, "&") | arrangements(count, "|")) for count in (2, 3, 4))]
    assert set(SHAPES) == set(SAYS)

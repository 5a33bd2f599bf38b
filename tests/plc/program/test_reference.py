"""Random programs do the same here and in the tests' own interpreter: two hundred, and two thousand of an FX3U."""

from __future__ import annotations

import random
import re

import numpy as np
import pytest

from bussim.plc.memory import Family, Memory
from bussim.plc.program.execution import ProgramRun
from bussim.plc.program.program import Program
from bussim.plc.program.text.catalog import FORMS
from bussim.units import TICKS_PER_MS
from tests.plc.program.random_programs import Writer
from tests.plc.program.reference import Reference
from tests.selection import quick

PROGRAMS, SCANS = 200, 15
#: What the reference does not keep: the steps of errors, the watchdog's time.
UNTOLD = {8000, 8068, 8069}


def state(memory: Memory) -> dict[tuple[str, int], int]:
    """Every device that is not 0; a bit's letter in capitals, a word's in small letters."""
    found = {}
    for letters, shelf in (("XYMSTC", memory.bits), ("DRTCVZ", memory.words)):
        for letter in letters:
            devices = np.asarray(shelf(letter))
            shown = letter if shelf == memory.bits else letter.lower()
            found |= {(shown, int(at)): int(devices[at]) for at in np.flatnonzero(devices)}
    return {key: value for key, value in found.items() if key[0] != "d" or key[1] not in UNTOLD}


def expected(reference: Reference) -> dict[tuple[str, int], int]:
    found = {key: 1 for key, bit in reference.bits.items() if bit}
    return found | {
        (letter.lower(), at): word & (0xFFFFFFFF if letter == "C" and at >= 200 else 0xFFFF)
        for (letter, at), word in reference.words.items()
        if word
    }


def compare(seed: int, *, fx3: bool = False) -> None:
    text = Writer(seed, fx3=fx3).program()
    memory, reference = Memory(), Reference(text, fx3=fx3)
    run = ProgramRun(Program.parse(text, "random", family=Family.FX3U if fx3 else Family.FX2N), memory)
    run.run(0)
    rng = random.Random(seed)
    now = 0
    for number in range(SCANS):
        for point in range(8):
            bit = rng.getrandbits(1)
            memory.bits("X")[point] = bit
            reference.bits["X", point] = bit
        run.scan(now)
        reference.scan(now)
        assert state(memory) == expected(reference), f"scan {number} of\n{text}"
        now += rng.choice((1, 5, 30, 100)) * TICKS_PER_MS + rng.randrange(1000)


@pytest.mark.parametrize("seed", quick(30, range(PROGRAMS)))
def test_a_random_program_does_the_same_compiled_and_interpreted(seed: int) -> None:
    compare(seed)


@pytest.mark.parametrize("block", quick(1, range(100)))
def test_so_do_twenty_of_an_fx3u(block: int) -> None:
    for seed in range(20 * block, 20 * block + 20):
        compare(seed, fx3=True)


def test_the_random_programs_are_no_trifles() -> None:
    """They use every instruction, and operands of every kind; some run into errors, some do not.

    Steps have random charts of their own (test_steps).
    """
    texts = [Writer(seed).program() for seed in range(PROGRAMS)]
    used = {line.split()[0] for text in texts for line in text.split("\n")}
    missing = {name for name in FORMS if name not in used}
    missing -= {"NOP", "WDT", "WDTP", "RS", "RS2", "CPAVL", "STL", "RET"}
    assert not missing
    errors = 0
    for text in texts[:60]:
        reference = Reference(text)
        for number in range(5):
            reference.scan(number * 720_000)
        errors += reference.bits["M", 8067]
    assert 5 < errors < 55
    texts = "\n".join(Writer(seed, fx3=True).program() for seed in range(60))
    for new in (
        r"LD D\d+\.",
        r"ANI D\d+\.",
        r"ORP D\d+\.",
        r"OUT D\d+\.",
        r"SET D\d+\.",
        r"RST D\d+\.",
        r"LDI M\d+Z",
        "OUT M30Z",
        "SET Y2[VZ]",
        "RST M7672[VZ]",
    ):
        assert re.search(f"^{new}", texts, re.MULTILINE), new
    for new in (
        r" R\d",
        " M7679",
        " S4095",
        r"OUT T256",
        "RST R3",
        r" R\d+[VZ]",
        "ANDF (X|M|Y|T|C)[0-9]+[VZ]",
    ):
        assert re.search(new, texts), new

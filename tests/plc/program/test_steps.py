"""Step ladders: STL, RET, and SET or OUT of the state that follows."""

from __future__ import annotations

import random

import pytest

from bussim.plc.memory import Memory
from bussim.plc.program.execution import ProgramRun
from bussim.plc.program.program import Program
from bussim.units import TICKS_PER_MS
from tests.plc.program.reference import Reference
from tests.plc.program.rigs import Rig, problems
from tests.plc.program.test_reference import expected, state

#: A press: it waits, goes down until X1, rests half a second, goes up until X2. Y1 is in two steps.
PRESS = """LD M8002
SET S0
STL S0
LD X0
SET S20
STL S20
OUT Y0
OUT Y1
LD X1
SET S21
STL S21
OUT T0 K5
LD T0
SET S22
STL S22
OUT Y1
LD X2
OUT S0
RET
"""


def test_a_sequence_goes_from_step_to_step() -> None:
    rig = Rig(PRESS)
    seen = []
    for number in range(14):
        rig.scan(every=100, X0=int(number == 2), X1=int(number == 4), X2=int(number == 12))
        seen.append("".join(str(rig.bit(name)) for name in ("S0", "S20", "S21", "S22", "Y0", "Y1")))
    # In the scan of a transition the coils of the step that was left stay on: they go off in the next one.
    assert seen == [
        *["100000"] * 2,
        *["010011"] * 2,
        "001011",
        *["001000"] * 4,
        *["000101"] * 3,
        "100001",
        "100000",
    ]


def test_what_stands_in_a_step_that_is_off_is_left_out() -> None:
    rig = Rig("LD X0 / SET S20 / STL S20 / OUT Y0 / LD X1 / RST S20 / RET / LDI M8000 / OUT M0")
    rig.memory.set_word("D", 0, 0)
    assert rig.scan(X0=1).bit("Y0") == 1
    assert rig.scan(X0=0, X1=1).bit("Y0") == 1  # reset behind its coil
    assert rig.scan(X1=0).bit("Y0") == 0  # carried out once more
    rig.memory.bits("Y")[0] = 1
    assert rig.scan(2).bit("Y0") == 1  # and then no more


def test_parallel_steps_meet_where_all_are_on() -> None:
    text = """LD X0 / SET S20 / STL S20 / LD X1 / SET S21 / SET S22 / STL S21 / LD X2 / SET S23 / STL S22 / LD X3 / SET S24
 / STL S23 / STL S24 / LD X4 / SET S25 / STL S25 / OUT Y5 / RET"""
    rig = Rig(text.replace("\n", ""))
    names = ("S20", "S21", "S22", "S23", "S24", "S25")
    assert rig.scan(X0=1).scan(X0=0, X1=1).bits(*names) == [0, 1, 1, 0, 0, 0]
    assert rig.scan(X1=0, X2=1).scan(X2=0, X4=1).bits(*names) == [0, 0, 1, 1, 0, 0]
    assert rig.scan(X3=1).bits(*names) == [0, 0, 0, 0, 0, 1]
    assert rig.bit("Y5") == 1


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("LD X0 / OUT Y0 / RET / END", "RET without its STL"),
        ("STL S0 / OUT Y0 / END", "STL without its RET"),
        ("STL S0 / LD X0 / RET / END", "contacts that drive nothing"),
        ("STL S1000 / RET / END", "allowed S0–S999"),
    ],
)
def test_mistakes(text: str, says: str) -> None:
    assert says in str(problems(text))


def _chart(seed: int) -> str:
    """A random chart: jumps anywhere, several states on at once, coils in several steps, edges, branches."""
    rng = random.Random(seed)
    lines = ["LD M8002", "SET S0", "LDP X7", "SET S2"]
    states = list(range(6))
    for number in states:
        lines += [f"STL S{number}"] + [f"STL S{rng.choice(states)}"] * (rng.random() < 0.2)
        for _ in range(rng.randrange(3)):
            lines.append(rng.choice(("OUT Y", "OUT M", "SET M", "RST M")) + str(rng.randrange(5)))
        for _ in range(rng.randrange(1, 4)):
            lines.append(rng.choice(("LD X", "LDI X", "LDP X", "LD M")) + str(rng.randrange(7)))
            if rng.random() < 0.3:
                lines += ["MPS", f"AND X{rng.randrange(7)}", f"SET S{rng.choice(states)}", "MPP"]
            lines.append(
                rng.choice((f"SET S{rng.choice(states)}", f"OUT S{rng.choice(states)}", f"RST S{rng.choice(states)}",
                            f"OUT T{number} K3", f"OUT C{number} K2", f"INCP D{number}", f"MOV K{number} D9"))
            )  # fmt: skip
    return "\n".join([*lines, "RET", "LD S3", "OUT Y7", "END"]) + "\n"


@pytest.mark.parametrize("seed", range(30))
def test_a_random_chart_does_the_same_compiled_and_interpreted(seed: int) -> None:
    text = _chart(seed)
    memory, reference = Memory(), Reference(text)
    run = ProgramRun(Program.parse(text, "chart"), memory)
    run.run(0)
    rng, now = random.Random(seed), 0
    for number in range(25):
        for point in range(8):
            bit = rng.getrandbits(1)
            memory.bits("X")[point] = bit
            reference.bits["X", point] = bit
        run.scan(now)
        reference.scan(now)
        assert state(memory) == expected(reference), f"scan {number} of\n{text}"
        now += rng.choice((1, 5, 30, 100)) * TICKS_PER_MS


def test_one_device_may_be_driven_in_several_steps() -> None:
    assert not Program.parse(PRESS + "END", "p").warnings  # Y1 in two
    again = PRESS.replace("OUT Y1\nLD X2", "OUT Y1\nOUT Y1\nLD X2")
    (warning,) = Program.parse(again + "END", "p").warnings
    assert "Y1 is driven at line 16 too" in warning.message
    (warning,) = Program.parse(PRESS + "LD X7\nOUT Y0\nEND", "p").warnings  # behind RET
    assert "Y0 is driven at line 7 too" in warning.message
    twice = PRESS.replace("RET\n", "STL S20\nOUT Y0\nRET\n")
    (warning,) = Program.parse(twice + "END", "p").warnings
    assert "Y0 is driven at line 7 too" in warning.message

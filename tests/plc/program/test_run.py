"""Special devices, RUN and STOP, instruction times, RS2 and CPAVL."""

from __future__ import annotations

import pickle

import pytest

from bussim.plc.memory import Device, Memory
from bussim.plc.program.compiled.build import APPLIED
from bussim.plc.program.execution import ProgramRun
from bussim.plc.program.instruction_times import InstructionTimes
from bussim.plc.program.program import Program
from bussim.plc.program.text.catalog import FORMS, LABEL, SPECS, Flow, LadderRole
from bussim.units import TICKS_PER_MS
from tests.plc.program.rigs import Rig


def test_every_output_of_the_catalog_can_be_carried_out() -> None:
    outputs = {spec.name for spec in SPECS.values() if spec.role is LadderRole.OUTPUT}
    flows = {spec.name: spec.flow for spec in (*SPECS.values(), LABEL) if spec.flow is not None}
    assert set(flows.values()) == set(Flow)
    assert outputs - set(flows) == set(APPLIED) | {"OUT", "SET", "RST", "PLS", "PLF"}
    assert {name for name in outputs if SPECS[name].is_applied} == set(APPLIED)
    # A P behind a contact's name is an edge, a D form's name never that of another instruction.
    assert FORMS["ANDP"].spec.test == "rise"
    assert FORMS["DANDP"].spec.name == "WAND"


def test_special_bits_of_run_and_of_the_first_scan() -> None:
    rig = Rig("LD M8002 / INC D0 / LDI M8003 / INC D1 / LD M8000 / INC D2 / LD M8001 / INC D3").scan()
    assert rig.bits("M8000", "M8001", "M8002", "M8003") == [1, 0, 1, 0]
    rig.scan(4)
    assert rig.bits("M8000", "M8001", "M8002", "M8003") == [1, 0, 0, 1]
    assert [rig.word(f"D{n}") for n in range(4)] == [1, 1, 5, 0]
    rig.run.stop()
    assert rig.bits("M8000", "M8001") == [0, 1]
    rig.run.run(round(rig.ms * TICKS_PER_MS))
    assert rig.scan(3).word("D0") == 2


@pytest.mark.parametrize(
    ("bit", "period"), [("M8011", 10), ("M8012", 100), ("M8013", 1000), ("M8014", 60_000)]
)
def test_clocks_are_on_for_half_their_period(bit: str, period: int) -> None:
    rig = Rig(f"LDP {bit} / INC D0")
    states = [rig.scan(every=period / 10).bit(bit) for _ in range(30)]
    assert states == ([1] * 5 + [0] * 5) * 3
    assert rig.word("D0") == 3


def test_clocks_run_from_power_on() -> None:
    memory = Memory()
    run = ProgramRun(Program.parse("LD M8013\nOUT Y0\nEND", "p"), memory, power_on=700 * TICKS_PER_MS)
    run.run(700 * TICKS_PER_MS)
    run.scan(1100 * TICKS_PER_MS)
    assert memory.get(Device("Y", 0)) == 1
    run.scan(1300 * TICKS_PER_MS)
    assert memory.get(Device("Y", 0)) == 0


def test_scan_times_are_in_d8010_to_d8012() -> None:
    memory = Memory()
    run = ProgramRun(Program.parse("LD M8000\nMOV D8010 D0\nEND", "p"), memory)
    words = [Device("D", address) for address in (0, 8010, 8011, 8012)]

    def scanned(*begins: float) -> list[list[int]]:
        found = []
        for begin in begins:
            run.scan(round(begin * TICKS_PER_MS))
            found.append([memory.get(word) for word in words])
        return found

    run.run(5 * TICKS_PER_MS)
    expected = [[0, 0, 0, 0], [80, 80, 80, 80], [65, 65, 65, 80], [121, 121, 65, 121], [70, 70, 65, 121]]
    assert scanned(5, 13, 19.5, 31.69, 38.7) == expected
    run.stop()
    run.run(100 * TICKS_PER_MS)
    assert scanned(100, 120) == [[0, 0, 0, 0], [200, 200, 200, 200]]
    assert scanned(10_000)[0][1:] == [0xFFFF, 200, 0xFFFF]  # more than the word holds


def test_m8038_is_on_in_the_first_scan_at_step_0_only() -> None:
    rig = Rig("LD M8038 / MOV K2 D8176 / INC D0").scan(3)
    assert (rig.word("D8176"), rig.word("D0")) == (2, 1)
    assert rig.program.sets_link_at_step_0
    late = Rig("LD M8000 / INC D1 / LD M8038 / MOV K2 D8176").scan(3)
    assert late.word("D8176") == 0
    assert "first step" in late.program.warnings[0].message


def test_run_forgets_edges() -> None:
    rig = Rig("LD X0 / INCP D0 / OUT C100 K9").scan(4, X0=1)
    rig.run.stop()
    rig.run.run(round(rig.ms * TICKS_PER_MS))
    rig.scan()
    assert [rig.word(name) for name in ("C100", "D0")] == [2, 2]


def test_time_between_stop_and_run_is_not_counted_by_timers() -> None:
    rig = Rig("LD X0 / OUT T250 K90").scan(4, every=100, X0=1)
    rig.run.stop()
    rig.ms += 5000
    rig.run.run(round(rig.ms * TICKS_PER_MS))
    assert rig.scan(2, every=100).word("T250") == 4


# -- times -----------------------------------------------------------------------------------------


def ticks(text: str, times: InstructionTimes, **bits: int) -> int:
    rig = Rig(text, times=times)
    for name, value in bits.items():
        rig.scan(0, **{name: value})
    return rig.run.scan(0)


TIMES = InstructionTimes(
    basic=1000,
    timer=2000,
    comparison=3000,
    idle=500,
    move=10_000,
    arithmetic=20_000,
    block=30_000,
    each=100,
    wide=2.0,
)


@pytest.mark.parametrize(
    ("text", "off", "on"),
    [
        ("LD X0 / OUT Y0", 3, 3),  # END takes its µs too
        ("LD X0 / OR X1 / ANB / SET Y0", 0, 0),
        ("LD X0 / MPS / OUT Y0 / MPP / OUT Y1", 6, 6),
        ("LD X0 / OUT T0 K5", 4, 4),
        ("LD X0 / RST C0", 4, 4),
        ("LD X0 / RST M0", 3, 3),
        ("LD= D0 K1 / OUT Y0", 5, 5),
        ("LDD= D0 K1 / OUT Y0", 8, 8),
        ("LD X0 / MOV D0 D1", 2.5, 12),
        ("LD X0 / DMOV D0 D2", 2.5, 22),
        ("LD X0 / MOVP D0 D1 / MOV D0 D1", 3, 22),
        ("LD X0 / OUT Y0 / MOV D0 D1", 3.5, 13),
        ("LD X0 / ADD D0 D1 D2", 2.5, 22),
        ("LD X0 / BMOV D0 D10 K5", 2.5, 32.5),
        ("LD X0 / ZRST D0 D9", 2.5, 33),
        ("LD X0 / SFTL X0 M0 K8 K1", 2.5, 32.8),
        ("LDI X0 / CJ P0 / LD X1 / MOV D0 D1 / P0", 4, 5.5),
        ("FOR K3 / LD X0 / MOV D0 D1 / NEXT", 9.5, 38),
    ],
)  # fmt: skip
def test_a_scan_takes_the_sum_of_its_instructions(text: str, off: float, on: float) -> None:
    if "ANB" in text:
        text, off, on = text.replace("OR X1", "LD X1"), 5, 5
    assert (ticks(text, TIMES), ticks(text, TIMES, X0=1)) == (round(off * 72), round(on * 72))


def test_times_are_rounded_once_for_the_scan() -> None:
    # 0.08 µs are 5.76 ticks: a hundred contacts take 576 ticks, not 600.
    text = "LD M0 / " + " / ".join(["AND M1"] * 97) + " / OUT Y0"
    assert ticks(text, InstructionTimes()) == 576


def test_one_instruction_may_have_a_time_of_its_own() -> None:
    times = InstructionTimes(basic=0, idle=0, others=(("MOV", 7000), ("MOV off", 1000)))
    assert (ticks("LD X0 / MOV D0 D1", times), ticks("LD X0 / MOV D0 D1", times, X0=1)) == (72, 7 * 72)


# -- ports -----------------------------------------------------------------------------------------


class Heard:
    def __init__(self) -> None:
        self.calls: list[tuple[object, ...]] = []

    def drive(self, instruction: int, operands: tuple[Device | int, ...], now: int) -> None:
        self.calls.append((instruction, operands, now))

    def cpavl(self, words: Device, bits: Device, port: int) -> None:
        self.calls.append((words, bits, port))


def test_rs2_is_handed_on_while_it_is_driven() -> None:
    heard = Heard()
    rig = Rig(
        "LD M8002 / CPAVL D0 M0 K4 / LD X0 / RS2 D200 K5 D500 D7 K2 / RS2 D103 H0064 D400 D500 K4",
        ports=heard,
    )
    rig.scan()
    assert heard.calls == [(Device("D", 0), Device("M", 0), 4)]
    heard.calls.clear()
    rig.scan(2, X0=1).scan(X0=0)
    first = (Device("D", 200), 5, Device("D", 500), Device("D", 7), 2)
    second = (Device("D", 103), 0x64, Device("D", 400), Device("D", 500), 4)
    at = 10 * TICKS_PER_MS
    assert heard.calls == [(3, first, at), (4, second, at), (3, first, 2 * at), (4, second, 2 * at)]


def test_the_time_that_ports_see_is_the_simulations() -> None:
    heard, start = Heard(), 5 * TICKS_PER_MS
    run = ProgramRun(
        Program.parse("LD M8000\nRS2 D0 K1 D9 K1 K3\nEND", "p"), Memory(), ports=heard, power_on=start
    )
    run.run(start)
    run.scan(start + 7)
    assert heard.calls[0][2] == start + 7


def test_a_program_with_rs2_needs_ports() -> None:
    with pytest.raises(ValueError, match="ports"):
        Rig("LD X0 / RS2 D200 K5 D500 K4 K2")


# -- the program as a value ------------------------------------------------------------------------


def test_programs_are_values() -> None:
    one, other = (Program.parse("LD X0\nOUT Y0\nEND", name) for name in ("a.il", "b.il"))
    assert one == Program.parse(one.text, "a.il")
    assert one != other
    again = pickle.loads(pickle.dumps(one))  # noqa: S301 - what this test has just written
    assert again == one
    assert hash(again) == hash(one)
    assert again.steps == 3


def test_what_a_program_writes() -> None:
    program = Program.parse(
        "LD X0\nOUT M5\nMOV K1 K2M8\nDMOV D0 D10\nMUL D0 D1 D20\nBMOV D0 D40 K8\nMOV D0 D0Z0\nEND", "p"
    )
    written = [(extent.letter, extent.first, extent.last) for extent in program.writes()]
    assert written == [("M", 5, 5), ("M", 8, 15), ("D", 10, 11), ("D", 20, 21), ("D", 40, 47)]
    program = Program.parse("LD X0\nOUT M8024\nBMOV D0 D40 D9\nBMOV K1X0 D50 K1\nEND", "p")
    written = [(extent.letter, extent.first, extent.last) for extent in program.writes()]
    assert written == [("M", 8024, 8024), ("D", 0, 0), ("D", 40, 40), ("D", 50, 50)]


@pytest.mark.parametrize(
    ("text", "steps"),
    [("LD X0", 1), ("LDP X0", 2), ("OUT Y0", 1), ("OUT M8000", 2), ("OUT T0 K1", 3), ("OUT C200 K1", 5), ("MOV K1 D0", 5), ("DMOV K1 D0", 9),
     ("ADD D0 D1 D2", 7), ("DADD D0 D2 D4", 13), ("LD= D0 K1", 5), ("LDD= D0 K1", 9), ("CJ P63", 3), ("INC D0", 3), ("RS2 D0 K1 D1 K1 K3", 11),
     ("CPAVL D0 M0 K3", 11), ("RST D0", 3), ("ZCP K0 K1 D0 M0", 9), ("BMOV D0 D1 K2", 7)],
)  # fmt: skip
def test_program_steps(text: str, steps: int) -> None:
    text = text.replace("OUT M8000", "OUT M8122")
    front = "" if text.startswith("LD") else "LD M8000\n"
    back = "\nOUT Y1\nEND" if text.startswith("LD") else "\nEND"
    assert Program.parse(front + text + back, "p").steps == steps + 2


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("LD X0\nSET M8034\nSET M8034\nEND", ["p.il:2:1: M8034, which switches all outputs off, is not simulated: it changes nothing, and nothing drives it"]),
        ("LD X0\nMOV D0 K2M8032\nEND", [f"p.il:2:1: M{n}, which {what}, is not simulated: it changes nothing, and nothing drives it" for n, what in
         ((8032, "clears what is latched"), (8034, "switches all outputs off"), (8035, "with M8036 and M8037 forces RUN and STOP"),
          (8036, "forces RUN"), (8037, "forces STOP"), (8039, "makes the scan last as long as D8039 says"))]),
        ("LD X0\nOUT M8160\nXCHP D0 D1\nEND", ["p.il:2:1: M8160, which makes XCH swap bytes, is not simulated: it changes nothing, and nothing drives it"]),
        ("LD X0\nOUT M8160\nMOV D0 D1\nEND", ["p.il:2:1: M8160, which makes XCH swap bytes, is not simulated: it changes nothing, and nothing drives it"]),
        ("LD X0\nRST M8160\nXCHP D0 D1\nEND", []),
        ("LD M8160\nXCHP D0 D1\nEND", ["p.il:1:1: M8160, which makes XCH swap bytes, is not simulated: it changes nothing, and nothing drives it"]),
        ("LD X0\nSET M8161\nRS2 D0 K1 D9 K1 K3\nEND", ["p.il:2:1: M8161, the 8-bit mode of RS (RS2 has that of the format word which CPAVL takes), is for RS, which no program of the PLC has: it changes nothing, and nothing drives it"]),
        ("LD X0\nSET M8028\nOUT T62 K1\nEND", ["p.il:2:1: M8028, which on some PLCs makes T32–T62 timers of 10 ms, is not simulated: it changes nothing, and nothing drives it"]),
        ("LD X0\nMOV D8120 D1\nMOV K1 D8120\nEND", ["p.il:2:1: D8120 is for RS, which no program of the PLC has: it changes nothing, and nothing drives it"]),
        ("LD M8029\nOUT Y0\nLD M8123\nRST M8123\nEND", ["p.il:1:1: M8029 is not simulated: it changes nothing, and nothing drives it", "p.il:3:1: M8123 is for RS, which no program of the PLC has: it changes nothing, and nothing drives it"]),
        ("LD M8004\nMOV D8019 D0\nMOV K4M8000 D1\nOUT M8033\nEND", []),
        ("LD X0\nSET M8024\nBMOV D0 D1 K2\nEND", []),
    ],
)  # fmt: skip
def test_special_bits_that_change_nothing_are_a_warning(text: str, expected: list[str]) -> None:
    assert [str(problem) for problem in Program.parse(text, "p.il").warnings] == expected


def test_two_coils_are_a_warning() -> None:
    program = Program.parse(
        "LD X0\nOUT Y010\nLD X1\nOUT Y10\nMOV D0 K1Y7\nPLS M3\nDMOV D0 K8M0\nSET Y10\nEND", "p.il"
    )
    assert [str(problem) for problem in program.warnings] == [
        "p.il:4:1: Y10 is driven at line 2 too; the last one executed wins",
        "p.il:5:1: MOV writes Y10, which OUT at line 2 drives; the last one executed wins",
        "p.il:7:1: DMOV writes M3, which PLS at line 6 drives; the last one executed wins",
    ]

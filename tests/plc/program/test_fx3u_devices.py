"""Devices that an FX3U has and others have not: ranges, R, bits of words, contacts with an index."""

from __future__ import annotations

import pytest

import bussim
from bussim.errors import ProgramError, ScenarioError
from bussim.plc.memory import Device, Family, Memory, parse_device
from bussim.plc.program.execution import ProgramRun
from bussim.plc.program.program import Program
from bussim.scenario.loader import loads
from bussim.units import TICKS_PER_MS
from tests.plc.program.rigs import problems


def run(text: str, scans: int = 1) -> Memory:
    memory = Memory()
    program = ProgramRun(Program.parse(text + "\nEND", "p", family=Family.FX3U), memory)
    program.run(0)
    for scan in range(scans):
        program.scan(scan * 10 * TICKS_PER_MS)
    return memory


@pytest.mark.parametrize(
    ("last", "beyond"),
    [("M7679", "M7680"), ("M8511", "M8512"), ("S4095", "S4096"), ("D8511.F", "D8512.0"), ("D0.0", "D0.G")],
)
def test_the_last_bit_of_each_range_is_there_and_none_beyond(last: str, beyond: str) -> None:
    memory = run(f"LD M8000\nSET {last}")
    device, _, bit = last.partition(".")
    value = (
        memory.word("D", int(device[1:])) >> int(bit, 16)
        if bit
        else memory.get(Device(last[0], int(last[1:])))
    )
    assert value & 1
    for text, family in ((beyond, Family.FX3U), (last, Family.FX2N)):
        with pytest.raises(ProgramError, match=text.replace(".", r"\.")):
            Program.parse(f"LD M8000\nSET {text}\nEND", "p", family=family)


def test_registers_r_are_words_like_d() -> None:
    memory = run(
        "LD M8000\nDMOV K100000 R32766\nMOV K3 R5\nMOV K4 R9\nBMOV R5 D5 K1\nADD R9 R5 D6\nZRST R8 R9"
    )
    assert [memory.word("D", 5), memory.word("D", 6)] == [3, 7]
    assert [memory.word("R", at) for at in (9, 32766, 32767)] == [0, 100000 & 0xFFFF, 1]
    assert "allowed on an FX3U only" in str(problems("LD M8000\nMOV K1 R0\nEND"))


def test_a_bit_of_a_word_is_contact_and_coil() -> None:
    text = """LD M8000\nMOV K5 D7\nLDI M8002\nMOV K1 D7\nLD D7.2\nOUT Y0\nLDP D7.2\nOUT Y1\nLDI D7.0\nOUT Y2
LD M8000\nMOV HFFFF D1\nOUT D0.F\nRST D1.3\nLDI M8000\nOUT D1.0"""
    bits = [[run(text, scans).get(Device("Y", at)) for at in range(3)] for scans in (1, 2)]
    assert bits == [[1, 1, 0], [0, 0, 0]]
    assert [run(text).word("D", at) for at in (0, 1)] == [0x8000, 0xFFF6]


def test_a_contact_with_an_index_fails_beyond_its_range() -> None:
    text = "LD M8000\nMOV K7672 Z0\nSET M7679\nLD M7Z0\nOUT Y0\nLDI M8Z0\nOUT Y1"
    memory = run(text)
    assert [memory.get(Device("Y", 0)), memory.get(Device("Y", 1))] == [1, 0]
    assert memory.get(Device("M", 8067)) == 1
    assert memory.word("D", 8067) == 6706
    assert "cannot have an index register" in str(problems("LD M0Z0\nOUT Y0\nEND"))
    with pytest.raises(ProgramError, match="cannot have an index register"):
        Program.parse("LD S0Z0\nOUT Y0\nEND", "p", family=Family.FX3U)


def test_program_steps() -> None:
    lines = ["LD D0.3", "ANI M0Z1", "OUT D1.F", "LDP M0", "SET D1.0", "MOV K1 R0", "OUT T300 K5", "END"]
    program = Program.parse("\n".join(lines), "p", family=Family.FX3U)
    assert [at.step for at in program.instructions] == [0, 3, 6, 9, 11, 14, 19, 22]


def test_timers_from_t256_on_have_units_of_1_ms_and_keep_nothing() -> None:
    text = "LD X0\nOUT T511 K15\nOUT T250 K100\nLD T511\nOUT Y0"
    memory = Memory()
    program = ProgramRun(Program.parse(text + "\nEND", "p", family=Family.FX3U), memory)
    program.run(0)
    seen = []
    for scan, on in enumerate((1, 1, 1, 0)):
        memory.set(Device("X", 0), on)
        program.scan(scan * 100 * TICKS_PER_MS // 10)
        seen.append((memory.word("T", 511), memory.get(Device("Y", 0))))
    assert seen == [(0, 0), (10, 0), (15, 1), (0, 0)]


def test_labels_reach_p4095() -> None:
    assert run("LD M8000\nCJ P4095\nOUT Y0\nP4095").get(Device("Y", 0)) == 0


def test_an_operand_out_of_range_says_the_same_on_a_line_of_its_own() -> None:
    for operand, says in (
        ("D8512", "allowed D0–D8255"),
        ("X9", "point 9 of X is X11"),
        ("D0Z9", "allowed Z0–Z7"),
    ):
        below = problems(f"LD M8000\nMOV K1\n{operand}\nEND")
        beside = problems(f"LD M8000\nMOV K1 {operand}\nEND")
        assert [each.split(": ", 1)[1] for each in map(str, below)] == [
            each.split(": ", 1)[1] for each in map(str, beside)
        ]
        assert says in str(below)


OBSERVED = """
schema: 1
name: x
duration: 100 ms
plcs:
  - name: p
    profile: fx3u
    scan: 10 ms
    registers: {R7: 5, M7000: 1}
    program: |
      LD M7000
      MOV R7 D8
      OUT T50 K3
      END
observe: [p.R7, p.TN500, p.D8]
"""


def test_they_are_observed_and_set_as_any_other() -> None:
    text = OBSERVED.replace("T50 ", "T500 ").replace("D8\n", "R8\n").replace("p.D8", "p.R8")
    values = bussim.run(loads(text)).values
    last = {row.device: row.value for row in values.itertuples()}
    assert last == {"R7": 5, "TN500": 3, "R8": 5}
    # An FX2N has none of them.
    with pytest.raises(ScenarioError) as caught:
        loads(OBSERVED.replace("fx3u", "fx2n").replace("MOV R7", "MOV D7"))
    found = [problem.message for problem in caught.value.problems]
    assert len(found) == sum("only an FX3U has" in message for message in found) == 5


def test_a_coil_with_an_index() -> None:
    # FX3 programming manual, 7.13: the index counts in octal points of Y; not S, not special M.
    memory = run(
        "LD M8000\nMOV K16 Z0\nSET Y004Z0\nOUT M7Z0\nSET M30\nRST M14Z0\nLDI M8000\nSET M7679Z0\nOUT Y0Z0"
    )
    assert [memory.get(parse_device(name)) for name in ("Y24", "Y4", "M23", "M7", "M30")] == [1, 0, 1, 0, 0]
    assert memory.get(parse_device("M8067")) == 0  # SET that is off looks for nothing
    assert run("LD M8000\nMOV K1 Z0\nSET M7679Z0").get(parse_device("M8067")) == 1
    for text in ("SET S0Z0", "SET M8200Z0", "RST D0Z0", "SET D0.1Z0"):
        with pytest.raises(ProgramError):
            Program.parse(f"LD X0\n{text}\nEND", "p", family=Family.FX3U)
    assert "cannot have an index register" in str(problems("LD X0\nSET M0Z0\nEND"))
    # Two coils with an index are no two coils of one device.
    assert not Program.parse("LD X0\nOUT M0Z0\nLD X1\nOUT M0Z1\nEND", "p", family=Family.FX3U).warnings


@pytest.mark.parametrize("device", ["M7679", "M8500", "S4095", "R0.{}", "R32767.{}", "D8500.{}", "D8500.3"])
def test_a_signal_is_followed_through_all_of_them(device: str) -> None:
    bit, word = device.partition(".")[::2]
    text = f"LD X0\nMOV K1 {bit}\nLD= {bit} K1\n" if word == "{}" else f"LD X0\nOUT {device}\nLD {device}\n"
    for last, said in (("Y0", []), ("Y1", ["nothing leads from p.X0 to p.Y1"])):
        found = loads(LATENCY.format(program=text.replace("\n", "\n      "), last=last))
        assert [str(each) for each in found.warnings if "leads" in str(each)] == said


LATENCY = """
schema: 1
name: x
duration: 1 s
plcs:
  - name: p
    profile: fx3u
    inputs: {{X0: {{square: 700 ms}}}}
    program: |
      {program}OUT Y0
      END
latency: [{{from: p.X0, to: p.{last}}}]
"""

"""Instructions that are known and not simulated: refused by name, or skipped with a warning for each."""

from __future__ import annotations

import json
import pickle
from pathlib import Path

import pytest

from bussim.cli import main
from bussim.errors import ProgramError
from bussim.plc.memory import Device, Family, Memory
from bussim.plc.program.execution import ProgramRun
from bussim.plc.program.program import Program
from bussim.plc.program.text.catalog import FORMS
from bussim.plc.program.text.unsimulated import _EFFECT

TEXT = """LD M8000
DPLSV K1000 Y0 Y3
ADPRW H1
H3
H0
K2
D100
OUT Y1
DEMOV
E1.5
D0
EI
LD X0
MEP
OUT Y2
LD M8000
MOV K7 D5
OUT T0 SP K50
FEND
I001
LD M8000
OUT Y7
IRET
END
"""
SKIPPED = ["DPLSV", "ADPRW", "DEMOV", "EI", "MEP", "I001", "IRET"]


def test_what_is_simulated_is_not_among_them() -> None:
    assert not set(_EFFECT) & set(FORMS)


def test_each_is_refused_by_its_name() -> None:
    with pytest.raises(ProgramError) as caught:
        Program.parse(TEXT, "p")
    assert [each.message.split()[0].strip("'") for each in caught.value.problems] == SKIPPED
    assert all(
        "is an FX3 instruction that is not simulated" in each.message for each in caught.value.problems
    )
    assert all("did you mean" not in each.message for each in caught.value.problems)


def test_those_that_are_skipped_are_warned_of_and_the_rest_runs() -> None:
    program = Program.parse(TEXT, "p", skips=True)
    assert [each.message.split()[0] for each in program.warnings] == SKIPPED
    assert [each.line for each in program.warnings] == [2, 3, 9, 12, 14, 20, 23]
    assert pickle.loads(pickle.dumps(program)) == program  # noqa: S301 - just written
    memory = Memory()
    run = ProgramRun(program, memory)
    run.run(0)
    memory.set(Device("X", 0), 1)
    run.scan(0)
    assert [memory.get(Device("Y", at)) for at in (1, 2, 7)] == [1, 0, 0]
    assert memory.get(Device("D", 5)) == 7


@pytest.mark.parametrize(
    ("line", "says", "effect"),
    [
        ("OUT C235 K1000", "OUT C235 is a counter that counts in hardware", "it never counts"),
        ("OUT C255 D10", "OUT C255 is a counter that counts in hardware", "it never counts"),
        ("RS2 D200 K4 D210 K10 K1", "RS2 with K1 is the FX3U's own", "its port stays silent"),
        ("RS2 D200 K4 D210 K10 K0", "RS2 with K0 is the FX3U's own", "its port stays silent"),
    ],
)
def test_operands_that_are_not_simulated_are_refused_or_skipped(line: str, says: str, effect: str) -> None:
    text = f"LD M8000\n{line}\nOUT Y1\nEND"
    with pytest.raises(ProgramError) as caught:
        Program.parse(text, "p", family=Family.FX3U)
    (problem,) = caught.value.problems
    assert (problem.line, problem.column) == (2, 1)
    for part in (says, "not simulated", "--allow-unsimulated", effect):
        assert part in problem.message
    program = Program.parse(text, "p", skips=True, family=Family.FX3U)
    (warning,) = program.warnings
    for part in (says, "it is skipped", effect):
        assert part in warning.message
    assert program.steps == 1 + (5 if "C2" in line else 11) + 1 + 1
    memory = Memory()
    run = ProgramRun(program, memory)
    run.run(0)
    run.scan(0)
    assert memory.get(Device("Y", 1)) == 1


@pytest.mark.parametrize(
    ("line", "counter"),
    [("RST C235", "C235"), ("DMOV C240 D0", "C240"), ("LD C251\nOUT Y0", "C251"), ("DMOV K1 C250", "C250")],
)
def test_what_names_a_counter_in_hardware_is_warned_of(line: str, counter: str) -> None:
    program = Program.parse(f"LD M8000\n{line}\nEND" if line[0] != "L" else f"{line}\nEND", "p")
    (warning,) = program.warnings
    assert warning.message == f"{counter} counts in hardware, which is not simulated: it never counts"
    assert not Program.parse("LD M8000\nRST C234\nZRST C200 C255\nEND", "p").warnings


@pytest.mark.parametrize(
    ("line", "effect"),
    [
        ("DHSCS K100 C235 Y0", "its counter counts in hardware"),
        ("DHSCR K100 C235 M5", "its counter counts in hardware"),
        ("DHSZ K1 K2 C235 Y0", "its counter counts in hardware"),
        ("PRUN K1X0 K1M0", "what it would write stays as it is"),
    ],
)
def test_the_reason_is_that_of_the_instruction(line: str, effect: str) -> None:
    (warning,) = Program.parse(f"LD M8000\n{line}\nEND", "p", skips=True).warnings
    assert effect in warning.message


def test_a_mistake_stays_one() -> None:
    with pytest.raises(ProgramError, match="did you mean OUT"):
        Program.parse(TEXT.replace("OUT Y1", "OUTT Y1"), "p", skips=True)


def test_the_option_of_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    lines = "".join(f"      {line}\n" for line in TEXT.splitlines())
    Path("x.yaml").write_text(
        "schema: 1\nname: x\nduration: 100 ms\nplcs:\n  - name: p\n    profile: fx3u\n    program: |\n"
        + lines
    )
    assert main(["check", "x.yaml"]) == 2
    assert main(["check", "x.yaml", "--allow-unsimulated"]) == 0
    assert "x.yaml:9:7: warning: p: DPLSV is skipped" in capsys.readouterr().out
    assert main(["run", "x.yaml", "--allow-unsimulated", "--out", "one"]) == 0
    warnings = json.loads(Path("one/summary.json").read_text())["warnings"]
    assert sum(" is skipped, as it is not simulated" in str(each) for each in warnings) == len(SKIPPED)
    assert main(["run", "one/scenario.yaml", "--out", "two"]) == 0

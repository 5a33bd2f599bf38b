"""Reading an instruction list: its forms, and every mistake with its place and what was meant."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bussim.errors import ProgramError, ScenarioError
from bussim.plc.memory import Memory
from bussim.plc.program.execution import ProgramRun
from bussim.plc.program.program import Program
from bussim.plc.program.text.catalog import FORMS, LadderRole
from bussim.plc.program.text.operands import parse_operand
from bussim.plc.program.text.source import MAX_CHARACTERS
from tests.plc.program.rigs import problems
from tests.plc.program.test_run import Heard


def test_what_a_line_may_look_like() -> None:
    text = (
        "\ufeff; a program\r\n\r\n0 LD X000 // input\r\n1:\tout y010 # coil\n"
        "  ld=  d0,k5 ; c\n mov h0081 D0z1\rP0:\n7 P1 LDI M8000\nCJ P0\nEND\n\n"
    )
    program = Program.parse(text, "p.il")
    assert [at.name for at in program.instructions] == [
        "LD",
        "OUT",
        "LD=",
        "MOV",
        "P",
        "P",
        "LDI",
        "CJ",
        "END",
    ]
    assert [(at.line, at.column) for at in program.instructions][:4] == [(3, 3), (4, 4), (5, 3), (6, 2)]
    assert program.instructions[3].operands[1].index == ("Z", 1)
    assert program.instructions[1].operands[0].address == 8


@pytest.mark.parametrize(
    ("line", "column", "says"),
    [
        ("MVO K1 D0", 1, "did you mean MOV?"),
        ("OUTT Y0", 1, "did you mean OUT?"),
        ("DBMOV D0 D1 K2", 1, "forms BMOV and BMOVP only"),
        ("RS2P D0 K1 D1 K1 K3", 1, "neither a P (pulse) nor a D (32-bit) form"),
        ("DPLSY K1 K2 Y0", 1, "'DPLSY' is an FX3 instruction that is not simulated"),
        ("ADPRW H1 H3 H0 K2 D100", 1, "polls: of the PLC make the same requests"),
        ("DEMOVP E1.5 D0", 1, "not simulated; --allow-unsimulated (allow_unsimulated: true) skips it"),
        ("BKCMP<>P D0 D10 M0 K4", 1, "not simulated"),
        ("MEP", 1, "not simulated"),
        ("I001", 1, "interrupts never come"),
        ("EI", 1, "interrupts"),
        ("§ Y0", 1, "no instruction"),
        ("OUT", 1, "OUT takes 1 operand (device), found none"),
        ("MOV D0", 1, "MOV takes 2 operands (source, destination), found 1"),
        ("MOV D0 D1 D2", 11, "found 3"),
        ("OUT T0", 1, "2 operands (device, preset)"),
        ("OUT Y0 K5", 8, "takes 1 operand"),
        ("OUT X0", 5, "X is an input"),
        ("MOV K1 X0", 8, "cannot be X0, allowed KnY KnM"),
        ("MOV K1 K1X0", 8, "allowed KnY KnM"),
        ("MOV K1 K5", 8, "allowed KnY"),
        ("SET T0", 5, "allowed Y M S"),
        ("OUT D0", 5, "allowed Y M S T C"),
        ("OUT Y8", 5, "point 8 of Y is Y10"),
        ("OUT Y400", 5, "allowed Y0–Y377"),
        ("OUT M3072", 5, "allowed M0–M3071, M8000–M8255"),
        ("MOV K1 D8256", 8, "allowed D0–D8255"),
        ("MOV D0 Z8", 8, "allowed Z0–Z7"),
        ("MOV D0Z9 D1", 5, "allowed Z0–Z7"),
        ("MOV DO D1", 5, "did you mean D0?"),
        ("MOV 5 D1", 5, "did you mean K5?"),
        ("MOV Q5 D1", 5, "no device or constant"),
        ("MOV D D1", 5, "D needs a number, such as D0"),
        ("MOV K40000 D0", 5, "allowed K-32768…K32767 (32 bits: the D form)"),
        ("MOV H12345 D0", 5, "more than 4 digits"),
        ("DMOV K3000000000 D0", 6, "K2147483647"),
        ("MOV K5M0 D0", 5, "20 bits, allowed K1–K4"),
        ("DMOV K9M0 D0", 6, "allowed K1–K8"),
        ("MOV K4M3070 D0", 5, "reaches past M3071"),
        ("DMOV D8255 D0", 6, "reaches past D8255"),
        ("MUL D0 D1 D8255", 11, "reaches past D8255"),
        ("CMP D0 D1 M3070", 11, "reaches past M3071"),
        ("BMOV D8250 D0 K10", 6, "reaches past D8255"),
        ("BMOV D0 D10 K513", 13, "allowed K1…K512"),
        ("BMOV K1M0 K2M10 K2", 11, "same K"),
        ("MOV C200 D0", 5, "32 bits; use the D form"),
        ("DMOV C199 D0", 6, "reaches past C199"),
        ("BMOV C200 D0 K1", 6, "allowed C0–C199"),
        ("DMOV K1 V0", 9, "Z0 names that of V0 and Z0"),
        ("MUL D0 D1 Z0", 11, "allowed KnY KnM KnS T C D"),
        ("CJ 5", 4, "did you mean P5?"),
        ("MC 0 M5", 4, "did you mean N0?"),
        ("OUT T0 K40000", 8, "K0…K32767"),
        ("OUT T0 D8256", 8, "D8256"),
        ("OUT C240 K1", 1, "counts in hardware"),
        ("OUT Y0Z0", 5, "index register"),
        ("OUT M8000", 5, "M8000 is driven by the PLC itself"),
        ("MOV K0 K4M8006", 8, "M8011 is driven by the PLC itself"),
        ("ZRST M8000 M8009", 6, "M8000 is driven by the PLC itself"),
        ("PLS M8100", 5, "special bit"),
        ("ROR D0 K17", 8, "K1…K16"),
        ("SFTL X0 M0 K4 K5", 15, "allowed 1…n1 (4)"),
        ("SFTL X0 M0 K4Z0 K1", 12, "index register"),
        ("ZRST M0 D5", 9, "another kind"),
        ("ZRST C199 C200", 11, "reset them apart"),
        ("RS2 D0 K1 D1 K1 K1", 17, "allowed K2…K6"),
        ("CPAVL D0 M0 K7", 13, "allowed K2…K6"),
        ("CPAVL D8240 M0 K3", 7, "reaches past D8255"),
        ("CJ P200", 4, "allowed P0–P127"),
        ("CJ D0", 4, "cannot be D0, allowed P"),
        ("CJ P5", 1, "no label P5; the labels are: P9"),
        ("CALL P9", 1, "between FEND and END"),
        ("MC N8 M0", 4, "allowed N0–N7"),
    ],
)
def test_mistakes_of_one_line(line: str, column: int, says: str) -> None:
    found = problems(f"LD X0\n{line}\nP9\nEND")
    assert len(found) == 1, found
    assert found[0].startswith(f"test.il:2:{column}: ")
    assert says in found[0]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("OUT Y0 / END", ["1:1: OUT needs a contact in front of it"]),
        ("AND X0 / OUT Y0 / END", ["1:1: AND needs a contact"]),
        ("INV / LD X0 / OUT Y0 / END", ["1:1: INV needs a contact"]),
        ("LD X0 / LD X1 / OUT Y0 / END", ["3:1: 1 block is open in front of OUT; ANB or ORB"]),
        ("LD X0 / LD X1 / LD X2 / OUT Y0 / END", ["4:1: 2 blocks are open"]),
        ("LD X0 / ANB / OUT Y0 / END", ["2:1: ANB needs two blocks"]),
        ("ORB / LD X0 / OUT Y0 / END", ["1:1: ORB needs two blocks"]),
        ("LD X0 / MPP / OUT Y0 / END", ["2:1: MPP without MPS"]),
        ("LD X0 / MRD / OUT Y0 / END", ["2:1: MRD without MPS"]),
        ("LD X0 / MPS / AND X1 / OUT Y0 / END", ["2:1: MPS without its MPP"]),
        ("LD X0 / MPS / OUT Y0 / LD X1 / OUT Y1 / END", ["2:1: MPS without its MPP"]),
        ("LD X0 / MPS / AND X1 / MPP / OUT Y0 / END", ["3:1: contacts that drive nothing"]),
        ("LD X0 / AND X1 / END", ["1:1: contacts that drive nothing"]),
        ("LD X0 / P0 / LD X1 / OUT Y0 / END", ["1:1: contacts that drive nothing"]),
        ("LD X0 / OUT Y0", ["2:1: the program has no END"]),
        ("", ["1:1: the program has no instructions"]),
        ("; nothing yet", ["1:1: the program has no instructions"]),
        (
            "LD X0 / FNC12 K1 D0 / END",
            ["2:1: 'FNC12' is the number of an instruction; write its name, such as MOV for FNC 12"],
        ),
        ("LD X0 / FNC 12 K1 D0 / END", ["2:1: 'FNC' is the number of an instruction; write its name"]),
        ("LD X0 / OUT Y0 / END / LD X1 / OUT Y1", ["4:1: LD after END"]),
        ("P0 / P0 / END", ["2:1: the label P0 stands at line 1 already"]),
        ("P63 / END", ["1:1: P63 means END"]),
        ("LD X0 / CALL P0 / FEND / P0 / LD X1 / OUT Y0 / END", ["2:1: CALL P0: the subroutine at line 4 has no SRET"]),
        ("SRET / END", ["1:1: SRET before FEND"]),
        ("FOR K2 / LD X0 / OUT Y0 / END", ["1:1: FOR without its NEXT in front of END"]),
        ("NEXT / END", ["1:1: NEXT without its FOR"]),
        ("FOR K1 / FOR K1 / FOR K1 / FOR K1 / FOR K1 / FOR K1 / NEXT / NEXT / NEXT / NEXT / NEXT / NEXT / END", ["6:1: FOR is nested 6 deep, allowed 5"]),
        ("LD X0 / MC N0 M0 / END", ["2:1: MC without its MCR"]),
        ("MCR N0 / END", ["1:1: MCR N0 without its MC"]),
        ("LD X0 / MC N1 M0 / LD X0 / MC N0 M1 / MCR N0 / MCR N1 / END", ["4:1: MC N0 inside MC N1", "6:1: MCR N1 without"]),
        ("10 / END", ["1:1: a step number without an instruction"]),
        ("LD X0 / " + "LD X1 / " * 9 + "ANB / " * 9 + "OUT Y0 / END", ["10:1: more than 8 blocks"]),
        ("LD X0 / " + "MPS / " * 12 + "OUT Y0 / " + "MPP / OUT Y1 / " * 12 + "END", ["13:1: more than 11 MPS"]),
        ("LD X0 / " + "AND X1 / " * 200 + "OUT Y0 / END", ["201:1: more than 200 contacts"]),
    ],
)  # fmt: skip
def test_mistakes_of_the_ladder_and_the_flow(text: str, says: list[str]) -> None:
    found = problems(text)
    assert len(found) == len(says), found
    for problem, start in zip(found, says, strict=True):
        assert problem.startswith(f"test.il:{start}")


def test_all_mistakes_at_once_and_none_that_only_follows() -> None:
    text = "LD X8 / OUT Y0 / LD X1 / MOVX D0 D1 / ANDD X2 / OUT Y1 / LD X2 / MOV D0 / CJ P7"
    found = problems(text)
    assert [problem.split(":")[1] for problem in found] == ["1", "4", "5", "8", "9", "9"]


def test_a_mistake_is_a_scenarios_mistake() -> None:
    with pytest.raises(ScenarioError):
        Program.parse("MVO", "p.il")


def test_sizes_are_bounded() -> None:
    assert "allowed 1000000" in problems(" " * (MAX_CHARACTERS + 1))[0]
    assert "more than 16000 steps" in problems("NOP\n" * 16_002)[0]
    found = problems("FOO\n" * 5000)
    assert len(found) == 101
    assert "more than 100 mistakes" in found[-1]
    assert all(
        len(problem) < 300 for problem in problems("X" * 9999 + " " + "Y" * 9999 + "\nLD " + "D" * 9999)
    )


@pytest.mark.parametrize("name", FORMS)
def test_every_mnemonic_is_read_in_small_letters_too(name: str) -> None:
    with pytest.raises(ProgramError) as caught:
        Program.parse(f"{name.lower()} foo bar baz\nEND", "p.il")
    assert not any("is no instruction" in str(problem) for problem in caught.value.problems)


NAMES = [
    "X0",
    "X17",
    "Y0",
    "Y7",
    "M0",
    "M31",
    "M3071",
    "M8000",
    "M8020",
    "M8200",
    "S0",
    "S999",
    "T0",
    "T200",
    "T246",
    "T255",
    "C0",
    "C199",
    "C200",
    "C234",
    "C255",
    "D0",
    "D5",
    "D8000",
    "D8255",
    "V0",
    "Z0",
    "Z1",
    "K0",
    "K1",
    "K2",
    "K5",
    "K-1",
    "K32767",
    "K-32768",
    "K70000",
    "HFF",
    "HFFFF",
    "K1X0",
    "K4Y0",
    "K8M0",
    "K2S5",
    "K1M3068",
    "D0Z0",
    "D8250Z0",
    "M0V0",
    "K1Z0",
    "K4M0Z1",
    "K1Y370Z0",
    "N0",
    "N1",
    "P0",
    "P1",
    "P63",
    "D8067",
    "K20",
    "K512",
]


@st.composite
def likely_programs(draw: st.DrawFn) -> str:
    """Lines of real mnemonics with any operands: most are wrong, some get far."""
    lines = draw(
        st.lists(
            st.builds(
                lambda name, operands: " ".join([name, *operands]),
                st.sampled_from([*FORMS, "P0", "P1"]),
                st.lists(OPERANDS, max_size=5),
            ),
            max_size=12,
        )
    )
    return "\n".join([*lines, "END"])


OPERANDS = st.sampled_from(NAMES)
BY_KIND: dict[str, list[str]] = {}
for text in NAMES:
    BY_KIND.setdefault(parse_operand(text, 1).kind, []).append(text)


@st.composite
def driven_instructions(draw: st.DrawFn) -> str:
    """One instruction after another, each behind its own contact, with operands of the right kinds."""
    lines: list[str] = []
    for _ in range(draw(st.integers(1, 3))):
        name = draw(st.sampled_from(sorted(FORMS)))
        spec = FORMS[name].spec
        kinds = [
            draw(st.sampled_from([kind for kind in slot.takes if kind in BY_KIND])) for slot in spec.slots
        ]
        if name == "OUT" and kinds[0] in ("T", "C"):
            kinds.append(draw(st.sampled_from(("K", "D"))))
        line = " ".join([name, *(draw(st.sampled_from(BY_KIND[kind])) for kind in kinds)])
        if spec.join:
            lines += ["LD M8000", line, *(["ANB"] if spec.join == "LD" else []), "OUT M1"]
        elif spec.role is LadderRole.OUTPUT:
            lines += ["LD M8000", line]
    return "\n".join([*lines, "P0", "LD X0", "OUT M2", "P1", "END"])


def survives(text: str, registers: list[int]) -> None:
    try:
        program = Program.parse(text, "p.il")
    except ProgramError as error:
        assert error.problems
        assert all(problem.line >= 1 for problem in error.problems)
        return
    memory = Memory()
    for number, value in enumerate(registers):
        memory.set_word("DZ"[number % 2], number // 2, value)
    run = ProgramRun(program, memory, ports=Heard())
    run.run(0)
    for scan in range(4):
        memory.bits("X")[0] = scan & 1
        assert run.scan(scan * 720_000) >= 0
    # The arrays are what they were: no group or block has made one longer.
    assert [len(memory.bits(letter)) for letter in "XYMSTC"] == [256, 256, 8512, 4096, 512, 256]
    assert all(set(memory.bits(letter)) <= {0, 1} for letter in "XYMSTC")


REGISTERS = st.lists(st.one_of(st.integers(0, 65535), st.sampled_from([0, 1, 2, 65535])), max_size=16)


@given(likely_programs(), REGISTERS)
def test_random_lines_never_raise(text: str, registers: list[int]) -> None:
    survives(text, registers)


@given(driven_instructions(), REGISTERS)
def test_random_instructions_never_raise(text: str, registers: list[int]) -> None:
    survives(text, registers)


@given(st.text(max_size=200), REGISTERS)
def test_random_text_never_raises(text: str, registers: list[int]) -> None:
    survives(text, registers)


# -- as programming tools print lists ------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "same"),
    [
        ("LD X0\nOUT T0\nK50\nEND", "LD X0\nOUT T0 K50\nEND"),
        ("0 LD X000\n1 OUT T0\n     K 50\n4 END", "LD X000\nOUT T0 K50\nEND"),
        ("LD X0\nMOV\n\n K5 ; five\n D0\nEND", "LD X0\nMOV K5 D0\nEND"),
        ("LD X0\nZCP K1\nK2 D0\nM0\nEND", "LD X0\nZCP K1 K2 D0 M0\nEND"),
        ("LD X0\nCJ\nP0\nLD X1\nOUT Y0\nP0\nEND", "LD X0\nCJ P0\nLD X1\nOUT Y0\nP0\nEND"),
        ("(* a *)\nLD X0 (* b *)\nOUT Y0 'c\n/* d\nOUT Y1\n*/ END", "LD X0\nOUT Y0\nEND"),
        ("LD X0 ; (* no comment begins here\nOUT Y0 // nor /* here\nEND", "LD X0\nOUT Y0\nEND"),
        ("LD(*a*)X0\nOUT/**/Y0\nEND", "LD X0\nOUT Y0\nEND"),
        ("LD = D0 K1\nOR <> D1 K2\nOUT Y0\nEND", "LD= D0 K1\nOR<> D1 K2\nOUT Y0\nEND"),
        ("ldd >= d0 k1\nout y 0\nend", "LDD>= D0 K1\nOUT Y0\nEND"),
        ("LD X 0\nMOV K -5 D 0\nMOV H 1F Z 0\nEND", "LD X0\nMOV K-5 D0\nMOV H1F Z0\nEND"),
    ],
)
def test_lists_as_they_are_printed(text: str, same: str) -> None:
    one, other = Program.parse(text, "p"), Program.parse(same, "p")

    def read(program: Program) -> list[tuple[object, ...]]:
        return [(at.name, *(operand.text.upper() for operand in at.operands)) for at in program.instructions]

    assert read(one) == read(other)


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("LD X0 / OUT Y0 / K5 / END", ["3:1: K5 without its instruction: OUT in front of it takes no more"]),
        ("LD X0 / OUT T0 /  K99999 / END", ["3:2: OUT: the preset is K99999, allowed K0…K32767"]),
        (
            "LD X0 / MOV K5 /  Q5 / END",
            ["2:1: MOV takes 2 operands (source, destination), found 1", "3:2: 'Q5'"],
        ),
        ("LD X0 / MOV / K5 / X0 / END", ["4:1: MOV: the destination cannot be X0, allowed KnY"]),
        ("LD X0 / OTU T0 / K50 / END", ["2:1: 'OTU' is no instruction; did you mean OUT?"]),
        ("P0 / K5 / END", ["2:1: K5 without its instruction: a label takes no more"]),
        ("LD X0 / OUT T0 / P5 / END", ["2:1: OUT takes 2 operands (device, preset), found 1"]),
        ("LD X0 (* a / OUT Y0 / END", ["1:7: the comment that begins here has no *)"]),
        ("LD X0 / OUT Y0 /* a * / END", ["2:8: the comment that begins here has no */"]),
        ("LD X0 / MOV K5,D,1 / END", ["2:8: 'D' is no device or constant; D needs a number", "2:10: '1' is"]),
    ],
)
def test_mistakes_of_printed_lists_are_where_they_stand(text: str, found: list[str]) -> None:
    reported = problems(text.replace("/*", "§").replace(" / ", "\n").replace("§", "/*"))
    assert len(reported) == len(found), reported
    for one, wanted in zip(reported, found, strict=True):
        assert one.startswith(f"test.il:{wanted}")


@pytest.mark.parametrize(
    ("word", "near"),
    [
        *(("LDD X0", "LD"), ("OTU Y0", "OUT"), ("SETT Y0", "SET"), ("ANDI X0", "ANI"), ("MOVE K1 D0", "MOV")),
        *(("FOO", None), ("XYZ", None), ("DMVO K1 D0", "DMOV"), ("NEXTT", "NEXT"), ("ZRTS M0 M1", "ZRST")),
    ],
)
def test_the_plain_instruction_is_offered_first(word: str, near: str | None) -> None:
    (found,) = [text for text in problems(f"LD X0\n{word}\nOUT Y7\nEND") if "is no instruction" in text]
    assert found.endswith(f"did you mean {near}?" if near else "is no instruction")

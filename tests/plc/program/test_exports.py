"""Files that programming tools write: tables, code pages, printed lists; and comments, which are no program."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bussim.errors import ProgramError
from bussim.plc.memory import Memory
from bussim.plc.program.execution import ProgramRun
from bussim.plc.program.program import Program
from bussim.plc.program.text.catalog import FORMS
from bussim.plc.program.text.exports import listing
from bussim.scenario.loader import examine

#: Steps as the FX programming manual counts them, instruction and operands, and a comment in front or behind.
Row = tuple[int, str, str, str]
START_STOP: list[Row] = [
    (0, "LD", "X000", "起動, 停止"),
    (1, "OR", "Y000", ""),
    (2, "ANI", "X001", ""),
    (3, "OUT", "Y000", "モータ"),
    (4, "LD", "Y000", ""),
    (5, "OUT", "T0 K50", "待ち時間 5 秒"),
    (8, "LD", "T0", ""),
    (9, "OUT", "Y001", ""),
    (10, "END", "", ""),
]
LINK: list[Row] = [
    (0, "LD", "M8038", "链接参数"),
    (1, "MOV", "K0 D8176", "主站"),
    (6, "MOVP", "K2 D8177", ""),
    (11, "LD>=", "D10 K-5", "压力"),
    (16, "ANDF", "M1064", ""),
    (18, "SET", "M8", ""),
    (19, "DADDP", "D20 K100000 D22", '累加, "双字"'),
    (32, "LDI", "X007", ""),
    (33, "RST", "C3", ""),
    (35, "LD", "X002", ""),
    (36, "OUT", "C3 K10", "计数"),
    (39, "END", "", ""),
]
JUMPS: list[Row] = [
    (0, "LD", "M8000", "停止; 加工"),
    (1, "CALL", "P1", ""),
    (4, "LDI", "X003", ""),
    (5, "CJ", "P0", "跳过"),
    (8, "BMOV", "D0 D100 K8", "配方"),
    (15, "", "P0", ""),
    (16, "LD", "X004", ""),
    (17, "MPS", "", ""),
    (18, "AND", "X005", ""),
    (19, "SET", "S20", ""),
    (21, "MPP", "", ""),
    (22, "OUT", "M8200", "向下计数"),
    (24, "FEND", "", ""),
    (25, "", "P1", "子程序"),
    (26, "LD", "M8013", ""),
    (27, "INCP", "D200Z0", ""),
    (30, "SRET", "", ""),
    (31, "END", "", ""),
]
PROGRAMS = [START_STOP, LINK, JUMPS]


def _table(rows: list[Row], delimiter: str, columns: int, *, heads: tuple[str, ...] = ()) -> str:
    """Rows as GX Works2 and GX Developer write them: further operands and notes in rows of their own."""
    found = [heads] if heads else []

    def put(*cells: str) -> None:
        found.append((*cells, *[""] * (columns - len(cells))))

    for step, name, operands, comment in rows:
        first, *others = operands.split() or [""]
        if comment and name in ("LD", "LDI"):
            put(str(step), comment)
        put(str(step), "", name or first, first if name else "")
        for other in others:
            put("", "", "", other)
        if comment and name not in ("LD", "LDI"):
            put("", "", "", "", "", "", comment)
    lines = (delimiter.join('"' + cell.replace('"', '""') + '"' for cell in row) for row in found)
    return "\r\n".join(lines) + "\r\n"


HEADS = ("Step No.", "Line Statement", "Instruction", "I/O(Device)", "Blank", "PI Statement", "Note")
HEADS_JAPANESE = (
    "ステップ番号", "行間ステートメント", "命令", "I/Oデバイス", "空欄", "PIステートメント", "ノート",
)  # fmt: skip
HEADS_CHINESE = ("步号", "行间声明", "指令", "I/O(软元件)", "空白", "P/I声明", "注解")


def gx_works2(rows: list[Row]) -> bytes:
    top = '"MAIN"\r\n"PLC Information:"\t"FXCPU FX3U/FX3UC"\r\n'
    return (top + _table(rows, "\t", 7, heads=HEADS)).encode("utf-16")


def gx_works2_chinese(rows: list[Row]) -> bytes:
    return ('"主程序"\r\n' + _table(rows, "\t", 7, heads=HEADS_CHINESE)).encode("utf-16")


def gx_works2_japanese(rows: list[Row]) -> bytes:
    top = '"MAIN"\r\n"機種情報:"\t"FXCPU FX3U/FX3UC"\r\n'
    return (top + _table(rows, "\t", 7, heads=HEADS_JAPANESE)).encode("utf-16")


def gx_developer(rows: list[Row]) -> bytes:
    return _table(rows, ",", 9).encode("gbk" if rows is not START_STOP else "cp932")


def saved_by_a_spreadsheet(rows: list[Row]) -> bytes:
    return _table(rows, ";", 7, heads=HEADS).encode("utf-8-sig")


def gx_developer_bare(rows: list[Row]) -> bytes:
    """Tabs, nothing in quotes, no headings."""
    return _table(rows, "\t", 9).replace('"', "").encode("utf-8-sig")


def fxgp(rows: list[Row]) -> bytes:
    """A list as FXGP saves it: blanks between fields, no comments but those behind a semicolon."""
    lines = (
        f"{step:>5}  {name or operands:<8}{operands if name else '':<20}"
        + (f"; {comment}" if comment else "")
        for step, name, operands, comment in rows
    )
    return "\r\n".join(lines).encode("gbk" if rows is not START_STOP else "cp932")


def printed(rows: list[Row]) -> bytes:
    """A printed list: headings, a rule, operands below each other."""
    lines = ["  Step   Instruction   I/O", "-" * 40]
    for step, name, operands, _ in rows:
        first, *others = operands.split() or [""]
        lines += [f"{step:>6}   {name:<12}{first}", *(f"{'':21}{other}" for other in others)]
    return "\n".join(lines).encode()


def handheld(rows: list[Row]) -> bytes:
    """Several instructions on a line, SP in front of presets, comparisons without a blank, full width."""
    words = []
    for _, name, operands, _ in rows:
        text = f"{name} {operands}".strip().replace(">= ", ">=")
        words.append(text.replace(" K", " SP K") if name == "OUT" else text)
    lines = (" ".join(words[at : at + 3]) for at in range(0, len(words), 3))
    return "\n".join(lines).replace("LD X", "ＬＤ　Ｘ").encode()


TOOLS = [
    gx_works2,
    gx_works2_chinese,
    gx_works2_japanese,
    gx_developer,
    gx_developer_bare,
    saved_by_a_spreadsheet,
    fxgp,
    printed,
    handheld,
]


def scenario(path: Path, content: bytes, *, link: bool = False) -> Path:
    (path / "main.csv").write_bytes(content)
    file = path / "x.yaml"
    file.write_text(
        "schema: 1\nname: x\nduration: 1 s\n"
        + ("buses: [{name: link, nn: true}]\n" if link else "")
        + "plcs:\n  - {name: p, profile: fx3u, scan: 5 ms, program: main.csv"
        + (", ports: {COM3: {bus: link}}}\n" if link else "}\n")
    )
    return file


def _normal(word: str) -> str:
    """A device without the zeros in front of its number."""
    head = word[:1]
    return head + (word[1:].lstrip("0") or "0") if head in "XY" and word[1:].isdecimal() else word


def steps(program: Program) -> list[tuple[int, str, list[str]]]:
    return [(at.step, at.name, [_normal(each.text) for each in at.operands]) for at in program.instructions]


@pytest.mark.parametrize("tool", TOOLS)
@pytest.mark.parametrize("rows", PROGRAMS)
def test_an_export_loads_runs_and_is_read_step_for_step(
    tmp_path: Path, tool: Callable[[list[Row]], bytes], rows: list[Row]
) -> None:
    examined = examine(scenario(tmp_path, tool(rows), link=rows is LINK))
    assert [str(each) for each in examined.errors] == []
    assert examined.scenario is not None
    program = examined.scenario.plcs[0].program
    assert program is not None
    wanted = [(step, name or "P", [_normal(each) for each in words.split()]) for step, name, words, _ in rows]
    assert steps(program) == wanted
    for comment in (
        comment for *_, comment in rows if tool is not printed and tool is not handheld and comment
    ):
        if tool is not gx_developer_bare or '"' not in comment:
            assert comment in program.text
    run = ProgramRun(program, Memory())
    run.run(0)
    assert all(run.scan(scan * 360_000) > 0 for scan in range(3))
    assert run.halted == 0


GUESS = " (a guess; if its comments look wrong, save it as UTF-8)"


@pytest.mark.parametrize(
    ("content", "kind"),
    [
        (
            gx_works2(LINK),
            "exported by a programming tool (columns separated by tabs; taken: Instruction, I/O(Device)), UTF-16",
        ),
        (gx_developer(LINK), "exported by a programming tool (columns separated by commas), GBK" + GUESS),
        (
            gx_developer(START_STOP),
            "exported by a programming tool (columns separated by commas), Shift-JIS" + GUESS,
        ),
        (printed(JUMPS), "an instruction list, UTF-8"),
        ("LD X0 ; ﾓｰﾀ\nOUT Y0\nEND".encode("cp932"), "an instruction list, Shift-JIS" + GUESS),
    ],
)
def test_what_a_file_was_taken_for(tmp_path: Path, content: bytes, kind: str) -> None:
    found = examine(scenario(tmp_path, content, link="UTF-16" in kind or "GB" in kind)).scenario
    assert found is not None
    assert found.plcs[0].program is not None
    assert found.plcs[0].program.kind.endswith(kind)


def test_a_mistake_in_a_table_has_its_line_and_column(tmp_path: Path) -> None:
    rows = [(0, "LD", "X000", ""), (1, "OUT", "X001", ""), (2, "END", "", "")]
    found = examine(scenario(tmp_path, gx_works2(rows))).errors
    assert [(each.line, each.column) for each in found] == [(5, 15)]
    assert found[0].message == "OUT X001: X is an input; a program can only read it"


@pytest.mark.parametrize("delimiter", [",", "\t", ";"])
@pytest.mark.parametrize("preset", ["Preset", "Set Value", "設定値", "常数"])
def test_a_preset_has_a_column_of_its_own(delimiter: str, preset: str) -> None:
    rows = [
        ("Step", "Instruction", "Device", preset, "Note"),
        ("0", "LD", "X000", "", "K7"),
        ("1", "OUT", "T0", "K50", "5 s"),
        ("4", "LD", "T0", "", ""),
        ("5", "OUT", "C3", "D10", ""),
        ("8", "END", "", "", ""),
    ]
    found = listing("\n".join(delimiter.join(row) for row in rows))
    assert found.kind.endswith(f"; taken: Instruction, Device, {preset})")
    program = Program.parse(found.text, "p")
    assert [" ".join(each.text for each in at.operands) for at in program.instructions] == [
        "X000", "T0 K50", "T0", "C3 D10", "",
    ]  # fmt: skip
    assert not program.warnings


def test_long_notes_do_not_make_a_program_too_long(tmp_path: Path) -> None:
    rows = [
        (at, ("OUT" if at % 2 else "LD"), f"M{at}", "コンベヤの起動条件を確認する" * 12) for at in range(298)
    ]
    found = examine(scenario(tmp_path, gx_works2([*rows, (298, "END", "", "")]))).scenario
    assert found is not None
    assert found.plcs[0].program is not None
    assert len(found.plcs[0].program.instructions) == 299
    assert "コンベヤ" not in found.plcs[0].program.text  # kept where there is room


def test_columns_of_a_heading_need_no_quotes(tmp_path: Path) -> None:
    text = _table(START_STOP, ";", 7, heads=HEADS).replace('"', "")
    found = examine(scenario(tmp_path, text.encode())).scenario
    assert found is not None
    assert found.plcs[0].program is not None
    assert found.plcs[0].program.kind.endswith(", I/O(Device)), UTF-8")
    # In a list a semicolon begins a comment.
    listed = listing("LD X0 ; start\nOUT Y0 ; motor\nEND")
    assert (listed.kind, listed.text) == ("an instruction list", "LD X0 ; start\nOUT Y0 ; motor\nEND")


@pytest.mark.parametrize("magic", [b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", b"PK\x03\x04\x14\x00"])
def test_a_project_is_no_text(tmp_path: Path, magic: bytes) -> None:
    (found,) = examine(scenario(tmp_path, magic + bytes(3_000_000))).errors
    assert "main.csv, which is a tool's project, no text; export the program" in found.message


def test_devices_of_other_series_are_operands_on_lines_of_their_own(tmp_path: Path) -> None:
    rows = [(0, "LD", "SM400", ""), (2, "MOV", "K1 W1F", ""), (5, "END", "", "")]
    found = [each.message for each in examine(scenario(tmp_path, gx_works2(rows))).errors]
    assert len(found) == 2
    assert all("it is one of an FX5 or Q series" in message for message in found)


@pytest.mark.parametrize(
    "content",
    [
        '"small"\n"Device Name"\t"Comment"\n"X000"\t"start, stop"\n"Y000"\t"motor"\n'.encode("utf-16"),
        "デバイス名,コメント\nX000,起動\nY000,モータ\n".encode("cp932"),
        "X000,,起动\nD100,DATA,压力\n".encode("gbk"),
    ],
)
def test_device_comments_are_no_program(tmp_path: Path, content: bytes) -> None:
    (found,) = examine(scenario(tmp_path, content)).errors
    assert "which holds device comments" in found.message
    assert "2 devices, and no program" in found.message


def test_a_list_printed_in_columns_is_not_read_across() -> None:
    text = "0 LD X0    2 LD X1\n1 OUT Y0   3 OUT Y1\n4 END\n"
    with pytest.raises(ProgramError, match="put the columns of a printed list below each other"):
        Program.parse(text, "p")


# -- whatever the text ---------------------------------------------------------------------------------

_WORDS = st.sampled_from(
    [*itertools.islice(sorted(FORMS), 0, None, 7), "LD", "OUT", "END", "X0", "D0", "K1", "LD=D0", "SP", "P0", "12",
     '"', "\t", ",", "\n", "\n", " ", ";", "(*", "Step No.", "Instruction", "Comment", "Ｘ０", "ADPRW", "STL", "I001"]
)  # fmt: skip
_TEXTS = st.one_of(st.text(), st.lists(_WORDS, max_size=60).map(" ".join), st.lists(_WORDS).map("".join))


@given(_TEXTS)
def test_any_text_is_a_program_or_has_located_mistakes(text: str) -> None:
    found = listing(text)
    assert found.comments is not None or found.text.count("\n") == text.replace("\r\n", "\n").replace(
        "\r", "\n"
    ).count("\n")
    try:
        Program.parse(found.text, "p")
    except ProgramError as error:
        assert error.problems
        assert all(
            1 <= each.line <= found.text.count("\n") + 1 and each.column >= 1 for each in error.problems
        )


@given(st.binary(max_size=200))
def test_any_bytes_are_read_or_refused(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    examine(scenario(tmp_path_factory.mktemp("bytes"), content))


def test_an_empty_file_is_said_to_be_empty(tmp_path: Path) -> None:
    problem = examine(scenario(tmp_path, b"\n")).errors[0]
    assert "which is empty; expected a program that ends in END" in problem.message

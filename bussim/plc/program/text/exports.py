"""What programming tools write: tables of a program or of device comments, as against instruction lists.

GX Works2 and GX Developer export a program as rows of a step, statements, an instruction, one device and
notes, seven or nine columns separated by tabs, commas or (as spreadsheets save them) semicolons; further
operands stand in rows of their own. Device comments are rows of a device, perhaps a label, and a comment.
Headings are those of the English, Japanese and Chinese tools; where a table has none, what stands in its
columns decides.
"""

import re
from typing import NamedTuple

from bussim.plc.memory import Family, parse_device
from bussim.plc.program.text.catalog import FORMS
from bussim.words.language import say

#: How the headings of columns are written, in small letters and without blanks.
_HEADS = {
    "instruction": ("instruction", "命令", "指令", "命令語", "命令语"),
    "device": (
        "i/o",
        "i/o(device)",
        "i/oデバイス",
        "i/o(デバイス)",
        "i/o(软元件)",
        "デバイス",
        "软元件",
        "軟元件",
    ),
    "preset": ("preset", "setvalue", "value", "設定値", "设定值", "设置值", "预设值", "常数"),
    "comment": ("comment", "コメント", "注释", "註解", "注解", "软元件注释"),
    "name": ("device", "devicename", "デバイス", "デバイス名", "软元件", "软元件名", "軟元件名"),
}
#: The kind of what is no table.
INSTRUCTION_LIST = "an instruction list"
_DELIMITERS = {"\t": "export_tabs", ";": "export_semicolons", ",": "export_commas"}
_QUOTED = re.compile(r'"((?:[^"]|"")*)"?')
_OPERAND = re.compile(r"(?:[XYMSTCDR]|TN|TS|CN|CS)[0-9]+", re.ASCII)
#: Headings and rules of printed lists.
_PRINTED = re.compile(
    r"\s*(?:(?:step|ステップ|步).*(?:instruction|命令|指令).*|[-=_*]{3,}[-=_* ]*)", re.IGNORECASE
)


class _Cell(NamedTuple):
    column: int  # of its text, from 0
    text: str


class Listing(NamedTuple):
    """``kind`` in words; a program's ``text`` as an instruction list, line for line; or ``comments``."""

    kind: str
    text: str = ""
    comments: dict[str, str] | None = None


def listing(text: str, *, family: Family = Family.FX3U) -> Listing:
    """What a file's text is: an export of a program, of device comments, or an instruction list.

    ``family``: whose devices' comments are taken.
    """
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    delimiter = _delimiter(lines)
    words = say("export_columns", by=say(_DELIMITERS[delimiter]))
    rows = [_cells(line, delimiter) for line in lines]
    filled = [row for row in rows if any(cell.text for cell in row)]
    head, where = _heading(rows)
    named = any(cell.text.upper() in FORMS for row in filled for cell in row)
    if "comment" in where or (not named and _are_comments(filled)):
        return Listing(
            say("export_comments", words=words),
            comments=_comments(rows[head:], where.get("comment"), where.get("name", 0), family=family),
        )
    wide = sum(len(row) > 4 or line.startswith('"') for row, line in zip(rows, lines, strict=True) if row)
    if "instruction" not in where and (2 * wide < len(filled) or not named):
        plain = (";" + line[1:] if _PRINTED.fullmatch(line) else line for line in lines)
        return Listing(say("export_list"), "\n".join(plain))
    at = where["instruction"] if "instruction" in where else _busiest(filled)
    device = where.get("device", at + 1)
    texts = (at, device, where.get("preset"))
    if head:
        taken = (cell.text for number, cell in enumerate(rows[head - 1]) if number in texts)
        words = say("export_taken", words=words, columns=", ".join(taken))
    done = (_plain(row, at, texts, body=number >= head) for number, row in enumerate(rows))
    return Listing(say("export_program", words=words), "\n".join(done))


def _delimiter(lines: list[str]) -> str:
    """What separates columns; semicolons begin comments in a list, but not behind quotes or in a heading."""
    if any("\t" in line for line in lines):
        return "\t"
    quoted = any(line.startswith('"') and '";' in line for line in lines)
    return ";" if quoted or _heading([_cells(line, ";") for line in lines])[1] else ","


def _cells(line: str, delimiter: str) -> list[_Cell]:
    found, at = [], 0
    while at <= len(line):
        quoted = _QUOTED.match(line, at)
        end = line.find(delimiter, quoted.end() if quoted else at)
        end = len(line) if end < 0 else end
        text = quoted[1].replace('""', '"') if quoted else line[at:end]
        blanks = len(text) - len(text.lstrip())
        found.append(_Cell(at + bool(quoted) + blanks, text.strip()))
        at = end + 1
    return found


def _heading(rows: list[list[_Cell]]) -> tuple[int, dict[str, int]]:
    """The row below the headings, and what they name by column: of a program, or of comments."""
    for number, row in enumerate(rows):
        where = {
            name: at
            for at, cell in reversed(list(enumerate(row)))
            for name, heads in _HEADS.items()
            if cell.text.casefold().replace(" ", "") in heads
        }
        if "instruction" in where and len(row) > 2:
            return number + 1, {name: where[name] for name in where.keys() - {"comment", "name"}}
        if "comment" in where and "name" in where:
            return number + 1, {name: where[name] for name in ("comment", "name")}
    return 0, {}


def _are_comments(filled: list[list[_Cell]]) -> bool:
    devices = sum(_OPERAND.fullmatch(row[0].text.upper()) is not None and len(row) > 1 for row in filled)
    return 0 < len(filled) <= 2 * devices


def _comments(rows: list[list[_Cell]], at: int | None, name: int, *, family: Family) -> dict[str, str]:
    """By the device's plain name; where no heading names the column ``at``, the last that has a text."""
    found = {}
    for row in rows:
        texts = [cell.text for cell in row]
        comment = texts[at] if at is not None and at < len(texts) else next(filter(None, texts[:0:-1]), "")
        try:
            device = "".join(texts[name : name + 1]).upper()
            found[str(parse_device(device, observed=True, family=family))] = comment
        except ValueError:
            continue  # a heading, or a device that the PLC lacks
    printable = {name: "".join(filter(str.isprintable, text))[:200].strip() for name, text in found.items()}
    return {name: text for name, text in printable.items() if text}


def _busiest(filled: list[list[_Cell]]) -> int:
    """The column in which most instructions stand."""
    columns = [at for row in filled for at, cell in enumerate(row) if cell.text.upper() in FORMS]
    return max(set(columns), key=columns.count)


def _plain(row: list[_Cell], at: int, texts: tuple[int | None, ...], *, body: bool) -> str:
    """A row as a line of an instruction list: each word at its column, then a comment of all else."""
    step = row[:1] if body and at > 0 and row[0].text.isdecimal() else []
    words = [cell for number, cell in enumerate(row) if body and number in texts and cell.text]
    line = ""
    for word in [*step, *words] if words else []:
        line = f"{line:{word.column}}{word.text}"
    rest = " ".join(cell.text for cell in row if cell.text and cell not in (*step, *words))
    return f"{line} ; {rest}".strip() if rest else line

"""Reads the text of an instruction list: one instruction a line, all mistakes at once.

A line is ``[step number] mnemonic operands``, separated by blanks, tabs or commas, or a label
(``P0``), alone or in front of an instruction. ``;``, ``//`` and ``#`` begin a comment. Capitals or not
makes no difference. Step numbers are read over: a list that was edited keeps its old ones.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from bussim.errors import Problem
from bussim.plc.program.catalog import (
    FORMS,
    LABEL,
    NOT_SIMULATED,
    Form,
    Instruction,
    Spec,
    steps_of,
)
from bussim.plc.program.check import operand_problems
from bussim.plc.program.operands import Operand, parse_operand
from bussim.wording import nearest, shorten

#: Largest program that is read: the FX's 16 000 steps with room for comments.
MAX_CHARACTERS = 1_000_000
MAX_STEPS = 16_000
#: Mistakes that are listed before the reader gives up.
_MAX_PROBLEMS = 100

_TOKEN = re.compile(r"[^\s,]+")
_COMMENT = re.compile(r";|//|#")
_LABEL = re.compile(r"[Pp][0-9]+:?", re.ASCII)
_STEP = re.compile(r"[0-9]+:?", re.ASCII)


class Source:
    """The instructions of a text and the mistakes in it.

    An instruction with wrong operands has none. ``instructions`` leaves out a line whose mnemonic could
    not be read; ``gaps`` holds the numbers of the instructions in front of which one is missing, so that
    later checks blame nothing on its absence.
    """

    def __init__(self, text: str, name: str) -> None:
        self.name = name
        self.instructions: list[Instruction] = []
        self.gaps: set[int] = set()
        self.problems: list[Problem] = []
        #: Whether the text was read to its end.
        self.whole = False
        self._step = 0
        if len(text) > MAX_CHARACTERS:
            self._wrong(0, 0, f"has {len(text)} characters, allowed {MAX_CHARACTERS}")
            return
        # Not str.splitlines, which also breaks at form feeds and other characters no editor counts.
        for number, line in enumerate(text.replace("\r\n", "\n").replace("\r", "\n").split("\n"), 1):
            self._line(number, line)
            if len(self.problems) >= _MAX_PROBLEMS:
                self._wrong(number, 1, f"more than {_MAX_PROBLEMS} mistakes; the rest was not read")
                break
            if self._step > MAX_STEPS:
                self._wrong(number, 1, f"the program has more than {MAX_STEPS} steps")
                break
        else:
            self.whole = True

    def _wrong(self, line: int, column: int, message: str) -> None:
        self.problems.append(Problem(self.name, line, column, message))

    def _line(self, number: int, line: str) -> None:
        comment = _COMMENT.search(line)
        code = line[: comment.start()] if comment else line
        if number == 1:
            code = code.lstrip("\ufeff")  # editors on Windows put a mark there
        tokens = [(match.group(), match.start() + 1) for match in _TOKEN.finditer(code)]
        if tokens and _STEP.fullmatch(tokens[0][0]):
            if len(tokens) == 1:
                self._wrong(number, tokens[0][1], "a step number without an instruction")
                return
            tokens = tokens[1:]
        if tokens:
            self._instruction(number, tokens)

    def _instruction(self, line: int, tokens: list[tuple[str, int]]) -> None:
        (word, column), *rest = tokens
        if _LABEL.fullmatch(word):
            self._add(line, column, "P", Form(LABEL), [(word.rstrip(":"), column)])
            if not rest:
                return
            (word, column), *rest = rest
        name = word.upper()
        form = FORMS.get(name)
        if form is None:
            self._wrong(line, column, _unknown(word))
            self.gaps.add(len(self.instructions))
            return
        self._add(line, column, name, form, rest)

    def _add(self, line: int, column: int, name: str, form: Form, rest: list[tuple[str, int]]) -> None:
        before = len(self.problems)
        operands = tuple(self._operands(line, rest))
        if len(self.problems) == before:
            self._judge(line, column, name, form, operands)
        broken = len(self.problems) > before
        # With wrong operands its place in the ladder is known all the same.
        self.instructions.append(
            Instruction(
                len(self.instructions), self._step, line, column, name, form, () if broken else operands
            )
        )
        self._step += steps_of(form, operands)

    def _operands(self, line: int, tokens: list[tuple[str, int]]) -> Iterator[Operand]:
        for text, column in tokens:
            try:
                yield parse_operand(text, column)
            except ValueError as error:
                self._wrong(line, column, str(error))

    def _judge(self, line: int, column: int, name: str, form: Form, operands: tuple[Operand, ...]) -> None:
        for at, message in operand_problems(name, form, operands):
            self._wrong(line, operands[at].column if 0 <= at < len(operands) else column, message)


def _unknown(word: str) -> str:
    shown = shorten(repr(word))
    upper = word.upper()
    # A known instruction in a form that it does not have says more than the nearest name.
    for base in (
        upper,
        upper.removesuffix("P"),
        upper.removeprefix("D"),
        upper.removeprefix("D").removesuffix("P"),
    ):
        if base in NOT_SIMULATED:
            return f"{shown}: {NOT_SIMULATED[base]}"
        if base in FORMS and base != upper and not FORMS[base].wide:
            return f"{shown}: {base} has {_forms(FORMS[base].spec)}"
    near = nearest(upper, list(FORMS))
    if near is not None:
        return f"{shown} is no instruction; did you mean {near}?"
    return f"{shown} is no instruction"


def _forms(spec: Spec) -> str:
    wide = spec.wide_name or f"D{spec.name}"
    match spec.forms:
        case "":
            return "neither a P (pulse) nor a D (32-bit) form"
        case "P":
            return f"the forms {spec.name} and {spec.name}P only"
        case "D":
            return f"the forms {spec.name} and {wide} only"
        case _:
            return f"the forms {spec.name}, {spec.name}P, {wide} and {wide}P"

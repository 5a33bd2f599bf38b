"""Reads the text of an instruction list: one instruction a line, all mistakes at once.

A line is ``[step number] mnemonic operands``, separated by blanks, tabs or commas, or a label
(``P0``), alone or in front of an instruction. Operands may also stand on lines of their own below their
instruction, as programming tools print them. ``;``, ``//``, ``#`` and ``'`` begin a comment, as does a text
in Chinese, Japanese or Korean with no instruction behind it, and a line's first ``*``; ``(* … *)`` and
``/* … */`` hold one. Capitals or not, of full width or not makes no difference; between a device's letter
and its number may be blanks (``X 0``), in front of a comparison's sign too (``LD = D0 K1``), behind it none
(``LD=D0 K1``), and a handheld programmer's key SP between operands (``OUT T0 SP K50``). Several instructions
may stand on a line. Step numbers that are not those of the instructions are warned of: a list that was
edited keeps its old ones. Only where lines have several must they rise, for a list printed in columns is read
downwards.
"""

import re
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

from bussim.errors import Problem
from bussim.plc.memory import Family
from bussim.plc.program.text.catalog import FORMS, LABEL, Form, Instruction, steps_of
from bussim.plc.program.text.numbering import Printed, misnumbered
from bussim.plc.program.text.operand_checks import operand_problems, slots_of
from bussim.plc.program.text.operands import Operand, parse_operand
from bussim.plc.program.text.unknown import unknown
from bussim.plc.program.text.unsimulated import SKIPPED, effect_of, effect_of_operands, stand_in
from bussim.wording import shorten
from bussim.words.language import say

#: Largest program that is read: the FX's 16 000 steps with room for comments.
MAX_CHARACTERS = 1_000_000
MAX_STEPS = 16_000
#: Mistakes that are listed before the reader gives up.
_MAX_PROBLEMS = 100

_TOKEN = re.compile(r"[^\s,]+")
#: Comments, the first to begin wins: to the end of the line, or up to their closing mark.
_COMMENT = re.compile(
    r"(?:;|//|#|'|^[ \t]*\*)[^\n]*|\(\*.*?\*\)|/\*.*?\*/|(?P<open>\(\*|/\*).*", re.DOTALL | re.MULTILINE
)
#: What may stand apart from its number, and the signs of comparisons that may stand apart.
_LETTERS = frozenset("KHXYMSTCDPNVZ")
_NUMBER = re.compile(r"[+-]?[0-9]+(?:[VvZz][0-9]?)?", re.ASCII)
_DIGITS = re.compile(r"[0-9A-Fa-f]+(?:[VvZz][0-9]?)?", re.ASCII)  # behind H
_SIGNS = frozenset(("=", ">", "<", "<>", "<=", ">="))
_LABEL = re.compile(r"[Pp][0-9]+:?", re.ASCII)
_STEP = re.compile(r"[0-9]+:?", re.ASCII)
_COMPARISON = re.compile(r"((?:LD|AND|OR)D?(?:<>|<=|>=|=|<|>))([^=<>]+)", re.ASCII | re.IGNORECASE)
#: What is an operand, right or not, also of instructions that are not simulated: E, texts, buffer memory.
_OPERAND = re.compile(
    r"(?:(?:K[0-9]+)?(?:[XYMSTCDRPNLBWF]|S[MDBW]|ZR)[0-9]+|K[+-]?[0-9]+|H|E[+-]?[0-9]+|V|Z)[0-9.A-F]*(?:[VZ][0-9]*)?|\".*\"|U[0-9]\\G[0-9]+",
    re.ASCII | re.IGNORECASE,
)
#: A bracket that is not closed yet, or a < right in front of a text.
_OPENED = re.compile(r"[(\[{《「【〈][^)\]}》」】〉]*$|<$")
#: The first letter of a text in Chinese, Japanese or Korean: no device has such letters (5 ms to compile).
_EAST_ASIAN = "[\u3040-\u30ff\u3400-\u9fff\uac00-\ud7af\uff66-\uff9f]"
_FULL_WIDTH = {0xFF01 + at: 0x21 + at for at in range(94)} | {0x3000: 0x20}


class _Word(NamedTuple):
    """A word of the text and its position."""

    text: str
    line: int
    column: int


class _Statement(NamedTuple):
    """An instruction whose operands are still being gathered."""

    name: str
    head: _Word
    form: Form | None  # None: there is no such instruction
    words: list[_Word]

    def takes(self, word: _Word) -> bool:
        """Whether an operand on a line of its own belongs to it: it has too few, and a label is its own."""
        if self.form is None or self.form.spec is SKIPPED:
            return not _LABEL.fullmatch(word.text)  # how many an unknown instruction takes is unknown
        try:
            first = tuple(parse_operand(word.text, word.column) for word in self.words[:1])
        except ValueError:
            first = ()
        wanted = slots_of(self.form, first)[len(self.words) :]
        return bool(wanted) and (not _LABEL.fullmatch(word.text) or "P" in wanted[0].takes)


class Source:
    """The instructions of a text and the mistakes in it.

    An instruction with wrong operands has none. ``instructions`` leaves out a line whose mnemonic could
    not be read; ``gaps`` holds the numbers of the instructions in front of which one is missing, so that
    later checks blame nothing on its absence.
    """

    def __init__(self, text: str, name: str, *, skip: bool = False, family: Family = Family.FX2N) -> None:
        self.name = name
        #: Of instructions that are skipped, as they are not simulated (none without ``skip``), and of steps.
        self.warnings: list[Problem] = []
        self._skip, self._family = skip, family
        self.instructions: list[Instruction] = []
        self.gaps: set[int] = set()
        self.problems: list[Problem] = []
        #: Whether the text was read to its end.
        self.whole = False
        self._step = 0
        self._number = -1  # the latest step number that is written
        self._printed: list[Printed] = []
        self._numbered: _Word | None = None  # the step number of the instruction that begins next
        self._columns = False  # whether a line had several
        self._open = False  # whether a comment was not closed
        self._statement: _Statement | None = None
        if len(text) > MAX_CHARACTERS:
            self._wrong(0, 0, say("program_characters", number=len(text), max_characters=MAX_CHARACTERS))
            return
        text = text.replace("\r\n", "\n").replace("\r", "\n").translate(_FULL_WIDTH)
        text = self._without_comments(text)
        # Not str.splitlines, which also breaks at form feeds and other characters no editor counts.
        for number, line in enumerate(text.split("\n"), 1):
            self._line(number, line)
            if len(self.problems) >= _MAX_PROBLEMS:
                self._wrong(number, 1, say("program_mistakes", max_problems=_MAX_PROBLEMS))
                return
            if self._step > MAX_STEPS:
                self._wrong(number, 1, say("program_steps", max_steps=MAX_STEPS))
                return
        self._finish()
        self.whole = not self._open
        if not self.problems and (found := misnumbered(self._printed, self.instructions)):
            printed, step = found
            message = say("program_step", printed=printed.step, step=step)
            self.warnings.append(Problem(self.name, printed.line, printed.column, message))

    def _wrong(self, line: int, column: int, message: str) -> None:
        self.problems.append(Problem(self.name, line, column, message))

    def _without_comments(self, text: str) -> str:
        """The text with blanks for its comments; every other character keeps its place."""

        def blank(comment: re.Match[str]) -> str:
            if comment["open"]:
                self._open = True
                line = text.count("\n", 0, comment.start()) + 1
                column = comment.start() - text.rfind("\n", 0, comment.start())
                closing = "*)" if comment["open"] == "(*" else "*/"
                self._wrong(line, column, say("program_comment", closing=closing))
            return re.sub(r"[^\n]", " ", comment.group())

        if text.startswith("\ufeff"):
            text = " " + text[1:]  # editors on Windows put a mark there
        return _COMMENT.sub(blank, text)

    def _line(self, number: int, line: str) -> None:
        steps, found = 0, _without_text(number, line)
        for words in _statements(found):
            head = words[0]
            if not _STEP.fullmatch(head.text):
                self._begin_or_go_on(words)
                continue
            step, steps = int(head.text.rstrip(":")), steps + 1
            if len(words) == 1:
                self._finish()
                self._wrong(number, head.column, say("program_step_alone"))
                continue
            self._columns = self._columns or steps > 1
            if self._columns and step <= self._number:
                below = say("program_columns")
                self._wrong(
                    number,
                    head.column,
                    say("program_step_behind", step=step, number=self._number, below=below),
                )
            self._number, self._numbered = step, head
            self._begin_or_go_on(words[1:])
            self._numbered = None

    def _begin_or_go_on(self, words: list[_Word]) -> None:
        statement, head = self._statement, words[0]
        if head.text.upper() not in FORMS and _OPERAND.fullmatch(head.text):
            if statement is not None and statement.takes(head):
                statement.words.extend(words)
                return
            if statement is not None and not _LABEL.fullmatch(head.text):
                name = (
                    say("program_before_it", name=statement.name)
                    if statement.name != "P"
                    else say("program_a_label")
                )
                self._wrong(
                    head.line, head.column, say("program_without", text=shorten(head.text), name=name)
                )
                return
        self._finish()
        self._begin(words)

    def _begin(self, words: list[_Word]) -> None:
        head, *rest = words
        if self._numbered is not None:
            _, line, column = self._numbered
            self._printed.append(Printed(self._number, len(self.instructions), line, column))
            self._numbered = None
        if _LABEL.fullmatch(head.text):
            label = head._replace(text=head.text.rstrip(":"))
            self._statement = _Statement("P", head, Form(LABEL), [label])
            if not rest:
                return
            self._finish()
            head, *rest = rest
        name = head.text.upper()
        if rest and rest[0].text in _SIGNS and name + rest[0].text in FORMS:
            name, rest = name + rest[0].text, rest[1:]
        form, effect = FORMS.get(name), effect_of(name) if self._skip else None
        if form is None and effect:
            form = stand_in(name)
            message = say("program_skipped", name=name, effect=effect)
            self.warnings.append(Problem(self.name, head.line, head.column, message))
            if form.spec.slots:
                rest = [head._replace(text="M8000")]
        self._statement = _Statement(name, head, form, rest)
        if form is None:
            self._wrong(head.line, head.column, unknown(head.text))
            self.gaps.add(len(self.instructions))

    def _finish(self) -> None:
        """The statement that was begun has all its operands."""
        statement, self._statement = self._statement, None
        if statement is None or statement.form is None:
            return
        name, head, form, words = statement
        assert form is not None  # noqa: S101 - narrows the type
        if form.spec is SKIPPED:
            form = replace(form, spec=replace(SKIPPED, steps=1 + 2 * len(words)))
            words = []
        before = len(self.problems)
        operands = self._operands(form, words)
        found = effect_of_operands(name, operands, self._family) if len(self.problems) == before else None
        if found is not None:
            name, form, operands = self._leave_out(head, found, form, operands)
        elif len(self.problems) == before:
            for at, message in operand_problems(name, form, operands):
                word = words[at] if 0 <= at < len(words) else head
                self._wrong(word.line, word.column, message)
        broken = len(self.problems) > before
        # With wrong operands its place in the ladder is known all the same.
        self.instructions.append(
            Instruction(
                len(self.instructions),
                self._step,
                head.line,
                head.column,
                name,
                form,
                () if broken else operands,
            )
        )
        self._step += steps_of(form, operands)

    def _leave_out(
        self, head: _Word, found: tuple[str, str], form: Form, operands: tuple[Operand, ...]
    ) -> tuple[str, Form, tuple[Operand, ...]]:
        """What stands for one whose operands are not simulated; without ``skip`` it is a mistake."""
        what, effect = found
        if not self._skip:
            self._wrong(
                head.line,
                head.column,
                say("program_not_simulated", what=what, skip=say("effect_skip"), effect=effect),
            )
        else:
            message = say("program_is_skipped", what=what, effect=effect)
            self.warnings.append(Problem(self.name, head.line, head.column, message))
        return SKIPPED.name, Form(replace(SKIPPED, steps=steps_of(form, operands))), ()

    def _operands(self, form: Form, words: list[_Word]) -> tuple[Operand, ...]:
        found: list[Operand] = []
        for at, word in enumerate(words):
            takes = [kind for slot in slots_of(form, tuple(found))[at : at + 1] for kind in slot.takes]
            plain = "K" if len(takes) != 1 else takes[0]
            try:
                found.append(parse_operand(word.text, word.column, family=self._family, plain=plain))
            except ValueError as error:
                more = form.spec is not SKIPPED and at >= len(slots_of(form, tuple(found)))
                hint = say("program_semicolon") if more or re.search(r"[(\[{<]", word.text) else ""
                self._wrong(word.line, word.column, say("program_error", error=error.args[0], hint=hint))
        return tuple(found)


def _without_text(number: int, line: str) -> list[_Word]:
    """The words of a line up to a comment without its mark, a text in Chinese, Japanese or Korean.

    It begins behind an instruction's last operand, or else with the text or the bracket around it.
    """
    text = re.search(_EAST_ASIAN, line)
    if text is None or any(word.upper() in FORMS for word in _TOKEN.findall(line[text.start() :])):
        return _joined(number, line)
    opened = _OPENED.search(line[: text.start()])
    words = _joined(number, line[: (opened or text).start()])
    names = [at for at, word in enumerate(words) if word.text.upper() in FORMS]
    if not names:
        return words
    (_, *operands), name = words[names[-1] :], words[names[-1]].text.upper()
    if operands and operands[0].text in _SIGNS:
        name += operands.pop(0).text
    for at, word in enumerate(operands):
        if not _Statement(name, word, FORMS.get(name), operands[:at]).takes(word):
            return words[: words.index(word)]
    return words


def _joined(number: int, line: str) -> list[_Word]:
    """The words of a line; a device's letter and the number behind it are one."""
    words: list[_Word] = []
    end = 0
    for match in _TOKEN.finditer(line):
        text, start = match.group(), match.start()
        if text.upper() == "SP":
            continue
        last = words[-1] if words else None
        if (
            last is not None
            and last.text.upper() in _LETTERS
            and (_DIGITS if last.text.upper() == "H" else _NUMBER).fullmatch(text)
            and line[end:start].isspace()
        ):
            words[-1] = last._replace(text=last.text + text)
        else:
            words.extend(_word(text, number, start + 1))
        end = match.end()
    return words


def _word(text: str, line: int, column: int) -> Iterator[_Word]:
    """A word, or two where a comparison's first operand follows its sign at once."""
    if match := _COMPARISON.fullmatch(text):
        yield _Word(match[1], line, column)
        text, column = match[2], column + match.start(2)
    yield _Word(text, line, column)


def _statements(words: list[_Word]) -> Iterator[list[_Word]]:
    """The words of a line, each instruction with its step number and operands apart."""
    begun = head = 0
    form = None
    for at, word in enumerate(words):
        name = word.text.upper()
        full = form is not None and at - head > len(form.spec.slots)
        if name in FORMS or effect_of(name) or (full and _LABEL.fullmatch(word.text)):
            first = at - 1 if at and _STEP.fullmatch(words[at - 1].text) else at
            if first > begun:
                yield words[begun:first]
                begun = first
            head, form = at, FORMS.get(name)
    if words:
        yield words[begun:]

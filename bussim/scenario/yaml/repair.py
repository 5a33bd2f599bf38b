"""What was probably meant where a text is no YAML: repairs with which the parser reads on.

The parser decides. Of the repairs that the lines around its complaint suggest, the one counts that lets
it read farthest, and what that one mends is the mistake. Every repair changes one line of the text.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

from bussim.wording import describe, plain_form, shorten

#: Line and column, counted from 1.
Mark = tuple[int, int]

#: What ends a line to the parser.
LINE_END = re.compile("\r\n|[\n\r\x85\u2028\u2029]")
#: So many mistakes of one file are mended, and so many characters of repaired texts read in search of them.
_MOST_MISTAKES = 50
_MOST_TRIED = 1 << 19
#: So many lines above a complaint are looked at.
_MOST_ABOVE = 100
_KEY = r"([^\W\d][\w.-]*)"
_LEAD = "^( *(?:- +)*)"
#: What is found in a line, what stands there instead, and what is said of it: by number its groups, ``write``
#: what it becomes.
_RULES = [
    (re.compile(pattern), new, text)
    for pattern, new, text in (
        (rf"(?<![\w.-]){_KEY}:(?=[^\s:/])", r"\1: ", "{1} has no blank after its colon; write {write}"),
        ("^( *)-(?=[^ -])", r"\1- ", "a list entry has no blank after its dash; write {write}"),
        (rf"(?<![\w.-]){_KEY} *= *", r"\1: ", "{1} has a = instead of a colon; write {write}"),
        (rf"{_LEAD}{_KEY} *$", r"\1\2:", "{2} has no colon; write {write}"),
        (rf"{_LEAD}{_KEY}[ ;]+(?=\S)", r"\1\2: ", "{2} has no colon; write {write}"),
        (r"(?<=\S)\t+", " ", "there is a tab; write a blank"),
        (r"(?<!\S)//", "#", "a comment begins with //; write #"),
        (";", ",", "there is a ; for a comma; write ,"),
        (r",(\s*,)+", ",", "there is a comma too many"),
        (rf"(?<=[\w\"}}\]])( +)(\"?{_KEY}\"?: )", r",\1\2", "a comma is missing before {3}"),
        (r"(?<=[\w\"}\]])( +)(?=[\"{\[])", r",\1", "a comma is missing before {write}"),
        (r"(?<=[\w\"}\]]) *$", ",", "a comma is missing at the end of the line"),
        (r"[\])]", "}", "{0} closes a {{; write }}"),
        (r"[})]", "]", "{0} closes a [; write ]"),
        (r"[}\])]", "", "there is a {0} too many: it closes nothing"),
        (r"([\"'])([^\"',}\]#]*?)(?=[,}\]]| *$)", r"\1\2\1", "the {1} is never closed; write {write}"),
        (r"(?<=[:,{\[-] )([@`%*&!][^,}\]#]*)", r'"\1"', "{1} begins with a sign of YAML; write {write}"),
        (
            rf"{_LEAD}({_KEY}: +[^\s:,]+(?: [^\s:,]+)?),? +({_KEY}: .*)$",
            r"\1\2 # \4",
            "{5} stands in the same line as {3}; give it a line of its own",
        ),
        (
            rf'{_LEAD}({_KEY}: +)([^#"{{\[][^#"]*: [^#"]*)$',
            r'\1\2"\4"',
            "{3} is a text with a colon in it; write it in quotes",
        ),
        (rf"^( *){_KEY}: *{{ *", r"\1- {name: \2, ", "{2} is a mapping among list entries; write {write}"),
        (rf"^( *)  ({_KEY}:)(?=\s)", r"\1- \2", "{3} begins no list entry; for one write {write}"),
        (rf"^( *)({_KEY}:)(?=\s)", r"\1- \2", "{3} begins no list entry; for one write {write}"),
        (r"\(([^()]*)\)", r"{\1}", "{0} has round brackets; write {write}"),
        *(
            (
                r"(?<=program: [|>])(?=[+-]? *(#.*)?$)",
                f"{depth}",
                f"its lines begin deeper than they go on: indent them evenly, or write program: |{depth}",
            )
            for depth in range(9, 0, -1)
        ),
    )
]
#: Lines above a complaint that may be its cause: a quote that is not closed, a program's text.
_CAUSE = re.compile(r"[^\"]*(\"[^\"]*\"[^\"]*)*\"[^\"]*$|[ -]*program: [|>]")


class Trouble(Exception):  # noqa: N818 - not an error of the program but the end of reading
    """The text cannot be read beyond ``mark``; what the parser was reading began at ``begun``."""

    def __init__(self, mark: Mark, message: str, begun: Mark) -> None:
        self.mark, self.message, self.begun = mark, message, begun
        super().__init__(message)


#: Another text of one line (from 0), and what it mends: where, and the message.
_Repair = tuple[int, str, Mark, str]


@dataclass(slots=True)
class Mended:
    """A text as far as it could be repaired. ``mistakes`` are what was mended, by marks in the file."""

    text: str
    mistakes: list[tuple[Mark, str]] = field(default_factory=list)
    _changes: list[tuple[int, int, int]] = field(default_factory=list)  # line, column behind which, how far
    _tried: int = 0

    def original(self, mark: Mark) -> Mark:
        """Where a place of the repaired text is in the file."""
        line, column = mark
        for changed, after, by in reversed(self._changes):
            if line == changed and column > after:
                column = max(after + 1, column - by)
        return line, column

    def mend(self, trouble: Trouble, read: Callable[[str], Trouble | None]) -> bool:
        """Repair what stops the parser; False if nothing that is known lets it read on.

        ``read`` returns what stops it in another text, None for nothing.
        """
        lines, ends = LINE_END.split(self.text), [*LINE_END.findall(self.text), ""]
        start = farthest = _reach(lines, trouble)
        best: tuple[_Repair, str] | None = None
        for repair in _repairs(lines, trouble):
            if repair is None and best is not None:
                break
            if repair is None:
                continue
            changed = [*lines[: repair[0]], repair[1], *lines[repair[0] + 1 :]]
            text = "".join(line + end for line, end in zip(changed, ends, strict=True))
            found = read(text)
            self._tried += len(text) if found is None else sum(map(len, lines[: found.mark[0]]))
            reach = _reach(changed, found)
            same = reach[0] == start[0] and (reach[1] <= start[1] or reach[2] <= start[2])
            if reach > farthest and not same:
                farthest, best = reach, (repair, text)
            if found is None or self._tried > _MOST_TRIED:
                break
        if best is None or len(self.mistakes) == _MOST_MISTAKES:
            return False
        (number, line, mark, message), self.text = best
        if not trouble.message.startswith("is not YAML"):
            message = f"{trouble.message}; {message}"
        self.mistakes.append((self.original(mark), message))
        before = lines[number]
        self._changes.append((number + 1, _alike(before, line), len(line) - len(before)))
        return True


def _reach(lines: Sequence[str], trouble: Trouble | None) -> tuple[int, int, int]:
    """Where the reading stops: line, column from the line's beginning, and (below 0) from its end."""
    if trouble is None:
        return len(lines) + 2, 0, 0
    line, column = trouble.mark
    return line, column, column - len(lines[line - 1]) if line <= len(lines) else 0


def _alike(one: str, other: str) -> int:
    """How many characters two texts have in common from their beginning on."""
    return next(
        (n for n, (a, b) in enumerate(zip(one, other, strict=False)) if a != b), min(len(one), len(other))
    )


def _repairs(lines: Sequence[str], trouble: Trouble) -> Iterator[_Repair | None]:
    """What can be tried, what is more likely first; None where what went before is enough if it helps."""
    here = min(trouble.mark[0], len(lines)) - 1
    above = [number for number in range(here - 1, max(-1, here - _MOST_ABOVE), -1) if lines[number].strip()]
    causes = [number for number in above if _CAUSE.match(lines[number])]
    near = sorted({trouble.begun[0] - 1, *causes[:1], *above[:1], here} & set(range(len(lines))))
    for number in near:
        yield from _lookalikes(number, lines[number])
    yield None
    for number in near:
        yield from _by_rules(number, lines[number], _RULES[:1])
    yield None
    yield from _unclosed(lines, trouble.begun)
    for number in near:
        yield from _by_rules(number, lines[number], _RULES[1:])
    for number in (here, *above[:1]):
        yield from _indented(number, [lines[other] for other in above], lines[number])


def _lookalikes(number: int, line: str) -> Iterator[_Repair]:
    """Characters that were typed or pasted for those of YAML."""
    for at, char in enumerate(line):
        plain = plain_form(char)
        if plain is not None:
            plain = {"(": "{", ")": "}", ";": ","}.get(plain, plain)
            blank = " " if plain in ":,-" and line[at + 1 : at + 2].strip() else ""
            text = f"there is {describe(char)}; write {'a blank' if plain == ' ' else plain}"
            yield (number, line[:at] + plain + blank + line[at + 1 :], (number + 1, at + 1), text)


def _by_rules(number: int, line: str, rules: list[tuple[re.Pattern[str], str, str]]) -> Iterator[_Repair]:
    for pattern, new, text in rules:
        for match in pattern.finditer(line):
            became = match.expand(new)
            value, cut, _ = re.split(r"([,}\]#]|$)", line[match.end() :], maxsplit=1)
            write = shorten((became + value).strip(" ,")) + (" …" if cut and "{" in became else "")
            said = text.format(match.group(), *match.groups(), write=write)
            column = match.start() + _alike(match.group(), became) + 1
            repaired = line[: match.start()] + became + line[match.end() :]
            yield (number, repaired, (number + 1, column), said)


def _unclosed(lines: Sequence[str], begun: Mark) -> Iterator[_Repair]:
    """A bracket that is closed at the end of its line, or of one that follows."""
    first = begun[0] - 1
    opener = lines[first][begun[1] - 1 :][:1] if first < len(lines) else ""
    closer = {"{": "}", "[": "]"}.get(opener)
    for number in range(first, min(first + 20, len(lines))) if closer else ():
        text = re.sub(r"( +#.*| *)$", rf"{closer}\1", lines[number], count=1)
        where = "the end" if number == first else f"the end of line {number + 1}"
        yield (number, text, begun, f"the {opener} is never closed; write {closer} at {where}")


def _indented(number: int, above: Sequence[str], line: str) -> Iterator[_Repair]:
    """A line that begins where one above it does."""
    lead = line[: len(line) - len(line.lstrip())]
    width, odd = len(lead) + lead.count("\t"), lead.strip(" ")
    starts = [re.match("( *)((?:- +)*)", other) for other in above]
    levels = {found.end(group) for found in starts if found for group in (1, 2)} | {width - width % 2}
    for level in sorted(levels, key=lambda level: abs(level - width)):
        text = f"the line begins in column {width + 1}; expected column {level + 1}, as a line above it"
        if odd:
            text = f"{describe(odd[0])} indents the line; YAML takes blanks only"
        mark = number + 1, 1 if odd else width + 1
        yield (number, " " * level + line.lstrip(), mark, text)

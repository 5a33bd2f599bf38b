"""What was probably meant where a text is no YAML: repairs with which the parser reads on.

The parser decides. Of the repairs that the lines around its complaint suggest, the one counts that lets
it read farthest, and what that one mends is the mistake. Every repair changes one line of the text, and
where that line is indented by tabs all lines below that are indented so.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import islice

from bussim.wording import plain_form, shorten
from bussim.words.language import say
from bussim.words.values import describe

#: Line and column, counted from 1.
Mark = tuple[int, int]

#: What ends a line to the parser.
LINE_END = re.compile("\r\n|[\n\r\x85\u2028\u2029]")
#: So many mistakes of one file are mended, and so many characters of repaired texts read in search of them.
_MOST_MISTAKES = 50
_MOST_TRIED = 1 << 20
#: So many lines above a complaint are looked at.
_MOST_ABOVE = 100
_KEY = r"([^\W\d][\w.-]*)"
_LEAD = "^( *(?:- +)*)"
_GROUPS = ("found", "one", "two", "three", "four", "five")
_Rule = tuple[re.Pattern[str], str, str]
#: What is found in a line, what stands there instead, and the key of what is said of it: with its groups,
#: ``write``, what it becomes, and ``new``, what stands there instead.
_RULES = [
    (re.compile(pattern), new, key)
    for pattern, new, key in (
        (rf"(?<![\w.-]){_KEY}:(?=[^\s:/])", r"\1: ", "mend_no_blank"),
        (r"( +#.*| *)$", r"}\1", "mend_brace_open"),
        (r"( +#.*| *)$", r"]\1", "mend_bracket_open"),
        ("^( *)-(?=[^ -])", r"\1- ", "mend_dash"),
        (r"\b(\d+),(\d{3})\b(?! *[a-zµ])", r"\1\2", "mend_comma_number"),
        (r"\b(\d+),(\d+)", r"\1.\2", "mend_comma_number"),
        (rf"(?<![\w.-]){_KEY} *= *", r"\1: ", "mend_equals"),
        (rf"{_LEAD}{_KEY} *$", r"\1\2:", "mend_no_colon"),
        (rf"{_LEAD}{_KEY}[ ;]+(?=\S)", r"\1\2: ", "mend_no_colon"),
        (r"(?<=\S)\t+", " ", "mend_tab"),
        (r"(?<!\S)//", "#", "mend_comment"),
        (";", ",", "mend_semicolon"),
        (r",(\s*,)+", ",", "mend_comma_many"),
        (rf"(?<=[\w\"}}\]])( +)(\"?{_KEY}\"?: )", r",\1\2", "mend_comma_before"),
        (r"(?<=[\w\"}\]])( +)(?=[\"{\[])", r",\1", "mend_comma_write"),
        (r"(?<=[\w\"}\]]) *$", ",", "mend_comma_end"),
        (r"[\])]", "}", "mend_closes_brace"),
        (r"[})]", "]", "mend_closes_bracket"),
        (r"[}\])]", "", "mend_closes_nothing"),
        (r"([\"'])([^\"',}\]#]*?)(?=[,}\]]| *$)", r"\1\2\1", "mend_quote"),
        (r"(?<=[:,{\[-] )([@`%*&!][^,}\]#]*)", r'"\1"', "mend_sign"),
        (rf"{_LEAD}({_KEY}: +[^\s:,]+(?: [^\s:,]+)?),? +({_KEY}: .*)$", r"\1\2 # \4", "mend_same_line"),
        (rf'{_LEAD}({_KEY}: +)([^#"{{\[][^#"]*: [^#"]*)$', r'\1\2"\4"', "mend_colon_text"),
        (rf"^( *){_KEY}: *{{ *", r"\1- {name: \2, ", "mend_mapping"),
        (rf"^( *)  ({_KEY}:)(?=\s)", r"\1- \2", "mend_no_entry"),
        (rf"^( *)({_KEY}:)(?=\s)", r"\1- \2", "mend_no_entry"),
        (r"\(([^()]*)\)", r"{\1}", "mend_round"),
        *((r"(?<=program: [|>])(?=[+-]? *(#.*)?$)", f"{depth}", "mend_uneven") for depth in range(9, 0, -1)),
    )
]
#: Lines above a complaint that may be its cause: a quote that is not closed, a program's text.
_CAUSE = re.compile(r"[^\"]*(\"[^\"]*\"[^\"]*)*\"[^\"]*$|[ -]*program: [|>]")
#: A line from 0, another text of it, the column from which it differs, and the mistake that this mends.
_Repair = tuple[int, str, int, str]


class Trouble(Exception):  # noqa: N818 - not an error of the program but the end of reading
    """The text cannot be read beyond ``mark``; what the parser was reading began at ``begun``."""

    def __init__(self, mark: Mark, message: str, begun: Mark) -> None:
        self.mark, self.message, self.begun = mark, message, begun
        super().__init__(message)


@dataclass(slots=True)
class Mended:
    """A text as far as it could be repaired. ``mistakes`` are what was mended, by marks in the file."""

    text: str
    mistakes: list[tuple[Mark, str]] = field(default_factory=list)
    _changes: list[tuple[int, int, int]] = field(default_factory=list)  # line, column from which, how far
    _tried: int = 0

    def original(self, mark: Mark) -> Mark:
        """Where a place of the repaired text is in the file."""
        line, column = mark
        for changed, start, by in reversed(self._changes):
            if line == changed and column > start:
                column = max(start, column - by)
        return line, column

    def mend(self, trouble: Trouble, read: Callable[[str], Trouble | None]) -> bool:
        """Repair what stops the parser; False if nothing that is known lets it read on.

        ``read`` returns what stops it in another text, None for nothing.
        """
        if len(self.mistakes) >= _MOST_MISTAKES:
            return False
        lines, ends = LINE_END.split(self.text), [*LINE_END.findall(self.text), ""]
        farthest, best = _reach(lines, read(self.text)), None
        for repair in _repairs(lines, trouble):
            if repair is None and best is not None:
                break
            if repair is None:
                continue
            number, line, column, _ = repair
            if len(line) < len(lines[number]) and (number + 1, column) > trouble.mark:
                continue  # less text behind the place is no progress
            repairs = [repair, *islice(_alike(lines, repair), _MOST_MISTAKES - len(self.mistakes) - 1)]
            changed = _changed(lines, repairs)
            text = _joined(changed, ends)
            found = read(text)
            self._tried += len(text) if found is None else sum(map(len, lines[: found.mark[0]]))
            if (reach := _reach(changed, found)) > farthest:
                farthest, best = reach, repairs
            if found is None or self._tried > _MOST_TRIED:
                break
        if best is None:
            return False
        if "twice" in trouble.message:
            best[0] = (*best[0][:3], say("mend_and", known=trouble.message, what=best[0][3]))
        taken = [best[0], *(each for each in best[1:] if each[0] + 1 < farthest[0])]
        for number, line, column, message in taken:
            self.mistakes.append((self.original((number + 1, column)), message))
            self._changes.append((number + 1, column, len(line) - len(lines[number])))
        self.text = _joined(_changed(lines, taken), ends)
        return True


def _changed(lines: Sequence[str], repairs: Iterable[_Repair]) -> list[str]:
    changed = {number: line for number, line, _, _ in repairs}
    return [changed.get(number, line) for number, line in enumerate(lines)]


def _joined(lines: Sequence[str], ends: Sequence[str]) -> str:
    return "".join(line + end for line, end in zip(lines, ends, strict=True))


def _reach(lines: Sequence[str], trouble: Trouble | None) -> tuple[int, int]:
    """Where the reading stops: line, and column from its end (below 0)."""
    line, column = (len(lines) + 2, 0) if trouble is None else trouble.mark
    return line, column - len(lines[line - 1]) if line <= len(lines) else 0


def _repairs(lines: Sequence[str], trouble: Trouble) -> Iterator[_Repair | None]:
    """What can be tried, what is more likely first; None where what went before is enough if it helps."""
    here = min(trouble.mark[0], len(lines)) - 1
    above = [number for number in range(here - 1, max(-1, here - _MOST_ABOVE), -1) if lines[number].strip()]
    causes = [number for number in above if _CAUSE.match(lines[number])]
    near = sorted({trouble.begun[0] - 1, *causes[:1], *above[:1], here} & set(range(len(lines))))
    indented = (
        repair
        for number in (here, *above[:1])
        for repair in _indented(number, [lines[other] for other in above], lines[number])
    )
    if lines[here].startswith("\t"):
        yield from indented
        yield None
    for step in (_lookalikes, _glued, _by_rules):
        for number in near:
            yield from step(number, lines[number])
        if step is not _by_rules:
            yield None
    yield from indented


def _alike(lines: Sequence[str], repair: _Repair) -> Iterator[_Repair]:
    """The same for lines below where it puts blanks for tabs that indent a line: as many for each tab."""
    first, new, column, message = repair
    tabs, blanks = _lead(lines[first])
    width, rest = divmod(_lead(new)[1] - blanks, tabs or 1)
    if not tabs or _lead(new)[0] or rest or width < 0:
        return
    for number, line in enumerate(lines[first + 1 :], first + 1):
        tabs, blanks = _lead(line)
        if tabs and line.strip():
            yield number, " " * (width * tabs + blanks) + line.lstrip(), column, message


def _lead(line: str) -> tuple[int, int]:
    """The tabs and blanks that indent a line."""
    lead = line[: len(line) - len(line.lstrip(" \t"))]
    return lead.count("\t"), lead.count(" ")


def _lookalikes(number: int, line: str) -> Iterator[_Repair]:
    """Characters that were typed or pasted for those of YAML."""
    for at, char in enumerate(line):
        plain = plain_form(char)
        if plain is not None:
            plain = {"(": "{", ")": "}", ";": ","}.get(plain, plain)
            blank = " " if plain in ":,-" and line[at + 1 : at + 2].strip() else ""
            write = say("mend_blank") if plain == " " else plain
            text = say("mend_there", found=describe(char), write=write)
            yield number, line[:at] + plain + blank + line[at + 1 :], at + 1, text


def _glued(number: int, line: str) -> Iterator[_Repair]:
    return _by_rules(number, line, _RULES[:1])


def _by_rules(number: int, line: str, rules: Sequence[_Rule] = _RULES) -> Iterator[_Repair]:
    for pattern, new, key in rules:
        for match in pattern.finditer(line):
            became = match.expand(new)
            value, cut, _ = re.split(r"([,}\]#]|$)", line[match.end() :], maxsplit=1)
            write = shorten((became + value).strip(" ,")) + (" …" if cut and "{" in became else "")
            groups = dict(zip(_GROUPS, (match.group(), *match.groups()), strict=False))
            said = say(key, write=write, new=new, **groups)
            column = match.end() - len(match.group().lstrip()) + 1
            yield number, line[: match.start()] + became + line[match.end() :], column, said


def _indented(number: int, above: Sequence[str], line: str) -> Iterator[_Repair]:
    """A line that begins where one above it does."""
    lead = line[: len(line) - len(line.lstrip())]
    width, odd = len(lead) + lead.count("\t"), lead.strip(" ")
    starts = [re.match("( *)((?:- +)*)", other) for other in above]
    levels = {found.end(group) for found in starts if found for group in (1, 2)} | {width - width % 2}
    if odd:  # as deep as editors show it: the text of a program stands behind its key then
        levels |= {len(lead.expandtabs(tab)) for tab in (4, 8)}
    for level in sorted(levels, key=lambda level: (abs(level - width), -level)):
        text = say("mend_column", column=width + 1, expected=level + 1)
        if odd:
            text = say("mend_indents", found=describe(odd[0]))
        yield number, " " * level + line.lstrip(), 1 if odd else width + 1, text

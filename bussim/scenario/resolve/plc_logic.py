"""What a PLC's program and inputs mean: files read, the program parsed, its first scan tried."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from bussim.errors import Problem, ProgramError
from bussim.forms.registers import named_devices
from bussim.plc.first_scan import FirstScan, first_scan
from bussim.plc.inputs import InputSpec, Pulse, RandomInput, Square, Times
from bussim.plc.memory import Device, Family, parse_device
from bussim.plc.profiles import Profile
from bussim.plc.system_devices import CLOCK, clock_of
from bussim.scenario.schema.document import PlcIn
from bussim.scenario.schema.programs import InputIn, ProgramIn
from bussim.scenario.yaml.files import Files
from bussim.scenario.yaml.input_table import read_times
from bussim.scenario.yaml.source_map import Path, Report
from bussim.wording import shorten
from bussim.words.language import say
from bussim.words.tables import changed

if TYPE_CHECKING:
    from bussim.plc.program.program import Program

#: A program's text, comments and all; a run's scenario holds all of them.
MAX_PROGRAM = 128 * 1024
#: What a programming tool makes of that in its tables.
MAX_EXPORT = 16 * MAX_PROGRAM
MAX_CSV = 1024 * 1024
#: Devices with comments that are taken from a file: a run's scenario.yaml holds them.
MAX_COMMENTS = 2000

#: How a message names another line of the program; no word of a program has a blank in it.
_DEVICE = re.compile(r"\b[XYMSTCDR][0-9]+\b", re.ASCII)
_LINE = re.compile(r"\bat line ([0-9]+)\b", re.ASCII)


@dataclass(frozen=True, slots=True)
class Origin:
    """Where the lines of a program stand: in a file of its own, in the scenario, or in no file at all."""

    file: str  # "" for a text whose lines have no marks of their own
    path: Path
    line: int = 0  # of the scenario, of the text's first line; 0: the text is the file's own
    indent: int = 0

    def problem(self, report: Report, found: Problem, *, warning: bool = False) -> Problem:
        """A problem of the program, placed where the user finds it, as are the other lines that it names.

        What a run says of a warning is the same wherever the program stands: lines of the program.
        """
        plain = changed(found.message, lambda text: _LINE.sub(r"at line \1 of the program", text))
        named = report.source_map.full_name(self.path)
        if not self.file:
            text = plain if warning else say("program_in_line", line=found.line, text=plain)
            placed = report.source_map.remark(self.path, text)
        elif self.line == 0:
            placed = Problem(self.file, found.line, found.column, found.message, named)
        else:
            begins = self.line - 1
            moved = changed(
                found.message, lambda text: _LINE.sub(lambda match: f"at line {int(match[1]) + begins}", text)
            )
            line, column = self.line + max(found.line, 1) - 1, self.indent + max(found.column, 1)
            placed = Problem(self.file, line, column, moved, named)
        if warning:
            report.plain[placed] = plain
        return placed


@dataclass(frozen=True, slots=True)
class PlcLogic:
    """``first`` is what the program sets at RUN; ``inputs`` and ``comments`` are by device name."""

    program: Program | None = None
    origin: Origin | None = None
    first: FirstScan = field(default_factory=FirstScan)
    inputs: Mapping[str, InputSpec] = field(default_factory=dict)
    comments: Mapping[str, str] = field(default_factory=dict)


def read_logic(
    path: Path,
    plc: PlcIn,
    profile: Profile,
    registers: Mapping[str, int],
    power_on: int,
    files: Files,
    report: Report,
    *,
    skips: bool,
) -> PlcLogic:
    """What a PLC's entry says of its program and inputs; mistakes in them are reported.

    ``registers`` are what the PLC has at power-on without its program.
    """
    inputs = _inputs((*path, "inputs"), plc.inputs, files, report, family=profile.family)
    comments = _comments((*path, "comments"), plc.comments, files, report, family=profile.family)
    if plc.program is None:
        return PlcLogic(inputs=inputs, comments=comments)
    program, origin = _program(
        (*path, "program"), plc, plc.program, files, report, comments, skips=skips, family=profile.family
    )
    if program is None:
        return PlcLogic(origin=origin, inputs=inputs, comments=comments)
    known = {parse_device(name): value for name, value in registers.items()}
    levels = {
        parse_device(name): given for name, given in inputs.items() if not isinstance(given, RandomInput)
    }
    clock = [Device("D", address) for address in CLOCK[:-1]]
    try:
        clock_of([known.get(device, 0) & 0xFFFF for device in clock])
    except ValueError:  # which a rule reports: the program's link and ports are tried at another time
        known = {device: value for device, value in known.items() if device not in clock}
    first = first_scan(program, profile, known, levels, power_on)
    return PlcLogic(program, origin, first, inputs, comments)


def _comments(
    path: Path, given: Mapping[str, str], files: Files, report: Report, *, family: Family
) -> dict[str, str]:
    """The names of devices, those of the scenario before those of a file."""
    names = {key: text for key, text in given.items() if key != "file"}
    devices = named_devices(path, names, report, family=family, observed=True)
    own = {str(device): names[name] for name, device in devices}
    if "file" not in given:
        return own
    from bussim.plc.program.text.exports import listing  # what only a scenario with such a file pays

    name = given["file"]
    try:
        found = listing(files.read(name, MAX_EXPORT, coded=True), family=family)
    except ValueError as error:
        report.error(_inner(path, "file", report), error.args[0])
        return own
    if found.comments is None:
        report.error(
            _inner(path, "file", report), say("file_no_comments", name=shorten(name), kind=found.kind)
        )
    elif not found.comments:
        report.warn(_inner(path, "file", report), say("file_comments_none", name=shorten(name)))
    kept = dict(list((found.comments or {}).items())[:MAX_COMMENTS])
    if len(kept) < len(found.comments or {}):
        text = say("file_comments", max_comments=MAX_COMMENTS)
        report.warn(_inner(path, "file", report), text)
    return kept | own


def _program(
    path: Path,
    plc: PlcIn,
    given: ProgramIn,
    files: Files,
    report: Report,
    comments: Mapping[str, str],
    *,
    skips: bool,
    family: Family,
) -> tuple[Program | None, Origin | None]:
    kind = ""
    if given.file is not None:
        origin = Origin(given.file, _inner(path, "file", report))
        try:
            text, kind = _exported(given.file, files)
        except ValueError as error:
            report.error(origin.path, error.args[0])
            return None, origin
    else:
        text = given.text or ""
        at = _inner(path, "text", report)
        block = report.source_map.blocks.get(at)
        origin = Origin("" if block is None else report.source_map.file, at, *(block or ()))
        if len(text.encode()) > MAX_PROGRAM:
            report.error(at, say("file_more", most=MAX_PROGRAM >> 10))
            return None, origin
    from bussim.plc.program.program import Program  # what only a scenario with programs pays

    text = text.replace("\r\n", "\n").replace("\r", "\n")
    try:
        text = text if text.endswith("\n") else text + "\n"
        program = Program.parse(text, plc.name, skips=skips, family=family)
    except ProgramError as error:
        for problem in error.problems:
            report.add(origin.problem(report, problem), fatal=True)
        return None, origin
    for problem in program.warnings:
        # A run's warnings have no marks: the PLC's name shows whose program it is.
        # With its comment the first device stands, the one that is spoken of.
        message = changed(
            problem.message, lambda text: _DEVICE.sub(lambda at: _commented(at[0], comments), text, count=1)
        )
        named = replace(problem, message=say("rule_of_plc", member=plc.name, what=message))
        report.add(origin.problem(report, named, warning=True), fatal=False)
    return replace(program, kind=kind), origin


def _commented(device: str, comments: Mapping[str, str]) -> str:
    comment = comments.get(device)
    return f"{device} ({comment})" if comment else device


def _exported(name: str, files: Files) -> tuple[str, str]:
    """A file as an instruction list, and what it was taken for. Raises ValueError with a predicate."""
    from bussim.plc.program.text.exports import INSTRUCTION_LIST, listing  # what only programs pay

    content = files.read(name, MAX_EXPORT, coded=True)
    if not content.strip():
        raise ValueError(say("file_empty_program", name=shorten(name)))
    found = listing(content)
    if found.comments is not None:
        raise ValueError(say("file_holds", name=shorten(name), kind=found.kind, comments=len(found.comments)))
    text = found.text
    # Columns are dispensable, and notes of an export, whose comments are its only semicolons.
    for dispensable in ("(?m)^ +", "(?m) *;.*$")[: 1 + (found.kind != INSTRUCTION_LIST)]:
        if len(text.encode()) > MAX_PROGRAM:
            text = re.sub(dispensable, "", text)
    if len(text.encode()) > MAX_PROGRAM:
        raise ValueError(say("file_too_large", name=shorten(name), most=MAX_PROGRAM >> 10))
    coding = files.codings.get(name, "UTF-8")
    guess = "" if coding.startswith("UTF") else say("file_guess")
    return text, say("file_read_as", name=name, kind=found.kind, coding=coding, guess=guess)


def _inner(path: Path, key: str, report: Report) -> Path:
    """Where a value stands that may have been written without its key."""
    inner = (*path, key)
    return inner if inner in report.source_map.values else path


# -- inputs --------------------------------------------------------------------------------------------


def _inputs(
    path: Path, given: Mapping[str, InputIn], files: Files, report: Report, *, family: Family
) -> dict[str, InputSpec]:
    found: dict[str, InputSpec] = {}
    for name, device in named_devices(path, given, report, family=family):
        if device.letter != "X":
            report.error((*path, name), say("rule_no_input", letter=device.letter), key=True)
        elif (spec := _input((*path, name), given[name], files, report)) is not None:
            found[str(device)] = spec
    return found


#: What becomes of each kind of input that needs no file.
_INPUTS: dict[str, Callable[[Any], InputSpec]] = {
    "pulse": lambda given: Pulse(given.width, given.at, given.every, given.times),
    "square": lambda given: Square(given.period, given.at),
    "random": lambda given: RandomInput(given.on, given.off, given.seed),
    "times": lambda given: Times(tuple(given)),
}


def _input(path: Path, given: InputIn, files: Files, report: Report) -> InputSpec | None:
    """What drives an input; None where a mistake is reported."""
    if not given.kind:
        return None
    if given.csv is None:
        return _INPUTS[given.kind](getattr(given, given.kind))
    try:
        text = files.read(given.csv, MAX_CSV)
    except ValueError as error:
        report.error((*path, "csv"), error.args[0])
        return None
    times = read_times(text, given.csv, (*path, "csv"), report)
    return Times(times) if times is not None else None

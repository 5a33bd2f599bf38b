"""Writes a program's blocks as Python functions: they run some hundred times a simulated second.

Contacts, coils and jumps become expressions and statements on the memory's arrays, as do the commonest
instructions of words. What the others do are functions bound to the memory (``build``), called by the
instruction's number: ``act_7()`` while its condition is on, ``take_7(on)`` in every scan, ``test_7()`` of a
comparison, ``count_7()`` of FOR. Edges and comparisons with an index register must be evaluated in every
scan (they remember, or may fail), so they stand in front of the statement whose condition they belong to.
"""

from collections.abc import Iterator
from functools import lru_cache
from types import CodeType
from typing import assert_never

from bussim.plc.program.instruction_times import InstructionTimes
from bussim.plc.program.program import Program
from bussim.plc.program.text.catalog import Flow, Instruction
from bussim.plc.program.text.flow import BasicBlock
from bussim.plc.program.text.ladder import (
    STEP_LEVEL,
    Both,
    Condition,
    Contact,
    Control,
    Either,
    Not,
    Rung,
    Saved,
)
from bussim.plc.program.text.operands import Operand
from bussim.plc.program.text.unsimulated import SKIPPED

#: The arrays that a function uses; arguments with defaults are faster to reach than globals.
ARRAYS = ("X", "Y", "M", "S", "T", "C", "D", "R", "TN", "CN", "V", "Z", "levels", "saved", "earlier", "spent")
#: The arrays of words: T and C are the arrays of contacts.
WORD_ARRAYS = {"D": "D", "R": "R", "T": "TN", "C": "CN", "V": "V", "Z": "Z"}
#: Instructions that are carried out in Python's own words while their condition is on: what they store.
STORED = {"SET": 1, "RST": 0}
#: Applied instructions of words that never move.
_OF_WORDS = {
    "MOV": "{1} = {0}",
    "CML": "{1} = {0} ^ 0xFFFF",
    "WAND": "{2} = {0} & {1}",
    "WOR": "{2} = {0} | {1}",
    "WXOR": "{2} = {0} ^ {1}",
    "INC": "{0} = {0} + 1 & 0xFFFF",
    "DEC": "{0} = {0} - 1 & 0xFFFF",
    "NEG": "{0} = -{0} & 0xFFFF",
    # Patterns with their sign bit inverted are the values plus 32768.
    "ADD": "{2} = stored(M, ({0} ^ 0x8000) + ({1} ^ 0x8000) - 0x10000) & 0xFFFF",
    "SUB": "{2} = stored(M, ({0} ^ 0x8000) - ({1} ^ 0x8000)) & 0xFFFF",
}
#: Comparisons that Python writes in another way.
_OPERATORS = {"=": "==", "<>": "!="}
#: What ends a scan.
END = -1


def is_bound_coil(at: Instruction) -> bool:
    """Whether an instruction is OUT or RST of a timer or counter."""
    return at.spec.name in ("OUT", "RST") and at.operands[0].kind in ("T", "C")


def needs_function(at: Instruction) -> bool:
    """Whether an applied instruction or a comparison is not written out, as of fixed 16-bit words."""
    if at.spec.is_applied and at.spec.name not in _OF_WORDS:
        return True
    return at.form.wide or any(operand.index is not None or operand.groups for operand in at.operands)


def standing_time(times: InstructionTimes, at: Instruction) -> int:
    """Nanoseconds that an instruction takes whatever its condition."""
    if at.spec.is_applied:
        return times.of(f"{at.spec.name} off", "idle", wide=False)
    return time_when_on(times, at)


def time_when_on(times: InstructionTimes, at: Instruction) -> int:
    """Nanoseconds that an instruction takes when it is carried out, without those for each device."""
    return times.of(at.spec.name, "timer" if is_bound_coil(at) else at.spec.group, wide=at.form.wide)


@lru_cache(maxsize=64)
def compiled(program: Program, times: InstructionTimes) -> CodeType:
    """A program's blocks as functions ``block_0``, ``block_1``, …, which return the next block's number.

    Kept, as the PLCs of a sweep and of a bus run the same programs.
    """
    writer = _Writer(program, times)
    return compile("\n".join(writer.lines), f"<{program.name}>", "exec")


class _Writer:
    def __init__(self, program: Program, times: InstructionTimes) -> None:
        self.lines: list[str] = []
        self._times = times
        #: The indices of the conditions that other rungs use again.
        self._saved: dict[int, int] = {}
        for block in program.blocks:
            for item in (*block.rungs, block.exit):
                for rung in () if item is None or item.condition is None else _used_again(item.condition):
                    self._saved.setdefault(id(rung), len(self._saved))
        last = len(program.blocks) - 1
        for number, block in enumerate(program.blocks):
            self._block(number, block, END if number == last else number + 1)

    def _write(self, *lines: str) -> None:
        self.lines += [f"    {line}" for line in lines]

    def _block(self, here: int, block: BasicBlock, following: int) -> None:
        self.lines.append(f"def block_{here}({', '.join(f'{name}={name}' for name in ARRAYS)}):")
        self._write(f"time = {sum(standing_time(self._times, at) for at in block.instructions)}")
        for item in block.rungs:
            if isinstance(item, Rung):
                self._rung(item)
            elif item.flow is Flow.MC:
                level, coil = item.instruction.operands
                self._condition(item.driven_by, item.level)
                self._write(f"levels[{level.address}] = {coil.letter}[{coil.address}] = on")
        self._write("spent[0] += time")
        if block.exit is None:
            self._write(f"return {following}")
        else:
            self._exit(block.exit, here, block.target, following)

    def _exit(self, control: Control, here: int, target: int, following: int) -> None:
        at = control.instruction
        if control.condition is not None:
            self._condition(control.condition, control.level)
            if at.form.pulse:
                self._rising(at)
        match control.flow:
            case Flow.CJ:
                self._write(f"return {target} if on else {following}")
            case Flow.CALL:
                self._write(f"return call({target}, {following}, {at.step}) if on else {following}")
            case Flow.SRET:
                self._write(f"return calls.pop() if calls else {END}")
            case Flow.FOR:  # 0 and less count as 1 (FX programming manual)
                self._write(f"loops[{here}] = max(count_{at.number}(), 1)", f"return {following}")
            case Flow.NEXT:
                loop = f"loops[{target - 1}]"
                self._write(f"{loop} -= 1", f"return {target} if {loop} > 0 else {following}")
            case Flow.STL:  # carried out once more, without its state, after that has gone off
                state, earlier = at.operands[0].address, f"earlier[{at.number}]"
                joined = f"levels[{STEP_LEVEL}] and " if control.level == STEP_LEVEL else ""
                self._write(f"on = levels[{STEP_LEVEL}] = {joined}S[{state}]")
                self._write(
                    f"before, {earlier} = {earlier}, on", f"return {following} if on or before else {target}"
                )
            case Flow.RET:
                self._write(f"return {following}")
            case Flow.WDT:
                self._write("if on: watch()", f"return {following}")
            case Flow.FEND | Flow.END:
                self._write(f"return {END}")
            case Flow.MC | Flow.MCR | Flow.LABEL:
                raise ValueError(f"{at.name} ends no block")
            case flow:
                assert_never(flow)

    # -- rungs -------------------------------------------------------------------------------------

    def _rung(self, rung: Rung) -> None:
        self._condition(rung.condition, rung.level)
        if (index := self._saved.get(id(rung))) is not None:
            self._write(f"saved[{index}] = on")
        for at in rung.outputs:
            if rung.steps and at.spec.name in ("SET", "OUT") and at.operands[0].kind == "S":
                # The state that follows takes the place of those that led to it.
                states = "".join(f"S[{state}] = " for state in rung.steps)
                self._write("if on:", f"    {states}0", f"    S[{at.operands[0].address}] = 1")
            else:
                self._output(at)

    def _output(self, at: Instruction) -> None:
        if at.spec.is_applied:
            self._applied(at)
            return
        if at.spec.name == SKIPPED.name:
            return
        if is_bound_coil(at) or at.operands[0].index is not None:
            self._write(f"take_{at.number}(on)")
            return
        device = at.operands[0]
        array = WORD_ARRAYS[device.letter] if device.kind in ("D", "V", "Z") else device.letter
        bit = f"{array}[{device.address}]"
        match at.spec.name:
            case "SET" | "RST" | "OUT" if device.kind == "D.b":
                value = "on" if at.spec.name == "OUT" else STORED[at.spec.name]
                store = f"{bit} = {bit} & {0xFFFF ^ 1 << device.bit} | {value} << {device.bit}"
                self._write(store if at.spec.name == "OUT" else f"if on: {store}")
            case "SET" | "RST":
                self._write(f"if on: {bit} = {STORED[at.spec.name]}")
            case "PLS" | "PLF":
                sign = ">" if at.spec.name == "PLS" else "<"
                self._write(f"{bit} = on {sign} earlier[{at.number}]", f"earlier[{at.number}] = on")
            case "OUT":
                self._write(f"{bit} = on")
            case name:
                raise ValueError(f"{name} is no coil that is written out")

    def _applied(self, at: Instruction) -> None:
        if at.form.pulse:
            self._write("level = on")
            self._rising(at)
        extra = time_when_on(self._times, at) - standing_time(self._times, at)
        act = f"act_{at.number}()"
        if not needs_function(at):
            act = _OF_WORDS[at.spec.name].format(*map(_word, at.operands))
        self._write("if on:", f"    time += {extra}", f"    {act}")
        if at.form.pulse:
            self._write("on = level")

    def _rising(self, at: Instruction) -> None:
        """The P form: carried out where the condition rises."""
        earlier = f"earlier[{at.number}]"
        self._write(f"before, {earlier} = {earlier}, on", "on = on > before")

    # -- conditions --------------------------------------------------------------------------------

    def _condition(self, condition: Condition, level: int | None) -> None:
        """``on``: whether a condition is on, and that of the MC around it."""
        text = self._text(condition)
        self._write(f"on = {text}" if level is None else f"on = levels[{level}] and ({text})")

    def _text(self, condition: Condition) -> str:
        match condition:
            case Contact(at):
                return self._contact(at)
            case Saved(rung):
                return f"saved[{self._saved[id(rung)]}]"
            case Not(part):
                return f"not {self._enclosed(part, (Both, Either))}"
            case Both(first, second):
                return f"{self._enclosed(first, (Either,))} and {self._enclosed(second, (Either,))}"
            case Either(first, second):
                return f"{self._text(first)} or {self._text(second)}"
            case _:
                assert_never(condition)

    def _enclosed(self, part: Condition, binding_less: tuple[type, ...]) -> str:
        text = self._text(part)
        return f"({text})" if isinstance(part, binding_less) else text

    def _contact(self, at: Instruction) -> str:
        first, test, name = at.operands[0], at.spec.test, f"test_{at.number}"
        if at.spec.group == "comparison":
            if not needs_function(at):
                # Patterns with their sign bit inverted have the order of their values.
                return (
                    f"{_word(first)} ^ 0x8000 {_OPERATORS.get(test, test)} {_word(at.operands[1])} ^ 0x8000"
                )
            if all(operand.index is None for operand in at.operands):
                return f"{name}()"
            self._write(f"{name}_on = {name}()")
            return f"{name}_on"
        bit = f"{first.letter}[{first.address}]"
        if first.kind == "D.b":
            bit = f"({bit} >> {first.bit} & 1)"
        if first.index is not None:
            self._write(f"{name}_bit = {name}()")
            bit = f"{name}_bit"
        if test in ("on", "off"):
            return bit if test == "on" or first.index is not None else f"not {bit}"
        earlier = f"earlier[{at.number}]"
        self._write(f"{name}_on = {bit} {'>' if test == 'rise' else '<'} {earlier}", f"{earlier} = {bit}")
        return f"{name}_on"


def _word(operand: Operand) -> str:
    """A word's pattern of bits, or a constant's."""
    if operand.kind == "K":
        return str(operand.address & 0xFFFF)
    return f"{WORD_ARRAYS[operand.letter]}[{operand.address}]"


def _used_again(condition: Condition) -> Iterator[Rung]:
    """The rungs whose conditions a condition uses."""
    match condition:
        case Saved(rung):
            yield rung
        case Not(part):
            yield from _used_again(part)
        case Both(first, second) | Either(first, second):
            yield from _used_again(first)
            yield from _used_again(second)
        case Contact():
            pass
        case _:
            assert_never(condition)

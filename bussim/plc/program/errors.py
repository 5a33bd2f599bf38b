"""Errors that stop a running program or that its PLC flags, with their texts for the user."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from bussim.plc.program.machine import CALLS_TOO_DEEP, OUT_OF_RANGE

if TYPE_CHECKING:
    from bussim.plc.program.program import Program

#: Codes of D8067 in words (FX programming manual).
MEANINGS = {
    CALLS_TOO_DEEP: "CALL nested more than five deep",
    OUT_OF_RANGE: "an operand's address or data out of range",
}


class OperationFault(NamedTuple):
    """Operation errors with one code between two ENDs: M8067 on, ``code`` in D8067.

    ``step`` is where the first of them was (D8069), ``number`` how many there were.
    """

    code: int
    step: int
    number: int

    def text(self, program: Program | None) -> str:
        """In words; the instruction is that of the program."""
        meaning = MEANINGS.get(self.code, "operation error")
        return f"M8067 on, D8067 = {self.code} ({meaning}) {location(program, self.step)}"


class Halt(NamedTuple):
    """The program stands still from ``tick`` on: M8061 on, ``code`` in D8061.

    ``watchdog`` is D8000 in ms. ``endless``: its jumps have no end, so that the scan was given up.
    """

    tick: int
    code: int
    watchdog: int
    endless: bool

    @property
    def text(self) -> str:
        """Why, in words."""
        if self.endless:
            why = "its scan jumps on without end"
        else:
            why = f"its scan exceeds the watchdog (D8000 = {self.watchdog} ms)"
        return f"{why}, M8061 on, D8061 = {self.code}"


class PortRefused(NamedTuple):
    """RS2, the instruction ``refused``, was driven ``number`` times while the one ``holder`` had its port."""

    holder: int
    refused: int
    port: str
    number: int

    def text(self, program: Program | None) -> str:
        """In words; the instructions are those of the program."""
        holds, other = (program.instructions[at].line if program is not None else at for at in self[:2])
        which = f"that at line {holds} of the program keeps it (assumed), that at line {other} is refused"
        return f"two RS or RS2 are driven on {self.port} at once: {which}"


#: What an observer is told of a program.
Fault = OperationFault | Halt | PortRefused


def location(program: Program | None, step: int) -> str:
    """``at step 12 (line 5 of the program: DIV D0 D1 D2)``."""
    found = None if program is None else next((at for at in program.instructions if at.step == step), None)
    if found is None:
        return f"at step {step}"
    words = " ".join((found.name, *(operand.text for operand in found.operands)))
    return f"at step {step} (line {found.line} of the program: {words})"

"""What is carried out of a program is text that bussim wrote: whole numbers and a closed set of names.

A user's program decides which of these stand where, and nothing of its own text gets in.
"""

from __future__ import annotations

import ast
import re

import pytest

from bussim.errors import ProgramError
from bussim.plc.program.compiled.code import ARRAYS, _Writer
from bussim.plc.program.instruction_times import InstructionTimes
from bussim.plc.program.program import Program
from tests.plc.program.random_programs import Writer

#: The forms of Python that blocks consist of: no import, no attribute but two methods', no text, no loop.
NODES = (
    *(ast.Module, ast.FunctionDef, ast.arguments, ast.arg, ast.Return, ast.Assign, ast.AugAssign, ast.If),
    *(ast.Expr, ast.IfExp, ast.BoolOp, ast.BinOp, ast.UnaryOp, ast.Compare, ast.Subscript, ast.Tuple),
    *(ast.Call, ast.Attribute, ast.Name, ast.Constant, ast.expr_context, ast.boolop, ast.operator),
    *(ast.unaryop, ast.cmpop),
)
LOCALS = {"time", "on", "before", "level"}
FLOW = {"call", "calls", "loops", "watch", "max", "stored"}
NUMBERED = re.compile(r"(block|act|take|test|count)_\d+(_on)?")


def check(program: Program) -> None:
    for node in ast.walk(ast.parse("\n".join(_Writer(program, InstructionTimes()).lines))):
        assert isinstance(node, NODES), ast.dump(node)
        if isinstance(node, ast.Name):
            assert node.id in {*ARRAYS, *LOCALS, *FLOW} or NUMBERED.fullmatch(node.id), node.id
        if isinstance(node, ast.Attribute):
            assert (node.value.id, node.attr) == ("calls", "pop"), ast.dump(node)
        if isinstance(node, ast.Constant):
            assert type(node.value) is int, ast.dump(node)
        if isinstance(node, ast.FunctionDef):
            assert NUMBERED.fullmatch(node.name), node.name
            assert not node.decorator_list


@pytest.mark.parametrize("seed", range(40))
def test_random_programs_become_numbers_and_known_names(seed: int) -> None:
    program = Program.parse(Writer(seed).program(), 'x"); import os #')
    check(program)


@pytest.mark.parametrize(
    "line",
    [
        "LD X0;__import__('os')",
        "LD X0 ; exec('1')",
        "OUT Y0\\nimport os",
        "MOV K1 D0[0]",
        "LD M0.real",
        "LD= D0 K1)",
    ],
)
def test_python_in_a_program_is_a_mistake_or_a_comment(line: str) -> None:
    try:
        program = Program.parse(f"LD X0\n{line}\nOUT Y1\nEND", "main.il")
    except ProgramError:
        return
    check(program)

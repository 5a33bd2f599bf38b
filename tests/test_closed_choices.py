"""A choice over the kinds of a closed family fails where a kind is forgotten, instead of passing it over.

Closed families are the enumerations of bussim and the unions of its classes that a module names. A
``match`` or a chain of ``if`` over two or more of their members, also one of early returns, ends in
``assert_never`` or ``raise``; a table of them has all. Where the remaining kinds are really alike the choice
stands in ``ALIKE``. What a profile leaves open is decided beside its enumeration, nowhere else.
"""

from __future__ import annotations

import ast
import importlib
from enum import Enum
from functools import cache
from pathlib import Path
from types import ModuleType, UnionType
from typing import Any, get_args, get_type_hints

import pytest

import bussim
from bussim.plc import profiles
from bussim.plc.profiles import Profile
from bussim.plc.program.text import ladder

ROOT = Path(bussim.__file__).parent

#: Choices whose other kinds are alike, with the reason; by module and function.
ALIKE = {
    "commands.sniff.tally.Tally.take": "the collector, its base class, takes every record",
    "devices.stepper.controller.Controller._check_motion": "inputs stop no other job",
    "devices.stepper.controller.Controller._motion_over": "nothing follows any other job",
    "engines.modbus.codes.EXCEPTION_ERRORS": "any other code is a data error (assumed)",
    "engines.modbus.codes.REJECTION_ERRORS": "the others are of requests, and a slave's",
    "engines.nn.master.Master.transmit_done": "the table of states refuses to leave any other",
    "exact.from_scenario._LinkReader._fault": "the others go on to _lasting, which names them",
    "exact.from_scenario._LinkReader._noise": "a kind that is not worked out becomes an obstacle",
    "results.summary.ports._MESSAGES": "the others are of requests",
    "results.store.rows.FORMS": "the others are in no table, only in a trace",
    "sim.faults.FaultPlan._begin": "the others go on to the match below, which names them",
    "sim.serial.node.SerialNode.report": "all go on to handle_event; two are noted on their way",
    "trace.codec.LineTexts.of": "lines of the others are rare, and encoded each",
    "trace.file._concerns": "mypy refuses a record that has no bus",
}


@cache
def modules() -> tuple[tuple[str, ModuleType, ast.Module], ...]:
    """Every module of bussim with its name below bussim and its text."""
    found = []
    for path in sorted(ROOT.rglob("*.py")):
        parts = path.relative_to(ROOT.parent).with_suffix("").parts
        if parts[-1] == "__main__":
            continue  # importing it runs the program
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        text = path.read_text(encoding="utf-8")
        found.append((name.removeprefix("bussim."), importlib.import_module(name), ast.parse(text)))
    return tuple(found)


def is_own(kind: object) -> bool:
    return isinstance(kind, type) and kind.__module__.startswith("bussim")


@cache
def unions() -> list[frozenset[type]]:
    """The unions of classes that bussim's modules name."""
    found = set()
    for _, module, _ in modules():
        for value in vars(module).values():
            members = get_args(value) if isinstance(value, UnionType) else ()
            if len(members) > 1 and all(map(is_own, members)):
                found.add(frozenset(members))
    return list(found)


class Choices(ast.NodeVisitor):
    """The choices of one module that end without naming what is left, by function."""

    def __init__(self, module: ModuleType, families: list[frozenset[type]]) -> None:
        self.found: list[tuple[str, int]] = []
        self._names = vars(module)
        self._families = families
        self._where: list[str] = []
        self._parts: set[ast.If] = set()  # elif: of a chain that has been seen

    def value(self, node: ast.expr) -> Any:
        """What a name or an attribute of one stands for, None for anything else."""
        if isinstance(node, ast.Name):
            return self._names.get(node.id)
        return getattr(self.value(node.value), node.attr, None) if isinstance(node, ast.Attribute) else None

    def kinds(self, node: ast.expr) -> list[Any]:
        """The classes or members that an expression or several joined in one name."""
        if isinstance(node, ast.Tuple | ast.Set | ast.List):
            return [kind for part in node.elts for kind in self.kinds(part)]
        if isinstance(node, ast.BinOp):
            return [*self.kinds(node.left), *self.kinds(node.right)]
        value = self.value(node)
        if isinstance(value, UnionType):
            return list(get_args(value))
        return [value] if isinstance(value, Enum | type) and is_own(family_of(value)) else []

    def tested(self, test: ast.expr) -> tuple[str, list[Any]]:
        """The subject and the kinds of a condition, none where it asks for something else."""
        match test:
            case ast.BoolOp():
                return next((found for part in test.values if (found := self.tested(part))[1]), ("", []))
            case ast.UnaryOp(ast.Not(), operand):
                return self.tested(operand)
            case ast.Call(ast.Name("isinstance"), [subject, kinds]):
                return ast.unparse(subject), self.kinds(kinds)
            case ast.Compare(subject, [ast.Is() | ast.Eq() | ast.In()], [kinds]):
                return ast.unparse(subject), [kind for kind in self.kinds(kinds) if isinstance(kind, Enum)]
        return "", []

    def is_choice(self, branches: list[list[Any]]) -> bool:
        """Whether two or more branches are for kinds of one family."""
        named = [kinds for kinds in branches if kinds]
        if len(named) < 2:
            return False
        families = [{kind} for kinds in named for kind in map(type, kinds) if issubclass(kind, Enum)]
        return any(
            sum(any(family_of(kind) in family for kind in kinds) for kinds in named) > 1
            for family in [*families, *self._families]
        )

    def check(self, branches: list[list[Any]], end: list[ast.stmt], line: int) -> None:
        if self.is_choice(branches) and not refuses(end):
            self.found.append((".".join(self._where), line))

    def visit_Dict(self, node: ast.Dict) -> None:
        """A table whose keys are kinds of one family has all of them."""
        keys = [
            kind for key in node.keys if isinstance(key, ast.Name | ast.Attribute) for kind in self.kinds(key)
        ]
        for family in {type(key) for key in keys if isinstance(key, Enum)}:
            if len({key for key in keys if type(key) is family}) < len(family):
                self.found.append((".".join(self._where), node.lineno))
        for union in self._families:
            if 1 < len(union & {key for key in keys if isinstance(key, type)}) < len(union):
                self.found.append((".".join(self._where), node.lineno))
        self.generic_visit(node)

    # -- statements ------------------------------------------------------------------------------

    def generic_visit(self, node: ast.AST) -> None:
        match node:
            case ast.FunctionDef(name) | ast.AsyncFunctionDef(name) | ast.ClassDef(name):
                named = [name]
            case ast.AnnAssign(ast.Name(name)) if not self._where:
                named = [name]
            case _:
                named = []
        self._where += named
        for _, block in ast.iter_fields(node):
            if isinstance(block, list) and block and isinstance(block[0], ast.stmt):
                self.block(block)
        super().generic_visit(node)
        if named:
            self._where.pop()

    def block(self, statements: list[ast.stmt]) -> None:
        """Check each chain that begins in a block, early returns one after the other as one chain."""
        index = 0
        while index < len(statements):
            statement = statements[index]
            index += 1
            if isinstance(statement, ast.Match):
                last = statement.cases[-1]
                branches = [self.pattern(case.pattern) for case in statement.cases]
                self.check(branches, [] if branches[-1] else last.body, statement.lineno)
            elif isinstance(statement, ast.If) and statement not in self._parts:
                found, end = self.chain(statement)
                while not end and leaves(statement) and index < len(statements):
                    following = statements[index]
                    if not isinstance(following, ast.If) or refuses([following]):
                        end = [following]
                        break
                    statement, index = following, index + 1
                    more, end = self.chain(statement)
                    found += more
                for subject in {subject for subject, kinds in found if kinds}:
                    branches = [kinds for other, kinds in found if other == subject]
                    self.check(branches, end, statement.lineno)

    def chain(self, statement: ast.If) -> tuple[list[tuple[str, list[Any]]], list[ast.stmt]]:
        """What each test of if and elif asks for, and what else does."""
        found = [self.tested(statement.test)]
        end = statement.orelse
        if len(end) == 1 and isinstance(end[0], ast.If):
            self._parts.add(end[0])
            more, end = self.chain(end[0])
            found += more
        return found, end

    def pattern(self, pattern: ast.pattern) -> list[Any]:
        match pattern:
            case ast.MatchClass(cls):
                return self.kinds(cls)
            case ast.MatchValue(value):
                return self.kinds(value)
            case ast.MatchOr(patterns):
                return [kind for part in patterns for kind in self.pattern(part)]
            case ast.MatchAs(pattern=ast.pattern() as inner):
                return self.pattern(inner)
        return []


def family_of(kind: Any) -> type:
    return type(kind) if isinstance(kind, Enum) else kind


def leaves(statement: ast.If) -> bool:
    """Whether every branch of an if leaves the block."""
    left = isinstance(statement.body[-1], ast.Return | ast.Raise | ast.Continue)
    other = statement.orelse
    return left and (not other or (isinstance(other[0], ast.If) and leaves(other[0])))


def refuses(end: list[ast.stmt]) -> bool:
    """Whether the end of a choice is assert_never or raise."""
    match end:
        case [ast.Raise()] | [ast.If(body=[ast.Raise()])]:
            return True
        case [ast.Expr(ast.Call(ast.Name("assert_never")))]:
            return True
    return False


def choices_of(
    module: ModuleType, tree: ast.Module, families: list[frozenset[type]]
) -> list[tuple[str, int]]:
    choices = Choices(module, families)
    choices.visit(tree)
    return choices.found


@pytest.mark.slow
def test_every_choice_names_all_kinds() -> None:
    families, found = unions(), {}
    for name, module, tree in modules():
        for where, line in choices_of(module, tree, families):
            found[f"{name}.{where}"] = line
    forgotten = {where: line for where, line in found.items() if where not in ALIKE}
    assert forgotten == {}
    assert set(ALIKE) <= set(found), "entries that nothing needs any more"


@pytest.mark.slow
def test_choices_of_a_profile_are_decided_beside_it() -> None:
    """A comparison with one member would take a further one for the other."""
    hints = get_type_hints(Profile).values()
    kinds = {kind for kind in hints if isinstance(kind, type) and issubclass(kind, Enum)}
    assert len(kinds) == 5
    wrong = []
    for name, module, tree in modules():
        choices = Choices(module, [])
        for node in ast.walk(tree) if module is not profiles else ():
            if isinstance(node, ast.Compare):
                compared = [kind for side in (node.left, *node.comparators) for kind in choices.kinds(side)]
                wrong += [f"{name}:{node.lineno}" for kind in compared if type(kind) in kinds]
    assert wrong == []


PASSED_OVER = """
def chain(x):
    if isinstance(x, Contact):
        return 1
    elif isinstance(x, Not | Both):
        return 2
    return 3

def returns(x):
    if x is LadderRole.CONTACT: return 1
    if x is LadderRole.BLOCK: return 2
    return 3

def otherwise(x):
    match x:
        case LadderRole.CONTACT: return 1
        case LadderRole.BLOCK | LadderRole.OUTPUT: return 2
        case _: return 3

def nothing(x):
    match x:
        case Contact(): return 1
        case Not(): return 2

TABLE: dict = {LadderRole.CONTACT: 1, LadderRole.BLOCK: 2}
"""
REFUSED = """
def chain(x):
    if isinstance(x, Contact):
        return 1
    elif isinstance(x, Not | Both):
        return 2
    else:
        raise ValueError

def returns(x):
    if x is LadderRole.CONTACT: return 1
    if x is LadderRole.BLOCK: return 2
    raise ValueError

def otherwise(x):
    match x:
        case LadderRole.CONTACT: return 1
        case LadderRole.BLOCK | LadderRole.OUTPUT: return 2
        case _: assert_never(x)

def one(x):
    return 1 if isinstance(x, Contact) else 2
"""


def test_choices_that_pass_kinds_over_are_found() -> None:
    families = unions()
    found = choices_of(ladder, ast.parse(PASSED_OVER), families)
    assert {where for where, _ in found} == {"chain", "returns", "otherwise", "nothing", "TABLE"}
    assert choices_of(ladder, ast.parse(REFUSED), families) == []

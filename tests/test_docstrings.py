"""Cross-references in docstrings and comments lead to something, and so do the calls of their examples."""

from __future__ import annotations

import ast
import builtins
import importlib
import re
import textwrap
from collections.abc import Iterator
from pathlib import Path

import pytest

import bussim

ROOT = Path(bussim.__file__).parent
PARTS = sorted(path.name for path in ROOT.iterdir() if path.is_dir() and path.name != "__pycache__")
_REFERENCE = re.compile(r":(mod|class|func|meth|attr|data|exc|obj):`(?:[^`<]*<)?[~!]?([\w.]+)>?`")
#: A role without its target in backquotes, or with a target that is no name.
_BROKEN = re.compile(r":(?:mod|class|func|meth|attr|data|exc|obj):(?!`[^`\n]+`)\S*")


def module_of(path: Path) -> str:
    parts = path.relative_to(ROOT.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def texts(tree: ast.Module, source: str) -> Iterator[tuple[ast.ClassDef | None, str]]:
    """Every docstring and comment with the class that it stands in."""
    classes = [node for node in ast.walk(tree) if isinstance(node, ast.ClassDef)]

    def at(line: int) -> ast.ClassDef | None:
        inside = [c for c in classes if c.lineno <= line <= (c.end_lineno or 0)]
        return max(inside, key=lambda c: c.lineno, default=None)

    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            yield at(getattr(node, "lineno", 0)), ast.get_docstring(node) or ""
    for number, line in enumerate(source.splitlines(), 1):
        if "`" in line and (comment := re.match(r"\s*#(.*)", line)):
            yield at(number), comment[1]


def attributes(scope: ast.ClassDef) -> set[str]:
    """What a class defines: methods, fields, and what its methods set on ``self``."""
    names = {node.name for node in scope.body if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)}
    for node in ast.walk(scope):
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            names.add(node.target.id)
        elif isinstance(node, ast.Assign):
            names |= {target.id for target in node.targets if isinstance(target, ast.Name)}
        elif (
            isinstance(node, ast.Attribute)
            and isinstance(node.ctx, ast.Store)
            and isinstance(node.value, ast.Name)
            and node.value.id == "self"
        ):
            names.add(node.attr)
    return names


def has(owner: object, name: str) -> bool:
    """Whether a class has an attribute or field of a name, by itself or from its bases."""
    if hasattr(owner, name):
        return True
    for base in getattr(owner, "__mro__", ()):
        if base.__module__.startswith("bussim"):
            tree = ast.parse(Path(str(importlib.import_module(base.__module__).__file__)).read_text("utf-8"))
            for node in ast.walk(tree):
                if isinstance(node, ast.ClassDef) and node.name == base.__name__ and name in attributes(node):
                    return True
    return False


def leads_somewhere(owner: object, path: list[str]) -> bool:
    """Whether names, one in the other, begin at a module or class."""
    for index, name in enumerate(path):
        if index == len(path) - 1:
            return has(owner, name)
        if not hasattr(owner, name):
            return False
        owner = getattr(owner, name)
    return True


def resolves(target: str, module: str, tree: ast.Module, scope: ast.ClassDef | None) -> bool:
    """Whether a target is a module, a name of one, or a name of this module or class."""
    path = target.split(".")
    for length in range(len(path), 0, -1) if path[0] == "bussim" else ():
        try:
            found = importlib.import_module(".".join(path[:length]))
        except ImportError:
            continue
        return leads_somewhere(found, path[length:])
    here = importlib.import_module(module)
    if leads_somewhere(here, path):
        return True
    if scope is not None and len(path) == 1:
        owner = getattr(here, scope.name, None)
        return path[0] in attributes(scope) or (owner is not None and has(owner, path[0]))
    # What is imported for types only, or within a function.
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module and not node.level:
            for alias in node.names:
                if (alias.asname or alias.name) == path[0]:
                    return leads_somewhere(importlib.import_module(node.module), [alias.name, *path[1:]])
    return False


@pytest.mark.slow
@pytest.mark.parametrize("part", ["", *PARTS])
def test_every_cross_reference_leads_somewhere(part: str) -> None:
    wrong = []
    for path in sorted((ROOT / part).rglob("*.py") if part else ROOT.glob("*.py")):
        if path.name == "__main__.py":
            continue  # importing it runs the program
        source = path.read_text(encoding="utf-8")
        tree = ast.parse(source)
        for scope, text in texts(tree, source):
            wrong += [f"{module_of(path)} {broken}" for broken in _BROKEN.findall(text)]
            for role, target in _REFERENCE.findall(text):
                if not resolves(target, module_of(path), tree, scope):
                    wrong.append(f"{module_of(path)} :{role}:`{target}`")
    assert wrong == []


#: What an example leaves to its reader.
_READERS = {"MyClient"}
_EXAMPLE = re.compile(r"::\n\n((?:[ ]+\S.*\n|\n)+)")


def unknown_calls(text: str, known: set[str]) -> set[str]:
    """Functions and classes that the examples of a docstring call, and that nothing defines."""
    found: set[str] = set()
    for example in _EXAMPLE.findall(text + "\n"):
        try:
            tree = ast.parse(textwrap.dedent(example))
        except SyntaxError:
            continue  # no Python
        nodes = list(ast.walk(tree))
        bound = {n.id for n in nodes if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
        bound |= {n.asname or n.name for n in nodes if isinstance(n, ast.alias)}
        called = {n.func.id for n in nodes if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)}
        found |= called - bound - known - _READERS - set(vars(builtins))
    return found


def defined(tree: ast.Module) -> set[str]:
    """The functions and classes of a module, and what it imports."""
    own = {node.name for node in tree.body if isinstance(node, ast.FunctionDef | ast.ClassDef)}
    return own | {node.asname or node.name for node in ast.walk(tree) if isinstance(node, ast.alias)}


@pytest.mark.slow
def test_examples_call_what_there_is() -> None:
    sources = {path: path.read_text(encoding="utf-8") for path in sorted(ROOT.rglob("*.py"))}
    trees = {path: ast.parse(source) for path, source in sources.items()}
    known = set().union(*map(defined, trees.values()))
    wrong = {
        f"{module_of(path)}: {name}"
        for path, tree in trees.items()
        for _, text in texts(tree, "")
        for name in unknown_calls(text, known)
    }
    assert wrong == set()
    example = "Serve.\n\n::\n\n    with Session(targets(1)) as it:\n        it.run()\n"
    assert unknown_calls(example, {"Session"}) == {"targets"}


def test_references_that_lead_nowhere_are_found() -> None:
    tree = ast.parse("class A:\n    x: int\n    def f(self): self.y = 1\n")
    scope = tree.body[0]
    assert isinstance(scope, ast.ClassDef)
    for good in (
        "bussim.cli.main",
        "bussim.scenario.model.Plc.name",
        "ticks",
        "bussim.exact.link.LinkModel.valid",
    ):
        assert resolves(good.replace("ticks", "parse_time"), "bussim.units", tree, scope)
    for bad in ("bussim.cli.mian", "bussim.cli.main.x", "bussim.nothing", "parse_tme", "z"):
        assert not resolves(bad, "bussim.units", tree, scope)
    assert resolves("y", "bussim.units", tree, scope)

"""The notebooks run from a clean install."""

from __future__ import annotations

import ast
import importlib
import json
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import click
import nbformat
import pytest
import yaml
from nbclient import NotebookClient

import bussim
from bussim.cli import COMMANDS, cli
from bussim.report.scene import _TROUBLE_KINDS
from bussim.results.result import Result
from bussim.results.store.rows import FORMS
from bussim.scenario import builtin
from bussim.scenario.schema.profiles import ProfileIn, TurnaroundIn
from bussim.scenario.yaml.dump import dumps
from bussim.sweep.tables import HIGH, LOW, NEEDED

NOTEBOOKS = sorted((Path(__file__).parent.parent / "notebooks").glob("*.ipynb"))


@pytest.mark.filterwarnings("ignore")  # Jupyter's own, about its event loop and transport
@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_runs(path: Path, tmp_path: Path) -> None:
    notebook = nbformat.read(path, as_version=4)
    resources = {"metadata": {"path": str(tmp_path)}}
    NotebookClient(notebook, timeout=300, kernel_name="python3", resources=resources).execute()
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert code
    assert all(cell.outputs for cell in code)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_what_a_notebook_imports_is_there(path: Path) -> None:
    cells = [cell.source for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "code"]
    for node in ast.walk(ast.parse("\n".join(cells))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("bussim"):
            module = importlib.import_module(str(node.module))
            assert [each.name for each in node.names if not hasattr(module, each.name)] == []


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_imports_public_names_only(path: Path) -> None:
    cells = [cell.source for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "code"]
    inner = []
    for node in ast.walk(ast.parse("\n".join(cells))):
        if isinstance(node, ast.ImportFrom):
            inner.append(node.module or "")
        elif isinstance(node, ast.Import):
            inner += [each.name for each in node.names if each.name != "bussim"]
    assert [each for each in inner if each.startswith("bussim")] == []


def keys_of(data: Any) -> Iterator[str]:
    """Every key of plain data, at any depth."""
    if isinstance(data, dict):
        for key, value in data.items():
            yield key
            yield from keys_of(value)
    elif isinstance(data, list):
        for value in data:
            yield from keys_of(value)


@cache
def vocabulary() -> frozenset[str]:
    """What a text may name: commands, scenarios, attributes and columns of results, keys, endings of files."""
    columns = {column for form in FORMS.values() for column in form.columns.kinds}
    summaries = [
        json.loads(path.read_text("utf-8")) for path in (Path(__file__).parent / "recorded").iterdir()
    ]
    scenarios = [yaml.safe_load(dumps(bussim.load(name))) for name in builtin.names()]
    keys = {*keys_of(summaries), *keys_of(scenarios), *ProfileIn.model_fields, *TurnaroundIn.model_fields}
    found = {*COMMANDS, *builtin.names(), *dir(Result), *columns, *keys, *_TROUBLE_KINDS, LOW, HIGH, NEEDED}
    return frozenset(found | {".sr", ".pcapng"})


def names_in(code: str) -> set[str]:
    """The names, attributes and texts of a notebook's code, which runs in the slow pass."""
    nodes = list(ast.walk(ast.parse(code)))
    texts = {str(node.value) for node in nodes if isinstance(node, ast.Constant)}
    return texts | {node.id for node in nodes if isinstance(node, ast.Name)}


def check_command(line: str) -> None:
    """Assert that a command line names a command, and options of it."""
    _, name, *words = line.split()
    assert name in COMMANDS, line
    command = cli.get_command(click.Context(cli), name)
    assert command is not None
    options = {text for option in command.params for text in (*option.opts, *option.secondary_opts)}
    assert [word for word in words if word.startswith("-") and word not in options] == [], line


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_what_the_text_of_a_notebook_names_is_there(path: Path) -> None:
    cells = nbformat.read(path, as_version=4).cells
    code = names_in("\n".join(cell.source for cell in cells if cell.cell_type == "code"))
    for cell in cells:
        for named in re.findall(r"`([^`]+)`", cell.source) if cell.cell_type == "markdown" else ():
            if named.startswith("bussim "):
                check_command(named)
            else:
                known = named.partition(":")[0] if ": " in named or named.endswith(":") else named
                assert known in vocabulary() | code, f"`{named}` is nothing that there is"

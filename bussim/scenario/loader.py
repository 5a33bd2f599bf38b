"""From a file, a text or plain data to a :class:`Scenario`, or to every mistake in it."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO

from bussim.errors import Problem, ScenarioError, UsageError
from bussim.files import kind_of
from bussim.scenario import builtin
from bussim.scenario.model import Scenario
from bussim.scenario.yaml import parser as yaml
from bussim.scenario.yaml.files import Files, GivenFiles
from bussim.scenario.yaml.overrides import Override, apply_overrides
from bussim.scenario.yaml.plain import copied
from bussim.scenario.yaml.source_map import Report, SourceMap
from bussim.scenario.yaml.user_code import Code
from bussim.wording import nearest
from bussim.words.language import say
from bussim.words.tables import recognised

#: Values set from outside of the file: ``key.path=value``, or an Override with a label of its own.
Overrides = Iterable[str | Override]


@dataclass(frozen=True, slots=True)
class Examined:
    """A scenario, or all of its mistakes; a scenario's warnings. Problems are in file order."""

    scenario: Scenario | None
    errors: tuple[Problem, ...]
    warnings: tuple[Problem, ...]

    def get(self) -> Scenario:
        """The scenario. Raises ScenarioError with every mistake."""
        if self.scenario is None:
            raise ScenarioError(self.errors)
        return self.scenario


def load(path: str | os.PathLike[str], overrides: Overrides = (), *, allow_code: bool = False) -> Scenario:
    """The scenario in a file, or the built-in one of that name if there is no such file.

    ``overrides`` are texts ``key.path=value``. Functions of the user that a scenario names are loaded
    only with ``allow_code``, from the scenario's folder, the current one, or where Python finds its
    own; programs and tables that it names lie in its folder (a text's: in the current one). Raises
    ScenarioError with every mistake, and UsageError for an override whose path leads nowhere.
    """
    return examine(path, overrides, allow_code=allow_code).get()


def loads(
    text: str, name: str = "<string>", overrides: Overrides = (), *, allow_code: bool = False
) -> Scenario:
    """The scenario in a text; ``name`` stands for the file in messages. Raises as :func:`load`."""
    return _check(*yaml.read(text, name), overrides, Code(allowed=allow_code)).get()


def from_data(
    data: Mapping[str, object],
    overrides: Overrides = (),
    name: str = "<data>",
    *,
    allow_code: bool = False,
    folder: Path | None = None,
) -> Scenario:
    """The scenario in plain data as a YAML file would give them. Raises as :func:`load`.

    ``folder`` is where the user's functions are looked for first.
    """
    plain = copied(data, name)
    return _check(
        plain, SourceMap(name, data=plain), [], overrides, Code(allowed=allow_code, folder=folder)
    ).get()


def examine(
    path: str | os.PathLike[str],
    overrides: Overrides = (),
    *,
    allow_code: bool = False,
    source: BinaryIO | None = None,
) -> Examined:
    """Like :func:`load`, but mistakes are returned, and warnings with their positions.

    ``source`` is read in place of a file, and ``path`` is its name in messages.
    """
    file, shown = builtin.locate(os.fspath(path)) if source is None else (Path(), os.fspath(path))
    try:
        raw = _bytes(file, shown) if source is None else source.read(yaml.MAX_BYTES + 1)
    except ScenarioError as error:
        return Examined(None, error.problems, ())
    code = Code(allowed=allow_code, folder=file.parent)
    return _check(*yaml.read(raw, shown), overrides, code, Files(file.parent))


def examine_text(text: str, *, name: str = "<string>", files: Mapping[str, bytes] | None = None) -> Examined:
    """Like :func:`examine` for a text, from which nothing in the user's folders is read.

    ``name`` stands for the file in messages. Programs and tables that the text names are those of ``files``,
    by the names that the text has for them, and those that come with bussim.
    """
    return _check(*yaml.read(text, name), (), Code(), GivenFiles(files or {}))


def _bytes(path: Path, shown: str) -> bytes:
    try:
        mode = path.stat().st_mode
        if not stat.S_ISREG(mode):  # reading a pipe would wait
            message = say("file_no_scenario", kind=recognised(kind_of(mode), "file_kind_of_"))
        else:
            with path.open("rb") as file:
                return file.read(yaml.MAX_BYTES + 1)
    except FileNotFoundError:
        message = _missing(path, shown)
    except OSError as error:
        message = say("file_cannot", strerror=error.strerror or type(error).__name__)
    except ValueError:
        message = say("file_no_path")
    raise ScenarioError([Problem(shown, 0, 0, message)])


def _missing(path: Path, shown: str) -> str:
    if path.name != shown:
        return say("file_none")  # a built-in scenario has no folder
    near = nearest(shown.removesuffix(".yaml"), builtin.names())
    hint = say("form_mean", near=near) if near else say("file_lists")
    return say("file_no_builtin", hint=hint)


def _check(
    data: object,
    source_map: SourceMap,
    problems: list[Problem],
    overrides: Overrides,
    code: Code | None = None,
    files: Files | None = None,
) -> Examined:
    report = Report(source_map, problems)
    if data is None:
        empty = Problem(source_map.file, 0, 0, say("file_empty"))
        return Examined(None, tuple(sorted(problems)) or (empty,), ())
    # Here, because pydantic costs a tenth of a second that only a readable file should pay.
    from bussim.scenario.build.scenario import build
    from bussim.scenario.resolve.scenario import resolve
    from bussim.scenario.rules.cross_checks import check_rules
    from bussim.scenario.schema.draft import read_draft

    data = apply_overrides(data, source_map, overrides)
    draft = read_draft(data, report)
    resolved = resolve(draft, code or Code(), files or Files(None), report)
    check_rules(resolved, report)
    labels = set(source_map.labels.values())
    for problem in report.unknown:
        if problem.file in labels:  # the request is wrong, not the file
            raise UsageError(say("edit_problem", label=problem.file, what=problem.message))
    if report.errors:
        # A warning beside a mistake may be no more than its consequence.
        return Examined(None, tuple(sorted(report.errors)), ())
    scenario = build(resolved)
    if scenario.latency:
        from bussim.scenario.signals.paths import signal_paths  # what only a scenario with latencies pays

        for entry, path in zip(draft.latency, signal_paths(scenario), strict=True):
            if path.unmeasured:
                report.warn((*entry.path, "to"), path.unmeasured)
    # Without their positions, two may be the same.
    said = (report.plain.get(each, each.message) for each in report.warnings)
    carried = (each.text for each in scenario.carried)
    warnings = tuple(dict.fromkeys(text for text in (*carried, *said) if text))
    scenario = replace(scenario, warnings=warnings)
    return Examined(scenario, (), tuple(sorted(report.warnings)))

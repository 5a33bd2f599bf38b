"""One run of a sweep as a task for any process on any machine."""

import time
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, NamedTuple

from bussim.errors import UsageError
from bussim.scenario.loader import Examined, _check
from bussim.scenario.model import Scenario
from bussim.scenario.yaml import parser as yaml
from bussim.scenario.yaml.files import Files
from bussim.scenario.yaml.overrides import Override
from bussim.scenario.yaml.source_map import SourceMap
from bussim.scenario.yaml.user_code import Code
from bussim.sweep.figures import Number, figures_of
from bussim.version import __version__


class Template:
    """The text of a scenario, with ``name`` for messages, and the files and functions that it names.

    Reading YAML takes most of the time of loading; a sweep does it once a process.
    """

    def __init__(self, text: str, name: str, files: Files | None = None, code: Code | None = None) -> None:
        self._files = files
        self._code = code
        self._data, self._source_map, self._problems = yaml.read(text, name)

    def examine(self, overrides: Iterable[Override]) -> Examined:
        """The scenario with values set, or every mistake in it.

        Raises UsageError for an override whose path leads nowhere, or that another one replaces.
        """
        given = list(overrides)
        source_map = self._copy_of_source_map()
        examined = _check(
            _copied(self._data), source_map, list(self._problems), given, self._code, self._files
        )
        left = set(source_map.labels.values())
        lost = [override for override in given if override.label not in left]
        if lost:
            raise UsageError(f"{lost[0].label}: another option sets the same value")
        return examined

    def _copy_of_source_map(self) -> SourceMap:
        known = self._source_map
        return SourceMap(
            known.file, dict(known.keys), dict(known.values), {}, dict(known.blocks), data=known.data
        )


def _copied(data: Any) -> Any:
    """The same values in new dicts and lists (numbers keep the text that they had in the file)."""
    if isinstance(data, dict):
        return {key: _copied(value) for key, value in data.items()}
    if isinstance(data, list):
        return [_copied(value) for value in data]
    return data


@dataclass(frozen=True, slots=True)
class Job:
    """A run: the scenario's ``text`` and ``name``, what is set in it, and the seed (None: its own).

    It carries all that it needs, so that the process that runs it needs no file: ``files`` are those
    that the scenario names, with their texts. Only the user's functions have to be where it runs:
    ``code`` are the folders to look in (None: there must be none). ``version`` is that of the bussim
    which asks for it.
    """

    run: int
    text: str
    name: str
    overrides: tuple[Override, ...]
    seed: int | None
    version: str = __version__
    files: tuple[tuple[str, str], ...] = ()
    code: tuple[str, ...] | None = None


class Outcome(NamedTuple):
    """What became of a job: its figures, or why it failed."""

    run: int
    figures: dict[str, Number | None] | None
    error: str = ""


def run_job(job: Job) -> Outcome:
    """Simulate. An exception becomes part of the outcome, so that it is not taken for a lost worker."""
    from bussim import api

    if job.version != __version__:
        error = f"the worker has bussim {__version__}, the sweep is made by {job.version}; install the same"
        return Outcome(job.run, None, error)
    try:
        scenario = _scenario_of(job)
        summary = api.run(scenario, rows=False).summary
        return Outcome(job.run, figures_of(summary, masters_of(scenario)))
    except (Exception, SystemExit) as error:
        return Outcome(job.run, None, f"{type(error).__name__}: {error}")


class _EnoughError(Exception):
    """A run was simulated long enough to tell its cost."""


def cost_of(job: Job, patience: float) -> float:
    """About how many seconds of a processor each simulated tick takes; 0 where the run fails.

    The run is ended after ``patience`` seconds of a processor.
    """
    from bussim import api

    begun, ticks = time.process_time(), 1

    def watch(done: int, _: int) -> None:
        nonlocal ticks
        ticks = max(done, 1)
        if time.process_time() - begun > patience:
            raise _EnoughError

    try:
        scenario = _scenario_of(job)
        api.run(scenario, rows=False, progress=watch)
        ticks = scenario.duration
    except _EnoughError:
        pass
    except (Exception, SystemExit):
        return 0.0
    return (time.process_time() - begun) / ticks


def _scenario_of(job: Job) -> Scenario:
    scenario = _scenario(job.text, job.name, job.files, job.code, job.overrides)
    return scenario if job.seed is None else replace(scenario, seed=job.seed)


def masters_of(scenario: Scenario) -> dict[str, str]:
    """By bus, the first PLC with station number 0."""
    found: dict[str, str] = {}
    for plc in scenario.plcs:
        if plc.link is not None and plc.registers.get("D8176", 0) == 0:
            found.setdefault(plc.link.bus, plc.name)
    return found


# The repeats of a point follow each other, and mostly meet the same process.
@lru_cache(maxsize=8)
def _scenario(
    text: str,
    name: str,
    files: tuple[tuple[str, str], ...],
    code: tuple[str, ...] | None,
    overrides: tuple[Override, ...],
) -> Scenario:
    return _template(text, name, files, code).examine(overrides).get()


@lru_cache(maxsize=2)
def _template(
    text: str, name: str, files: tuple[tuple[str, str], ...], code: tuple[str, ...] | None
) -> Template:
    return Template(text, name, Files(None, dict(files)), Code(allowed=code is not None, folders=code or ()))

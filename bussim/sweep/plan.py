"""What a sweep is to run: the points, their runs and seeds, all of it checked before anything runs."""

import json
import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from hashlib import blake2b
from typing import Any

from bussim.errors import Problem, ScenarioError, UsageError
from bussim.scenario import builtin, loader
from bussim.scenario.yaml.files import Files
from bussim.scenario.yaml.overrides import Override
from bussim.scenario.yaml.user_code import Code
from bussim.sweep.identity import SCHEMA
from bussim.sweep.jobs import Job, Template
from bussim.sweep.vary import Axis, Point, grid, parse_axes
from bussim.version import __version__
from bussim.wording import counted, shorten

#: Most messages about bad points, and most points named in one of them.
_MOST_MESSAGES = 100
_MOST_POINTS = 20


class Plan:
    """A scenario, what varies in it, and how often each point is run.

    ``source`` is a file or a built-in scenario, ``sets`` what is set in it at every point. The
    scenario must be good by itself; :meth:`check` is for every point.

    Runs have numbers from 0: all repeats of the first point, then those of the second. Repeats are
    counted from 1. Where ``seed`` itself is varied, runs have these seeds and cannot be repeated.

    Raises ScenarioError for mistakes in the scenario, UsageError for those in ``vary`` (texts
    ``key.path=…``), ``sets`` and ``repeat``.
    """

    def __init__(
        self,
        source: str | os.PathLike[str],
        vary: Iterable[str],
        *,
        sets: Sequence[str | Override] = (),
        repeat: int = 1,
        common_random_numbers: bool = False,
        allow_code: bool = False,
    ) -> None:
        self.sets = tuple(Override.parse(each) if isinstance(each, str) else each for each in sets)
        self.axes = parse_axes(vary, [override.key for override in self.sets])
        self.points = grid(self.axes, repeat)
        self.repeat = repeat
        self.common_random_numbers = common_random_numbers
        self._own_seeds = any(axis.key == "seed" for axis in self.axes)
        if self._own_seeds and repeat > 1:
            raise UsageError(
                "--vary seed and --repeat exclude each other: with --repeat every run has a seed of its own"
            )
        self.base = loader.load(source, self.sets, allow_code=allow_code)
        path, self.name = builtin.locate(os.fspath(source))
        self._text = path.read_text(encoding="utf-8-sig")
        self._files = Files(path.parent)
        self._code = Code(allowed=allow_code, folder=path.parent)
        self._template = Template(self._text, self.name, self._files, self._code)
        self._template.examine(self.sets)  # reads the files and functions that the scenario names
        self._check_keys()

    @property
    def runs(self) -> int:
        """How many runs there are."""
        return len(self.points) * self.repeat

    @property
    def title(self) -> str:
        """The scenario's name."""
        return self.base.name

    def point_of(self, run: int) -> tuple[int, int]:
        """The point (from 0) and the repeat (from 1) of a run."""
        point, repeat = divmod(run, self.repeat)
        return point, repeat + 1

    def seed(self, run: int) -> int | None:
        """The seed of a run, None where the point itself sets it."""
        if self._own_seeds:
            return None
        point, repeat = self.point_of(run)
        return run_seed(
            self.base.seed,
            self.axes,
            self.points[point],
            repeat,
            common_random_numbers=self.common_random_numbers,
        )

    def job(self, run: int) -> Job:
        """The task of a run."""
        point, _ = self.point_of(run)
        return Job(
            run,
            self._text,
            self.name,
            self._overrides(self.points[point]),
            self.seed(run),
            files=tuple(sorted(self._files.texts.items())),
            code=self._code.folders if self._code.allowed else None,
        )

    def _source(self) -> Any:
        """The scenario in its canonical form, and the contents of the files and modules that it names."""
        data = dict(self.base.source)
        if self._files.texts:
            data["files"] = dict(sorted(self._files.texts.items()))
        if code := self._code.texts():
            data["code"] = code
        return data

    def in_words(self, run: int) -> str:
        """A run, for messages."""
        point, repeat = self.point_of(run)
        return f"{_at(self.axes, self.points[point])}, repeat {repeat}"

    def manifest(self) -> dict[str, Any]:
        """What makes this sweep this one: the content of ``sweep.json``."""
        return {
            "schema": SCHEMA,
            "bussim": __version__,
            "scenario": self.title,
            "vary": [
                {"key": axis.key, "column": axis.column, "values": [v.canonical for v in axis.values]}
                for axis in self.axes
            ],
            "repeat": self.repeat,
            "same_luck": self.common_random_numbers,
            "points": len(self.points),
            "runs": self.runs,
            "source": self._source(),
        }

    def check(self, progress: Callable[[int, int], None] | None = None) -> int:
        """Examine the scenario of every point, and return the ticks to simulate in all.

        Raises ScenarioError that names all bad points.
        """
        found: dict[Problem, list[Point]] = {}
        ticks = 0
        for number, point in enumerate(self.points, 1):
            examined = self._template.examine(self._overrides(point))
            ticks += self.repeat * examined.scenario.duration if examined.scenario else 0
            for problem in examined.errors:
                found.setdefault(problem, []).append(point)
            if progress is not None:
                progress(number, len(self.points))
        if found:
            raise ScenarioError(self._explained(found))
        return ticks

    def _check_keys(self) -> None:
        """Every key must lead somewhere. Raises UsageError that names all that do not."""
        wrong = []
        for axis in self.axes:
            try:
                self._template.examine([*self.sets, axis.override(axis.values[0], as_given=True)])
            except UsageError as error:
                wrong.append(str(error))
        if wrong:
            raise UsageError("\n".join(wrong))

    def _overrides(self, point: Point) -> tuple[Override, ...]:
        return self.sets + tuple(axis.override(value) for axis, value in zip(self.axes, point, strict=True))

    def _explained(self, found: dict[Problem, list[Point]]) -> list[Problem]:
        """The problems, with the points at which they occur where their own text does not."""
        explained = []
        for problem, points in found.items():
            if self._said(problem, points):
                explained.append(problem)
                continue
            if len(points) == len(self.points):
                where = "at every point"
            else:
                where = " / ".join(_at(self.axes, point) for point in points[:_MOST_POINTS])
                more = len(points) - _MOST_POINTS
                where = f"at {where}" + (f" and {counted(more, 'more point')}" if more > 0 else "")
            explained.append(replace(problem, message=f"{problem.message} ({where})"))
        if len(explained) > _MOST_MESSAGES:
            more = len(explained) - _MOST_MESSAGES
            explained = sorted(explained)[:_MOST_MESSAGES]
            explained.append(Problem("…", 0, 0, f"and {counted(more, 'more mistake')}"))
        return explained

    def _said(self, problem: Problem, points: list[Point]) -> bool:
        """Whether a problem occurs at exactly the points with the value that its label names."""
        for index, axis in enumerate(self.axes):
            for value in axis.values:
                if axis.override(value).label == problem.file:
                    return len(points) * len(axis.values) == len(self.points) and all(
                        point[index] == value for point in points
                    )
        return False


def _at(axes: Sequence[Axis], point: Point) -> str:
    return ", ".join(f"{axis.key}={shorten(value.text)}" for axis, value in zip(axes, point, strict=True))


# 48 bits: spreadsheets keep 15 digits of a number, and a seed is there to be copied from one.
_BYTES = 6


def run_seed(
    base: int, axes: Sequence[Axis], point: Point, repeat: int, *, common_random_numbers: bool
) -> int:
    """The seed (0 <= seed < 2**48) of a repeat (from 1) at a point, of the scenario's seed ``base``.

    It depends on nothing else: not on the process, the number of workers, the order of the runs or
    the other points of the grid, so that a finer or longer sweep repeats the runs of a coarser one.
    Seeds of different points and repeats are independent, as far as a cryptographic hash is.

    With ``common_random_numbers`` the point is left out: every point has the same seeds. Then the
    difference between two points has a smaller variance than with independent seeds, since
    both meet the same noise; the points' own confidence intervals are valid one by one, but their
    errors are no longer independent of each other.
    """
    at = sorted([axis.key, value.same] for axis, value in zip(axes, point, strict=True))
    text = json.dumps([base, [] if common_random_numbers else at, repeat], allow_nan=False)
    return int.from_bytes(blake2b(text.encode("ascii"), digest_size=_BYTES).digest(), "big")

"""What a sweep gave, for Python and for the command line."""

from __future__ import annotations

from dataclasses import asdict
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bussim.sweep.intervals import Mean
from bussim.sweep.plan import Plan
from bussim.sweep.tables import LOW, POINTS, RUNS, Table, at_point, axis_cell, mean_at, read_csv
from bussim.version import __version__
from bussim.wording import counted

if TYPE_CHECKING:
    import pandas as pd


class SweepResult:
    """A whole sweep in its folder.

    ``already_there`` is how many of its runs were not made now but before.
    """

    def __init__(self, plan: Plan, folder: Path, *, already_there: int) -> None:
        self.plan = plan
        self.folder = folder
        self.already_there = already_there

    @cached_property
    def runs(self) -> pd.DataFrame:
        """One row a run: run, point, the varied keys, repeat, seed, and its figures."""
        return _frame(self._runs)

    @cached_property
    def points(self) -> pd.DataFrame:
        """One row a point: point, the varied keys, runs, and X, X_low, X_high, X_needed for each figure X.

        The mean over its runs, the limits of the 95 % confidence interval, and how many runs put these
        within 10 % of the mean: more than there are says that these are too few.
        """
        return _frame(self._points)

    @cached_property
    def _runs(self) -> Table:
        axes = [axis.column for axis in self.plan.axes]
        head = list(dict.fromkeys(("run", "point", *axes, "repeat", "seed")))  # the seed may be varied
        return read_csv(self.folder / RUNS, head, self.plan.runs)

    @cached_property
    def _points(self) -> Table:
        head = ["point", *(axis.column for axis in self.plan.axes), "runs"]
        return read_csv(self.folder / POINTS, head, len(self.plan.points))

    @property
    def figures(self) -> list[str]:
        """The names of all figures, such as ``link.scan_time_mean_ms``."""
        return [name.removesuffix(LOW) for name in self._points if name.endswith(LOW)]

    def mean(self, figure: str, point: int) -> Mean:
        """The mean of a figure at a point (from 0) with its confidence interval."""
        return mean_at(self._points, figure, point)

    def values(self, figure: str, point: int) -> list[float | None]:
        """What each run at a point (from 0) gave of a figure."""
        return list(at_point(self.plan, self._runs.get(figure, []), point))

    @property
    def summary(self) -> dict[str, Any]:
        """Everything about the points as plain data, what ``bussim sweep --json`` prints."""
        plan = self.plan
        return {
            "schema": 1,
            "bussim": __version__,
            "scenario": plan.title,
            "folder": str(self.folder),
            "vary": [
                {"key": axis.key, "column": axis.column, "values": [axis_cell(axis, v) for v in axis.values]}
                for axis in plan.axes
            ],
            "repeat": plan.repeat,
            "same_luck": plan.common_random_numbers,
            "runs": plan.runs,
            "points": [
                {
                    "at": {a.key: axis_cell(a, v) for a, v in zip(plan.axes, at, strict=True)},
                    "figures": {name: asdict(self.mean(name, number)) for name in self.figures},
                }
                for number, at in enumerate(plan.points)
            ],
        }

    def __repr__(self) -> str:
        keys = ", ".join(axis.key for axis in self.plan.axes)
        size = f"{counted(len(self.plan.points), 'point')}, {counted(self.plan.runs, 'run')}"
        return f"<SweepResult of {self.plan.title!r} over {keys}: {size} in {self.folder}>"


def _frame(table: Table) -> pd.DataFrame:
    import pandas as pd

    # A column without a single number is one of numbers all the same.
    return pd.DataFrame(
        {
            name: pd.Series(values, dtype="float64" if set(map(type, values)) == {type(None)} else None)
            for name, values in table.items()
        }
    )

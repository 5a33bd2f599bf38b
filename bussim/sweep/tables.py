"""The tables of a sweep: one row a run, and one row a point with means and confidence intervals."""

import csv
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from bussim.errors import UsageError
from bussim.files import plain
from bussim.results.store.safe_names import cell, from_cell
from bussim.results.store.tables import import_pyarrow
from bussim.sweep.figures import Number, in_order, is_event_count, rare_count_of
from bussim.sweep.intervals import Mean, mean_of
from bussim.sweep.plan import Plan
from bussim.sweep.vary import Axis, Value
from bussim.wording import counted

RUNS, POINTS, RUNS_PARQUET = "runs.csv", "points.csv", "runs.parquet"

Cell = Number | str | None
#: Columns by name, all of the same length.
Table = dict[str, list[Cell]]

#: What is added to a figure's name for the limits of its confidence interval, and for how many repeats it
#: takes to know it within 10 %.
LOW, HIGH, NEEDED = "_low", "_high", "_needed"


def runs_table(plan: Plan, entries: Iterable[tuple[int, Mapping[str, Number | None]]]) -> Table:
    """One row a run, in the order of their numbers, whatever the order of ``entries``.

    Columns: run, point and repeat (all from 1), the varied keys (times with their unit behind the
    name), seed, and the figures of :func:`bussim.sweep.figures.figures_of`. A figure that a run
    does not have is None; so are quantiles that it has too few scans for.
    """
    figures: Table = {}
    for run, row in entries:
        for name, value in row.items():
            if name not in figures:
                figures[name] = [None] * plan.runs
            figures[name][run] = value
    _count_what_did_not_occur(figures)
    axes = [axis.column for axis in plan.axes]
    table: Table = {name: [] for name in ("run", "point", *axes, "repeat", "seed")}
    for run in range(plan.runs):
        point, repeat = plan.point_of(run)
        numbers = {"run": run + 1, "point": point + 1, "repeat": repeat, "seed": plan.seed(run)}
        for name, cell_ in {**numbers, **_at(plan, point)}.items():
            table[name].append(cell_)
    buses = [bus.name for bus in plan.base.buses]
    return table | {name: figures[name] for name in in_order(figures, buses)}


def _count_what_did_not_occur(figures: Table) -> None:
    """Put 0 for a code that did not occur in a run, which is not in its summary."""
    whose = {name: owner for name in figures if (owner := rare_count_of(name)) is not None}
    for owner in set(whose.values()):
        others = [column for name, column in figures.items() if name.startswith(f"{owner}.")]
        was_there = [any(value is not None for value in row) for row in zip(*others, strict=True)]
        for name in whose:
            if whose[name] == owner:
                column = figures[name]
                column[:] = [0 if v is None and t else v for v, t in zip(column, was_there, strict=True)]


def points_table(plan: Plan, runs: Table) -> Table:
    """One row a point: point, the varied keys, runs, and for each figure mean, low, high and needed.

    ``X`` is the mean of the figure X over the point's runs, ``X_low`` and ``X_high`` are the limits
    of its 95 % confidence interval, ``X_needed`` is how many runs would put these within 10 % of the mean,
    see :func:`bussim.sweep.intervals.mean_of`.
    """
    count = len(plan.points)
    table: Table = {"point": list(range(1, count + 1))}
    for axis in plan.axes:
        table[axis.column] = [_at(plan, point)[axis.column] for point in range(count)]
    table["runs"] = [plan.repeat] * count
    for name in figure_names(runs, plan):
        column = runs[name]
        events = is_event_count(name)
        means = [mean_of(at_point(plan, column, point), events=events) for point in range(count)]
        table[name] = [each.mean for each in means]
        table[name + LOW] = [each.low for each in means]
        table[name + HIGH] = [each.high for each in means]
        table[name + NEEDED] = [each.needed for each in means]
    return table


def at_point(plan: Plan, column: Sequence[Cell], point: int) -> list[Number | None]:
    """What the repeats of a point (from 0) gave of a figure, of its column in the runs' table."""
    values = column[point * plan.repeat : (point + 1) * plan.repeat]
    return [value for value in values if not isinstance(value, str)]


def mean_at(points: Table, figure: str, point: int) -> Mean:
    """The mean of a figure at a point (from 0); a table of an earlier version has no ``X_needed``."""
    columns = (points.get(figure + ending) for ending in ("", LOW, HIGH, NEEDED))
    return Mean(*(None if column is None else column[point] for column in columns))  # type: ignore[arg-type] # numbers


def figure_names(runs: Table, plan: Plan) -> list[str]:
    """The columns of the runs' table that are figures."""
    others = {"run", "point", "repeat", "seed", *(axis.column for axis in plan.axes)}
    return [name for name in runs if name not in others]


def axis_cell(axis: Axis, value: Value) -> Cell:
    """A value of an axis in tables: its number where the axis has numbers or times, else its text."""
    return value.number if axis.unit is not None else value.text


def _at(plan: Plan, point: int) -> dict[str, Cell]:
    pairs = zip(plan.axes, plan.points[point], strict=True)
    return {axis.column: axis_cell(axis, value) for axis, value in pairs}


def write_csv(path: Path, table: Table) -> None:
    """Write a table as CSV after RFC 4180: a header, a comma, a decimal point, CR LF."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow([cell(name) for name in table])
        for row in zip(*table.values(), strict=True):
            writer.writerow([cell(value) if isinstance(value, str) else value for value in row])


def read_csv(path: Path, head: Sequence[str], rows: int) -> Table:
    """The table of :func:`write_csv` with its number of rows, whose first columns are ``head``.

    The first of them counts the rows from 1; behind them are figures. Raises UsageError if the table is not
    there or is another one, as what a spreadsheet saves may be.
    """
    try:
        with plain(path).open(encoding="utf-8-sig", newline="") as file:
            return _checked(file.read(), head, rows)
    except (OSError, ValueError, csv.Error) as error:
        raise UsageError(f"{path} cannot be read: {error}; --force runs the sweep again") from error


def _checked(text: str, head: Sequence[str], rows: int) -> Table:
    if not text.endswith(("\n", "\r")):
        raise ValueError("its last line is cut off")
    cells = list(csv.reader(io.StringIO(text, newline="")))
    names = list(map(from_cell, cells[0])) if cells else []
    if names[: len(head)] != [*head]:
        raise ValueError(f"its columns begin with {names[: len(head)]}, not with {[*head]}")
    for number, row in enumerate(cells, 1):
        if len(row) != len(names):
            raise ValueError(f"row {number} has {counted(len(row), 'column')}, its heading {len(names)}")
    table: Table = {
        name: list(map(_parsed, column))
        for name, column in zip(names, zip(*cells[1:], strict=True), strict=bool(cells[1:]))
    }
    if table.get(head[0], []) != list(range(1, rows + 1)):
        raise ValueError(f"its column {head[0]} does not count {rows} rows")
    for name in names[len(head) :]:
        for value in table[name]:
            if isinstance(value, str) or not math.isfinite(value or 0):
                raise ValueError(f"its column {name} has {value!r}, no number")
    return table


def _parsed(text: str) -> Cell:
    if not text:
        return None
    for kind in (int, float) if "_" not in text else ():  # Python would read 1_0 as a number
        try:
            return kind(text)
        except ValueError:
            continue
    return from_cell(text)


def write_parquet(path: Path, table: Table) -> bool:
    """Write a table as Parquet, unless pyarrow is not installed: then False, and no file."""
    try:
        pyarrow, parquet = import_pyarrow()
    except UsageError:
        return False
    arrays = {name: pyarrow.array(values, type=_type(values, pyarrow)) for name, values in table.items()}
    with path.open("wb") as file:  # pyarrow opens no path that is no text
        parquet.write_table(pyarrow.table(arrays), file)
    return True


def _type(values: list[Cell], pyarrow: object) -> object:
    kinds = {type(value) for value in values if value is not None}
    if str in kinds:
        return pyarrow.string()  # type: ignore[attr-defined] # pyarrow has no types
    return pyarrow.int64() if kinds == {int} else pyarrow.float64()  # type: ignore[attr-defined] # the same

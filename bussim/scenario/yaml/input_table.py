"""Tables of times that drive an input: CSV, with a comma, a semicolon or a tab between the columns.

Seconds in the first column, rising. Alone, each one is a change of the level, which is off before the
first. With a second column, 0 or 1, each row sets the level; one that sets what is there changes nothing.
Empty lines and lines that begin with # are left out; the first other line may be a heading.
"""

import re
from fractions import Fraction

from bussim.errors import Problem
from bussim.scenario.yaml.source_map import Path, Report
from bussim.units import TICKS_PER_SECOND, round_half_up
from bussim.words.language import say
from bussim.words.values import show

_SECONDS = re.compile(r"[+]?([0-9]{1,9}(\.[0-9]{0,12})?|\.[0-9]{1,12})([eE][+-]?[0-9]{1,2})?", re.ASCII)
#: Changes that a table may have, or ``times`` in a scenario.
MAX_TIMES = 10_000
#: Mistakes of one table that are reported.
_MOST_PROBLEMS = 20


def read_times(text: str, file: str, path: Path, report: Report) -> tuple[int, ...] | None:
    """The ticks at which the level changes; None where the table has mistakes, which are reported.

    ``path`` is the key that names the file.
    """
    table = _Table()
    for number, line in enumerate(text.splitlines(), 1):
        cells = [cell.strip().strip('"').strip() for cell in _cells(line)]
        if not any(cells) or cells[0].startswith("#"):
            continue
        table.row(number, cells)
        if len(table.problems) >= _MOST_PROBLEMS or table.full:
            break
    for line_number, message in table.problems or table.lacking():
        named = report.source_map.full_name(path)
        report.add(Problem(file, line_number, 1, message, named), fatal=True)
    return None if table.problems or not table.changes else tuple(table.changes)


def _cells(line: str) -> list[str]:
    # A table with semicolons may have decimal commas, which are reported.
    mark = next((mark for mark in ";\t," if mark in line), ",")
    return line.split(mark)


def _is_heading(cells: list[str]) -> bool:
    """Every cell begins with a letter and is no number: nan and inf are (wrong) numbers."""
    return all(cell[:1].isalpha() and not _is_number(cell) for cell in cells) and not re.search(
        r"\d", cells[0]
    )


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


class _Table:
    def __init__(self) -> None:
        self.columns = 0  # 0: no row yet
        self.changes: list[int] = []
        self.problems: list[tuple[int, str]] = []
        self.full = False
        self._first = 0  # the line of the heading, then of the first row
        self._last: int | None = None
        self._level = 0

    def row(self, number: int, cells: list[str]) -> None:
        heading = not self.columns and _is_heading(cells)
        if not self.columns:
            self.columns, self._first = len(cells), number
        if self._misshapen(number, cells) or heading:
            return
        tick = self._tick(number, cells[0])
        if len(cells) == 2 and cells[1] not in ("0", "1"):
            self._wrong(number, say("table_level", found=show(cells[1]) if cells[1] else say("table_empty")))
            return
        if tick is None:
            return
        self._last = tick
        level = int(cells[1]) if len(cells) == 2 else 1 - self._level
        if level == self._level:
            return
        self._level = level
        self.full = len(self.changes) == MAX_TIMES
        if self.full:
            self._wrong(number, say("table_changes", max_times=MAX_TIMES))
        else:
            self.changes.append(tick)

    def lacking(self) -> list[tuple[int, str]]:
        """What is wrong with a table that was read without a mistake and has no changes."""
        if self.changes:
            return []
        if not self.columns:
            return [(1, say("table_no_times"))]
        if self._last is None:
            return [(self._first, say("table_only_heading"))]
        return [(self._first, say("table_no_changes"))]

    def _wrong(self, number: int, message: str) -> None:
        self.problems.append((number, message))

    def _misshapen(self, number: int, cells: list[str]) -> bool:
        if len(cells) > 2:
            self._wrong(number, say("table_columns", cells=len(cells)))
        elif len(cells) != self.columns and self.columns <= 2:
            one, other = (
                (say("table_a_level"), "without") if len(cells) == 2 else (say("table_a_no_level"), "with")
            )
            self._wrong(number, say("table_differs", one=one, first=self._first, other=other))
        else:
            return False
        return True

    def _tick(self, number: int, cell: str) -> int | None:
        if not cell:
            self._wrong(number, say("table_time_empty"))
        elif _SECONDS.fullmatch(cell) is None:
            point = cell.replace(",", ".")
            hint = say("table_write", point=point) if point != cell and _SECONDS.fullmatch(point) else ""
            self._wrong(number, say("table_time", cell=show(cell), hint=hint))
        else:
            tick = round_half_up(Fraction(cell) * TICKS_PER_SECOND)
            if self._last is None or tick > self._last:
                return tick
            self._wrong(number, say("table_later", cell=cell))
        return None

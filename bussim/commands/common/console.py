"""Where commands print their tables, and how these look."""

from collections.abc import Iterable

from rich.console import Console
from rich.table import Table
from rich.text import Text

from bussim.words.language import shown

#: Columns of output that goes to no terminal, and so is cut by none.
_WIDE = 120


def wide_console() -> Console:
    """Standard output: as wide as the terminal, or wide enough for every table in a file.

    A command prints text in a notebook too, where rich would show every line as a display of its own.
    """
    console = Console(soft_wrap=True, highlight=False)
    if console.is_terminal and not console.is_jupyter:
        return console
    return Console(soft_wrap=True, highlight=False, force_jupyter=False, force_terminal=False, width=_WIDE)


def print_line(console: Console, text: str, indent: int = 2, style: str = "") -> None:
    """Print a text in the language that is used, behind so many blanks."""
    console.print(Text(" " * indent + shown(text), style))


def plain_table(left: Iterable[str], right: Iterable[str] = (), *, title: str = "", gap: int = 2) -> Table:
    """A table without lines: headings of columns of text, then of columns of numbers.

    ``gap`` is the number of blanks on either side of a cell.
    """
    heading = Text(shown(title)) if title else None
    table = Table(title=heading, title_justify="left", box=None, pad_edge=False, padding=(0, gap))
    for name in left:
        table.add_column(Text(shown(name)))
    for name in right:
        table.add_column(Text(shown(name)), justify="right")
    return table


def named_values(rows: Iterable[tuple[str, str]]) -> Table:
    """A table of names, each with its text, without headings."""
    table = Table(show_header=False, box=None, pad_edge=False, padding=(0, 2))
    for name, text in rows:
        table.add_row(Text(shown(name)), Text(shown(text)))
    return table

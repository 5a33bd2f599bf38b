"""Where commands print their tables."""

from __future__ import annotations

from rich.console import Console

#: Columns of output that goes to no terminal, and so is cut by none.
_WIDE = 120


def wide_console() -> Console:
    """Standard output: as wide as the terminal, or wide enough for every table in a file."""
    console = Console(soft_wrap=True, highlight=False)
    return console if console.is_terminal else Console(soft_wrap=True, highlight=False, width=_WIDE)

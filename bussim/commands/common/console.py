"""Where commands print their tables."""

from __future__ import annotations

from rich.console import Console

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

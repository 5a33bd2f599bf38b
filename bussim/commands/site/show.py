"""What ``bussim site`` prints."""

from __future__ import annotations

from rich.console import Console
from rich.text import Text

from bussim.site.diagnosis.causes import MEANINGS
from bussim.site.diagnosis.diagnose import Diagnosis
from bussim.site.readout import Readout

#: Causes whose evidence is printed.
_SHOWN = 3


def _line(console: Console, text: str, indent: int = 2, style: str = "") -> None:
    console.print(Text(" " * indent + text, style))


def show_diagnosis(console: Console, readout: Readout, found: Diagnosis) -> None:
    """Print the likeliest causes with their evidence, and the next reading."""
    _line(console, "what is wrong", 0, "bold")
    if not found.causes:
        _line(console, "nothing in these readings points to a cause")
    for index, cause in enumerate(found.causes[:_SHOWN], 1):
        named = None if cause.station is None else readout.at(cause.station)
        at = named.label if named else "a station" if cause.station is None else f"station {cause.station}"
        style = "bold" if index == 1 else ""
        _line(
            console, f"{index}. {MEANINGS[cause.cause].format(at=at)} ({cause.score:.1f} points)", style=style
        )
        for why in cause.evidence:
            _line(console, why, 5)
    if found.close:
        names = ", ".join(one.cause.value.replace("_", " ") for one in (found.causes[0], *found.close))
        _line(console, f"these readings cannot tell apart: {names}")
    for text in found.next:
        _line(console, f"next: {text}")
    for note in readout.notes:
        _line(console, f"note: {note}")

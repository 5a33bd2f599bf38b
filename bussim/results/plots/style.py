"""The style of bussim's pictures, and how they are saved: the same bytes for the same run."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from bussim.errors import UsageError
from bussim.files import written_whole
from bussim.version import __version__

# The palette of Okabe and Ito, which colour-blind people can distinguish; yellow, too pale for
# lines, is left out.
_BLUE, _VERMILLION, _GREEN, _PURPLE = "#0072B2", "#D55E00", "#009E73", "#CC79A7"
_ORANGE, _SKY, _BLACK = "#E69F00", "#56B4E9", "#000000"
PALETTE = (_BLUE, _VERMILLION, _GREEN, _PURPLE, _ORANGE, _SKY, _BLACK)
GREY = "#6b6b6b"

# A thing has the same colour in every picture and in the report. Seven colours do not reach for one
# meaning each; within one picture they do.
SIMULATED = _BLUE  # what a run counted
DISTRIBUTION = _GREEN  # what the exact distribution says
FAULT = _ORANGE  # a fault acts
IN_ERROR = _VERMILLION  # a failed attempt, a damaged character, a station in error
LOST = _BLACK  # the master makes no link scan, or slaves do not receive it
#: Of runs on one axis, in order; the colours of faults and errors come last.
RUNS = (SIMULATED, _GREEN, _PURPLE, _SKY, _BLACK, _ORANGE, _VERMILLION)
#: Frames by their kind in the trace: polls and requests are purple, replies, responses and data sky blue.
FRAMES = {
    "data": _SKY,
    "poll": _PURPLE,
    "parameters": _GREEN,
    "request": _PURPLE,
    "response": _SKY,
    "exception": _ORANGE,
    "broadcast": _GREEN,
    "free": _SKY,
    "jabber": _BLACK,
}
#: What a latency is made of; none of the colours is the bound's.
PARTS_OF_LATENCY = {
    "scan": _BLUE,
    "turn": _PURPLE,
    "wire": _SKY,
    "destination": _ORANGE,
    "output": _VERMILLION,
}

_DPI = 150
_SOFTWARE = f"bussim {__version__}"
# Any, since the type of matplotlib's setting names differs between its versions.
_SETTINGS: Any = {
    "axes.axisbelow": True,
    "axes.edgecolor": GREY,
    "axes.formatter.useoffset": False,
    "axes.grid": True,
    "axes.labelsize": 10,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlelocation": "left",
    "axes.titlesize": 11,
    "figure.dpi": 100,
    "font.family": ["DejaVu Sans"],  # comes with matplotlib: the same picture everywhere
    "font.size": 9,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "legend.fontsize": 9,
    "legend.frameon": False,
    "svg.hashsalt": "bussim",
    "xtick.color": GREY,
    "xtick.labelcolor": "black",
    "ytick.color": GREY,
    "ytick.labelcolor": "black",
}


@contextmanager
def style() -> Iterator[None]:
    """The settings under which pictures are drawn and saved, whatever the user's own are."""
    with mpl.rc_context():
        mpl.rcdefaults()
        with mpl.rc_context(_SETTINGS):
            yield


class Picture(Figure):
    """A matplotlib figure that needs no pyplot and that a notebook shows by itself.

    ``title`` and ``description`` (scenario, seed, version) go into the metadata of its files.
    """

    title = ""
    description = ""

    def save(self, path: Path) -> Path:
        """Write the picture as PNG or SVG, after the path's ending, and return the path.

        Raises UsageError for another ending or a path that cannot be written.
        """
        kind = path.suffix.lower()
        if kind not in (".png", ".svg"):
            raise UsageError(f"{path} ends in {kind or 'nothing'}; allowed are .png and .svg")
        content = self._repr_png_() if kind == ".png" else self._svg()
        with written_whole(path) as part:
            part.write_bytes(content)
        return path

    def save_both(self, stem: Path) -> tuple[Path, Path]:
        """Write ``stem.png`` and ``stem.svg`` and return their paths; raises as :meth:`save`."""
        png, svg = (self.save(stem.with_name(stem.name + ending)) for ending in (".png", ".svg"))
        return png, svg

    def _repr_png_(self) -> bytes:
        return self._bytes(format="png", dpi=_DPI, metadata={"Software": _SOFTWARE, **self._about()})

    def _svg(self) -> bytes:
        return self._bytes(format="svg", metadata={"Creator": _SOFTWARE, "Date": None, **self._about()})

    def _about(self) -> dict[str, str]:
        return {"Title": self.title, "Description": self.description}

    def _bytes(self, **how: Any) -> bytes:
        buffer = io.BytesIO()
        with style():
            self.savefig(buffer, **how)
        return buffer.getvalue()


def new_picture(width: float, height: float, description: str) -> Picture:
    """An empty figure of so many inches; draw on it within :func:`style`."""
    picture = Picture(figsize=(width, height), layout="constrained")
    picture.description = description
    FigureCanvasAgg(picture)
    return picture


def legend_of_runs(labels: Sequence[str], texts: Sequence[str]) -> list[Line2D]:
    """A line for each of several runs, in its colour, and what the marks of all of them mean."""
    handles = [
        Line2D([], [], color=RUNS[number], linewidth=3, label=f"{shorten(label, 40)}: {text}")
        for number, (label, text) in enumerate(zip(labels, texts, strict=True))
    ]
    return [*handles, Line2D([], [], linestyle="", label="lines: mean solid, p99 dashed, maximum dotted")]


def too_many(runs: Sequence[object]) -> None:
    """Raise UsageError where there are more runs than colours."""
    if len(runs) > len(RUNS):
        raise UsageError(f"{len(runs)} runs on one axis cannot be distinguished; at most {len(RUNS)}")


def finish_picture(picture: Picture, heading: str, handles: Sequence[Artist], *, columns: int = 1) -> None:
    """Heading and legend above the axes, where they hide no data; the description under them.

    The heading, whole, is the title of the picture's files.
    """
    picture.title = heading
    picture.legend(
        handles=handles,
        ncols=columns,
        title=shorten(heading, 90),
        title_fontsize=11,
        loc="outside upper left",
        alignment="left",
        borderaxespad=0.2,
    )
    picture.supxlabel(shorten(picture.description, 150), x=0.99, ha="right", fontsize=7, color=GREY)


def shorten(text: str, length: int) -> str:
    """At most so many characters of a text, without what matplotlib would take for a formula."""
    text = text if len(text) <= length else text[: length - 1].rstrip() + "…"
    return text.replace("$", r"\$")

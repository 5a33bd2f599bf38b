"""The style of bussim's pictures, and how they are saved: the same bytes for the same run."""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import wraps
from importlib.resources import files
from pathlib import Path
from typing import Any, ParamSpec

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.text import Text

from bussim.errors import UsageError
from bussim.files import written_whole
from bussim.results.plots.fonts import FONT, drawable_language, use_fonts
from bussim.version import __version__
from bussim.words.language import said_text, shown, use_language

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

_Arguments = ParamSpec("_Arguments")

#: Where a line may end: between Chinese characters, not before what closes a part of the sentence.
_PIECES = re.compile(
    r"[（【“]*(?:[\u3400-\u9fff]|[^\u3400-\u9fff、。，．：；？！（）【】“”]+|.)[、。，．：；？！）】”]*"
)
_DPI = 150
#: Inches of a column of a legend beside its labels.
_SWATCH = 0.6
_SOFTWARE = f"bussim {__version__}"
# First the defaults of matplotlib: its rcdefaults() reads thirty style sheets to know what it must not set.
_SETTINGS: Any = {
    **{name: value for name, value in mpl.rcParamsDefault.items() if not name.startswith("backend")},
    **mpl.rc_params_from_file(str(files(__package__) / "pictures.mplstyle"), use_default_template=False),
    "font.family": [FONT],
}


def drawn(draw: Callable[_Arguments, Picture]) -> Callable[_Arguments, Picture]:
    """Draw a picture whose texts are in the language that is used, as far as there is a font for it."""

    @wraps(draw)
    def in_language(*args: _Arguments.args, **named: _Arguments.kwargs) -> Picture:
        with use_language(drawable_language()):
            return draw(*args, **named)

    return in_language


@contextmanager
def style() -> Iterator[None]:
    """The settings under which pictures are drawn and saved, whatever the user's own are."""
    with mpl.rc_context(_SETTINGS), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")  # use_fonts says it in its own words
        yield


class Picture(Figure):
    """A matplotlib figure that needs no pyplot and that a notebook shows by itself.

    ``title`` and ``description`` (scenario, seed, version) go into the metadata of its files.
    """

    title = ""
    description = ""

    def draw(self, renderer: Any) -> None:
        """Draw everything, each text in fonts that have its characters."""
        use_fonts(self.findobj(Text))
        layout = self.get_layout_engine()
        with style():
            # matplotlib draws twice when it saves, first for the layout alone.
            if self.axes and isinstance(layout, ConstrainedLayoutEngine) and self.canvas.is_saving():
                layout.execute(self)
            else:
                super().draw(renderer)

    def width_of(self, text: str, points: float) -> float:
        """The width in inches of a line of text of so many points."""
        # As many dots as in the file: the grid of these makes small letters up to 6 % wider.
        probe = Text(0, 0, text, fontsize=points * _DPI / self.dpi, parse_math=False, figure=self)
        use_fonts([probe])
        renderer = self.canvas.get_renderer()  # type: ignore[attr-defined] # Agg's
        return float(probe.get_window_extent(renderer).width) / _DPI

    def wrapped(self, text: str, points: float, inches: float) -> str:
        """A text on lines of at most so many inches, without what matplotlib would take for a formula."""
        lines = [""]
        for word in [text] if self.width_of(text, points) <= inches else text.split(" "):
            pieces = _PIECES.findall(word)
            fits = max((self.width_of(piece, points) for piece in pieces), default=0) <= inches
            for index, part in enumerate(pieces if fits else word):
                joined = f"{lines[-1]} {part}" if lines[-1] and not index else lines[-1] + part
                if lines[-1] and self.width_of(joined, points) > inches:
                    lines.append(part)
                else:
                    lines[-1] = joined
        return "\n".join(lines).replace("$", r"\$")

    def save(self, path: Path) -> Path:
        """Write the picture as PNG or SVG, after the path's ending, and return the path.

        Raises UsageError for another ending, and as :func:`bussim.files.written_whole`.
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
    picture.description = shown(description)
    FigureCanvasAgg(picture)
    return picture


def legend_of_runs(labels: Sequence[str], texts: Sequence[str]) -> list[Line2D]:
    """A line for each of several runs, in its colour, and what the marks of all of them mean."""
    handles = [
        Line2D(
            [], [], color=RUNS[number], linewidth=3, label=said_text("plot_of_run", label=label, text=text)
        )
        for number, (label, text) in enumerate(zip(labels, texts, strict=True))
    ]
    return [*handles, Line2D([], [], linestyle="", label=said_text("plot_marks"))]


def too_many(runs: Sequence[object]) -> None:
    """Raise UsageError where there are more runs than colours."""
    if len(runs) > len(RUNS):
        raise UsageError(f"{len(runs)} runs on one axis cannot be distinguished; at most {len(RUNS)}")


def finish_picture(picture: Picture, heading: str, handles: Sequence[Artist], *, columns: int = 1) -> None:
    """Heading and legend above the axes, where they hide no data; the description under them.

    All are whole, however long: the picture becomes so much higher. The heading is the title of its files.
    """
    heading = shown(heading)
    picture.title = heading
    room = 0.96 * picture.get_figwidth()
    title, about = picture.wrapped(heading, 11, room), picture.wrapped(picture.description, 7, room)
    more = 11.0 * title.count("\n") + 7.0 * about.count("\n")
    widths = [_SWATCH + picture.width_of(str(handle.get_label()), 9) for handle in handles]
    # As the legend shares its entries among its columns, each as wide as its widest entry.
    fits = sum(max(part, default=0) for part in np.array_split(widths, columns)) <= room
    for handle in handles:
        label = picture.wrapped(str(handle.get_label()), 9, room if fits else room / columns - _SWATCH)
        handle.set_label(label)
        more += 9.0 * label.count("\n") / columns
    picture.set_figheight(picture.get_figheight() + 1.3 * more / 72)
    picture.legend(
        handles=handles,
        ncols=columns,
        title=title,
        title_fontsize=11,
        loc="outside upper left",
        alignment="left",
        borderaxespad=0.2,
    )
    picture.supxlabel(about, x=0.99, ha="right", fontsize=7, color=GREY)


def shorten(text: str, length: int) -> str:
    """At most so many characters of a text, the middle left out: its end may be what distinguishes it.

    Without what matplotlib would take for a formula.
    """
    if len(text) > length:
        text = f"{text[: 2 * length // 3]}…{text[2 * length // 3 + 1 - length :]}"
    return text.replace("$", r"\$")

"""Histograms of times as bars on an axis."""

from collections.abc import Mapping, Sequence
from math import isqrt
from typing import Literal

from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from bussim.results.meters.histogram import BIN_TICKS, Histogram, bar_width
from bussim.results.plots.style import RUNS
from bussim.results.text.lines import number_named
from bussim.units import milliseconds
from bussim.words.language import said_text

_MOST_BARS, _FEW_BARS = 160, 20
#: Marks are apart where at least this part of the axis lies between them.
_APART = 80
#: Shortest range of times on an axis, in ms.
_LEAST_SHOWN = 0.1
#: The whole range is so many times the usual one before that has an axis of its own.
_FAR = 5
#: How mean, p99 and maximum are marked.
MARKS: dict[str, Literal["-", "--", ":"]] = {"mean": "-", "p99": "--", "max": ":"}


def whole_range(histograms: Sequence[Histogram]) -> tuple[int, int]:
    """First and last bin that any of the histograms, none of them empty, has."""
    return min(min(h.bins) for h in histograms), max(max(h.bins) for h in histograms)


def usual_range(histograms: Sequence[Histogram]) -> tuple[int, int]:
    """The bins around the densest half of every histogram, and at least those of its densest nine tenths.

    So a peak of one scan in five is not left out because it is narrow and lies apart.
    """
    halves = [_densest(histogram, 5) for histogram in histograms]
    low, high = min(low for low, _ in halves), max(high for _, high in halves)
    margin = max(3 * (high - low) // 2, 5)
    most = [_densest(histogram, 9) for histogram in histograms]
    first, last = min(low for low, _ in most), max(high for _, high in most)
    more = max((last - first) // 10, 5)
    return min(low - margin, first - more), max(high + margin, last + more)


def _densest(histogram: Histogram, tenths: int) -> tuple[int, int]:
    """First and last bin of the shortest range that holds so many tenths of the samples."""
    needed = tenths * histogram.count
    numbers = sorted(histogram.bins)
    best = (numbers[0], numbers[-1])
    held, tail = 0, 0
    for number in numbers:
        held += histogram.bins[number]
        while 10 * (held - histogram.bins[numbers[tail]]) >= needed:
            held -= histogram.bins[numbers[tail]]
            tail += 1
        if 10 * held >= needed and number - numbers[tail] < best[1] - best[0]:
            best = (numbers[tail], number)
    return best


def is_far(whole: tuple[int, int], usual: tuple[int, int]) -> bool:
    """Whether the usual range needs an axis of its own beside the whole one."""
    return (usual[1] - usual[0]) * _FAR < whole[1] - whole[0]


def draw(
    axes: Axes, histograms: Sequence[Histogram], shown: tuple[int, int], times: str, counted: str
) -> None:
    """Draw the bins ``shown`` (first and last) of all histograms, and their marks.

    ``times`` is the label of the horizontal axis, ``counted`` what the bars count. One histogram has
    black marks, of several each has its colour of :data:`RUNS`.
    """
    first, last = shown
    samples = max(sum(histogram.bars(last + 1, first, last).values()) for histogram in histograms)
    # Bars of less than a few samples each would be a comb.
    width = bar_width(last - first + 1, min(_MOST_BARS, max(_FEW_BARS, 3 * isqrt(samples))))
    alone = len(histograms) == 1
    for number, histogram in enumerate(histograms):
        _draw_bars(axes, histogram.bars(width, first, last), width, RUNS[number], alone=alone)
    # The margins are those of the bars; a mark outside of them does not widen the axis.
    low, high = axes.get_xlim()
    missing = max(_LEAST_SHOWN - (high - low), 0.0)
    axes.set_xlim(low - missing / 2, high + missing / 2)
    if axes.get_yscale() == "linear":
        axes.yaxis.set_major_locator(MaxNLocator(8, integer=True, steps=[1, 2, 5, 10]))
    near = (last - first + 1) * BIN_TICKS / _APART
    for number, histogram in enumerate(histograms):
        marks = marked(histogram)
        for name, value in marks.items():
            # Marks that would lie on each other share the height, in the order of their names.
            same = [other for other in marks if abs(marks[other] - value) < near]
            low, high = (index / len(same) for index in (same.index(name), same.index(name) + 1))
            colour = "black" if alone else RUNS[number]
            axes.axvline(milliseconds(value), low, high, color=colour, linestyle=MARKS[name], linewidth=1.2)
    axes.set_xlabel(times)
    axes.set_ylabel(said_text("axis_per", counted=counted, width=_width_text(width)))


def _draw_bars(axes: Axes, bars: dict[int, int], width: int, colour: str, *, alone: bool) -> None:
    if not bars:
        return
    first, last = min(bars), max(bars)
    counts = [bars.get(bar, 0) for bar in range(first, last + 1)]
    # A bar begins half a bin before its first bin's centre.
    edges = [milliseconds((bar * width - 0.5) * BIN_TICKS) for bar in range(first, last + 2)]
    axes.stairs(counts, edges, fill=True, color=colour, alpha=0.85 if alone else 0.25, linewidth=0)
    if not alone:
        axes.stairs(counts, edges, color=colour, linewidth=1.2)


def marked(histogram: Histogram) -> dict[str, float]:
    """What is marked of a histogram, in ticks: mean, p99 and max as far as they are known."""
    values = {"mean": histogram.mean, "p99": histogram.quantile(990), "max": histogram.maximum}
    return {name: value for name, value in values.items() if value is not None}


def marks_in_words(histogram: Histogram) -> dict[str, str]:
    """What is marked of a histogram as text: ``mean 50.4 ms``, ``max 51.1 ms``."""
    return {
        name: said_text("plot_mark", name=number_named(name), time=ms_text(value))
        for name, value in marked(histogram).items()
    }


def legend_of_marks(texts: Mapping[str, str]) -> list[Line2D]:
    """The black lines that mark a single histogram, by mark with their texts."""
    return [
        Line2D([], [], color="black", linestyle=MARKS[name], linewidth=1.2, label=text)
        for name, text in texts.items()
    ]


def ms_text(ticks: float) -> str:
    """A time with five digits or more."""
    return f"{milliseconds(ticks):.3f} ms" if milliseconds(ticks) < 100 else f"{milliseconds(ticks):.2f} ms"


def _width_text(width: int) -> str:
    micros = width * 10
    return f"{micros} µs" if micros < 1000 else f"{micros / 1000:g} ms"

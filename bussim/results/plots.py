"""The histogram of link scan times, of one run or of several on one axis."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import wrap
from typing import Literal

from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from bussim.errors import UsageError
from bussim.results.histogram import BIN_TICKS, Histogram
from bussim.results.record import LinkRecord, RunRecord
from bussim.results.style import RUNS, Picture, finish_picture, new_picture, shorten, style
from bussim.units import milliseconds, seconds

_MOST_BARS = 160
#: Shortest stretch of scan times on an axis, in ms.
_LEAST_SHOWN = 0.1
_MOST_RUNS = len(RUNS)
#: The whole range is so many times the usual one before that has an axis of its own.
_FAR = 8
#: How mean, p99 and maximum are marked.
_MARKS: dict[str, Literal["-", "--", ":"]] = {"mean": "-", "p99": "--", "max": ":"}


def scan_time_histogram(runs: Sequence[RunRecord], bus: str, labels: Sequence[str] | None = None) -> Picture:
    """The histogram of a bus's link scan times.

    With several runs each has a colour; ``labels`` names them (default: the scenarios' names). Where
    a few scans lie far from the usual ones, the usual ones have an axis of their own beside the
    whole range, whose counts are logarithmic.

    Raises UsageError if a run has no such bus or no scans on it, or for too many runs.
    """
    if len(runs) > _MOST_RUNS:
        raise UsageError(f"{len(runs)} runs on one axis cannot be told apart; at most {_MOST_RUNS}")
    links = [link_of(run, bus) for run in runs]
    histograms = [link.scan_times.histogram for link in links]
    whole = (min(min(h.bins) for h in histograms), max(max(h.bins) for h in histograms))
    usual = _usual_range(histograms)
    with style():
        picture = new_picture(7.5, 4.4 + 0.2 * len(runs), _captions(runs))
        if (usual[1] - usual[0]) * _FAR < whole[1] - whole[0]:
            close_up, axes = picture.subplots(1, 2, width_ratios=(2, 3))
            _draw(close_up, histograms, usual)
            close_up.set_title("the usual scans")
            close_up.locator_params(axis="x", nbins=5)
            axes.set_title("all scans")
            axes.set_yscale("log")
        else:
            axes = picture.add_subplot()
        _draw(axes, histograms, whole)
        if axes.get_yscale() == "log":
            axes.set_ylim(bottom=0.6)
        if len(runs) == 1:
            heading = f"{run_labels(runs)[0]}: {histograms[0].count:,} link scans on {bus}"
            attempts = runs[0].summary["links"][bus]["attempts"]
            if attempts is not None:
                heading += f", {attempts} attempts a poll"
            handles = _explain_one(links[0])
        else:
            heading = f"link scans on {bus}"
            handles = _explain_several(labels or run_labels(runs), histograms)
        finish_picture(picture, heading, handles)
    return picture


def link_of(run: RunRecord, bus: str) -> LinkRecord:
    """The link of a run. Raises UsageError if there is none of that name, or without a single scan."""
    link = run.links.get(bus)
    if link is None:
        raise UsageError(
            f"{run.scenario} has no N:N link {bus!r}; it has {', '.join(map(repr, run.links)) or 'none'}"
        )
    if not link.scan_times.histogram.count:
        raise UsageError(f"{run.scenario}: the link {bus!r} made no complete scan, there is nothing to plot")
    return link


def caption(run: RunRecord) -> str:
    """What a picture rests on: scenario, seed, duration, version."""
    summary = run.summary
    return (
        f"{summary['scenario']}, seed {summary['seed']}, {summary['duration_s']:g} s, "
        f"bussim {summary['bussim']}"
    )


def run_labels(runs: Sequence[RunRecord]) -> list[str]:
    """A different name for each run: its scenario's, with the seed or a number where that is not enough."""
    names = [run.scenario for run in runs]
    if len(set(names)) < len(names):
        names = [f"{run.scenario}, seed {run.summary['seed']}" for run in runs]
    if len(set(names)) < len(names):
        names = [f"{name} ({number})" for number, name in enumerate(names, 1)]
    return names


def _captions(runs: Sequence[RunRecord]) -> str:
    return "; ".join(dict.fromkeys(caption(run) for run in runs))


def _usual_range(histograms: Sequence[Histogram]) -> tuple[int, int]:
    """The bins around the densest half of every histogram."""
    halves = [_densest_half(histogram) for histogram in histograms]
    low, high = min(low for low, _ in halves), max(high for _, high in halves)
    margin = max(3 * (high - low) // 2, 5)
    return low - margin, high + margin


def _densest_half(histogram: Histogram) -> tuple[int, int]:
    """First and last bin of the shortest stretch that holds half of the samples."""
    places = sorted(histogram.bins)
    best = (places[0], places[-1])
    held, tail = 0, 0
    for place in places:
        held += histogram.bins[place]
        while 2 * (held - histogram.bins[places[tail]]) >= histogram.count:
            held -= histogram.bins[places[tail]]
            tail += 1
        if 2 * held >= histogram.count and place - places[tail] < best[1] - best[0]:
            best = (places[tail], place)
    return best


def _draw(axes: Axes, histograms: Sequence[Histogram], shown: tuple[int, int]) -> None:
    """Draw the bins ``shown`` (first and last) of all histograms, and their marks."""
    first, last = shown
    width = _bar_width(last - first + 1)
    alone = len(histograms) == 1
    for number, histogram in enumerate(histograms):
        bars: dict[int, int] = {}
        for place, times in histogram.bins.items():
            if first <= place <= last:
                bars[place // width] = bars.get(place // width, 0) + times
        _draw_bars(axes, bars, width, RUNS[number], alone=alone)
    # The margins are those of the bars; a mark outside of them does not widen the axis.
    low, high = axes.get_xlim()
    missing = max(_LEAST_SHOWN - (high - low), 0.0)
    axes.set_xlim(low - missing / 2, high + missing / 2)
    if axes.get_yscale() == "linear":
        axes.yaxis.set_major_locator(MaxNLocator(8, integer=True, steps=[1, 2, 5, 10]))
    for number, histogram in enumerate(histograms):
        for name, value in _marked(histogram).items():
            colour = "black" if alone else RUNS[number]
            axes.axvline(milliseconds(value), color=colour, linestyle=_MARKS[name], linewidth=1.2)
    axes.set_xlabel("link scan time (ms)")
    axes.set_ylabel(f"link scans per {_width_text(width)}")


def _bar_width(span: int) -> int:
    """Width of a bar in bins: the least of 1, 2, 5, 10… with which ``span`` bins fit on the axis."""
    decade = 1
    while True:
        for width in (decade, 2 * decade, 5 * decade):
            if span <= width * _MOST_BARS:
                return width
        decade *= 10


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


def _marked(histogram: Histogram) -> dict[str, float]:
    values = {"mean": histogram.mean, "p99": histogram.quantile(990), "max": histogram.maximum}
    return {name: value for name, value in values.items() if value is not None}


def _explain_one(link: LinkRecord) -> list[Line2D]:
    times = link.scan_times
    texts = {name: f"{name} {_ms_text(value)}" for name, value in _marked(times.histogram).items()}
    if times.longest_at is not None:
        texts["max"] += f" at {seconds(times.longest_at):.2f} s"
        if times.longest_cause:
            texts["max"] += f": {times.longest_cause}"
    return [
        Line2D([], [], color="black", linestyle=_MARKS[name], linewidth=1.2, label=_wrapped(text))
        for name, text in texts.items()
    ]


def _explain_several(labels: Sequence[str], histograms: Sequence[Histogram]) -> list[Line2D]:
    handles = []
    for number, (label, histogram) in enumerate(zip(labels, histograms, strict=True)):
        numbers = ", ".join(f"{name} {_ms_text(value)}" for name, value in _marked(histogram).items())
        text = f"{shorten(label, 40)}: {histogram.count:,} scans, {numbers}"
        handles.append(Line2D([], [], color=RUNS[number], linewidth=3, label=text))
    key = "lines: mean solid, p99 dashed, maximum dotted"
    return [*handles, Line2D([], [], linestyle="", label=key)]


def _wrapped(text: str) -> str:
    """A text on at most two lines of the legend."""
    first, *rest = wrap(text, 92)
    return "\n".join([shorten(first, 92), shorten(" ".join(rest), 92)] if rest else [shorten(first, 92)])


def _ms_text(ticks: float) -> str:
    return f"{milliseconds(ticks):.3f} ms" if milliseconds(ticks) < 100 else f"{milliseconds(ticks):.2f} ms"


def _width_text(width: int) -> str:
    micros = width * 10
    return f"{micros} µs" if micros < 1000 else f"{micros / 1000:g} ms"

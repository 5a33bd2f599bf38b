"""The histogram of one latency, and what the shortest, the mean and the longest one are made of."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from bussim.errors import UsageError
from bussim.results.bars import MARKS, draw, marked, ms_text, whole_range
from bussim.results.histogram import BIN_TICKS
from bussim.results.latency import PARTS, LatencyRecord
from bussim.results.latency_text import PART_NAMES, counts_in_words
from bussim.results.plots import caption
from bussim.results.record import RunRecord
from bussim.results.style import LAW, PALETTE, Picture, finish_picture, new_picture, shorten, style
from bussim.units import milliseconds

#: The colours of the parts; none of them is the bound's.
_COLOURS = dict(zip(PARTS, (PALETTE[0], PALETTE[3], PALETTE[5], PALETTE[4], PALETTE[1]), strict=True))
#: A bound is on the axis up to so many times the longest latency.
_BEYOND = 3


def measured(run: RunRecord) -> list[str]:
    """Entries of a run whose latencies can be drawn."""
    return [name for name, entry in run.latency.items() if entry.histogram.count]


def latency_picture(run: RunRecord, name: str) -> Picture:
    """One entry's histogram, and below it, on the same axis, shortest, mean and longest in their parts.

    Bounds are marked as far as they lie near. Raises UsageError if there is no such entry or nothing
    was measured.
    """
    record = run.latency.get(name)
    if record is None:
        known = ", ".join(map(repr, run.latency)) or "none"
        raise UsageError(f"{run.scenario} has no latency {name!r}; it has {known}")
    if not record.histogram.count:
        raise UsageError(f"{run.scenario}: nothing was measured of {name}, there is nothing to plot")
    bounds: dict[str, float] = run.summary["latency"][name].get("bound_ms", {})
    longest = milliseconds(record.histogram.maximum or 0)
    near = {case: bound for case, bound in bounds.items() if bound <= _BEYOND * longest}
    first = next(iter(bounds), None)
    if first is not None:
        near.setdefault(first, bounds[first])
    with style():
        picture = new_picture(8, 5.6, caption(run))
        axes, stack = picture.subplots(2, 1, sharex=True, height_ratios=(3, 1.5))
        what = "age (ms)" if record.word else "latency (ms)"
        counted = "readings" if record.word else "changes"
        draw(axes, [record.histogram], whole_range([record.histogram]), what, counted)
        axes.set_xlabel("")
        axes.tick_params(axis="x", labelbottom=False)
        _draw_parts(stack, record)
        stack.set_xlabel(what)
        shown = max(longest, *near.values()) if near else longest
        stack.set_xlim(0, 1.03 * shown + milliseconds(BIN_TICKS))
        for number, bound in enumerate(near.values()):
            for each in (axes, stack):
                each.axvline(bound, color=LAW, linewidth=2 if number == 0 else 1)
        title = run.latency[name]
        way = f"{title.source} to {title.target}"
        heading = f"{run.scenario}: {way if name == way else f'{name}, {way}'}"
        axes.set_title(shorten(counts_in_words(run.summary["latency"][name]), 100), fontsize=9)
        finish_picture(picture, heading, _explain(record, near), columns=2)
    return picture


def _draw_parts(axes: Axes, record: LatencyRecord) -> None:
    """Shortest, mean and longest as bars of their parts."""
    count = record.delivered
    rows: list[tuple[str, list[float]]] = [("mean", [total / count for total in record.sums])]
    if record.shortest is not None and record.longest is not None:
        rows = [
            ("shortest", [float(part) for part in record.shortest.parts]),
            *rows,
            ("longest", [float(part) for part in record.longest.parts]),
        ]
    for number, (_, parts) in enumerate(rows):
        left = 0.0
        for name, ticks in zip(PARTS, parts, strict=True):
            width = milliseconds(ticks)
            axes.barh(number, width, left=left, height=0.7, color=_COLOURS[name], linewidth=0)
            left += width
    axes.set_yticks(range(len(rows)), [label for label, _ in rows])
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.grid(visible=False, axis="y")


def _explain(record: LatencyRecord, bounds: dict[str, float]) -> list[Patch | Line2D]:
    handles: list[Patch | Line2D] = [
        Patch(color=_COLOURS[name], linewidth=0, label=PART_NAMES[name])
        for name, longest in zip(PARTS, record.longest_parts, strict=True)
        if longest
    ]
    for name, value in marked(record.histogram).items():
        label = f"{name} {ms_text(value)}"
        handles.append(Line2D([], [], color="black", linestyle=MARKS[name], linewidth=1.2, label=label))
    for number, (case, bound) in enumerate(bounds.items()):
        label = f"at worst with {case}: {bound:.3f} ms"
        handles.append(Line2D([], [], color=LAW, linewidth=2 if number == 0 else 1, label=label))
    return handles

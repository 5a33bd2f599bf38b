"""The histogram of one latency, and what the shortest, the mean and the longest one are made of."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from bussim.errors import UsageError
from bussim.results.meters.histogram import BIN_TICKS, Histogram
from bussim.results.meters.latency_record import PARTS, LatencyRecord
from bussim.results.plots.bars import draw, is_far, legend_of_marks, marks_in_words, usual_range, whole_range
from bussim.results.plots.scan_times import captions, run_labels
from bussim.results.plots.style import (
    DISTRIBUTION,
    GREY,
    PARTS_OF_LATENCY,
    RUNS,
    Picture,
    drawn,
    finish_picture,
    legend_of_runs,
    new_picture,
    shorten,
    style,
    too_many,
)
from bussim.results.run_record import RunRecord
from bussim.results.text.latency import (
    bounds_in_words,
    case_in_words,
    caveats,
    counts_in_words,
    part_names,
    shown_bounds,
)
from bussim.units import TICKS_PER_MS, milliseconds
from bussim.words.language import said_text, shown

#: Longest label of a run beside its bars.
_LONGEST_LABEL = 22
#: The columns of a picture where a few latencies lie far from the others.
_USUAL, _ALL = "plot_usual", "plot_all"


@dataclass(frozen=True, slots=True)
class _Mark:
    """The line of a bound: where (ms), and how it differs from the others; without a dash none is drawn."""

    at: float
    text: str
    colour: str
    dash: Literal["-", "-.", ""]
    width: float


def measured(run: RunRecord) -> list[str]:
    """Entries of a run whose latencies can be drawn."""
    return [name for name, entry in run.latency.items() if entry.histogram.count]


def latency_of(run: RunRecord, name: str) -> LatencyRecord:
    """An entry of a run. Raises UsageError if there is none of that name, or nothing was measured of it."""
    record = run.latency.get(name)
    if record is None:
        known = ", ".join(map(repr, run.latency)) or "none"
        raise UsageError(f"{run.scenario} has no latency {name!r}; it has {known}")
    if not record.histogram.count:
        raise UsageError(f"{run.scenario}: nothing was measured of {name}, there is nothing to plot")
    return record


@drawn
def latency_picture(runs: Sequence[RunRecord], name: str, labels: Sequence[str] | None = None) -> Picture:
    """One entry's histogram, and below it, on the same axis, latencies in their parts.

    Of one run the shortest, the mean and the longest; its bounds are marked up to the first that lies
    above the longest. Of several runs, each in its colour and named by ``labels`` (default: the
    scenarios' names), the mean and the longest, and the bounds without error.

    Raises UsageError if a run has no such entry or nothing was measured, if it is of a bit in one run and
    of a word in another, or for too many runs.
    """
    too_many(runs)
    records = [latency_of(run, name) for run in runs]
    if len({record.word for record in records}) > 1:
        raise UsageError(f"{name} is the age of a word in one run and the latency of a bit in another")
    histograms = [record.histogram for record in records]
    several = labels or run_labels(runs) if len(runs) > 1 else None
    if several is None:
        marks = _marks_of_one(records[0], runs[0].summary["latency"][name])
    else:
        marks = _marks_of_several([run.summary["latency"][name] for run in runs])
    bars = _bars(records, several)
    handles = _explain(records, several, marks)
    with style():
        picture = new_picture(8, _height(len(bars), several), captions(runs))
        what = said_text("axis_age" if records[0].word else "axis_latency")
        counted = said_text("axis_readings" if records[0].word else "axis_changes")
        columns = _shown(histograms, marks)
        first, furthest = whole_range(histograms)
        grid = picture.subplots(
            2,
            len(columns),
            sharex="col",
            squeeze=False,
            height_ratios=(3, 0.5 * len(bars)),
            width_ratios=(2, 3)[-len(columns) :],
        )
        for (axes, stack), (title, last) in zip(grid.T.tolist(), columns.items(), strict=True):
            if title == _ALL and len(columns) > 1:
                axes.set_yscale("log")
            draw(axes, histograms, (first, min(last, furthest)), what, counted)
            if title == _ALL and len(columns) > 1:
                axes.set_ylim(bottom=0.6)
            axes.set_xlabel("")
            axes.tick_params(axis="x", labelbottom=False)
            _draw_parts(stack, bars)
            stack.set_xlabel(what)
            axes.set_xlim(0, 1.03 * milliseconds(last * BIN_TICKS) + milliseconds(BIN_TICKS))
            for mark in marks:
                for each in (axes, stack) if mark.dash else ():
                    each.axvline(mark.at, color=mark.colour, linewidth=mark.width, linestyle=mark.dash)
            if len(columns) > 1:
                axes.set_title(said_text(title), fontsize=9)
                axes.locator_params(axis="x", nbins=5)
        if len(columns) > 1:
            grid[1, 1].tick_params(axis="y", labelleft=False)
        if several is None:
            words = picture.wrapped(shown(counts_in_words(runs[0].summary["latency"][name])), 9, 7)
            grid[0, 0].set_title(words if len(columns) == 1 else f"{words}\n{said_text(_USUAL)}", fontsize=9)
        heading = _heading(name, records)
        if several is None:
            heading = said_text("plot_latency", run=runs[0].scenario, heading=heading)
        finish_picture(picture, heading, handles, columns=2 if several is None else 1)
    return picture


def _shown(histograms: Sequence[Histogram], marks: Sequence[_Mark]) -> dict[str, int]:
    """The columns of the picture, and the last bin of each: a few far ones leave the others their own."""
    usual, last = usual_range(histograms)[1], whole_range(histograms)[1]
    shown = {_ALL: max([last, *(round(mark.at * TICKS_PER_MS) // BIN_TICKS for mark in marks if mark.dash)])}
    return {_USUAL: usual, **shown} if is_far((0, last), (0, usual)) else shown


def _height(bars: int, several: Sequence[str] | None) -> float:
    """Inches of the picture."""
    return 5.6 if several is None else 5.0 + 0.28 * bars + 0.22 * len(several)


def _heading(name: str, records: Sequence[LatencyRecord]) -> str:
    ends = list(dict.fromkeys((record.source, record.target) for record in records))
    if len(ends) > 1:
        return name
    said = said_text("latency_ends", start=ends[0][0], end=ends[0][1])
    return said if name == " to ".join(ends[0]) else said_text("plot_latency_ends", name=name, ends=said)


def _marks_of_one(record: LatencyRecord, summary: Mapping[str, object]) -> list[_Mark]:
    near = shown_bounds(summary, milliseconds(record.histogram.maximum or 0))
    far = {case: bound for case, bound in bounds_in_words(summary).items() if case not in near}
    return [
        *(
            _bound_mark(case_in_words(case), bound, "plot_bound", DISTRIBUTION, "-", 1 if number else 2)
            for number, (case, bound) in enumerate(near.items())
        ),
        *(
            _bound_mark(case_in_words(case), bound, "plot_bound_beyond", DISTRIBUTION, "", 0)
            for case, bound in far.items()
        ),
        *_caveats([summary]),
    ]


def _marks_of_several(summaries: Sequence[Mapping[str, object]]) -> list[_Mark]:
    """The bound without error of each run in its colour, or of all of them where it is the same."""
    bounds = [next(iter(shown_bounds(summary).items()), None) for summary in summaries]
    numbers = {number: bound for number, bound in enumerate(bounds) if bound is not None}
    if len(set(bounds)) == 1:
        marks = [
            _bound_mark(case_in_words(case), at, "plot_bound", GREY, "-.", 1.2)
            for case, at in list(numbers.values())[:1]
        ]
    else:
        marks = [
            _bound_mark(
                said_text("plot_case_of", case=case_in_words(case), number=number + 1),
                at,
                "plot_bound",
                RUNS[number],
                "-.",
                1.2,
            )
            for number, (case, at) in numbers.items()
        ]
    return marks + _caveats(summaries)


def _caveats(summaries: Sequence[Mapping[str, object]]) -> list[_Mark]:
    """Lines of text: what must be said beside the bounds, each once."""
    found = dict.fromkeys(said for summary in summaries for said in caveats(summary))
    return [_Mark(0.0, shown(said), DISTRIBUTION, "", 0) for said in found]


def _bound_mark(
    case: str, at: float, key: str, colour: str, dash: Literal["-", "-.", ""], width: float
) -> _Mark:
    return _Mark(at, said_text(key, case=case, at=at), colour, dash, width)


def _bars(
    records: Sequence[LatencyRecord], labels: Sequence[str] | None
) -> list[tuple[str, Sequence[float]]]:
    """What is shown in its parts, from above to below: what it is called and the ticks of each part."""
    bars: list[tuple[str, Sequence[float]]] = []
    for number, record in enumerate(records):
        rows = record.examples()
        if labels is not None:
            rows.pop("shortest", None)
        for what, parts in rows.items():
            text = said_text(f"example_{what}")
            if labels is not None:
                label = shorten(labels[number], _LONGEST_LABEL)
                text = said_text("plot_of_run", label=label, text=text)
            bars.append((text, parts))
    return bars


def _draw_parts(axes: Axes, rows: Sequence[tuple[str, Sequence[float]]]) -> None:
    for number, (_, parts) in enumerate(rows):
        left = 0.0
        for name, ticks in zip(PARTS, parts, strict=True):
            width = milliseconds(ticks)
            axes.barh(number, width, left=left, height=0.7, color=PARTS_OF_LATENCY[name], linewidth=0)
            left += width
    axes.set_yticks(range(len(rows)), [label for label, _ in rows])
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.grid(visible=False, axis="y")


def _explain(
    records: Sequence[LatencyRecord], labels: Sequence[str] | None, marks: Sequence[_Mark]
) -> list[Patch | Line2D]:
    names = part_names(word=records[0].word)
    handles: list[Patch | Line2D] = [
        Patch(color=PARTS_OF_LATENCY[name], linewidth=0, label=shown(names[name]))
        for name in PARTS
        if any(record.parts[name][1] for record in records)
    ]
    if labels is None:
        handles += legend_of_marks(marks_in_words(records[0].histogram))
    else:
        texts = [
            said_text(
                "plot_read" if record.word else "plot_arrived",
                number=record.delivered,
                marks=list(marks_in_words(record.histogram).values()),
            )
            for record in records
        ]
        handles += legend_of_runs([f"{number} {label}" for number, label in enumerate(labels, 1)], texts)
    return handles + [
        Line2D([], [], color=mark.colour, linewidth=mark.width, linestyle=mark.dash, label=mark.text)
        for mark in marks
    ]

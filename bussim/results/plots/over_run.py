"""Scan times over a run, with its faults and the stations in error."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from bussim.results.meters.link import LinkRecord
from bussim.results.meters.timeline import Span, fault_spans
from bussim.results.plots.scan_times import link_of
from bussim.results.plots.style import (
    FAULT,
    IN_ERROR,
    LOST,
    SIMULATED,
    Picture,
    drawn,
    finish_picture,
    new_picture,
    shorten,
    style,
)
from bussim.results.run_record import RunRecord
from bussim.results.text.lines import fault_in_words
from bussim.results.text.run import caption_of, lost_in_words
from bussim.units import TICKS_PER_SECOND, milliseconds, seconds
from bussim.words.language import said_text, shown

#: Most lines of faults; the others share one.
_MOST_FAULTS = 10


@dataclass(frozen=True, slots=True)
class _Lane:
    """A line of the chart of events: its label, when it was on, and its colour."""

    label: str
    spans: Sequence[Span]
    colour: str


@drawn
def scan_times_over_run(run: RunRecord, bus: str) -> Picture:
    """A bus's link scan times over the run; below them faults, stations in error, times without the master.

    Where the run has more scans than the picture columns, the longest and the shortest of
    neighbouring scans are drawn. Raises UsageError if there is no such bus or it made no scan.
    """
    link = link_of(run, bus)
    lost = run.summary["links"][bus].get("master_lost", ())
    lanes = [*_fault_lanes(run, link, bus), *_error_lanes(link), *_lost_lanes(lost)]
    end = seconds(run.duration)
    with style():
        height = 0.25 * len(lanes) + 0.35 if lanes else 0.0
        picture = new_picture(8.5, 4.2 + height, caption_of(run.summary))
        if lanes:
            axes, chart = picture.subplots(2, 1, sharex=True, height_ratios=(3.2, height))
            _draw_lanes(chart, lanes, end)
            axes.tick_params(axis="x", labelbottom=False)
            lowest = chart
        else:
            lowest = axes = picture.add_subplot()
        handles = _draw_scans(axes, link)
        for colour in dict.fromkeys(lane.colour for lane in lanes):
            for start, stop in _covered((lane for lane in lanes if lane.colour == colour), end):
                axes.axvspan(start, stop, color=colour, alpha=0.12, linewidth=0)
        lowest.set_xlabel(said_text("axis_run"))
        axes.set_xlim(0, end)
        heading = said_text("plot_over_run", run=run.scenario, bus=bus)
        finish_picture(picture, heading, [*handles, *_explain(lanes)])
    return picture


def _draw_scans(axes: Axes, link: LinkRecord) -> list[Line2D]:
    cells = link.timeline
    starts = [seconds(cell.start) for cell in cells]
    longest = [milliseconds(cell.longest) for cell in cells]
    colour = SIMULATED
    wide = [cell for cell in cells if cell.longest > cell.shortest]
    if wide:
        axes.vlines(
            [seconds(cell.start) for cell in wide],
            [milliseconds(cell.shortest) for cell in wide],
            [milliseconds(cell.longest) for cell in wide],
            color=colour,
            linewidth=0.8,
            alpha=0.5,
        )
    axes.plot(starts, longest, linestyle="", marker=".", markersize=3, color=colour)
    axes.set_ylabel(said_text("axis_scan_time"))
    most = max(cell.scans for cell in cells)
    text = said_text("plot_one_scan") if most == 1 else said_text("plot_neighbours", number=most)
    return [Line2D([], [], color=colour, linestyle="", marker=".", label=text)]


def _explain(lanes: Iterable[_Lane]) -> list[Patch]:
    texts = {
        FAULT: said_text("plot_fault"),
        IN_ERROR: said_text("plot_in_error"),
        LOST: said_text("plot_lost"),
    }
    return [
        Patch(color=colour, alpha=0.6, linewidth=0, label=texts[colour])
        for colour in dict.fromkeys(lane.colour for lane in lanes)
    ]


def _draw_lanes(chart: Axes, lanes: Sequence[_Lane], end: float) -> None:
    for number, lane in enumerate(lanes):
        bars = [_between(span, end) for span in lane.spans]
        chart.broken_barh(
            [(start, stop - start) for start, stop in bars], (number - 0.35, 0.7), color=lane.colour
        )
        # A mark at each beginning, or a short one would not be seen in a long run.
        chart.plot([start for start, _ in bars], [number] * len(bars), "|", color=lane.colour, markersize=10)
    chart.set_yticks(range(len(lanes)), [shorten(lane.label, 34) for lane in lanes], fontsize=8)
    chart.set_ylim(len(lanes) - 0.4, -0.6)
    chart.grid(visible=False, axis="y")


def _covered(lanes: Iterable[_Lane], end: float) -> list[tuple[float, float]]:
    """When at least one of the lanes has a span."""
    covered: list[tuple[float, float]] = []
    for start, stop in sorted(_between(span, end) for lane in lanes for span in lane.spans):
        if covered and start <= covered[-1][1]:
            covered[-1] = (covered[-1][0], max(stop, covered[-1][1]))
        else:
            covered.append((start, stop))
    return covered


def _between(span: Span, end: float) -> tuple[float, float]:
    return seconds(span.start), end if span.end is None else seconds(span.end)


def _fault_lanes(run: RunRecord, link: LinkRecord, bus: str) -> list[_Lane]:
    """Faults of the bus and of its PLCs, those with the same text on one line."""
    lanes: dict[str, list[Span]] = {}
    for text, span in fault_spans(run.notes, {bus, *link.plc_names}):
        lanes.setdefault(shown(fault_in_words(text)), []).append(span)
    if len(lanes) > _MOST_FAULTS:
        rest = list(lanes)[_MOST_FAULTS - 1 :]
        merged = [span for text in rest for span in lanes.pop(text)]
        lanes[said_text("plot_other_faults", number=len(rest))] = merged
    return [_Lane(text, spans, FAULT) for text, spans in lanes.items()]


def _lost_lanes(lost: Iterable[Mapping[str, Any]]) -> list[_Lane]:
    """Times without the master, those of the same slaves on one line."""
    lanes: dict[str, list[Span]] = {}
    for each in lost:
        span = Span(
            round(each["from_s"] * TICKS_PER_SECOND),
            round((each["from_s"] + each["for_s"]) * TICKS_PER_SECOND),
        )
        lanes.setdefault(shown(lost_in_words(each["stations"])), []).append(span)
    return [_Lane(text, spans, LOST) for text, spans in lanes.items()]


def _error_lanes(link: LinkRecord) -> list[_Lane]:
    return [
        _Lane(said_text("station_in_error", station=station), spans, IN_ERROR)
        for station, spans in link.in_error.items()
    ]

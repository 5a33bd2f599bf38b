"""The numbers behind a report's charts, for the script in the page."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from bussim.report.picture import BOX_STYLES, MARKS, BoxStyle, style_of
from bussim.report.runs import ExactDistribution
from bussim.report.scene import END, Scene
from bussim.results.meters.histogram import BIN_TICKS, Histogram
from bussim.results.meters.latency_record import PARTS, LatencyRecord
from bussim.results.meters.link import LinkRecord
from bussim.results.meters.timeline import Span
from bussim.results.plots.bars import is_far, usual_range, whole_range
from bussim.results.plots.style import PARTS_OF_LATENCY
from bussim.results.text.latency import case_in_words, part_names
from bussim.results.text.lines import fault_in_words
from bussim.results.text.run import lost_in_words
from bussim.units import milliseconds, seconds
from bussim.words.language import say

# A page of seven runs stays under 5 MB, whatever they are: what a chart carries is bounded.
#: Most bins of a histogram and most points of a curve.
MOST_BINS, MOST_POINTS = 6_000, 4_000
#: Significant digits of a probability in the page.
_DIGITS = 6


class Quantity(NamedTuple):
    """What a histogram is of: the time on its axis, what its bars count, and so many of that."""

    name: str

    @property
    def time(self) -> str:
        """The time."""
        return say(f"quantity_{self.name}_time")

    @property
    def counted(self) -> str:
        """What is counted."""
        return say(f"quantity_{self.name}_counted")

    def times(self, count: int) -> str:
        """So many of them."""
        one = "one" if count == 1 else "many"
        return say(f"quantity_{self.name}_{one}", count=f"{count:,}")

    @property
    def forms(self) -> list[str]:
        """One of them, and several, with ``{count}`` for how many."""
        return [say(f"quantity_{self.name}_{number}", count="{count}") for number in ("one", "many")]


SCANS, LATENCIES = Quantity("scans"), Quantity("latencies")
AGES, RESPONSES = Quantity("ages"), Quantity("responses")


def histogram_chart(
    histograms: Mapping[str, Histogram],
    distribution: ExactDistribution | None,
    title: str,
    quantity: Quantity = SCANS,
    bounds: Mapping[str, float] | None = None,
    shown: tuple[float, float] | None = None,
) -> dict[str, Any]:
    """Histograms by label, as (bin number, count); the distribution as (x in ms, P(scan > x)).

    Bins are 10 µs wide, or so many times wider that :data:`MOST_BINS` of them do. ``bounds`` (ms, by case)
    are marked; ``shown`` (ms) is what the axis shows (default: where the bins are). A few samples far from
    the usual ones leave these the first view (``usual``, in ms), and ``beyond`` says so.
    """
    width = 1
    # An odd number of bins is as wide on both sides of the middle one: the centres stay on the grid.
    while max(len(each.bars(width, shift=width // 2)) for each in histograms.values()) > MOST_BINS:
        width *= 3
    return {
        "kind": "histogram",
        "title": title,
        "bin_ms": milliseconds(BIN_TICKS * width),
        "time": quantity.time,
        "counted": quantity.counted,
        "times": quantity.forms,
        "bounds": _bounds(bounds or {}),
        "shown": shown,
        **(_first_view(list(histograms.values()), quantity) if shown is None else {}),
        "series": [
            {
                "label": label,
                "count": histogram.count,
                "bins": [list(bar) for bar in sorted(histogram.bars(width, shift=width // 2).items())],
            }
            for label, histogram in histograms.items()
        ],
        "law": _distribution_points(distribution),
        "without": _without(distribution),
    }


def _first_view(histograms: Sequence[Histogram], quantity: Quantity) -> dict[str, Any]:
    usual = usual_range(histograms)
    if not is_far(whole_range(histograms), usual):
        return {}
    count = sum(each.count for each in histograms)
    beyond = count - sum(sum(each.bars(1, *usual).values()) for each in histograms)
    longest = milliseconds(max(each.maximum or 0 for each in histograms))
    text = say("chart_beyond", beyond=beyond, count=quantity.times(count), longest=longest)
    return {"usual": [milliseconds(BIN_TICKS * each) for each in usual], "beyond": text}


def _bounds(bounds: Mapping[str, float]) -> list[list[Any]]:
    return [[bound, say("plot_bound", case=case_in_words(case), at=bound)] for case, bound in bounds.items()]


def parts_chart(
    record: LatencyRecord, bounds: Mapping[str, float], longest: float, title: str
) -> dict[str, Any]:
    """Shortest, mean and longest latency, a lane each, as boxes of their parts in ms; up to ``longest`` ms.

    In the form of :func:`scene_chart`, with ``bounds`` (ms, by case) beside.
    """
    boxes, lanes, names = [], record.examples(), part_names(word=record.word)
    for lane, (what, parts) in enumerate(lanes.items()):
        end = 0.0
        for part, ticks in zip(PARTS, parts, strict=True):
            start, end = end, end + ticks
            if ticks:
                values = {"what": say(f"example_{what}"), "part": names[part]}
                text = say("chart_part", **values, ms=milliseconds(ticks))
                at = [round(milliseconds(tick), 6) for tick in (start, end)]
                boxes.append([lane, *at, names[part], f"{milliseconds(ticks):.1f}", text])
    return {
        "kind": "parts",
        "title": title,
        "span": longest,
        "lanes": [say(f"example_{what}") for what in lanes],
        "boxes": boxes,
        "marks": [],
        "bounds": _bounds(bounds),
        "box_styles": {
            names[part]: BoxStyle(PARTS_OF_LATENCY[part], 0.7, meaning=names[part])._asdict()
            for part, (_, most) in record.parts.items()
            if most
        },
        "mark_styles": {},
    }


def tail_chart(histogram: Histogram, distribution: ExactDistribution | None, title: str) -> dict[str, Any]:
    """The share of link scans that take longer than x: counted, and by the distribution."""
    beyond, points = histogram.count, []
    for number in sorted(histogram.bins):
        beyond -= histogram.bins[number]
        if not beyond:
            break
        # All samples of a bin are at most half a bin above its centre.
        x = round(milliseconds((number + 0.5) * BIN_TICKS), 6)
        points.append([x, float(f"{beyond / histogram.count:.{_DIGITS}g}")])
    return {
        "kind": "tail",
        "title": title,
        "counted": _thinned(points),
        "law": _distribution_points(distribution),
        "without": _without(distribution),
    }


def _thinned(points: list[list[float]]) -> list[list[float]]:
    """At most :data:`MOST_POINTS` of the points, evenly, the last one among them."""
    step = -(-len(points) // MOST_POINTS) or 1
    return points[::-step][::-1]


def _without(distribution: ExactDistribution | None) -> str:
    return say("chart_undisturbed") if distribution is not None and distribution.notes else ""


def _distribution_points(distribution: ExactDistribution | None) -> list[list[float]]:
    if distribution is None:
        return []
    points = [
        [round(x, 6), float(f"{p:.{_DIGITS}g}")]
        for x, p in zip(distribution.x, distribution.tail, strict=True)
    ]
    return _thinned(points)


def over_run_chart(
    link: LinkRecord,
    faults: Sequence[tuple[str, Span]],
    duration: int,
    title: str,
    lost: Sequence[Mapping[str, Any]] = (),
) -> dict[str, Any]:
    """Longest and shortest of neighbouring link scans over the run, faults, stations in error.

    ``lost`` are the times without the master, of the summary.
    """
    end = seconds(duration)
    return {
        "kind": "over-run",
        "title": title,
        "end": end,
        "cells": [
            [
                round(seconds(cell.start), 6),
                round(milliseconds(cell.longest), 6),
                round(milliseconds(cell.shortest), 6),
            ]
            for cell in link.timeline
        ],
        "faults": [[fault_in_words(text), *_span(span, end)] for text, span in faults],
        "errors": [
            [say("station_in_error", station=station), *_span(span, end)]
            for station, spans in link.in_error.items()
            for span in spans
        ],
        "lost": [
            [lost_in_words(each["stations"]), each["from_s"], round(each["from_s"] + each["for_s"], 6)]
            for each in lost
        ],
    }


def _span(span: Span, end: float) -> list[float]:
    return [round(seconds(span.start), 6), end if span.end is None else round(seconds(span.end), 6)]


def scene_chart(scene: Scene, title: str) -> dict[str, Any]:
    """A timeline: lanes, boxes and marks, in ms from its beginning."""

    def at(tick: int) -> float:
        return round(milliseconds(tick - scene.begin), 6)

    return {
        "kind": "timeline",
        "title": title,
        "begin_s": seconds(scene.begin),
        "span": at(scene.end),
        "lanes": list(scene.lanes),
        "boxes": [
            [box.lane, at(box.start), at(box.end), box.kind, box.label, box.text] for box in scene.boxes
        ],
        "marks": [[mark.lane, at(mark.tick), mark.kind, mark.text] for mark in scene.marks],
        "box_styles": {
            kind: style_of(kind)._asdict() | {"grey": kind in BOX_STYLES and style_of(kind).colour in _GREYS}
            for kind in dict.fromkeys(box.kind for box in scene.boxes)
        },
        "mark_styles": {
            kind: {"colour": MARKS[kind][1], "meaning": MARKS[kind][3], "below": kind == END}
            for kind in dict.fromkeys(mark.kind for mark in scene.marks)
        },
    }


#: Greys of the picture, which a dark page turns round.
_GREYS = frozenset(each.colour for each in BOX_STYLES.values() if len(set(each.colour[1::2])) == 1)

"""The histogram of link scan times, of one run or of several on one axis."""

from collections.abc import Sequence

from matplotlib.lines import Line2D

from bussim.errors import UsageError
from bussim.results.meters.link import LinkRecord
from bussim.results.plots import bars
from bussim.results.plots.style import (
    Picture,
    drawn,
    finish_picture,
    legend_of_runs,
    new_picture,
    style,
    too_many,
)
from bussim.results.run_record import RunRecord
from bussim.results.text.run import caption_of
from bussim.units import seconds
from bussim.words.language import said_text, shown


@drawn
def scan_time_histogram(runs: Sequence[RunRecord], bus: str, labels: Sequence[str] | None = None) -> Picture:
    """The histogram of a bus's link scan times.

    With several runs each has a colour; ``labels`` names them (default: the scenarios' names). Where
    a few scans lie far from the usual ones, the usual ones have an axis of their own beside the
    whole range, whose counts are logarithmic.

    Raises UsageError if a run has no such bus or no scans on it, or for too many runs.
    """
    too_many(runs)
    links = [link_of(run, bus) for run in runs]
    histograms = [link.scan_times.histogram for link in links]
    whole = bars.whole_range(histograms)
    usual = bars.usual_range(histograms)
    axis = said_text("axis_scan_time"), said_text("axis_scans")
    with style():
        picture = new_picture(7.5, 4.4 + 0.2 * len(runs), captions(runs))
        if bars.is_far(whole, usual):
            close_up, axes = picture.subplots(1, 2, width_ratios=(2, 3))
            bars.draw(close_up, histograms, usual, *axis)
            close_up.set_title(said_text("plot_usual_scans"))
            close_up.locator_params(axis="x", nbins=5)
            axes.set_title(said_text("plot_all_scans"))
            axes.set_yscale("log")
        else:
            axes = picture.add_subplot()
        bars.draw(axes, histograms, whole, *axis)
        if axes.get_yscale() == "log":
            axes.set_ylim(bottom=0.6)
        if len(runs) == 1:
            what = {"run": run_labels(runs)[0], "scans": histograms[0].count, "bus": bus}
            attempts = runs[0].summary["links"][bus]["attempts"]
            heading = said_text("plot_scans", **what)
            if attempts is not None:
                heading = said_text("plot_scans_attempts", **what, attempts=attempts)
            handles = _explain_one(links[0])
        else:
            heading = said_text("plot_scans_several", bus=bus)
            texts = [
                said_text(
                    "plot_scans_marks",
                    scans=histogram.count,
                    marks=list(bars.marks_in_words(histogram).values()),
                )
                for histogram in histograms
            ]
            handles = legend_of_runs(labels or run_labels(runs), texts)
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


def run_labels(runs: Sequence[RunRecord]) -> list[str]:
    """A different name for each run: its scenario's, with the seed or a number where that is not enough."""
    names = [run.scenario for run in runs]
    if len(set(names)) < len(names):
        names = [f"{run.scenario}, seed {run.summary['seed']}" for run in runs]
    if len(set(names)) < len(names):
        names = [f"{name} ({number})" for number, name in enumerate(names, 1)]
    return names


def captions(runs: Sequence[RunRecord]) -> str:
    """The captions of several runs, each once."""
    return "; ".join(dict.fromkeys(shown(caption_of(run.summary)) for run in runs))


def _explain_one(link: LinkRecord) -> list[Line2D]:
    times = link.scan_times
    texts = bars.marks_in_words(times.histogram)
    if times.longest_at is not None:
        at = {"mark": texts["max"], "at": seconds(times.longest_at)}
        texts["max"] = said_text("plot_max_at", **at)
        if times.longest_cause:
            texts["max"] = said_text("plot_max_because", **at, cause=times.longest_cause)
    return bars.legend_of_marks(texts)

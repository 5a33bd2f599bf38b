"""The histograms of a Modbus master's response times, poll by poll."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from bussim.errors import UsageError
from bussim.results.meters.histogram import BIN_TICKS, Histogram
from bussim.results.meters.ports import PortRecord
from bussim.results.plots import bars
from bussim.results.plots.scan_times import captions, run_labels
from bussim.results.plots.style import (
    IN_ERROR,
    Picture,
    drawn,
    finish_picture,
    legend_of_runs,
    new_picture,
    style,
    too_many,
)
from bussim.results.run_record import RunRecord
from bussim.results.text.lines import number_named
from bussim.units import format_ms, milliseconds
from bussim.words.language import said_text, shown

#: Most panels; the polls with the fewest attempts share the last one.
_MOST_PANELS = 8
#: A timeout is on the axis up to so many times the longest response; a further one would leave these no room.
_BEYOND = 1.5


@dataclass(slots=True)
class _Panel:
    """One poll in every run: its responses and attempts."""

    label: str
    responses: list[Histogram]
    attempts: list[int]

    def add(self, other: _Panel) -> None:
        for number, histogram in enumerate(other.responses):
            self.responses[number].merge(histogram)
            self.attempts[number] += other.attempts[number]


@drawn
def response_time_histogram(
    runs: Sequence[RunRecord], node: str, labels: Sequence[str] | None = None
) -> Picture:
    """The histograms of a master's response times: a row for each poll, on one axis of time.

    Counts are logarithmic, so that rare slow responses are seen. Where a few responses lie far from the usual
    ones, these have an axis of their own beside the whole range. The timeout is marked, or where it is far
    said beside, with the attempts that got no response. Several runs share the panels, each in its colour;
    ``labels`` names them (default: the scenarios' names).

    Raises UsageError if a run has no such master or it had no response, or for too many runs.
    """
    too_many(runs)
    ports = [master_of(run, node) for run in runs]
    panels = _panels(ports)
    filled = [histogram for panel in panels for histogram in panel.responses if histogram.count]
    usual, whole = bars.usual_range(filled), bars.whole_range(filled)
    timeouts = list(dict.fromkeys(port.timeout for port in ports if port.timeout is not None))
    near = [timeout for timeout in timeouts if timeout <= _BEYOND * whole[1] * BIN_TICKS]
    whole = (whole[0], max(whole[1], *(timeout // BIN_TICKS for timeout in near), 0))
    beside = bars.is_far(whole, usual)
    handles = _explain(ports, labels or run_labels(runs), timeouts, near)
    abreast = len(handles) if len(runs) == 1 else 1
    counted = said_text("axis_responses")
    with style():
        height = 1.2 + 0.22 * len(handles) / abreast + 1.6 * len(panels)
        picture = new_picture(7.5, height, captions(runs))
        columns = picture.subplots(
            len(panels), 1 + beside, sharex="col", squeeze=False, width_ratios=(2, 3) if beside else (1,)
        ).T.tolist()
        for first, axes, panel in zip(columns[0], columns[-1], panels, strict=True):
            if beside:
                bars.draw(first, panel.responses, usual, said_text("axis_usual_responses"), counted)
                first.locator_params(axis="x", nbins=5)
            axes.set_yscale("log")
            bars.draw(axes, panel.responses, whole, said_text("axis_response"), counted)
            axes.set_ylim(0.6, max(12, axes.get_ylim()[1]))  # a whole decade: whole numbers on the axis
            for timeout in near:
                axes.axvline(milliseconds(timeout), color=IN_ERROR, linewidth=2, alpha=0.8)
            missing = sum(panel.attempts) - sum(histogram.count for histogram in panel.responses)
            missing *= len(near) < len(timeouts)
            first.set_title(picture.wrapped(_in_words(panel), 9, 4.8 if missing else 6.5), fontsize=9)
            edge = said_text("plot_without", number=missing) if missing else ""
            axes.set_title(edge, loc="right", fontsize=8, color=IN_ERROR)
        for axes in (*columns[0], *columns[-1]):
            axes.yaxis.label.set_size(8)
        for column, shown in zip(columns, (usual, whole) if beside else (whole,), strict=True):
            _limit(column, shown)
        heading = said_text("plot_responses", node=node)
        if len(runs) == 1:
            heading = said_text("plot_latency", run=run_labels(runs)[0], heading=heading)
        finish_picture(picture, heading, handles, columns=abreast)
    return picture


def masters(run: RunRecord) -> list[str]:
    """Nodes of a run whose response times can be drawn."""
    return [node for node, port in run.ports.items() if port.responses.count]


def master_of(run: RunRecord, node: str) -> PortRecord:
    """The master of a run. Raises UsageError if there is none of that name, or without a response."""
    port = run.ports.get(node)
    if port is None or not port.polls:
        known = ", ".join(repr(name) for name, port in run.ports.items() if port.polls) or "none"
        raise UsageError(f"{run.scenario} has no Modbus master {node!r}; it has {known}")
    if not port.responses.count:
        raise UsageError(f"{run.scenario}: {node} had no response, there is nothing to plot")
    return port


def _panels(ports: Sequence[PortRecord]) -> list[_Panel]:
    names = dict.fromkeys(name for port in ports for name, poll in port.polls.items() if poll.transactions)
    panels = []
    for name in names:
        polls = [port.polls.get(name) for port in ports]
        responses = [deepcopy(poll.responses) if poll else Histogram() for poll in polls]
        attempts = [poll.transactions if poll else 0 for poll in polls]
        panels.append(_Panel(name or said_text("program"), responses, attempts))
    if len(panels) > _MOST_PANELS:
        few = sorted(panels, key=lambda panel: -sum(panel.attempts))[_MOST_PANELS - 1 :]
        panels = [panel for panel in panels if panel not in few]
        for panel in few[1:]:
            few[0].add(panel)
        few[0].label = said_text("plot_other_polls", number=len(few))
        panels.append(few[0])
    return panels


def _in_words(panel: _Panel) -> str:
    responses, attempts = sum(h.count for h in panel.responses), sum(panel.attempts)
    words = said_text("plot_answered", label=panel.label, responses=responses, attempts=attempts)
    marks = list(bars.marks_in_words(panel.responses[0]).values()) if len(panel.responses) == 1 else []
    return said_text("plot_answered_marks", answered=words, marks=marks) if marks else words


def _limit(column: Sequence[Axes], shown: tuple[int, int]) -> None:
    """Give a column one axis of time, its label below the last panel."""
    low, high = (milliseconds(number * BIN_TICKS) for number in shown)
    margin = max(0.03 * (high - low), 0.05)
    for axes in column[:-1]:
        axes.set_xlabel("")
    column[-1].set_xlim(low - margin, high + margin)


def _explain(
    ports: Sequence[PortRecord], labels: Sequence[str], timeouts: Sequence[int], near: Sequence[int]
) -> list[Line2D]:
    responses = [port.responses for port in ports]
    if len(ports) > 1:
        texts = [
            said_text(
                "plot_response_marks", number=each.count, marks=list(bars.marks_in_words(each).values())
            )
            for each in responses
        ]
        handles = legend_of_runs(labels, texts)
    else:
        marks = {name: shown(number_named(name)) for name in bars.marked(responses[0])}
        handles = bars.legend_of_marks(marks)
    for timeout in timeouts:
        text = said_text("plot_timeout", time=format_ms(timeout))
        handle = Line2D([], [], color=IN_ERROR, linewidth=2, alpha=0.8, label=text)
        if timeout not in near:
            handle.set(linestyle="", label=said_text("plot_timeout_beyond", time=format_ms(timeout)))
        handles.append(handle)
    return handles

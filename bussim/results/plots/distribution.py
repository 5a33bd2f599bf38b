"""Pictures of exact distributions beside simulated histograms, from plain numbers."""

import numpy as np
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from bussim.results.meters.histogram import BIN_TICKS, Histogram
from bussim.results.plots.style import (
    DISTRIBUTION,
    SIMULATED,
    Picture,
    drawn,
    finish_picture,
    new_picture,
    style,
)
from bussim.units import TICKS_PER_MS
from bussim.words.language import said_text

Floats = NDArray[np.float64]

#: Of a simulated tail, a point stands for at least so many samples.
_LEAST = 5


@drawn
def distribution_and_histogram(
    bus: str, x: Floats, tail: Floats, simulated: Histogram | None, description: str, lowest: float
) -> Picture:
    """P(link scan > x) as a line, with the simulated relative frequency as steps, on a log axis.

    ``x`` in ticks, ascending; ``tail`` of the same length; ``lowest`` is the least probability shown.
    """
    picture = new_picture(7.5, 4.6, description)
    with style():
        axes = picture.subplots()
        axes.plot(x / TICKS_PER_MS, tail, color=DISTRIBUTION, linewidth=1.6, zorder=3)
        handles = [Line2D([], [], color=DISTRIBUTION, label=said_text("plot_law"))]
        if simulated is not None and simulated.count:
            times, share = _frequencies(simulated)
            axes.step(times / TICKS_PER_MS, share, where="post", color=SIMULATED, linewidth=4)
            # Broad, for where both agree the distribution lies over it.
            label = said_text("plot_simulated", scans=simulated.count, least=_LEAST)
            handles.append(Line2D([], [], color=SIMULATED, linewidth=4, label=label))
        axes.set_yscale("log")
        axes.set_ylim(lowest, 1.5)
        shown = x[tail >= lowest]
        if len(shown):
            left, right = shown[0] / TICKS_PER_MS, shown[-1] / TICKS_PER_MS
            margin = 0.03 * max(right - left, 0.1)
            axes.set_xlim(left - margin, right + margin)
        axes.set_xlabel(said_text("axis_scan_x"))
        axes.set_ylabel(said_text("axis_over_x"))
        finish_picture(picture, said_text("plot_law_heading", bus=bus), handles)
    return picture


def _frequencies(simulated: Histogram) -> tuple[Floats, Floats]:
    bins = sorted(simulated.bins.items())
    times = np.array([number for number, _ in bins], dtype=np.float64) * BIN_TICKS
    counts = np.array([count for _, count in bins], dtype=np.float64)
    beyond = counts.sum() - np.cumsum(counts)
    enough = beyond >= _LEAST
    return times[enough], beyond[enough] / counts.sum()

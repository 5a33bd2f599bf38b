"""Pictures of exact distributions and of sizings, from plain numbers: who worked them out does not matter here."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from bussim.results.meters.histogram import BIN_TICKS, Histogram
from bussim.results.plots.style import (
    DISTRIBUTION,
    GREY,
    IN_ERROR,
    SIMULATED,
    Picture,
    finish_picture,
    new_picture,
    style,
)
from bussim.units import TICKS_PER_MS

Floats = NDArray[np.float64]

#: Of a simulated tail, a point stands for at least so many samples.
_LEAST = 5


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
        handles = [Line2D([], [], color=DISTRIBUTION, label="exact law")]
        if simulated is not None and simulated.count:
            times, share = _frequencies(simulated)
            axes.step(times / TICKS_PER_MS, share, where="post", color=SIMULATED, linewidth=4)
            # Broad, for where both agree the distribution lies over it.
            label = f"simulated, {simulated.count:,} link scans (points of at least {_LEAST})"
            handles.append(Line2D([], [], color=SIMULATED, linewidth=4, label=label))
        axes.set_yscale("log")
        axes.set_ylim(lowest, 1.5)
        shown = x[tail >= lowest]
        if len(shown):
            left, right = shown[0] / TICKS_PER_MS, shown[-1] / TICKS_PER_MS
            margin = 0.03 * max(right - left, 0.1)
            axes.set_xlim(left - margin, right + margin)
        axes.set_xlabel("link scan time x (ms)")
        axes.set_ylabel("P(link scan > x)")
        finish_picture(picture, f"Link scan time on {bus}", handles)
    return picture


def _frequencies(simulated: Histogram) -> tuple[Floats, Floats]:
    bins = sorted(simulated.bins.items())
    times = np.array([place for place, _ in bins], dtype=np.float64) * BIN_TICKS
    counts = np.array([count for _, count in bins], dtype=np.float64)
    beyond = counts.sum() - np.cumsum(counts)
    enough = beyond >= _LEAST
    return times[enough], beyond[enough] / counts.sum()


def sizing_grid(
    bus: str,
    retries: Sequence[int],
    timeouts: Floats,
    errors: Floats,
    front: Sequence[tuple[int, float]],
    chosen: tuple[int, float] | None,
    description: str,
) -> Picture:
    """False station errors a year over retries and timeout, with the Pareto front and the choice.

    ``timeouts`` in ms, ``errors`` of shape (retries, timeouts); NaN where a setting is not considered.
    ``front`` and ``chosen`` are (retries, timeout in ms).
    """
    picture = new_picture(7.5, 4.8, description)
    with style():
        axes = picture.subplots()
        logs = np.log10(np.clip(errors, 1e-12, 1e9))
        shown = axes.pcolormesh(timeouts, np.asarray(retries), logs, cmap="cividis_r", shading="nearest")
        bar = picture.colorbar(shown, ax=axes, label="false station errors a year")
        ticks = np.arange(np.ceil(np.nanmin(logs)), np.floor(np.nanmax(logs)) + 1, 3)
        bar.set_ticks(ticks.tolist(), labels=[f"$10^{{{int(tick)}}}$" for tick in ticks])
        axes.grid(visible=False)
        handles = []
        if front:
            axes.plot(
                [at for _, at in front], [r for r, _ in front], "o", color="white", mec=GREY, markersize=5
            )
            handles.append(
                Line2D([], [], marker="o", color="white", mec=GREY, linestyle="", label="Pareto front")
            )
        if chosen is not None:
            label = f"recommended: D8179 = {chosen[0]}, D8180 = {chosen[1] / 10:g} ({chosen[1]:g} ms)"
            axes.plot([chosen[1]], [chosen[0]], "*", color=IN_ERROR, mec="black", markersize=15)
            handles.append(
                Line2D(
                    [], [], marker="*", color=IN_ERROR, mec="black", markersize=11, linestyle="", label=label
                )
            )
        axes.set_yticks(list(retries))
        axes.set_xscale("log")
        places = [float(t) for t in (20, 50, 100, 200, 500, 1000, 2000) if timeouts[0] <= t <= timeouts[-1]]
        axes.set_xticks(places, labels=[f"{place:g}" for place in places], minor=False)
        axes.set_xlim(timeouts[0] * 0.85, timeouts[-1])
        axes.set_xlabel("timeout D8180 (ms)")
        axes.set_ylabel("retries D8179")
        finish_picture(picture, f"Retries and timeout on {bus}", handles)
    return picture

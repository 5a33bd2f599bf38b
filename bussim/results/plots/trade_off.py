"""The trade-off of a sizing: what a dead station costs against false station errors, from plain numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from bussim.results.plots.style import (
    DISTRIBUTION,
    FAULT,
    GREY,
    IN_ERROR,
    SIMULATED,
    Picture,
    finish_picture,
    new_picture,
    style,
)
from bussim.wording import counted

#: Colours of the levels of noise, the lowest level first.
_COLOURS = (SIMULATED, FAULT, IN_ERROR)
#: Labels of the axis of errors by their rate a year.
_RATES = {
    1e-4: "1 in 10,000 years",
    1e-2: "1 in 100 years",
    1.0: "1 a year",
    365.0: "1 a day",
    8760.0: "1 an hour",
    525_600.0: "1 a minute",
    31_536_000.0: "1 a second",
}
_LOWEST = 1e-5


def trade_off_picture(
    bus: str,
    retries: Sequence[int],
    series: Mapping[str, Sequence[tuple[float, float]]],
    *,
    timeout: float,
    errors: float,
    dead: float | None,
    chosen: tuple[str, int] | None,
    description: str,
) -> Picture:
    """Mean link scan with a dead station (ms) against false station errors a year, a dot for each D8179.

    ``series`` has by the noise's name a point (ms, errors a year) for each of ``retries``, at most three
    names. ``errors`` and ``dead`` (ms, None for no such goal) bound the bands in which a goal is met;
    ``chosen`` is the recommended D8179 with the noise that it was chosen for, None for none; ``timeout``
    in ms.
    """
    picture = new_picture(7.5, 5.2, description)
    with style():
        axes = picture.subplots()
        axes.set_yscale("log")
        handles: list[Artist] = [
            _points(axes, name, retries, points, colour)
            for colour, (name, points) in zip(_COLOURS, series.items(), strict=False)
        ]
        handles.append(
            Line2D([], [], marker="o", color=GREY, markersize=9, linestyle="", label="number in a dot: D8179")
        )
        if chosen is not None:
            noise, best = chosen
            handles.append(_recommended(axes, best, dict(zip(retries, series[noise], strict=True)), timeout))
        _limits(axes, list(series.values()))
        handles.append(_goals(axes, errors, dead))
        axes.set_xlabel(f"mean link scan time with one station dead (ms), timeout {timeout:g} ms")
        axes.set_ylabel("false station errors")
        finish_picture(picture, f"What a dead station costs against false errors on {bus}", handles)
    return picture


def _points(
    axes: Axes, name: str, retries: Sequence[int], points: Sequence[tuple[float, float]], colour: str
) -> Line2D:
    """Dots with D8179 in them, joined by a line; the handle for the legend."""
    shown = [(x, y, r) for (x, y), r in zip(points, retries, strict=True) if y >= _LOWEST]
    x, y = [point[0] for point in shown], [point[1] for point in shown]
    axes.plot(x, y, "o-", color=colour, markersize=12, linewidth=1, zorder=3)
    for left, height, number in shown:
        axes.annotate(
            f"{number}", (left, height), ha="center", va="center", color="white", fontsize=8, zorder=4
        )
    return Line2D([], [], marker="o", color=colour, markersize=9, linewidth=1, label=name)


def _recommended(
    axes: Axes, retries: int, points: Mapping[int, tuple[float, float]], timeout: float
) -> Line2D:
    """A ring around the recommended dot, where that is shown; the handle for the legend."""
    x, y = points.get(retries, (math.nan, math.nan))
    if y >= _LOWEST:
        axes.plot([x], [y], "o", mfc="none", mec="black", mew=1.8, markersize=17, zorder=5)
    label = f"recommended: D8179 = {retries}, D8180 = {timeout / 10:g} ({timeout:g} ms)"
    return Line2D([], [], marker="o", mfc="none", mec="black", markersize=10, linestyle="", label=label)


def _goals(axes: Axes, errors: float, dead: float | None) -> Patch:
    """The bands in which the goals are met; the handle for the legend."""
    axes.axhspan(*_band(axes.get_ylim()[0], errors), color=DISTRIBUTION, alpha=0.12, linewidth=0)
    goals = f"at most {counted(errors, 'false station error')} a year"
    if dead is not None:
        axes.axvspan(*_band(axes.get_xlim()[0], dead), color=DISTRIBUTION, alpha=0.12, linewidth=0)
        goals += f"; at most {dead:g} ms with a dead station"
    return Patch(color=DISTRIBUTION, alpha=0.25, label=f"goal: {goals}")


def _limits(axes: Axes, series: Sequence[Sequence[tuple[float, float]]]) -> None:
    times = [x for points in series for x, y in points if y >= _LOWEST]
    margin = 0.06 * max(max(times, default=1.0) - min(times, default=0.0), 1.0)
    axes.set_xlim(min(times, default=0.0) - margin, max(times, default=1.0) + margin)
    top = max((y for points in series for _, y in points), default=1.0)
    axes.set_ylim(_LOWEST / 3, 10 ** (math.log10(max(top, 1.0)) + 0.7))
    axes.set_yticks(list(_RATES), labels=list(_RATES.values()))
    axes.minorticks_off()


def _band(low: float, high: float) -> tuple[float, float]:
    """From the axis's end to a goal; nothing where the goal lies below it."""
    return low, max(low, high)

"""The trade-off of a sizing: what a dead station costs against false station errors, from plain numbers."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

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
    drawn,
    finish_picture,
    new_picture,
    style,
)
from bussim.words.language import said_text, shown

#: Colours of the levels of noise, the lowest level first.
_COLOURS = (SIMULATED, FAULT, IN_ERROR)
#: Labels of the axis of errors by their rate a year.
_RATES = {
    1e-4: "10000_years",
    1e-2: "100_years",
    1.0: "year",
    365.0: "day",
    8760.0: "hour",
    525_600.0: "minute",
    31_536_000.0: "second",
}
_LOWEST = 1e-5


@drawn
def trade_off_picture(
    bus: str,
    retries: Sequence[int],
    series: Mapping[str, Sequence[tuple[float, float]]],
    *,
    timeout: float,
    errors: Sequence[float],
    dead: Sequence[tuple[float, float]],
    goals: Sequence[str],
    chosen: tuple[str, int] | None,
    more: bool,
    description: str,
) -> Picture:
    """Mean link scan with a dead station (ms) against false station errors a year, a dot for each D8179.

    ``series`` has by the noise's name a point (ms, errors a year) for each of ``retries``, at most three
    names. The bands in which the ``goals``, which are in words, are met reach up to each of ``errors``, and
    from and to each two scans (ms) of ``dead``; ``chosen`` is the recommended D8179 with the noise that it
    was chosen for, None for none; ``timeout`` in ms. ``more``: some stations are dead anyway.
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
            Line2D([], [], marker="o", color=GREY, markersize=9, linestyle="", label=said_text("plot_dots"))
        )
        times = [x for points in series.values() for x, y in points if y >= _LOWEST]
        if chosen is not None:
            noise, best = chosen
            point = dict(zip(retries, series[noise], strict=True))[best]
            handles.append(_recommended(axes, best, point, timeout))
            times.append(point[0])
        _limits(axes, times, [y for points in series.values() for _, y in points])
        handles.append(_goals(axes, errors, dead, goals))
        axes.set_xlabel(said_text("axis_dead_more" if more else "axis_dead", timeout=timeout))
        axes.set_ylabel(said_text("axis_errors"))
        finish_picture(picture, said_text("plot_trade", bus=bus), handles)
    return picture


def _points(
    axes: Axes, name: str, retries: Sequence[int], points: Sequence[tuple[float, float]], colour: str
) -> Line2D:
    """Dots with D8179 in them, joined by a line; the handle for the legend."""
    inside = [(x, y, r) for (x, y), r in zip(points, retries, strict=True) if y >= _LOWEST]
    x, y = [point[0] for point in inside], [point[1] for point in inside]
    axes.plot(x, y, "o-", color=colour, markersize=12, linewidth=1, zorder=3)
    for left, height, number in inside:
        axes.annotate(
            f"{number}", (left, height), ha="center", va="center", color="white", fontsize=8, zorder=4
        )
    return Line2D([], [], marker="o", color=colour, markersize=9, linewidth=1, label=shown(name))


def _recommended(axes: Axes, retries: int, point: tuple[float, float], timeout: float) -> Line2D:
    """A ring around the recommended dot, where it lies lower at the edge; the handle for the legend."""
    x, y = point
    ring: dict[str, Any] = {"mfc": "none", "mec": "black", "mew": 1.8, "markersize": 17, "zorder": 5}
    axes.plot([x], [max(y, _LOWEST)], "o", clip_on=False, **ring)
    if y < _LOWEST:
        axes.annotate(f"{retries}", (x, _LOWEST), ha="center", va="center", fontsize=8, zorder=6)
        note: dict[str, Any] = {"xytext": (13, 0), "textcoords": "offset points", "va": "center"}
        axes.annotate(said_text("plot_below"), (x, _LOWEST), fontsize=8, **note)
    label = said_text("plot_recommended", retries=retries, units=timeout / 10, timeout=timeout)
    return Line2D([], [], marker="o", mfc="none", mec="black", markersize=10, linestyle="", label=label)


def _goals(
    axes: Axes, errors: Sequence[float], dead: Sequence[tuple[float, float]], goals: Sequence[str]
) -> Patch:
    """The bands in which the goals are met; the handle for the legend."""
    band: dict[str, Any] = {"color": DISTRIBUTION, "alpha": 0.12, "linewidth": 0}
    for most in errors:
        axes.axhspan(*_band(axes.get_ylim(), 0.0, most), **band)
    for within in dead:
        axes.axvspan(*_band(axes.get_xlim(), *within), **band)
    return Patch(color=DISTRIBUTION, alpha=0.25, label=said_text("plot_goals", goals=list(map(shown, goals))))


def _limits(axes: Axes, times: Sequence[float], errors: Sequence[float]) -> None:
    margin = 0.06 * max(max(times, default=1.0) - min(times, default=0.0), 1.0)
    axes.set_xlim(min(times, default=0.0) - margin, max(times, default=1.0) + margin)
    top = max(errors, default=1.0)
    axes.set_ylim(_LOWEST / 3, 10 ** (math.log10(max(top, 1.0)) + 0.7))
    axes.set_yticks(list(_RATES), labels=[said_text(f"rate_{name}") for name in _RATES.values()])
    axes.minorticks_off()


def _band(axis: tuple[float, float], low: float, high: float) -> tuple[float, float]:
    """The part of an axis between two values; nothing where they lie outside of it."""
    start = min(max(axis[0], low), axis[1])
    return start, max(start, min(high, axis[1]))

"""Chosen devices over time: bits as lanes, words as steps."""

from collections.abc import Sequence
from itertools import groupby
from typing import Any

from matplotlib.axes import Axes
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator, StrMethodFormatter

from bussim.results.meters.watch import Watch, Watched
from bussim.results.plots.style import (
    GREY,
    PALETTE,
    SIMULATED,
    Picture,
    drawn,
    finish_picture,
    new_picture,
    shorten,
    style,
)
from bussim.units import seconds
from bussim.words.language import said_text

#: Height of a bit's lane and of a word's axes, in inches; and where there are so many that the picture
#: would become taller than the next figure.
_LANE, _STEPS = 0.32, 1.1
_LOW_LANE, _LOW_STEPS = 0.2, 0.55
_TALLEST = 20.0
#: From this height on the times stand above the axes as well.
_TALL = 8.0
_BETWEEN = 0.1
_SHADE: dict[str, Any] = {"color": GREY, "alpha": 0.2, "linewidth": 0}


def shown_devices(watched: Sequence[Watched]) -> int:
    """How many of these devices fit into a picture: the first so many."""
    height, number = 0.0, 0
    for group in _groups(watched):
        for each in group:
            height += _LOW_LANE if each.bit else _LOW_STEPS
            if height > _TALLEST:
                return number
            number += 1
        height += _BETWEEN if group[0].bit else 0
    return number


@drawn
def watch_picture(watch: Watch, begin: int, end: int, heading: str, about: str) -> Picture:
    """The devices of a watch from ``begin`` to ``end`` (ticks), in their order; neighbouring bits share axes.

    ``about`` names the scenario, seed and version. Of more devices than fit
    (:func:`shown_devices`) the first ones are shown, and the heading says so.
    """
    number, among = shown_devices(watch.watched), len(watch.watched)
    if number < among:
        heading = said_text("plot_first_of", heading=heading, number=number, among=among)
    groups = _groups(watch.watched[:number])
    heights = _heights(groups, _LANE, _STEPS)
    if sum(heights) > _TALLEST:
        low = _heights(groups, _LOW_LANE, _LOW_STEPS)
        part = max(0.0, (_TALLEST - sum(low)) / (sum(heights) - sum(low)))
        heights = [small + part * (tall - small) for small, tall in zip(low, heights, strict=True)]
    with style():
        picture = new_picture(9, sum(heights) + 1.1, about)
        rows = picture.subplots(len(groups), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
        for axes, group in zip(rows, groups, strict=True):
            if group[0].bit:
                _lanes(axes, group, begin, end)
            else:
                _steps(axes, group[0], begin, end)
        shown = {each.plc for group in groups for each in group}
        spans = [span for span in watch.without_supply(begin, end) if span[0] in shown]
        for axes, group in zip(rows, groups, strict=True):
            _shade(axes, group, spans)
        for axes in rows[:-1]:
            axes.tick_params(axis="x", labelbottom=False)
        if sum(heights) > _TALL:
            rows[0].tick_params(axis="x", top=True, labeltop=True)
        rows[-1].set_xlabel(said_text("axis_run"))
        rows[-1].set_xlim(seconds(begin), seconds(end))
        finish_picture(picture, heading, [Patch(label=said_text("without_supply"), **_SHADE)] * bool(spans))
    return picture


def _label(each: Watched) -> str:
    name = shorten(each.name, 24)
    return f"{name}\n{shorten(each.comment, 24)}" if each.comment else name


def _heights(groups: Sequence[Sequence[Watched]], lane: float, steps: float) -> list[float]:
    return [lane * len(group) + _BETWEEN if group[0].bit else steps for group in groups]


def _groups(watched: Sequence[Watched]) -> list[list[Watched]]:
    """Bits that stand next to each other share axes, a word has its own."""
    groups: list[list[Watched]] = []
    for bit, alike in groupby(watched, lambda each: each.bit):
        some = list(alike)
        groups += [some] if bit else [[word] for word in some]
    return groups


def _course(each: Watched, begin: int, end: int) -> tuple[list[float], list[int]]:
    """Times and values from one end of the axis to the other."""
    changes = each.between(begin, end)
    times = [seconds(begin), *(seconds(tick) for tick, _ in changes), seconds(end)]
    values = [each.at(begin), *(value for _, value in changes)]
    return times, [*values, values[-1]]


def _lanes(axes: Axes, group: list[Watched], begin: int, end: int) -> None:
    for lane, each in enumerate(group):
        times, values = _course(each, begin, end)
        low = lane + 0.35
        levels = [low - 0.7 * value for value in values]
        axes.step(times, levels, where="post", color=SIMULATED, linewidth=1.1)
        axes.fill_between(times, levels, low, step="post", color=SIMULATED, alpha=0.25, linewidth=0)
    axes.set_yticks(range(len(group)), [_label(each) for each in group])
    axes.set_ylim(len(group) - 0.4, -0.6)
    axes.grid(visible=False, axis="y")


def _shade(axes: Axes, group: list[Watched], spans: Sequence[tuple[str, int, int]]) -> None:
    """Shade when the PLCs of these devices had no supply: of bits the lane, of a word the axes."""
    for lane, each in enumerate(group):
        for plc, *span in spans:
            times = [seconds(tick) for tick in span]
            if plc == each.plc and each.bit:
                axes.fill_between(times, lane - 0.45, lane + 0.45, **_SHADE)
            elif plc == each.plc:
                axes.axvspan(*times, **_SHADE)


def _steps(axes: Axes, each: Watched, begin: int, end: int) -> None:
    times, values = _course(each, begin, end)
    axes.step(times, values, where="post", color=PALETTE[1], linewidth=1.1)
    low, high = min(values), max(values)
    margin = max(1, (high - low) * 0.05)  # a constant value is a line through the middle
    axes.set_ylim(low - margin, high + margin)
    ticks = 4 if axes.get_window_extent().height > 60 else 2
    axes.yaxis.set_major_locator(MaxNLocator(ticks, integer=True))
    axes.yaxis.set_major_formatter(StrMethodFormatter("{x:.0f}"))
    axes.set_ylabel(_label(each), rotation=0, ha="right", va="center")

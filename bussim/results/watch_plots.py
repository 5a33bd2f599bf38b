"""Chosen devices over time: bits as lanes, words as steps."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from bussim.results.style import PALETTE, SIMULATED, Picture, finish_picture, new_picture, shorten, style
from bussim.results.watch import Watch, Watched
from bussim.units import seconds

#: Height of a bit's lane and of a word's axes, in inches.
_LANE, _STEPS = 0.32, 1.1


def watch_picture(watch: Watch, begin: int, end: int, heading: str, about: str) -> Picture:
    """The devices of a watch from ``begin`` to ``end`` (ticks), in their order; neighbouring bits together.

    ``about`` is what the picture rests on.
    """
    groups = _groups(watch.watched)
    heights = [_LANE * len(group) + 0.1 if group[0].bit else _STEPS for group in groups]
    with style():
        picture = new_picture(9, sum(heights) + 1.1, about)
        rows = picture.subplots(len(groups), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
        for axes, group in zip(rows, groups, strict=True):
            if group[0].bit:
                _lanes(axes, group, begin, end)
            else:
                _steps(axes, group[0], begin, end)
        for axes in rows[:-1]:
            axes.tick_params(axis="x", labelbottom=False)
        rows[-1].set_xlabel("time of the run (s)")
        rows[-1].set_xlim(seconds(begin), seconds(end))
        finish_picture(picture, heading, [])
    return picture


def _groups(watched: tuple[Watched, ...]) -> list[list[Watched]]:
    """Bits that stand next to each other share axes, a word has its own."""
    groups: list[list[Watched]] = []
    for each in watched:
        if each.bit and groups and groups[-1][0].bit:
            groups[-1].append(each)
        else:
            groups.append([each])
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
    axes.set_yticks(range(len(group)), [shorten(each.name, 24) for each in group])
    axes.set_ylim(len(group) - 0.4, -0.6)
    axes.grid(visible=False, axis="y")


def _steps(axes: Axes, each: Watched, begin: int, end: int) -> None:
    times, values = _course(each, begin, end)
    axes.step(times, values, where="post", color=PALETTE[1], linewidth=1.1)
    axes.yaxis.set_major_locator(MaxNLocator(4, integer=True))
    axes.set_ylabel(shorten(each.name, 24), rotation=0, ha="right", va="center")

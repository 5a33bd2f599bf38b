"""Pictures of a sweep: lines with error bands over one key, heat maps over two."""

from collections.abc import Mapping, Sequence
from math import isfinite, log10, nan
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from bussim.results.plots.style import (
    DISTRIBUTION,
    GREY,
    SIMULATED,
    Picture,
    finish_picture,
    new_picture,
    shorten,
    style,
)
from bussim.results.store.safe_names import file_names
from bussim.sweep.figures import SHOWN, kinds_in
from bussim.sweep.intervals import TOO_FEW, footnotes, with_interval
from bussim.sweep.plan import Plan
from bussim.sweep.tables import HIGH, LOW, Table, at_point, mean_at
from bussim.sweep.vary import Axis
from bussim.units import seconds
from bussim.version import __version__
from bussim.wording import counted

#: Left out of the four panels of a picture where there are more figures.
_ONLY_IN_TABLES = ("station_error_onsets", "ms.p95")
#: What is drawn beside a figure, over one key.
_BOUNDS = {"ms.max": "bound_ms.no error"}
#: Values over so many decades get a logarithmic axis or colour.
_DECADES = 2
_MOST_TICKS = 12
#: Heat maps with at most so many columns have the number written in each cell.
_MOST_WRITTEN = 10
_MOST_SHAPES = 1000
_LONGEST_TICK, _LONGEST_NUMBER = 14, 6
_WIDE, _HIGH = 3.8, 2.4  # a panel in inches
_MAP = "viridis"
#: Where the repeats are too few: the least run, the mean and the greatest run; in a cell without a number.
_HOLLOW: Any = {"c": SIMULATED, "ls": ":", "lw": 1, "marker": "o", "mfc": "w", "markevery": [1], "zorder": 3}
_NO_LINE: Any = {"ls": ""}
_DOT: Any = {"ls": "", "marker": "o", "ms": 2.5, "mfc": "white", "mec": "black", "mew": 0.5}


def draw(plan: Plan, runs: Table, points: Table, folder: Path) -> list[Path]:
    """Draw every N:N link, Modbus master and latency of a sweep over one key or two.

    The files are ``sweep_<name>.png`` and ``.svg``. ``runs`` and ``points`` are the tables of
    :mod:`bussim.sweep.tables`. A sweep over more keys has no picture. Returns the paths.
    """
    if len(plan.axes) > 2:
        return []
    paths: list[Path] = []
    for bus, stem in file_names(kinds_in(points, [bus.name for bus in plan.base.buses])).items():
        shape = heat_maps if len(plan.axes) == 2 else lines
        paths += shape(plan, runs, points, bus).save_both(folder / f"sweep_{stem}")
    return paths


def lines(plan: Plan, runs: Table, points: Table, bus: str) -> Picture:
    """The means of a link's, master's or latency's figures over one key, with 95 % confidence intervals.

    Where the repeats are too few the dot is hollow, and the least and the greatest run are its limits. With
    the longest latency goes what it may be at worst without error.
    """
    axis = plan.axes[0]
    positions, logarithmic = _positions(axis)
    bounded, few = False, False
    with style():
        picture = _new(plan)
        for panel, figure in _panels(picture, points, bus):
            column = f"{bus}.{figure}"
            mean, low, high = (_numbers(points[column + ending]) for ending in ("", LOW, HIGH))
            line = "-" if axis.unit is not None else ""  # nothing lies between two texts
            panel.plot(
                positions, mean, color=SIMULATED, marker="o", markersize=3.5, linestyle=line, clip_on=False
            )
            for point, at in enumerate(positions):
                if mean_at(points, column, point).too_few(plan.repeat):
                    seen = _numbers(at_point(plan, runs[column], point))
                    panel.plot([at] * 3, [min(seen), mean[point], max(seen)], **_HOLLOW)
                    low[point], high[point], few = nan, nan, True
            bound = _numbers(points.get(f"{bus}.{_BOUNDS.get(figure)}", []))
            if any(map(isfinite, bound)):
                panel.plot(positions, bound, color=DISTRIBUTION, linestyle=line, marker="_", clip_on=False)
                bounded = True
            # The lines show what a band cannot: a point whose neighbours have no interval.
            panel.vlines(positions, low, high, color=SIMULATED, linewidth=1)
            if line:
                panel.fill_between(positions, low, high, color=SIMULATED, alpha=0.25, linewidth=0)
            if logarithmic:
                panel.set_xscale("log")
            elif positions == list(range(len(positions))):
                _label_positions(panel, axis, "x")
                panel.set_xlim(-0.5, len(positions) - 0.5)
            elif all(float(position).is_integer() for position in positions):
                panel.xaxis.set_major_locator(MaxNLocator(integer=True))
            if not any(mean):
                panel.set_ylim(0, 1)  # an axis of nothing would show hundredths of an event
            elif min((value for value in (*mean, *low) if isfinite(value)), default=0) >= 0:
                panel.set_ylim(bottom=max(0, panel.get_ylim()[0]))
            panel.set_xlabel(_axis_label(picture, axis, _WIDE))
        key = _line_key(plan, band=axis.unit is not None, bounded=bounded, few=few)
        finish_picture(picture, _heading(plan, bus), key)
    return picture


def heat_maps(plan: Plan, runs: Table, points: Table, bus: str) -> Picture:
    """The means of figures as of :func:`lines` over two keys: the first to the right, the second upwards."""
    across, up = plan.axes
    numbered = len(across.values) <= _MOST_WRITTEN and len(up.values) <= 2 * _MOST_WRITTEN
    written = ""
    with style():
        picture = _new(plan)
        for panel, figure in _panels(picture, points, bus):
            column = f"{bus}.{figure}"
            means = _numbers(points[column])
            found = [mean_at(points, column, point) for point in range(len(means))]
            height = len(up.values)
            # The last key changes fastest in the table.
            rows = [means[row::height] for row in range(height)]
            colours = _colours(means)
            panel.grid(visible=False)
            panel.set_facecolor("#e4e4e4")  # of cells without a number
            many = len(means) > _MOST_SHAPES  # an SVG of thousands of squares is slow to show
            mesh = panel.pcolormesh(rows, cmap=_MAP, norm=colours, rasterized=many)
            picture.colorbar(mesh, ax=panel)
            texts = [with_interval(mean, at_point(plan, runs[column], at)) for at, mean in enumerate(found)]
            written += "".join(texts)
            if numbered:
                _write(panel, texts, rows, colours)
            else:
                few = [divmod(at, height) for at, mean in enumerate(found) if mean.too_few(plan.repeat)]
                panel.plot([x + 0.5 for x, _ in few], [y + 0.5 for _, y in few], **_DOT)
            _label_positions(panel, across, "x", 0.5)
            _label_positions(panel, up, "y", 0.5)
            panel.set_xlabel(_axis_label(picture, across, _WIDE))
            panel.set_ylabel(_axis_label(picture, up, _HIGH))
        finish_picture(picture, _heading(plan, bus), _map_key(plan, written, _NO_LINE if numbered else _DOT))
    return picture


def _new(plan: Plan) -> Picture:
    base = plan.base
    about = (
        f"{base.name}, seed {base.seed}{' at every point' if plan.common_random_numbers else ''}, "
        f"{seconds(base.duration):g} s, {counted(plan.runs, 'run')}, bussim {__version__}"
    )
    return new_picture(10.5, 8, about)


def _panels(picture: Picture, points: Table, bus: str) -> list[tuple[Axes, str]]:
    panels = SHOWN[kinds_in(points, [bus])[bus]]
    if len(panels) > 4:
        panels = {figure: title for figure, title in panels.items() if figure not in _ONLY_IN_TABLES}
    grid = picture.subplots(2, 2).flatten()
    for panel, title in zip(grid, panels.values(), strict=True):
        panel.set_title(title)
    shown = []
    for panel, figure in zip(grid, panels, strict=True):
        if any(value is not None for value in points.get(f"{bus}.{figure}", [])):
            shown.append((panel, figure))
        else:
            panel.set_axis_off()
            panel.text(0.5, 0.5, "not known at any point", ha="center", color=GREY, transform=panel.transAxes)
    return shown


def _numbers(column: Sequence[object]) -> list[float]:
    return [float(value) if isinstance(value, int | float) else nan for value in column]


def _positions(axis: Axis) -> tuple[list[float], bool]:
    """Where the values of an axis lie on it, and whether it is logarithmic.

    Texts, and numbers over many decades with a 0 among them, lie side by side.
    """
    numbers = [value.number for value in axis.values if value.number is not None]
    side_by_side: list[float] = list(range(len(axis.values)))
    if axis.unit is None:
        return side_by_side, False
    sizes = [abs(number) for number in numbers if number]
    far = bool(sizes) and log10(max(sizes)) - log10(min(sizes)) >= _DECADES
    if far and min(numbers) <= 0:
        return side_by_side, False
    return [float(number) for number in numbers], far


def _label_positions(panel: Axes, axis: Axis, side: str, offset: float = 0.0) -> None:
    """The values of an axis as labels of positions 0, 1, 2…, as many as there is room for."""
    step = -(-len(axis.values) // _MOST_TICKS)
    chosen = range(0, len(axis.values), step)
    texts = [_tick(axis, index) for index in chosen]
    ticks = [index + offset for index in chosen]
    if side == "y":
        panel.set_yticks(ticks, texts)
        return
    crowded = sum(map(len, texts)) > 44
    panel.set_xticks(ticks, texts, rotation=35 if crowded else 0, ha="right" if crowded else "center")


def _tick(axis: Axis, index: int) -> str:
    value = axis.values[index]
    if value.number is not None and (axis.unit or len(value.text) > _LONGEST_NUMBER):
        return f"{value.number:.3g}" if abs(value.number) < 1000 else f"{value.number:g}"
    return shorten(value.text, _LONGEST_TICK)


def _axis_label(picture: Picture, axis: Axis, inches: float) -> str:
    return picture.wrapped(axis.key + (f" ({axis.unit})" if axis.unit else ""), 10, inches)


def _colours(values: Sequence[float]) -> Normalize:
    known = [value for value in values if isfinite(value)]
    low, high = min(known), max(known)
    if low > 0 and log10(high) - log10(low) >= _DECADES:
        return LogNorm(low, high)
    # matplotlib widens a range without a width by itself, but to a negative one.
    return Normalize(low, high if high > low else low + 1)


def _write(panel: Axes, texts: Sequence[str], rows: Sequence[Sequence[float]], colours: Normalize) -> None:
    """Write into each cell its text, on lines that are short."""
    size = 8 if max(len(rows), len(rows[0])) <= 6 else 6.5
    for point, text in enumerate(texts):
        x, y = divmod(point, len(rows))
        dark = isfinite(rows[y][x]) and float(colours(rows[y][x])) < 0.6
        lines = text.replace(" ± ", "\n± ").replace("–", "–\n").strip()
        colour = "white" if dark else "black"
        panel.text(x + 0.5, y + 0.5, lines, ha="center", va="center", size=size, color=colour)


def _heading(plan: Plan, bus: str) -> str:
    return f"{plan.title}: {bus} over {' and '.join(axis.key for axis in plan.axes)}"


def _line_key(plan: Plan, *, band: bool, bounded: bool, few: bool) -> list[Line2D | Patch]:
    bound = (
        [Line2D([], [], color=DISTRIBUTION, marker="_", label="at worst with no error")] if bounded else []
    )
    if plan.repeat == 1:
        return [Line2D([], [], color=SIMULATED, marker="o", label="one run a point, spread unknown"), *bound]
    label = "95 % confidence interval of the mean"
    if few:
        (text,) = footnotes(TOO_FEW, plan.repeat)
        bound.append(Line2D([], [], label=text.removeprefix(TOO_FEW).strip(), **_HOLLOW | {"markevery": 1}))
    return [
        Line2D([], [], color=SIMULATED, marker="o", label=f"mean of {plan.repeat} runs"),
        Patch(color=SIMULATED, alpha=0.25, label=label)
        if band
        else Line2D([], [], color=SIMULATED, linewidth=1, label=label),
        *bound,
    ]


def _map_key(plan: Plan, written: str, dot: Mapping[str, Any]) -> list[Line2D]:
    if plan.repeat == 1:
        return [Line2D([], [], linestyle="", label="one run a point, spread unknown")]
    labels = [f"means of {plan.repeat} runs a point ± half of the 95 % confidence interval"]
    labels += footnotes(written, plan.repeat)
    return [Line2D([], [], label=text, **(dot if TOO_FEW in text else _NO_LINE)) for text in labels]

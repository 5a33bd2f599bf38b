"""The picture of a sizing's trade-off."""

from __future__ import annotations

import math

from matplotlib.patches import Rectangle
from matplotlib.text import Annotation

from bussim.results.plots.style import Picture
from bussim.results.plots.trade_off import trade_off_picture

#: Points that fall by a thousand for each retry, at three levels of noise.
SERIES = {
    name: [(100.0 + 50 * retries, level * 10.0 ** (6 - 3 * retries)) for retries in range(5)]
    for name, level in (("low", 1.0), ("middle", 10.0), ("high", 100.0))
}


def drawn(
    chosen: tuple[str, int] | None = ("low", 2), dead: tuple[float, float] | None = (0.0, 250.0)
) -> Picture:
    bands = [] if dead is None else [dead]
    return trade_off_picture(
        "link",
        range(5),
        SERIES,
        timeout=50,
        errors=[1.0, 20.0],
        dead=bands,
        goals=["at most 1 a year", "at most 250 ms"],
        chosen=chosen,
        more=False,
        description="a test",
    )


def test_each_dot_has_its_number_and_lies_at_its_figures() -> None:
    (axes,) = drawn().axes
    dots = {(note.xy, note.get_text()) for note in axes.texts if isinstance(note, Annotation)}
    for points in SERIES.values():
        for retries, point in enumerate(points):
            assert ((point, str(retries)) in dots) == (point[1] >= 1e-5)
    low, high = axes.get_ylim()
    assert all(low < y < high for (_, y), _ in dots)


def test_the_recommended_dot_has_a_ring() -> None:
    (axes,) = drawn().axes
    rings = [line for line in axes.lines if line.get_markerfacecolor() == "none"]
    assert [(ring.get_xdata(), ring.get_ydata()) for ring in rings] == [([200.0], [1.0])]
    assert not [line for line in drawn(None).axes[0].lines if line.get_markerfacecolor() == "none"]


def test_a_recommended_dot_that_lies_lower_is_shown_at_the_edge() -> None:
    (axes,) = drawn(("low", 4)).axes  # one error in a million years
    (ring,) = [line for line in axes.lines if line.get_markerfacecolor() == "none"]
    assert (ring.get_xdata(), ring.get_ydata()) == ([300.0], [1e-5])
    said = [
        note.get_text() for note in axes.texts if isinstance(note, Annotation) and note.xy == (300.0, 1e-5)
    ]
    assert said == ["4", "lies below"]
    low, high = axes.get_xlim()
    assert low < 300 < high


def test_the_goals_are_bands_from_the_axes_to_their_limits() -> None:
    (axes,) = drawn().axes
    errors, onsets, dead = (patch for patch in axes.patches if isinstance(patch, Rectangle))
    assert [band.get_y() + band.get_height() for band in (errors, onsets)] == [1, 20]
    assert dead.get_x() + dead.get_width() == 250
    assert len(drawn(dead=None).axes[0].patches) == 2
    (axes,) = drawn(dead=(170.0, math.inf)).axes  # an interruption that must pass
    ride = axes.patches[2]
    assert isinstance(ride, Rectangle)
    assert (ride.get_x(), ride.get_x() + ride.get_width()) == (170.0, axes.get_xlim()[1])


def test_a_goal_that_nothing_reaches_has_an_empty_band() -> None:
    for within in ((0.0, 10.0), (math.inf, math.inf)):
        (axes,) = drawn(dead=within).axes
        dead = axes.patches[2]
        assert isinstance(dead, Rectangle)
        assert dead.get_width() == 0
        assert dead.get_x() in axes.get_xlim()


def test_the_legend_names_the_setting_and_the_goals() -> None:
    (legend,) = drawn().legends
    texts = [text.get_text() for text in legend.get_texts()]
    assert texts[:3] == ["low", "middle", "high"]
    assert "recommended: D8179 = 2, D8180 = 5 (50 ms)" in texts
    assert "goals, all met where all bands cross: at most 1 a year; at most 250 ms" in texts

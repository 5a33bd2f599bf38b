from __future__ import annotations

import random
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh

from bussim.results.plots.style import DISTRIBUTION, Picture
from bussim.sweep.figures import SHOWN
from bussim.sweep.plan import Plan
from bussim.sweep.plots import draw, heat_maps, lines
from bussim.sweep.tables import Table, points_table, runs_table
from tests.results.plots.test_scan_times import assert_legible, has
from tests.sweep.samples import BER, RETRIES, TIMEOUT, noisy

PANELS = SHOWN["link"]


def results(plan: Plan, *, rare: bool = False) -> tuple[Table, Table]:
    """The runs and the points, with a known law: the mean scan time is 40 + 2·(number of the point), give or take 1 ms."""
    rng = random.Random(1)

    def figures(run: int) -> dict[str, Any]:
        point, _ = plan.point_of(run)
        return {
            "link.scans": 100,
            "link.scan_time_mean_ms": 40 + 2 * point + rng.uniform(-1, 1),
            "link.scan_time_max_ms": None if point == 1 else 90 + point**2,
            "link.station_errors": 0 if rare else point,
            "link.refresh_gap_max_ms": None if rare else 200 + rng.uniform(-50, 50),
        }

    return tables(plan, figures)


def tables(plan: Plan, figures: Callable[[int], dict[str, Any]]) -> tuple[Table, Table]:
    runs = runs_table(plan, ((run, figures(run)) for run in range(plan.runs)))
    return runs, points_table(plan, runs)


def panels(picture: Picture) -> dict[str, Axes]:
    return {axes.get_title("left"): axes for axes in picture.axes if axes.get_title("left")}


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    return noisy(tmp_path)


@pytest.mark.slow
def test_a_heat_map_has_each_mean_at_its_point(scenario: Path) -> None:
    plan = Plan(scenario, [f"{RETRIES}=0:3:1", f"{TIMEOUT}=50ms:70ms:10ms"], repeat=3)
    runs, points = results(plan)
    picture = heat_maps(plan, runs, points, "link")
    axes = panels(picture)
    assert set(axes) == set(PANELS.values()) - {PANELS["station_error_onsets"]}
    mean = axes[PANELS["scan_time_mean_ms"]]
    mesh = next(artist for artist in mean.collections if isinstance(artist, QuadMesh))
    cells = mesh.get_array()
    assert cells is not None
    assert cells.shape == (3, 4)
    for x in range(4):
        for y in range(3):
            assert cells[y][x] == points["link.scan_time_mean_ms"][3 * x + y]
    assert [text.get_text() for text in mean.get_xticklabels()] == ["0", "1", "2", "3"]
    assert [text.get_text() for text in mean.get_yticklabels()] == ["50", "60", "70"]
    assert (mean.get_xlabel(), mean.get_ylabel()) == (RETRIES, f"{TIMEOUT} (ms)")
    assert has(picture, "means of 3 runs a point")
    assert has(picture, "36 runs")
    scans = [text.get_text() for text in mean.texts]
    assert all(re.fullmatch(r"\d\d(\.\d+)?\n± \d(\.\d+)?", text) for text in scans), scans
    gaps = [text.get_text() for text in axes[PANELS["refresh_gap_max_ms"]].texts]
    assert any(re.fullmatch(r"\d+\.\d\d–\n\d+\.\d\d\*", text) for text in gaps)
    assert has(picture, "* least and greatest run: 3 repeats are too few for a mean within ±10 %")
    errors = [text.get_text() for text in axes[PANELS["station_errors"]].texts]
    assert errors[0] == "0°"
    assert has(picture, "° in none of 3 runs; with 95 % confidence in at most 64 % of all")
    assert has(picture, "–")  # the point whose longest scan is not known
    assert_legible(picture)


@pytest.mark.slow
def test_a_large_heat_map_is_legible(scenario: Path) -> None:
    plan = Plan(scenario, [f"{TIMEOUT}=50ms:1000ms:10ms", f"{BER}=1e-6:1e-3:log31"])
    runs, points = results(plan, rare=True)
    picture = heat_maps(plan, runs, points, "link")
    assert_legible(picture)
    assert has(picture, "not known at any point")
    longest = panels(picture)[PANELS["scan_time_max_ms"]]
    mesh = next(artist for artist in longest.collections if isinstance(artist, QuadMesh))
    assert type(mesh.norm).__name__ == "LogNorm"


def test_a_line_with_its_band(scenario: Path) -> None:
    plan = Plan(scenario, [f"{RETRIES}=0:5:1"], repeat=4)
    runs, points = results(plan)
    picture = lines(plan, runs, points, "link")
    mean = panels(picture)[PANELS["scan_time_mean_ms"]]
    assert list(mean.lines[0].get_xdata()) == [0, 1, 2, 3, 4, 5]
    assert list(mean.lines[0].get_ydata()) == points["link.scan_time_mean_ms"]
    low, high = mean.collections[0].get_paths()[3].vertices[:, 1]
    assert (low, high) == (points["link.scan_time_mean_ms_low"][3], points["link.scan_time_mean_ms_high"][3])
    assert has(picture, "mean of 4 runs")
    assert has(picture, "95 % confidence interval of the mean")
    assert_legible(picture)


def test_where_repeats_are_too_few_there_is_no_interval(scenario: Path) -> None:
    plan = Plan(scenario, [f"{RETRIES}=0:2:1"], repeat=3)
    longest = {0: (50.0, 50.1, 50.2), 1: (50.0, 60.0, 140.0), 2: (60.0, 60.0, 60.0)}

    def figures(run: int) -> dict[str, Any]:
        point, repeat = plan.point_of(run)
        errors = {"link.station_errors": 2 * repeat if point == 2 else 0}
        return {"link.scans": 100, "link.scan_time_max_ms": longest[point][repeat - 1], **errors}

    runs, points = tables(plan, figures)
    picture = lines(plan, runs, points, "link")
    panel = panels(picture)[PANELS["scan_time_max_ms"]]
    hollow = [line for line in panel.lines if line.get_markerfacecolor() == "w"]
    assert [(list(line.get_xdata()), list(line.get_ydata())) for line in hollow] == [
        ([1, 1, 1], [50.0, pytest.approx(250 / 3), 140.0])
    ]
    assert list(panel.lines[0].get_ydata()) == pytest.approx([50.1, 250 / 3, 60.0])
    shown = [path.vertices[:, 1] for path in panel.collections[0].get_paths() if len(path.vertices)]
    assert sum(bool(np.isfinite(limits).all()) for limits in shown) == 2
    assert has(picture, "least and greatest run: 3 repeats are too few for a mean within ±10 %")
    assert panel.get_xticks().tolist() == [tick for tick in panel.get_xticks().tolist() if tick == int(tick)]
    assert_legible(picture)


@pytest.mark.slow
def test_long_keys_cover_nothing(tmp_path: Path) -> None:
    name = "一台名字很长的压机它的名字由很有时间的人写成"
    path = noisy(tmp_path)
    text = (
        path.read_text(encoding="utf-8")
        .replace("name: press\n", f"name: {name}\n")
        .replace("name: noisy pair", f"name: {name * 3}")
    )
    assert name in text
    path.write_text(text, encoding="utf-8")
    keys = [f"plcs.{name}.nn.retries=0:3:1", f"plcs.{name}.nn.timeout=50ms:70ms:10ms"]
    two, one = Plan(path, keys, repeat=3), Plan(path, keys[:1], repeat=3)
    assert_legible(heat_maps(two, *results(two), "link"))
    assert_legible(lines(one, *results(one), "link"))


def test_an_axis_of_events_that_never_occurred_goes_to_one(scenario: Path) -> None:
    plan = Plan(scenario, [f"{RETRIES}=0,1"], repeat=2)
    picture = lines(plan, *results(plan, rare=True), "link")
    assert panels(picture)[PANELS["station_errors"]].get_ylim() == (0, 1)


def test_a_large_heat_map_marks_where_repeats_are_too_few(scenario: Path) -> None:
    plan = Plan(scenario, [f"{TIMEOUT}=50ms:150ms:10ms", f"{RETRIES}=0,1"], repeat=3)

    def figures(run: int) -> dict[str, Any]:
        point, repeat = plan.point_of(run)
        return {"link.scans": 100, "link.scan_time_max_ms": 50.0 + 40 * repeat * (point == 5)}

    runs, points = tables(plan, figures)
    picture = heat_maps(plan, runs, points, "link")
    panel = panels(picture)[PANELS["scan_time_max_ms"]]
    assert not panel.texts
    (dots,) = panel.lines
    assert (list(dots.get_xdata()), list(dots.get_ydata())) == ([2.5], [1.5])
    assert has(picture, "* least and greatest run: 3 repeats are too few")


def test_the_axis_of_a_line_fits_its_values(scenario: Path) -> None:
    def axes_of(vary: str) -> Axes:
        plan = Plan(scenario, [vary])
        picture = lines(plan, *results(plan), "link")
        return panels(picture)[PANELS["scan_time_mean_ms"]]

    assert axes_of(f"{BER}=1e-6:1e-3:log7").get_xscale() == "log"
    assert axes_of(f"{TIMEOUT}=50ms:2s:10ms").get_xscale() == "linear"
    with_zero = axes_of(f"{BER}=0,1e-6,1e-5,1e-3")
    assert [text.get_text() for text in with_zero.get_xticklabels()] == ["0", "1e-6", "1e-5", "1e-3"]
    texts = axes_of("plcs.press.profile=pw10,{base: pw10}")
    assert [text.get_text() for text in texts.get_xticklabels()] == ["pw10", "{base: pw10}"]
    assert texts.lines[0].get_linestyle() == "None"  # nothing lies between two texts


def test_a_picture_of_each_kind_for_one_key_or_two(scenario: Path, tmp_path: Path) -> None:
    plan = Plan(scenario, [f"{RETRIES}=0,1"])
    paths = draw(plan, *results(plan), tmp_path)
    assert [path.name for path in paths] == ["sweep_link.png", "sweep_link.svg"]
    assert paths[0].read_bytes().startswith(b"\x89PNG")
    assert b"<svg" in paths[1].read_bytes()
    three = Plan(scenario, [f"{RETRIES}=0,1", f"{BER}=0,1", "seed=1,2"])
    assert draw(three, *results(three), tmp_path) == []


@pytest.mark.slow
def test_a_modbus_master_has_a_picture_of_its_own(scenario: Path, tmp_path: Path) -> None:
    rng = random.Random(2)

    def figures(run: int) -> dict[str, Any]:
        return {
            "link.scans": 100,
            "link.scan_time_mean_ms": 40 + rng.random(),
            "press.COM3.transactions": 100,
            "press.COM3.response_ms.mean": 40 + rng.random(),
            "press.COM3.response_ms.max": 60 + rng.random(),
            "press.COM3.timeouts": run,
            "press.COM3.polls.transactions.transactions": 3,
        }

    for vary in ([f"{RETRIES}=0:4:1"], [f"{RETRIES}=0:3:1", f"{TIMEOUT}=50ms:70ms:10ms"]):
        plan = Plan(scenario, vary, repeat=2)
        runs, points = tables(plan, figures)
        paths = draw(plan, runs, points, tmp_path)
        assert {path.stem for path in paths} == {"sweep_link", "sweep_press.COM3"}
        picture = (lines if len(vary) == 1 else heat_maps)(plan, runs, points, "press.COM3")
        assert set(panels(picture)) == set(SHOWN["Modbus master"].values())
        assert has(picture, "not known at any point")  # the poll cycle
        assert_legible(picture)


@pytest.mark.slow
def test_latencies_have_pictures_of_their_own(scenario: Path, tmp_path: Path) -> None:
    rng = random.Random(3)

    def figures(run: int) -> dict[str, Any]:
        times = {"p50": 40 + rng.random(), "p95": 50 + rng.random(), "p99": None, "max": 60 + rng.random()}
        found: dict[str, Any] = {"link.scans": 100, "link.scan_time_mean_ms": 40 + rng.random()}
        for name in ("latency.door", "latency.age"):
            found |= {f"{name}.delivered": 90, **{f"{name}.ms.{key}": time for key, time in times.items()}}
        found |= {"latency.door.lost": run, "latency.door.lost_share": run / 100}
        return found | {"latency.door.bound_ms.no error": 70.5}

    for vary in ([f"{RETRIES}=0:4:1"], [f"{RETRIES}=0:3:1", f"{TIMEOUT}=50ms:70ms:10ms"]):
        plan = Plan(scenario, vary, repeat=2)
        runs, points = tables(plan, figures)
        paths = draw(plan, runs, points, tmp_path)
        assert {path.stem for path in paths} == {"sweep_link", "sweep_latency.door", "sweep_latency.age"}
        for name, expected in (("latency.door", "latency"), ("latency.age", "data age")):
            picture = (lines if len(vary) == 1 else heat_maps)(plan, runs, points, name)
            drawn = {
                title
                for figure, title in SHOWN[expected].items()
                if expected != "latency" or figure != "ms.p95"
            }
            assert set(panels(picture)) == drawn
            assert has(picture, "not known at any point")  # p99
            assert_legible(picture)
    plan = Plan(scenario, [f"{RETRIES}=0:4:1"], repeat=2)
    runs, points = tables(plan, figures)
    picture = lines(plan, runs, points, "latency.door")
    share = panels(picture)[SHOWN["latency"]["lost_share"]]
    assert list(share.lines[0].get_ydata()) == pytest.approx([0.005, 0.025, 0.045, 0.065, 0.085])
    bounds = [
        line for line in panels(picture)[SHOWN["latency"]["ms.max"]].lines if line.get_color() == DISTRIBUTION
    ]
    assert [list(line.get_ydata()) for line in bounds] == [[70.5] * 5]
    assert has(picture, "at worst with no error")
    assert not has(lines(plan, runs, points, "latency.age"), "at worst with no error")

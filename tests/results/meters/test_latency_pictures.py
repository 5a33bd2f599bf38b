"""Latencies of runs in their folders, and drawn."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

import bussim
from bussim.errors import UsageError
from bussim.report.latency import in_words
from bussim.results.meters.latency_record import LatencyRecord, Sample
from bussim.results.plots.latency import latency_picture, measured
from bussim.results.plots.style import DISTRIBUTION, GREY, RUNS
from bussim.results.run_record import RunRecord
from bussim.results.summary.latency import LatencyBounds, latency_summary
from bussim.results.text.latency import caveats, latency_lines
from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND
from tests.results.plots.test_scan_times import assert_legible, has

# -- what a run shows of it ----------------------------------------------------------------------------


def ms(number: float) -> int:
    return round(number * TICKS_PER_MS)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "run"
    bussim.run(bussim.load("counter_preset", ["duration=6 s"]), out=folder).save_plots()
    return folder


def test_a_runs_folder_has_its_latencies(folder: Path) -> None:
    again = bussim.open_run(folder)
    full, preset = again.summary["latency"].values()
    assert (full["from"], full["to"], full["edge"]) == ("packer.M1064", "line.Y0", "rising")
    assert full["changes"] == full["delivered"] == 2
    assert preset["edge"] is None
    assert preset["delivered"] > 500
    for entry in (full, preset):
        mean = sum(part["mean"] for part in entry["parts_ms"].values())
        assert mean == pytest.approx(entry["ms"]["mean"], abs=1e-4)
        assert entry["ms"]["max"] <= entry["bound_ms"]["no error"] < entry["bound_ms"]["1 lost reply"]
    assert measured(again.record) == ["full-box", "preset"]
    for name in ("latency_full-box", "latency_preset"):
        for ending in (".png", ".svg"):
            assert (folder / f"{name}{ending}").stat().st_size > 10_000
    # The scenario that it leaves needs no other file.
    bussim.load(folder / "scenario.yaml")


def test_the_picture_names_what_there_is(folder: Path) -> None:
    record: RunRecord = bussim.open_run(folder).record
    with pytest.raises(UsageError, match="has no latency 'no'; it has 'full-box', 'preset'"):
        latency_picture([record], "no")
    record.latency["empty"] = LatencyRecord("a.X0", "b.Y0", "both", inverted=False, word=False)
    with pytest.raises(UsageError, match="nothing was measured of empty"):
        latency_picture([record], "empty")
    picture = bussim.open_run(folder).plot_latency()
    assert "full-box, packer.M1064 to line.Y0" in picture.title  # type: ignore[attr-defined]


def made(name: str, latencies: list[int], parts: tuple[int, ...], bounds: dict[str, float]) -> RunRecord:
    """A run with one latency; ``parts`` (ms) are those of each sample, the last of them fills up."""
    record = LatencyRecord("a.X0", "b.Y0", "both", inverted=False, word=False)
    for number, latency in enumerate(latencies):
        record.changes += 1
        ticks = [part * TICKS_PER_MS for part in parts]
        record.add(Sample(number, (*ticks, latency * TICKS_PER_MS - sum(ticks))))
    summary = latency_summary(
        record, LatencyBounds({case: round(ms * TICKS_PER_MS) for case, ms in bounds.items()})
    )
    about = {"scenario": name, "seed": 1, "duration_s": 1, "bussim": "0", "latency": {"door": summary}}
    return RunRecord(about, TICKS_PER_SECOND, {}, latency={"door": record})


BOUNDS = {"no error": 60.0, "1 lost reply": 90.0, "2 lost replies": 120.0, "every retry spent": 500.0}


def upright(axes: Axes, colour: str) -> list[float]:
    """Where lines of a colour stand."""
    lines = [line for line in axes.get_lines() if line.get_color() == colour]
    return [float(np.asarray(line.get_xdata())[0]) for line in lines]


def widths(axes: Axes) -> list[list[float]]:
    """The widths (ms) of the parts of each bar, from above to below."""
    found: dict[float, list[float]] = {}
    for patch in axes.patches:
        assert isinstance(patch, Rectangle)
        found.setdefault(round(patch.get_y(), 3), []).append(patch.get_width())
    return [found[y] for y in sorted(found)]


def test_bounds_are_marked_up_to_the_first_that_nothing_goes_beyond() -> None:
    picture = latency_picture([made("one", [30, 40, 95], (10, 5, 8, 2), BOUNDS)], "door")
    for axes in picture.axes:
        assert upright(axes, DISTRIBUTION) == [60, 90, 120]
    assert picture.axes[1].get_xlim()[1] == pytest.approx(1.03 * 120, abs=0.02)
    assert has(picture, "at worst with 2 lost replies: 120.000 ms")
    assert has(picture, "at worst with every retry spent: 500.000 ms, beyond this axis")
    assert has(picture, "3 changes: 3 arrived")
    assert_legible(picture)
    short = latency_picture([made("one", [30, 40], (10, 5, 8, 2), BOUNDS)], "door")
    assert upright(short.axes[0], DISTRIBUTION) == [60]
    assert has(short, "at worst with 1 lost reply: 90.000 ms, beyond this axis")
    over = latency_picture([made("one", [30, 600], (10, 5, 8, 2), BOUNDS)], "door")
    assert upright(over.axes[0], DISTRIBUTION) == [60, 90, 120, 500]
    assert upright(latency_picture([made("one", [30], (1, 2, 3, 4), {})], "door").axes[0], DISTRIBUTION) == []


def test_shortest_mean_and_longest_are_stacked_from_their_parts() -> None:
    picture = latency_picture([made("one", [30, 40, 95], (10, 5, 8, 2), BOUNDS)], "door")
    stack = picture.axes[1]
    assert [text.get_text() for text in stack.get_yticklabels()] == ["shortest", "mean", "longest"]
    shortest, mean, longest = widths(stack)
    assert shortest == pytest.approx([10, 5, 8, 2, 5])
    assert mean == pytest.approx([10, 5, 8, 2, 30])
    assert longest == pytest.approx([10, 5, 8, 2, 70])


@pytest.mark.slow
def test_a_few_far_latencies_leave_the_usual_ones_their_own_axes() -> None:
    many = [30 + number % 20 for number in range(200)]
    run = made("cut", [*many, 5000], (10, 5, 8, 2), {**BOUNDS, "every retry spent": 4000.0})
    picture = latency_picture([run], "door")
    usual, whole, usual_parts, whole_parts = picture.axes
    assert (usual.get_yscale(), whole.get_yscale()) == ("linear", "log")
    assert usual.get_xlim() == usual_parts.get_xlim()
    assert whole.get_xlim() == whole_parts.get_xlim()
    assert 49 < usual.get_xlim()[1] < 90
    assert whole.get_xlim()[1] > 5000
    (bars,) = [patch for patch in usual.patches if hasattr(patch, "get_data")]
    assert bars.get_data()[0].sum() == 200
    (bars,) = [patch for patch in whole.patches if hasattr(patch, "get_data")]
    assert bars.get_data()[0].sum() == 201
    assert widths(whole_parts)[2] == pytest.approx([10, 5, 8, 2, 4975])
    assert upright(whole_parts, DISTRIBUTION) == [60, 90, 120, 4000]
    assert_legible(picture)
    assert_legible(latency_picture([run, run], "door", ["one", "two"]))


@pytest.mark.slow
def test_several_runs_share_the_axes() -> None:
    runs = [made("one", [30, 40], (10, 5, 8, 2), BOUNDS), made("two", [35, 95], (9, 6, 8, 1), BOUNDS)]
    picture = latency_picture(runs, "door", ["fast", "slow"])
    stack = picture.axes[1]
    names = ["fast: mean", "fast: longest", "slow: mean", "slow: longest"]
    assert [text.get_text() for text in stack.get_yticklabels()] == names
    assert [sum(bar) for bar in widths(stack)] == pytest.approx([35, 40, 65, 95])
    # The bound of both, once.
    assert upright(stack, GREY) == [60]
    assert has(picture, "1 fast: 2 arrived, mean 35.000 ms, max 40.000 ms")
    assert_legible(picture)
    other = [runs[0], made("two", [35, 95], (9, 6, 8, 1), {"no error": 70.0})]
    picture = latency_picture(other, "door")
    marks = [upright(picture.axes[1], RUNS[number]) for number in (0, 1)]
    assert marks == [[60], [70]]
    assert has(picture, "at worst with no error (2): 70.000 ms")
    assert_legible(picture)
    assert_legible(latency_picture([runs[0]] * 7, "door", [f"a run with a long name, {n}" for n in range(7)]))


def test_a_word_and_a_bit_do_not_share_an_axis() -> None:
    bit, word = (made("one", [30], (1, 2, 3, 4), {}) for _ in range(2))
    word.latency["door"].word = True
    with pytest.raises(UsageError, match="door is the age of a word in one run and the latency of a bit"):
        latency_picture([bit, word], "door")
    with pytest.raises(UsageError, match="8 runs on one axis cannot be distinguished"):
        latency_picture([bit] * 8, "door")


def test_what_belongs_beside_a_bound_stands_with_it() -> None:
    record = LatencyRecord("a.X0", "b.Y0", "both", inverted=False, word=False)
    record.add(Sample(0, (0, 0, 0, 0, 90 * TICKS_PER_MS)))
    cases = {"no error": 60 * TICKS_PER_MS, "every retry spent": 80 * TICKS_PER_MS}
    entry = latency_summary(record, LatencyBounds(cases, (), ("holds as long as M1 (b) let it through",)))
    assert entry["bound_ms"] == {"no error": 60, "every retry spent": 80}
    gate, beyond = caveats(entry)
    assert gate == "holds as long as M1 (b) let it through"
    assert beyond.startswith(
        "the longest, 90.000 ms, is beyond all of these cases: something that did not let it through, a fault,"
    )
    ungated = latency_summary(record, LatencyBounds(cases))
    assert caveats(ungated)[0].startswith("the longest, 90.000 ms, is beyond all of these cases: a fault,")
    shown = list(latency_lines({"latency": {"way": entry}}))
    assert shown[-3:] == [
        "  at worst         60.000 with no error, 80.000 with every retry spent (ms)",
        f"                   {gate}",
        f"                   {beyond}",
    ]
    assert list(in_words("way", entry))[-2:] == [f"way: {gate}.", f"way: {beyond}."]
    none = latency_summary(record, LatencyBounds({}, ("T0 at line 2 is a timer (b)",)))
    assert "bound_ms" not in none
    assert list(latency_lines({"latency": {"way": none}}))[-1] == ("  no bound: T0 at line 2 is a timer (b)")
    run = made("one", [30, 40], (10, 5, 8, 2), {})
    run.summary["latency"]["door"] |= {"bound_reasons": ["T0 at line 2 is a timer (b)"]}
    assert has(latency_picture([run], "door"), "no bound: T0 at line 2 is a timer (b)")
    gated = made("two", [30, 40], (10, 5, 8, 2), BOUNDS)
    gated.summary["latency"]["door"] |= {"bound_notes": [gate]}
    several = latency_picture([run, gated], "door")
    assert has(several, gate)
    assert_legible(several)

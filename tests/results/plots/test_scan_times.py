from __future__ import annotations

import itertools
import struct
import xml.etree.ElementTree as ET
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from bussim.errors import UsageError
from bussim.results.meters.histogram import BIN_TICKS, Histogram
from bussim.results.plots.bars import is_far, usual_range, whole_range
from bussim.results.plots.over_run import scan_times_over_run
from bussim.results.plots.scan_times import run_labels, scan_time_histogram
from bussim.results.plots.style import (
    _DPI,
    DISTRIBUTION,
    FAULT,
    FRAMES,
    IN_ERROR,
    PALETTE,
    RUNS,
    SIMULATED,
    Picture,
)
from bussim.results.run_record import RunRecord
from bussim.trace.records import NoteRecord
from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND
from tests.results.fakes import Fake, quiet
from tests.selection import quick

#: The three shapes that must be legible: all within 0.3 ms; 50 ms with scans at 350 ms; a wide one.
NARROW = quiet().run(name="narrow")
OUTLIERS = Fake().run(name="outliers")
NOISY = Fake(seed=8, loss=0.3).run(name="noisy")


def texts(picture: Figure) -> list[str]:
    return [text.get_text() for text in picture.findobj(Text) if text.get_text() and text.get_visible()]


def has(picture: Figure, part: str) -> bool:
    return any(part in text for text in texts(picture))


def drawn_texts(picture: Figure) -> list[tuple[str, Bbox]]:
    """Every text that is drawn (an axis keeps more than it draws), and where."""
    found: dict[int, tuple[str, Bbox]] = {}
    draw = Text.draw

    def watched(self: Text, renderer: Any) -> None:
        draw(self, renderer)
        if self.get_text().strip() and self.get_visible():
            found[id(self)] = (self.get_text(), self.get_window_extent(renderer))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Text, "draw", watched)
        picture.set_dpi(_DPI)  # of the files, whose dots round the widths of letters
        picture.canvas.draw()
    return list(found.values())


def assert_legible(picture: Picture) -> None:
    """No text covers another one or leaves the picture."""
    boxes = drawn_texts(picture)
    assert len(boxes) > 10
    for (one, first), (other, second) in itertools.combinations(boxes, 2):
        shared = Bbox.intersection(first, second)
        assert shared is None or min(shared.width, shared.height) < 2, f"{one!r} covers {other!r}"
    for text, box in boxes:
        assert box.x0 >= -1, text
        assert box.x1 <= picture.bbox.width + 1, text
        assert box.y0 >= -1, text
        assert box.y1 <= picture.bbox.height + 1, text


@pytest.mark.parametrize(
    "runs",
    quick(2, [[NARROW, OUTLIERS], [NOISY] * 7, [NARROW], [OUTLIERS], [NOISY], [NARROW, OUTLIERS, NOISY]]),
    ids=lambda runs: "+".join(run.scenario for run in runs),
)
def test_histograms_are_legible(runs: list[RunRecord]) -> None:
    assert_legible(scan_time_histogram(runs, "link"))


def test_a_narrow_histogram_names_mean_p99_and_maximum() -> None:
    picture = scan_time_histogram([NARROW], "link")
    (axes,) = picture.axes
    assert axes.get_yscale() == "linear"
    assert axes.get_xlabel() == "link scan time (ms)"
    assert axes.get_ylabel() == "link scans per 10 µs"
    assert axes.get_xlim() == pytest.approx((49.85, 50.15), abs=0.05)
    times = NARROW.summary["links"]["link"]["scan_time_ms"]
    for name in ("mean", "p99", "max"):
        assert has(picture, f"{name} {times[name]:.3f} ms")
    marks = sorted(np.asarray(line.get_xdata())[0] for line in axes.get_lines())
    assert marks == pytest.approx([times["mean"], times["p99"], times["max"]])
    assert has(picture, "1,200 link scans on link")


def test_far_outliers_get_a_logarithmic_axis_beside_the_usual_scans() -> None:
    picture = scan_time_histogram([OUTLIERS], "link")
    usual, whole = picture.axes
    assert (usual.get_yscale(), whole.get_yscale()) == ("linear", "log")
    assert usual.get_xlim()[1] < 51
    assert whole.get_xlim()[1] > 349
    assert has(picture, "station 1 (press2): 6 attempts, all 01")


def marks_of(axes: Axes) -> dict[str, tuple[float, float, float]]:
    """Where each mark stands (ms), and from where to where it goes of the height, by its style."""
    found = {}
    for line in axes.get_lines():
        x, y = np.asarray(line.get_xdata()), np.asarray(line.get_ydata())
        found[str(line.get_linestyle())] = (float(x[0]), float(y[0]), float(y[1]))
    return found


def test_marks_that_coincide_do_not_cover_each_other() -> None:
    picture = scan_time_histogram([quiet(jitter=0, duration=TICKS_PER_SECOND * 60).run()], "link")
    marks = marks_of(picture.axes[0])
    assert set(marks) == {"-", "--", ":"}
    assert {at for at, _, _ in marks.values()} == {50.0}
    heights = sorted((low, high) for _, low, high in marks.values())
    assert heights == [
        (0, pytest.approx(1 / 3)),
        (pytest.approx(1 / 3), pytest.approx(2 / 3)),
        (pytest.approx(2 / 3), 1),
    ]
    apart = marks_of(scan_time_histogram([NARROW], "link").axes[0])
    assert apart["-"][1:] == (0, 1)


def test_the_mark_of_p99_does_not_lie_over_the_maximum() -> None:
    """p99 and the maximum of the first picture of the README are a tenth of a ms apart, of 300 ms."""
    usual, whole = scan_time_histogram([OUTLIERS], "link").axes
    marks = marks_of(whole)
    p99, most = marks["--"], marks[":"]
    times = OUTLIERS.summary["links"]["link"]["scan_time_ms"]
    assert (p99[0], most[0]) == (pytest.approx(times["p99"]), pytest.approx(times["max"]))
    assert 0 < most[0] - p99[0] < 1
    assert (p99[2], most[1]) == (0.5, 0.5)
    del usual


def test_a_few_samples_are_no_comb() -> None:
    run = quiet(duration=3 * TICKS_PER_SECOND).run()
    (axes,) = scan_time_histogram([run], "link").axes
    (bars,) = axes.patches
    counts, edges, _ = bars.get_data()  # type: ignore[attr-defined] # of a StepPatch
    assert counts.sum() == 60
    assert len(counts) <= 3 * 60**0.5
    assert edges[1] - edges[0] == pytest.approx(0.02)


def test_a_hill_of_many_scans_is_among_the_usual_ones() -> None:
    """Three hills, a quarter of the scans in the last, far from the densest half; and some far scans."""
    histogram = Histogram()
    for hill, count in ((5100, 500), (5300, 240), (5800, 240), (10_000, 20)):
        for number in range(count):
            histogram.add((hill + number % 60) * BIN_TICKS)
    low, high = usual_range([histogram])
    assert 5000 < low < 5100
    assert 5860 < high < 6000
    assert is_far(whole_range([histogram]), (low, high))


def test_every_scan_is_in_a_bar() -> None:
    (axes,) = scan_time_histogram([NARROW], "link").axes
    (bars,) = axes.patches
    counts, edges, _ = bars.get_data()  # type: ignore[attr-defined] # of a StepPatch
    assert counts.sum() == 1200
    times = NARROW.summary["links"]["link"]["scan_time_ms"]
    assert edges[0] <= times["min"] <= times["max"] <= edges[-1]


def test_several_runs_share_one_axis_in_different_colours() -> None:
    picture = scan_time_histogram([NARROW, NOISY], "link", ["one", "two"])
    for label in ("one: 1,200 scans", "two: ", "lines: mean solid, p99 dashed, maximum dotted"):
        assert has(picture, label)
    assert len(set(RUNS)) == len(RUNS) == 7
    assert set(RUNS) == set(PALETTE)


def test_one_scan_time_is_a_picture_too() -> None:
    assert_legible(scan_time_histogram([quiet(jitter=0, duration=TICKS_PER_SECOND).run()], "link"))


def test_names_that_look_like_formulas_are_shown_as_they_are() -> None:
    picture = scan_time_histogram([quiet(duration=TICKS_PER_SECOND).run(name="cost $x$ $ \\frac{")], "link")
    assert_legible(picture)


def test_labels_are_always_different() -> None:
    other_seed = Fake(seed=9, duration=TICKS_PER_SECOND).run(name="noisy")
    assert run_labels([NARROW, NOISY]) == ["narrow", "noisy"]
    assert run_labels([NOISY, other_seed]) == ["noisy, seed 8", "noisy, seed 9"]
    assert run_labels([NOISY, NOISY]) == ["noisy, seed 8 (1)", "noisy, seed 8 (2)"]


def test_what_cannot_be_drawn_is_said() -> None:
    with pytest.raises(UsageError, match="narrow has no N:N link 'lonk'; it has 'link'"):
        scan_time_histogram([NARROW], "lonk")
    with pytest.raises(UsageError, match="made no complete scan"):
        scan_times_over_run(quiet(duration=10).run(), "link")
    with pytest.raises(UsageError, match="8 runs on one axis"):
        scan_time_histogram([NARROW] * 8, "link")


def test_over_the_run_faults_and_stations_in_error_have_lines_of_their_own() -> None:
    picture = scan_times_over_run(OUTLIERS, "link")
    assert_legible(picture)
    scans, events = picture.axes
    assert scans.get_ylabel() == "link scan time (ms)"
    assert events.get_xlabel() == "time of the run (s)"
    labels = [label.get_text() for label in events.get_yticklabels()]
    assert labels == ["power_off press2", "station 1 in error"]
    spans = [bars.get_paths()[0].get_extents() for bars in events.collections]
    assert (spans[0].x0, spans[0].x1) == (pytest.approx(10, abs=0.1), pytest.approx(15, abs=0.4))
    assert (spans[1].x0, spans[1].x1) == (pytest.approx(10.4, abs=0.1), pytest.approx(15.3, abs=0.4))


def test_a_run_without_events_has_no_chart_of_them() -> None:
    picture = scan_times_over_run(NARROW, "link")
    assert len(picture.axes) == 1
    assert_legible(picture)


def test_many_faults_share_the_last_line() -> None:
    run = Fake().run()
    notes = [
        NoteRecord(n * TICKS_PER_SECOND, "fault", f"f{n}", f"{'a very long name ' * 3}{n}", {})
        for n in range(30)
    ]
    notes += [NoteRecord((n + 1) * TICKS_PER_SECOND, "fault_over", f"f{n}", "", {}) for n in range(20)]
    picture = scan_times_over_run(RunRecord(run.summary, run.duration, run.links, tuple(notes)), "link")
    assert_legible(picture)
    labels = [label.get_text() for label in picture.axes[1].get_yticklabels()]
    assert labels[-2:] == ["21 other faults", "station 1 in error"]
    assert len(labels) == 11


def test_faults_of_another_bus_are_left_out_and_counted_ones_are_instants() -> None:
    run = quiet(duration=10 * TICKS_PER_SECOND).run()
    notes = (
        NoteRecord(100, "fault", "f1", "elsewhere", {"bus": "other"}),
        NoteRecord(4 * TICKS_PER_SECOND, "fault", "f2", "3 replies dropped", {"node": "press2", "count": 3}),
        NoteRecord(5 * TICKS_PER_SECOND, "fault", "f3", "press1 off", {"node": "press1"}),
    )
    picture = scan_times_over_run(RunRecord(run.summary, run.duration, run.links, notes), "link")
    events = picture.axes[1]
    assert [label.get_text() for label in events.get_yticklabels()] == ["3 replies dropped", "press1 off"]
    instant, endless = (bars.get_paths()[0].get_extents() for bars in events.collections)
    assert (instant.x0, instant.x1) == (4.0, 4.0)
    assert (endless.x0, endless.x1) == (5.0, 10.0)


def test_a_long_run_is_drawn_from_its_timeline() -> None:
    run = Fake(duration=120 * TICKS_PER_SECOND, plain=20 * TICKS_PER_MS).run()
    picture = scan_times_over_run(run, "link")
    assert_legible(picture)
    longest = run.summary["links"]["link"]["scan_time_ms"]["max"]
    dots = picture.axes[0].get_lines()[0].get_ydata()
    assert np.max(dots) == pytest.approx(longest)
    assert np.size(dots) <= 2048
    assert has(picture, "longest and shortest of up to")


def png_texts(path: Path) -> dict[str, str]:
    """The text chunks of a PNG file (PNG specification, 11.3.4)."""
    data, found, at = path.read_bytes(), {}, 8
    while at < len(data):
        length, kind = struct.unpack(">I4s", data[at : at + 8])
        body = data[at + 8 : at + 8 + length]
        if kind == b"tEXt":
            key, _, value = body.partition(b"\0")
            found[key.decode("latin-1")] = value.decode("latin-1")
        elif kind == b"iTXt":
            key, _, rest = body.partition(b"\0")
            packed, _, value = rest[:1], rest[1:2], rest[2:].split(b"\0", 2)[2]
            found[key.decode()] = (zlib.decompress(value) if packed == b"\1" else value).decode()
        at += 12 + length
    return found


def test_files_say_what_they_show_and_have_no_date(tmp_path: Path) -> None:
    png, svg = scan_time_histogram([NARROW], "link").save_both(tmp_path / "scan_time.v2")
    assert (png.name, svg.name) == ("scan_time.v2.png", "scan_time.v2.svg")
    about = png_texts(png)
    assert about["Description"] == "narrow, seed 7, 60 s, bussim 0.1.0"
    assert about["Title"] == "narrow: 1,200 link scans on link, 6 attempts a poll"
    assert about["Software"] == "bussim 0.1.0"
    assert not any("date" in key.lower() or "time" in key.lower() for key in about)
    text = svg.read_text(encoding="utf-8")
    assert "narrow, seed 7, 60 s, bussim 0.1.0" in text
    assert "<dc:date>" not in text
    ET.fromstring(text)  # noqa: S314 (own output)
    assert [path.name for path in sorted(tmp_path.iterdir())] == [png.name, svg.name]


def test_the_title_of_a_file_is_that_of_its_picture(tmp_path: Path) -> None:
    png, svg = scan_times_over_run(NARROW, "link").save_both(tmp_path / "over_run")
    title = "narrow: link scan time on link over the run"
    assert png_texts(png)["Title"] == title
    assert f"<dc:title>{title}</dc:title>" in svg.read_text(encoding="utf-8")


def test_a_thing_has_one_colour() -> None:
    assert len({SIMULATED, DISTRIBUTION, FAULT, IN_ERROR}) == 4
    assert RUNS[0] == SIMULATED
    # Who compares a few runs does not meet the colours of faults and errors.
    assert set(RUNS[-2:]) == {FAULT, IN_ERROR}
    assert set(FRAMES.values()) <= set(PALETTE)


@pytest.mark.slow
def test_the_users_own_settings_change_nothing(tmp_path: Path) -> None:
    import matplotlib as mpl

    plain = [path.read_bytes() for path in scan_times_over_run(OUTLIERS, "link").save_both(tmp_path / "a")]
    with mpl.rc_context({"font.size": 20, "axes.grid": False, "savefig.dpi": 30, "svg.fonttype": "none"}):
        other = [
            path.read_bytes() for path in scan_times_over_run(OUTLIERS, "link").save_both(tmp_path / "b")
        ]
    assert plain == other


@pytest.mark.parametrize(
    ("name", "match"), [("a.pdf", r"ends in \.pdf; allowed"), ("none/a.png", "cannot be")]
)
def test_where_a_picture_cannot_go(tmp_path: Path, name: str, match: str) -> None:
    with pytest.raises(UsageError, match=match):
        scan_time_histogram([NARROW], "link").save(tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_a_picture_is_drawn_once_for_each_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[Axes] = []
    draw = Axes.draw

    def counted(axes: Axes, renderer: Any) -> None:
        drawn.append(axes)
        draw(axes, renderer)

    monkeypatch.setattr(Axes, "draw", counted)
    scan_time_histogram([quiet(duration=3 * TICKS_PER_SECOND).run()], "link").save_both(tmp_path / "a")
    assert len(drawn) == len([*tmp_path.iterdir()]) == 2

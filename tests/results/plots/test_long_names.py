"""No picture cuts or covers a text, however long its names are and in whatever script."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from bussim.report.picture import timeline_picture
from bussim.report.scene import scene_of
from bussim.report.trace_window import TraceWindow
from bussim.results.meters.histogram import BIN_TICKS, Histogram
from bussim.results.meters.watch import Watch, Watched
from bussim.results.plots.distribution import distribution_and_histogram
from bussim.results.plots.over_run import scan_times_over_run
from bussim.results.plots.responses import response_time_histogram
from bussim.results.plots.scan_times import scan_time_histogram
from bussim.results.plots.style import Picture
from bussim.results.plots.trade_off import trade_off_picture
from bussim.results.plots.watch import watch_picture
from bussim.trace.records import NoteRecord, ScanRecord
from bussim.units import TICKS_PER_SECOND
from tests.results.fakes import Fake, Feeder
from tests.results.meters.test_ports import NODE
from tests.results.plots.test_scan_times import assert_legible, texts
from tests.selection import quick

ENGLISH = "a name that was chosen by an engineer who had the time to write it out in full, twice"
CHINESE = "一台名字很长的压机它的名字由很有时间的人写成而且在图片的标题和页脚中都应当完整地显示出来"
ONE_WORD = "x" * 120
NAMES = [ENGLISH, CHINESE, ONE_WORD, f"{CHINESE}_{ENGLISH} $x$"]


def histogram(name: str) -> Picture:
    run = Fake(duration=20 * TICKS_PER_SECOND).run(name=name)
    picture = scan_time_histogram([run], "link")
    # Heading and footer have the name, whole.
    whole = "".join(texts(picture)).replace("\n", "").replace(" ", "").replace("\\$", "$")
    assert whole.count(name.replace(" ", "")) == 2
    return picture


def four_histograms(name: str) -> Picture:
    runs = [Fake(seed=seed, duration=20 * TICKS_PER_SECOND).run(name=f"{name} {seed}") for seed in range(4)]
    return scan_time_histogram(runs, "link", [f"{number} {name}" for number in range(4)])


def over_run(name: str) -> Picture:
    return scan_times_over_run(Fake(duration=20 * TICKS_PER_SECOND).run(name=name), "link")


def responses(name: str) -> Picture:
    runs = [Feeder(seed=seed).run(name=f"{name} {seed}") for seed in range(4)]
    return response_time_histogram(runs, NODE)


def timeline(name: str) -> Picture:
    notes = [NoteRecord(1_000_000 * n, "fault", name, f"{name} {n}", {"node": name}) for n in (1, 2, 3, 4)]
    scan = ScanRecord(name, 5, 0, 8_000_000, 1, 0, 0, f"station 1 ({name}) replied 15 ms after its poll")
    window = TraceWindow(name, 0, 9_000_000, (name, "b", "c"), scans=[scan], notes=notes)
    return timeline_picture(scene_of(window), name)


def distribution(name: str) -> Picture:
    x = np.array([50.0, 51.0, 100.0]) * 100 * BIN_TICKS
    simulated = Histogram()
    simulated.add_all([int(tick) for tick in x for _ in range(9)])
    return distribution_and_histogram(name, x, np.array([1.0, 1e-2, 1e-5]), simulated, name, 1e-6)


def trade_off(name: str) -> Picture:
    series = {
        f"{name} {level}": [(100.0 + 50 * n, level * 10.0 ** (6 - 3 * n)) for n in range(4)]
        for level in (1, 50)
    }
    return trade_off_picture(
        name,
        range(4),
        series,
        timeout=50,
        errors=[1.0],
        dead=[(0.0, 250.0)],
        goals=["false station errors: at most 1 a year", "a scan of at most 250 ms with one station dead"],
        chosen=(f"{name} 1", 2),
        more=True,
        description=name,
    )


def watch(name: str) -> Picture:
    devices = [Watched(name, f"{device}{n}", 16 if device == "D" else 1) for n in (1, 2) for device in "DM"]
    return watch_picture(Watch(devices), 0, TICKS_PER_SECOND, name, name)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES, ids=["words", "Chinese", "one word", "both"])
@pytest.mark.parametrize(
    "drawn", [histogram, four_histograms, over_run, responses, timeline, distribution, trade_off, watch]
)
def test_pictures_with_long_names_are_legible(drawn: Callable[[str], Picture], name: str) -> None:
    assert_legible(drawn(name))


@pytest.mark.parametrize("name", quick(1, NAMES[1::-1]), ids=["Chinese", "words"])
def test_four_runs_with_long_names_cut_no_footer(name: str) -> None:
    assert_legible(four_histograms(name))


def test_a_picture_grows_with_its_texts() -> None:
    short, long = (over_run(name).get_figheight() for name in ("a", ENGLISH * 3))
    assert 0.3 < long - short < 2

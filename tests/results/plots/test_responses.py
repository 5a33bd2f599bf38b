from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from bussim.errors import UsageError
from bussim.results.collector import Collector
from bussim.results.pictures import draw_run
from bussim.results.plots.responses import masters, response_time_histogram
from bussim.results.plots.style import IN_ERROR
from bussim.results.result import Result
from bussim.results.run_record import RunRecord
from bussim.results.store.folder import RunFolder
from bussim.results.store.in_memory import MemoryRows
from bussim.results.store.load import load_run
from bussim.trace.records import RunTotals
from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND
from tests.results.fakes import Fake, Feeder, record_of
from tests.results.meters.test_ports import GOOD, NODE, TIMEOUT, port_totals
from tests.results.plots.test_scan_times import assert_legible, has, png_texts, texts
from tests.selection import quick

FAR = Feeder().run(name="far timeout")  # 36 ms at most, timeout 100 ms
NEAR = Feeder(timeout=40 * TICKS_PER_MS, seed=8).run(name="near timeout")
BEYOND = Feeder(timeout=2 * TICKS_PER_SECOND, bad=50).run(name="timeout beyond")


def many(polls: int) -> RunRecord:
    collector = Collector()
    for number in range(polls):
        for times in range(polls - number):
            collector.take(
                GOOD._replace(
                    poll=f"a poll with a long name, number {number}", asked=(20 - times) * TICKS_PER_MS
                )
            )
    totals = RunTotals(TICKS_PER_SECOND, (), (), ports=(port_totals(timeout=100 * TICKS_PER_MS),))
    return record_of(totals, collector)


def timeouts(picture: Figure) -> list[float]:
    """Where timeouts are marked, once each panel."""
    return [
        float(np.asarray(line.get_xdata())[0])
        for axes in picture.axes
        for line in axes.get_lines()
        if line.get_color() == IN_ERROR
    ]


@pytest.mark.slow
@pytest.mark.parametrize(
    "runs",
    quick(3, ([FAR], [FAR, NEAR, BEYOND], [many(12)], [NEAR], [BEYOND], [FAR, NEAR], [many(1)], [many(8)])),
    ids=lambda runs: "+".join(run.scenario for run in runs),
)
def test_pictures_are_legible(runs: list[RunRecord]) -> None:
    assert_legible(response_time_histogram(runs, NODE))


def test_a_panel_a_poll_and_every_response_in_a_bar() -> None:
    picture = response_time_histogram([NEAR], NODE)
    assert len(picture.axes) == 2
    for axes, (name, poll) in zip(picture.axes, NEAR.summary["ports"][NODE]["polls"].items(), strict=True):
        (bars,) = axes.patches
        counts, edges, _ = bars.get_data()  # type: ignore[attr-defined] # of a StepPatch
        responses = NEAR.ports[NODE].polls[name].responses.count
        assert counts.sum() == responses > 500
        assert edges[0] <= poll["response_ms"]["min"] <= poll["response_ms"]["max"] <= edges[-1]
        assert axes.get_yscale() == "log"
        assert f"{name}: {responses} of {poll['transactions']} attempts answered" in axes.get_title("left")
    assert timeouts(picture) == [40.0, 40.0]
    assert picture.axes[0].get_xlim() == picture.axes[1].get_xlim()
    assert picture.axes[-1].get_xlim()[1] > 40
    assert [axes.get_xlabel() for axes in picture.axes] == [
        "",
        "end of the request to end of its response (ms)",
    ]


@pytest.mark.parametrize(("run", "timeout"), [(FAR, "100 ms"), (BEYOND, "2000 ms")])
def test_a_timeout_far_away_leaves_the_responses_the_axis(run: RunRecord, timeout: str) -> None:
    picture = response_time_histogram([run], NODE)
    assert timeouts(picture) == []
    assert has(picture, f"timeout {timeout}, beyond this axis")
    assert max(axes.get_xlim()[1] for axes in picture.axes) < 40
    for axes, poll in zip(picture.axes, run.ports[NODE].polls.values(), strict=True):
        counts, edges, _ = axes.patches[0].get_data()  # type: ignore[attr-defined] # of a StepPatch
        left, right = axes.get_xlim()
        assert edges[-1] - edges[0] > (right - left) / 4  # each poll is wide enough to be read
        missing = poll.transactions - poll.responses.count
        assert missing == poll.transactions - counts.sum()
        assert axes.get_title("right") == (f"{missing:,} without a response →" if missing else "")
    assert any(axes.get_title("right") for axes in picture.axes)


def test_the_numbers_are_those_of_the_summary() -> None:
    picture = response_time_histogram([FAR], NODE)
    for name, poll in FAR.summary["ports"][NODE]["polls"].items():
        (title,) = [text for text in texts(picture) if text.startswith(f"{name}:")]
        assert f"mean {poll['response_ms']['mean']:.3f} ms" in title
        assert f"max {poll['response_ms']['max']:.3f} ms" in title


def test_several_runs_have_a_colour_each() -> None:
    picture = response_time_histogram([FAR, NEAR], NODE, ["one", "two"])
    responses = FAR.ports[NODE].responses.count
    assert has(picture, f"one: {responses:,} responses, mean ")
    assert has(picture, "two: ")
    assert set(timeouts(picture)) == {40.0}
    assert has(picture, "timeout 100 ms, beyond this axis")


def test_many_polls_share_the_last_panel() -> None:
    run = many(12)
    picture = response_time_histogram([run], NODE)
    titles = [title for axes in picture.axes if (title := axes.get_title("left"))]
    assert len(titles) == 8
    # The five polls with the fewest attempts: 5 + 4 + 3 + 2 + 1.
    assert titles[-1].startswith("5 other polls: 15 of 15 attempts answered")


def test_what_cannot_be_drawn_is_said() -> None:
    with pytest.raises(
        UsageError, match=r"far timeout has no Modbus master 'press2.COM3'; it has 'press1.COM3'"
    ):
        response_time_histogram([FAR], "press2.COM3")
    with pytest.raises(UsageError, match="it has none"):
        response_time_histogram([Fake(duration=TICKS_PER_SECOND).run()], NODE)
    collector = Collector()
    collector.take(TIMEOUT)
    silent = record_of(RunTotals(TICKS_PER_SECOND, (), (), ports=(port_totals(),)), collector)
    assert masters(silent) == []
    with pytest.raises(UsageError, match=r"press1\.COM3 had no response"):
        response_time_histogram([silent], NODE)
    with pytest.raises(UsageError, match="8 runs on one axis"):
        response_time_histogram([FAR] * 8, NODE)


def test_a_run_leaves_pictures_and_histograms(tmp_path: Path) -> None:
    with RunFolder(tmp_path / "run", rows=True, traced=False, fmt="csv") as folder:
        record = Feeder().run(rows=folder.rows)
        target = folder.finish(record, "schema: 1\n")
    drawn = draw_run(record, target)
    assert [path.name for path in drawn] == ["response_time_press1.COM3.png"]
    assert {path.name for path in target.iterdir()} == {
        "summary.json", "histograms.json", "scenario.yaml", "link_scans.csv", "modbus.csv", "free.csv",
        "values.csv", "response_time_press1.COM3.png", "response_time_press1.COM3.svg",
    }  # fmt: skip
    about = png_texts(target / "response_time_press1.COM3.png")
    assert about["Description"] == "feeder, seed 7, 60 s, bussim 0.1.0"
    assert about["Title"] == "feeder: response times of press1.COM3"
    again = load_run(target)
    assert again.histograms() == record.histograms()
    again_drawn = response_time_histogram([again], NODE).save(tmp_path / "again.png")
    assert again_drawn.read_bytes() == (target / "response_time_press1.COM3.png").read_bytes()


@pytest.mark.slow
def test_from_python(tmp_path: Path) -> None:
    result = Result(FAR, MemoryRows(rows=True, traced=False))
    result.plot_response_times(path=tmp_path / "a.svg")
    result.plot_response_times(NODE, tmp_path / "b.svg")
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()
    assert "press1.COM3: 1,178 of 1,227 transactions ok" in repr(result)
    assert "<th>Modbus master</th>" in result._repr_html_()
    plain = Result(Fake(duration=TICKS_PER_SECOND).run(), MemoryRows(rows=True, traced=False))
    assert "Modbus" not in plain._repr_html_()
    with pytest.raises(UsageError, match="no Modbus master had a response"):
        plain.plot_response_times()

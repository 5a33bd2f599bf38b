"""The whole way: killed and gone on with, on one process and on two, the results are the same bytes."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

import joblib
import pandas as pd
import pytest

from bussim.errors import RunError, ScenarioError, UsageError
from bussim.sweep import executors, jobs, plots, run
from bussim.sweep.executors import WorkerLost
from bussim.sweep.folder import JOURNAL
from bussim.sweep.plan import Plan
from bussim.sweep.run import sweep as run_sweep
from tests.sweep.samples import BER, REPEAT, RETRIES, VARY, HereExecutor, contents, invented, noisy

ROOT = Path(__file__).parents[2]

#: A process that runs the command line and kills itself in the middle of its n-th journal entry.
KILLED = """
import os, signal, sys
from bussim.cli import main
from bussim.sweep import journal
left = int(sys.argv[1])
whole = journal._line
def half(run, figures):
    global left
    left -= 1
    if left:
        return whole(run, figures)
    os.write(file.fileno(), whole(run, figures)[:40])
    os.kill(os.getpid(), signal.SIGKILL)
class Journal(journal.Journal):
    def append(self, run, figures):
        global file
        file = self._file
        super().append(run, figures)
journal._line = half
from bussim.sweep import folder
folder.Journal = Journal
sys.exit(main(sys.argv[2:]))
"""


def arguments(scenario: Path, out: Path, *more: str) -> list[str]:
    vary = [text for each in VARY for text in ("--vary", each)]
    return ["sweep", str(scenario), *vary, "--repeat", str(REPEAT), "--out", str(out), *more]


def killed_after(appended: int, *command: str) -> None:
    """Run the command line in a process that is killed while it notes down its n-th run."""
    done = subprocess.run(
        [sys.executable, "-c", KILLED, str(appended), *command],
        capture_output=True,
        env={"PYTHONPATH": str(ROOT)},
        check=False,
        timeout=300,
    )
    assert done.returncode == -9, done.stderr.decode()


@pytest.fixture
def no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plots, "draw", lambda *_: [])


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="there is no SIGKILL")
def test_killed_twice_and_resumed_by_two_workers_it_is_the_same(
    undisturbed: tuple[Path, dict[str, bytes]], tmp_path: Path
) -> None:
    scenario, wanted = undisturbed
    out = tmp_path / "out"
    journal = tmp_path / "out.incomplete" / JOURNAL
    for killed in (40, 70):
        killed_after(killed, *arguments(scenario, out, "--workers", "2"))
        assert not out.exists()
        assert not journal.read_bytes().endswith(b"\n")
    assert journal.read_bytes().count(b"\n") == 39 + 69
    result = run_sweep(scenario, VARY, out=out, repeat=REPEAT, workers=2)
    assert result.already_there == 39 + 69
    assert contents(out) == wanted
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


@pytest.mark.slow
def test_the_tables_have_what_a_technician_expects(undisturbed: tuple[Path, dict[str, bytes]]) -> None:
    scenario, wanted = undisturbed
    assert set(wanted) == {
        "sweep.json", "scenario.yaml", "runs.csv", "runs.parquet", "points.csv", "sweep_link.png",
        "sweep_link.svg",
    }  # fmt: skip
    result = run_sweep(scenario, VARY, out=scenario.parent / "out", repeat=REPEAT)
    assert result.already_there == 200
    runs, points = result.runs, result.points
    assert len(runs) == 200
    assert runs["seed"].nunique() == 200
    pd.testing.assert_frame_equal(pd.read_parquet(result.folder / "runs.parquet"), runs, check_dtype=False)
    mean = runs.groupby("point")["link.scan_time_mean_ms"].mean()
    assert mean.to_numpy() == pytest.approx(points["link.scan_time_mean_ms"].to_numpy(), rel=1e-9)
    # More noise, longer scans; more retries, fewer station errors where there is noise.
    by_noise = points.groupby(BER)["link.scan_time_mean_ms"].mean()
    assert by_noise.is_monotonic_increasing
    noisiest = points[points[BER] == 1e-2].set_index(RETRIES)["link.station_errors"]
    assert noisiest[0] > noisiest[2] > noisiest[4]
    assert "200 runs" in repr(result)


def test_the_order_of_the_outcomes_makes_no_difference(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, no_pictures: None
) -> None:
    del no_pictures
    found = []
    for seed in (1, 2):
        here = HereExecutor(seed)
        monkeypatch.setattr(run, "open_executor", lambda *_, here=here: here)
        result = run_sweep(noisy(tmp_path), [f"{RETRIES}=0:3:1"], out=tmp_path / f"{seed}", repeat=2)
        found.append((here.ran, contents(result.folder)))
    assert found[0][0] != found[1][0]
    assert found[0][1] == found[1][1]


def test_a_bad_point_stops_everything_before_it_begins(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = HereExecutor()
    monkeypatch.setattr(run, "open_executor", lambda *_: here)
    scenario = noisy(tmp_path)
    with pytest.raises(ScenarioError, match="retries is 11"):
        run_sweep(scenario, [f"{RETRIES}=8:11:1"], out=tmp_path / "sweeps" / "out")
    assert here.ran == []
    assert list(tmp_path.iterdir()) == [scenario]


def test_a_run_that_fails_is_named_and_the_others_are_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, no_pictures: None
) -> None:
    del no_pictures
    scenario = noisy(tmp_path)

    class Failing(HereExecutor):
        def run(self, jobs_: Any) -> Any:
            for job in jobs_:
                yield jobs.Outcome(job.run, None, "KeyError: 3") if job.run == 3 else invented(job)

    monkeypatch.setattr(run, "open_executor", lambda *_: Failing())
    with pytest.raises(RunError) as caught:
        run_sweep(scenario, [f"{RETRIES}=0:2:1"], out=tmp_path / "out", repeat=2)
    assert str(caught.value) == (
        f"{RETRIES}=1, repeat 2: the run failed: KeyError: 3; kept: 3 of 6 runs; the same command goes "
        "on from there"
    )
    monkeypatch.setattr(run, "open_executor", lambda *_: HereExecutor(real=False))
    assert run_sweep(scenario, [f"{RETRIES}=0:2:1"], out=tmp_path / "out", repeat=2).already_there == 3


def test_what_a_run_costs_is_told_from_a_piece_of_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plan = Plan(noisy(tmp_path), ["duration=400ms,300h"])
    short, endless = plan.job(0), plan.job(1)
    assert plan.check() == 72_000_000 * (0.4 + 300 * 3600)
    assert 0 < jobs.cost_of(endless, 0.05) < 1e-6
    assert 0 < jobs.cost_of(short, 60) < 1e-6

    def leaves(*_: object, **__: object) -> None:
        sys.exit(7)

    monkeypatch.setattr("bussim.api.run", leaves)
    assert jobs.cost_of(short, 60) == 0


class _Dying(HereExecutor):
    """Loses a worker after so many outcomes, each time."""

    def __init__(self, outcomes: int) -> None:
        super().__init__(real=False)
        self._outcomes = outcomes
        self.starts = 0

    def run(self, jobs_: Any) -> Iterator[Any]:  # type: ignore[override] # an iterator is enough
        self.starts += 1
        for number, outcome in enumerate(super().run(jobs_)):
            if number == self._outcomes:
                raise WorkerLost("a worker died")
            yield outcome


def test_a_lost_worker_is_no_reason_to_stop_unless_nothing_comes_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, no_pictures: None
) -> None:
    del no_pictures
    scenario = noisy(tmp_path)
    for outcomes, starts in ((1, 10), (0, 3)):
        dying = _Dying(outcomes)
        monkeypatch.setattr(run, "open_executor", lambda *_, dying=dying: dying)
        out = tmp_path / f"{outcomes}"
        if outcomes:
            result = run_sweep(scenario, [f"{RETRIES}=0:9:1"], out=out)
            assert len(result.runs) == 10
        else:
            with pytest.raises(RunError, match="a worker died; kept: 0 of 10 runs"):
                run_sweep(scenario, [f"{RETRIES}=0:9:1"], out=out)
        assert dying.starts == starts


def test_a_killed_process_of_the_pool_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object, **__: object) -> Any:
        def pool(tasks: Any) -> Iterator[Any]:
            del tasks
            raise BrokenProcessPool("terminated")
            yield

        return pool

    monkeypatch.setattr(joblib, "Parallel", broken)
    with pytest.raises(
        RunError, match=r"a worker process died \(is there enough memory\?\); kept: 0 of 2 runs"
    ):
        run_sweep(noisy(tmp_path), [f"{RETRIES}=0,1"], out=tmp_path / "out", workers=2)


def test_progress_shows_what_is_being_done_and_how_much_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, no_pictures: None
) -> None:
    del no_pictures
    monkeypatch.setattr(run, "open_executor", lambda *_: HereExecutor(real=False))
    reported: list[tuple[str, int, int]] = []
    run_sweep(
        noisy(tmp_path),
        [f"{RETRIES}=0,1"],
        out=tmp_path / "out",
        repeat=2,
        progress=lambda *what: reported.append(what),
    )
    assert reported == [
        *(("checking", done, 2) for done in (1, 2)),
        *(("running", done, 4) for done in range(5)),
    ]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"workers": 0}, "--workers is 0, allowed is 1 or more"),
        ({"workers": 2, "scheduler": "tcp://localhost:1"}, "with --scheduler the cluster decides"),
        ({"repeat": 0}, r"--repeat is 0, allowed 1\.\.100000"),
        ({"repeat": 50_001}, "2 points with 50,001 repeats each are 100,002 runs, allowed 100,000"),
    ],
)
def test_options_that_cannot_be(tmp_path: Path, options: dict[str, Any], message: str) -> None:
    scenario = noisy(tmp_path)
    with pytest.raises(UsageError, match=message):
        run_sweep(scenario, [f"{RETRIES}=0,1"], out=tmp_path / "out", **options)
    assert list(tmp_path.iterdir()) == [scenario]


def test_local_workers_default_to_the_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []

    def parallel(*, n_jobs: int, **_: object) -> Any:
        asked.append(n_jobs)
        return lambda tasks: (task for task in list(tasks)[:0])

    monkeypatch.setattr(joblib, "Parallel", parallel)
    monkeypatch.setattr(joblib, "cpu_count", lambda: 12)
    many: Any = [None] * 100
    assert list(executors.LocalExecutor(None).run(many)) == []
    assert list(executors.LocalExecutor(5).run(many)) == []
    assert list(executors.LocalExecutor(5).run(many[:3])) == []
    assert asked == [12, 5, 3]

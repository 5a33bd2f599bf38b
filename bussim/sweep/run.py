"""``bussim.sweep``: from what is to vary to the folder with the results."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path
from statistics import fmean

from bussim.errors import RunError
from bussim.scenario.yaml.overrides import Override
from bussim.sweep.executors import Executor, WorkerLost, open_executor
from bussim.sweep.folder import SweepFolder
from bussim.sweep.jobs import cost_of
from bussim.sweep.journal import Journal
from bussim.sweep.plan import Plan
from bussim.sweep.result import SweepResult
from bussim.sweep.tables import POINTS, RUNS, RUNS_PARQUET, points_table, runs_table, write_csv, write_parquet
from bussim.version import __version__
from bussim.wording import counted

#: Called with what is being done ("checking", "running"), how much of it is done, and how much there is.
Progress = Callable[[str, int, int], None]

#: How often jobs are given out again after a worker died, without a single outcome between.
_MOST_DEATHS = 3
#: Seconds of a run that tell what it costs.
_TRIED_SECONDS = 0.25


def sweep(
    scenario: str | os.PathLike[str],
    vary: Iterable[str],
    *,
    out: str | os.PathLike[str],
    repeat: int = 1,
    sets: Sequence[str | Override] = (),
    workers: int | None = None,
    scheduler: str | None = None,
    common_random_numbers: bool = False,
    force: bool = False,
    numbered: bool = False,
    allow_code: bool = False,
    progress: Progress | None = None,
    estimated: Callable[[float], None] | None = None,
) -> SweepResult:
    """Run a scenario at every point of a grid, ``repeat`` times with independent seeds.

    ``scenario`` is a file or the name of a built-in one; ``sets`` are values set at every point
    (``key.path=value``), ``vary`` what changes from point to point: ``key.path=a:b:step``,
    ``key.path=a:b:logN`` or ``key.path=value,value``. Several make a grid. With
    ``common_random_numbers`` every point has the same seeds, see :func:`bussim.sweep.plan.run_seed`.

    Runs are simulated by ``workers`` processes (None: one for each core), or by the workers of the
    Dask scheduler at the address ``scheduler``. The results depend on neither.

    ``out`` is the folder to write. Until it is whole its runs are kept in ``<out>.incomplete``: the
    same call goes on after any interruption, and returns at once if the folder is whole. ``force``
    replaces another sweep's folder and makes a whole one again; with ``numbered`` the next free of
    ``out-2``, ``out-3`` is taken instead, see :attr:`SweepResult.folder`.

    ``estimated`` is called before a new sweep begins, with about how many seconds it will take by pieces
    of its first and its last run. What it raises ends the sweep, of which nothing is left.

    Functions of the user that the scenario names are loaded only with ``allow_code``, in every process
    that simulates: from the scenario's folder, the current one, or where Python finds its own.

    Raises ScenarioError that names every bad point, UsageError for other mistakes, before anything
    is run or written; RunError if a run or writing fails.
    """
    plan = Plan(
        scenario,
        vary,
        sets=sets,
        repeat=repeat,
        common_random_numbers=common_random_numbers,
        allow_code=allow_code,
    )
    executor = open_executor(workers, scheduler)
    with SweepFolder(Path(out), plan.manifest(), force=force, numbered=numbered) as folder:
        before = plan.runs
        if folder.state != "whole":
            # What was begun was checked before it began.
            if folder.state == "new":
                ticks = plan.check(None if progress is None else partial(progress, "checking"))
            with executor:
                if folder.state == "new" and estimated is not None:
                    estimated(ticks * _cost(plan) / min(executor.workers, plan.runs))
                folder.begin()
                before = len(folder.journal.done)
                _run_missing(plan, folder.journal, executor, progress)
            folder.finish(partial(_write, plan, folder.journal))
        return SweepResult(plan, folder.target, already_there=before)


def _cost(plan: Plan) -> float:
    """About how many seconds each simulated tick takes."""
    jobs = plan.job(0), plan.job(plan.runs - 1)
    cost_of(jobs[0], 0)  # the very first run imports what it needs, which is no measure
    return fmean(cost_of(job, _TRIED_SECONDS) for job in jobs)


def _run_missing(plan: Plan, journal: Journal, executor: Executor, progress: Progress | None) -> None:
    deaths = 0
    while len(journal.done) < plan.runs:
        before = len(journal.done)
        if progress is not None:
            progress("running", before, plan.runs)
        try:
            _run_once(plan, journal, executor, progress)
        except WorkerLost as error:
            deaths = deaths + 1 if len(journal.done) == before else 1
            if deaths >= _MOST_DEATHS:
                raise RunError(f"{error}; {_kept(plan, journal)}") from error


def _run_once(plan: Plan, journal: Journal, executor: Executor, progress: Progress | None) -> None:
    missing = [plan.job(run) for run in range(plan.runs) if run not in journal.done]
    with closing(executor.run(missing)) as outcomes:
        for outcome in outcomes:
            if outcome.figures is None:
                raise RunError(
                    f"{plan.in_words(outcome.run)}: the run failed: {outcome.error}; {_kept(plan, journal)}"
                )
            journal.append(outcome.run, outcome.figures)
            if progress is not None:
                progress("running", len(journal.done), plan.runs)


def _kept(plan: Plan, journal: Journal) -> str:
    return f"kept: {len(journal.done):,} of {counted(plan.runs, 'run')}; the same command goes on from there"


def _write(plan: Plan, journal: Journal, folder: Path) -> None:
    from bussim.scenario.yaml.dump import dumps
    from bussim.sweep.plots import draw

    runs = runs_table(plan, journal.entries())
    points = points_table(plan, runs)
    write_csv(folder / RUNS, runs)
    write_csv(folder / POINTS, points)
    write_parquet(folder / RUNS_PARQUET, runs)
    with (folder / "scenario.yaml").open("w", encoding="utf-8", newline="\n") as file:
        file.write(f"# What a sweep by bussim {__version__} varied, with every default filled in.\n")
        file.write(dumps(plan.base))
    draw(plan, runs, points, folder)

"""The Python interface: load a scenario, run it, read the results.

::

    import bussim

    result = bussim.run("press_line")
    result.plot_scan_times()
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from bussim.errors import UsageError
from bussim.results.collector import Collector, Rows
from bussim.results.meters.latency import LatencySpec, Route
from bussim.results.result import Result
from bussim.results.run_record import RunRecord
from bussim.results.store.folder import RunFolder
from bussim.results.store.in_memory import MemoryRows
from bussim.results.store.load import FolderRows, load_run
from bussim.results.summary.latency import LatencyBounds
from bussim.scenario.build.trace_header import trace_header
from bussim.scenario.model import Scenario
from bussim.scenario.provenance import ASSUMED
from bussim.trace.records import RunTotals
from bussim.version import __version__

__all__ = ["Progress", "Result", "Source", "load", "open_run", "run"]

#: Called with (ticks simulated, ticks in all) now and then.
Progress = Callable[[int, int], None]
#: The path of a scenario file, or the name of a built-in scenario.
Source = str | os.PathLike[str]


def load(source: Source, overrides: Iterable[str] = (), *, allow_code: bool = False) -> Scenario:
    """The scenario in a file, or the built-in one of that name if there is no such file.

    ``overrides`` are texts such as ``"plcs.press1.nn.retries=2"``. A scenario that names Python
    functions is loaded, and they with it, only with ``allow_code``. Raises ScenarioError with every
    mistake in the file, UsageError for an override whose path leads nowhere.
    """
    from bussim.scenario import loader

    return loader.load(source, overrides, allow_code=allow_code)


def run(
    scenario: Scenario | Source,
    *,
    out: Source | None = None,
    trace: bool = False,
    rows: bool = True,
    format: str = "csv",  # noqa: A002 (the option's name on the command line)
    force: bool = False,
    numbered: bool = False,
    progress: Progress | None = None,
) -> Result:
    """Simulate a scenario, given as such, as a file or by a built-in name.

    ``out`` is a folder to write (summary, tables; :meth:`Result.save_plots` adds pictures); without it the
    result stays in memory.
    ``rows`` keeps one row a link scan, Modbus transaction, free-protocol message and change of an
    observed device, ``trace`` also every attempt, frame and event; without both the memory needed
    does not depend on the run's length. ``format`` is that of the tables, "csv" or "parquet". Where
    ``out`` exists, ``force`` replaces the folder of an earlier run and ``numbered`` takes the next
    free of ``out-2``, ``out-3`` and so on; :attr:`Result.folder` is the one taken.

    Raises ScenarioError or UsageError for bad input, RunError if writing fails.
    """
    if not isinstance(scenario, Scenario):
        scenario = load(scenario)
    if out is None:
        if force or numbered or format != "csv":
            raise UsageError("format, force and numbered are about a folder: give out as well")
        memory = MemoryRows(rows=rows, traced=trace, header=trace_header(scenario))
        totals, record = _simulate(scenario, memory if rows or trace else None, trace, progress)
        return Result(record, memory, totals=totals)
    from bussim.scenario.yaml.dump import dumps

    text = f"# As run by bussim {__version__}, with every default filled in.\n{dumps(scenario)}"
    location = Path(out)
    with RunFolder(
        location,
        rows=rows,
        traced=trace,
        fmt=format,
        force=force,
        numbered=numbered,
        header=trace_header(scenario),
    ) as folder:
        totals, record = _simulate(scenario, folder.rows if rows or trace else None, trace, progress)
        location = folder.finish(record, text)
    return Result(record, FolderRows(location), totals=totals, folder=location)


def open_run(folder: Source) -> Result:
    """The result of an earlier run, from its folder.

    Raises UsageError if it is not the folder of a run, or of one that was stopped.
    """
    location = Path(folder)
    return Result(load_run(location), FolderRows(location), folder=location)


def _simulate(
    scenario: Scenario,
    rows: Rows | None,
    trace: bool,  # noqa: FBT001 (private)
    progress: Progress | None,
) -> tuple[RunTotals, RunRecord]:
    from bussim.sim.runner import simulate

    bus_of = {plc.name: plc.link.bus for plc in scenario.plcs if plc.link is not None}
    numbers = {plc.name: plc.registers.get("D8176", 0) for plc in scenario.plcs if plc.link is not None}
    latency, bounds = _latency(scenario)
    collector = Collector(traced=trace, rows=rows, bus_of=bus_of, numbers=numbers, latency=latency)
    totals = simulate(scenario, collector, progress=progress)
    record = collector.run(totals, scenario=scenario.name, seed=scenario.seed, bounds=bounds)
    record.summary["rests_on"] = _rests_on(scenario, record.summary)
    return totals, record


def _rests_on(scenario: Scenario, summary: Mapping[str, Any]) -> dict[str, Any]:
    """The classes of a run's figures, and the assumptions that change those of each link most."""
    from bussim.exact.from_scenario import from_scenario
    from bussim.exact.sizing.assumptions import rests_on

    models = from_scenario(scenario, ignore_faults=True)
    links = {bus: rests_on(model, summary["links"].get(bus, ())) for bus, model in models.items()}
    return {"links": links, "other figures": ASSUMED}


def _latency(scenario: Scenario) -> tuple[list[LatencySpec], dict[str, LatencyBounds]]:
    """What is to be measured between devices, and what it may be at worst, by entry."""
    if not scenario.latency:
        return [], {}
    from bussim.exact.latency.bounds import bounds_of
    from bussim.scenario.signals.paths import signal_paths

    specs = [
        LatencySpec(
            path.entry.name,
            path.source.name,
            path.entry.source,
            path.target.name,
            path.entry.target,
            str(path.entry.edge),
            path.entry.inverted,
            path.word,
            path.direct,
            None if path.bus is None else Route(path.bus, *path.positions, path.frame),
            str(path.reachability),
            (path.unmeasured,) if path.unmeasured else (),
            *path.scans,
        )
        for path in signal_paths(scenario)
    ]
    comments = {f"{plc.name}.{key}": text for plc in scenario.plcs for key, text in plc.comments.items()}
    return specs, {
        name: LatencyBounds(bound.cases(), (bound.reason,) if bound.reason else (), bound.caveats, comments)
        for name, bound in bounds_of(scenario).items()
    }

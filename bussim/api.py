"""The Python interface: load a scenario, run it, read the results.

::

    import bussim

    result = bussim.run("press_line")
    result.plot_scan_times()
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

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

if TYPE_CHECKING:
    from bussim.results.plots.style import Picture
    from bussim.scenario.loader import Examined

__all__ = [
    "Progress",
    "Result",
    "Source",
    "examine",
    "load",
    "loads",
    "open_run",
    "plot_scan_times",
    "profiles",
    "run",
    "timeline",
]

#: How often the size of a run's folder is looked at.
_SIZE_CHECKS = 1000
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


def loads(text: str, overrides: Iterable[str] = (), *, allow_code: bool = False) -> Scenario:
    """The scenario in a text; else as :func:`load`."""
    from bussim.scenario import loader

    return loader.loads(text, overrides=overrides, allow_code=allow_code)


def examine(text: str, *, name: str = "<string>", files: Mapping[str, bytes] | None = None) -> Examined:
    """The scenario in a text or every mistake in it, and its warnings, with their lines and columns.

    No file that the text names is read from the disk: programs and tables that it names are those in
    ``files``, by the names that the text has for them, or come with bussim; functions of a user are a
    mistake. ``name`` stands for the file in messages. Raises nothing for what is wrong with the text.
    """
    from bussim.scenario import loader

    return loader.examine_text(text, name=name, files=files)


def profiles() -> dict[str, dict[str, Any]]:
    """What a link of each profile may be set to, by the profile's name, as plain data.

    ``stations`` (with the master), ``retries`` (D8179) and ``timeout`` (D8180, in 10 ms) are the least and
    the greatest value, ``default_timeout`` is D8180 at power-on. ``modes`` has for each refresh mode (D8178)
    how many ``bits`` (M) and ``words`` (D) of a station it carries, and whether the settings table lists it
    (``documented``); ``set_under`` is the contact under which a program sets the link. ``assumed`` are the
    settings that no public source gives and that a link's figures and error counts depend on, by their keys
    in a scenario's ``profile``.
    """
    from bussim.engines.nn.frames import MODES
    from bussim.plc.profiles import ASSUMED_OF_LINKS, MAX_RETRIES, MAX_SLAVES, PROFILES

    return {
        name: {
            "stations": [2, MAX_SLAVES + 1],
            "retries": [0, MAX_RETRIES],
            "timeout": list(profile.timeout_range),
            "default_timeout": profile.default_timeout,
            "modes": {
                mode: {**MODES[mode]._asdict(), "documented": mode in profile.documented_modes}
                for mode in profile.modes
            },
            "set_under": profile.set_under,
            "assumed": {key: str(getattr(profile, key)) for key in ASSUMED_OF_LINKS},
        }
        for name, profile in PROFILES.items()
    }


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
    largest: int | None = None,
) -> Result:
    """Simulate a scenario, given as such, as a file or by a built-in name.

    ``out`` is a folder to write (summary, tables; :meth:`Result.save_plots` adds pictures); without it the
    result stays in memory.
    ``rows`` keeps one row a link scan, Modbus transaction, free-protocol message and change of an
    observed device, ``trace`` also every attempt, frame and event; without both the memory needed
    does not depend on the run's length. ``format`` is that of the tables, "csv" or "parquet". Where
    ``out`` exists, ``force`` replaces the folder of an earlier run and ``numbered`` takes the next
    free of ``out-2``, ``out-3`` and so on; :attr:`Result.folder` is the one taken. A run whose folder
    would become larger than ``largest`` bytes (None: any) is given up as soon as that is seen: UsageError.

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
        if largest is not None:
            progress = _bounded(progress, folder, largest)
        totals, record = _simulate(scenario, folder.rows if rows or trace else None, trace, progress)
        location = folder.finish(record, text)
    return Result(record, FolderRows(location), totals=totals, folder=location)


def _bounded(progress: Progress | None, folder: RunFolder, largest: int) -> Progress:
    """The progress, which gives a run up whose folder would become larger than so many bytes."""
    done_before = 0

    def watch(done: int, total: int) -> None:
        nonlocal done_before
        if progress is not None:
            progress(done, total)
        if (done - done_before) * _SIZE_CHECKS < total:
            return
        done_before, size = done, folder.size()
        if size * _SIZE_CHECKS > largest and size * total > largest * done:
            raise UsageError(
                f"{folder.target} would become about {size * total / done / 1e9:,.2g} GB ({done / total:.1%} "
                f"of the run have {size / 1e9:,.2g} GB), allowed are {largest / 1e9:,.6g} GB: write less "
                "(without --trace, with --no-rows, a shorter --duration), or raise --largest"
            )

    return watch


def open_run(folder: Source) -> Result:
    """The result of an earlier run, from its folder.

    Raises UsageError if it is not the folder of a run, or of one that was stopped.
    """
    location = Path(folder)
    return Result(load_run(location), FolderRows(location), folder=location)


def plot_scan_times(runs: Mapping[str, Result | RunRecord], bus: str | None = None) -> Picture:
    """The histograms of several runs' link scan times in one picture, by what each is to be called.

    ``bus`` is the link's (None: the first one with scans). Raises UsageError for a bus that a run lacks, for
    one without scans, and for no run or more than can be distinguished.
    """
    from bussim.results.plots.scan_times import scan_time_histogram

    records = [run.record if isinstance(run, Result) else run for run in runs.values()]
    if not records:
        raise UsageError("no run to draw: give one at least")
    links = records[0].links
    name = (
        bus
        if bus is not None
        else next((each for each in links if links[each].scan_times.histogram.count), "")
    )
    return scan_time_histogram(records, name, list(runs))


def timeline(
    run: Result | Source, *, bus: str | None = None, since: str | None = None, span: str = "200ms"
) -> Picture:
    """A window of a traced run as a picture: what each station sent when, attempts, damage, what changed.

    ``run`` is a result with a trace or the folder of one; ``bus`` is the one to draw (None: the one with the
    longest link scan). The window begins at ``since``, such as "10 s", and lasts ``span``; without
    ``since`` it is the longest link scan, or the longest attempt of another bus.

    Raises UsageError without a trace, for an unknown bus, for what is no time, for a time after the run.
    """
    from bussim.report.picture import timeline_picture
    from bussim.report.scene import scene_of
    from bussim.report.trace_window import read_window, worst_window
    from bussim.results.text.run import caption_of
    from bussim.units import parse_time

    result = run if isinstance(run, Result) else open_run(run)
    trace, record = result.open_trace(), result.record
    name = drawn_bus(record, [each.name for each in trace.header.buses], bus)
    if since is None:
        window = worst_window(trace, record, name)
        if window is None:
            raise UsageError(f"the bus {name!r} carried nothing; choose a window with since and span")
    else:
        try:
            begin, length = parse_time(since), parse_time(span)
        except ValueError as error:
            raise UsageError(f"since or span {error}") from None
        if begin >= record.duration:
            raise UsageError(f"since is {since}, beyond the end of the run")
        window = begin, min(begin + length, record.duration)
    return timeline_picture(scene_of(read_window(trace, record, name, *window)), caption_of(record.summary))


def drawn_bus(record: RunRecord, buses: Sequence[str], wanted: str | None) -> str:
    """The bus of a run to draw: the wanted one, else the one with the longest link scan.

    ``buses`` are those of its trace. Raises UsageError if it is none of them, or there are none.
    """
    if wanted is not None:
        if wanted not in buses:
            raise UsageError(
                f"{record.scenario} has no bus {wanted!r}; it has {', '.join(map(repr, buses)) or 'none'}"
            )
        return wanted
    longest = {
        bus: link.scan_times.histogram.maximum or 0 for bus, link in record.links.items() if bus in buses
    }
    if longest:
        return max(longest, key=lambda bus: longest[bus])
    if not buses:
        raise UsageError(f"the trace of {record.scenario} names no bus; there is nothing to draw")
    return buses[0]


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

"""The report: one HTML page that needs nothing else, from finished runs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from bussim.report import charts, compare, tables
from bussim.report.document import document
from bussim.report.latency import LatencyPart, latency_part, overlays
from bussim.report.nodes import node_tables, response_charts
from bussim.report.parts import Chart, Charts
from bussim.report.runs import Source
from bussim.report.scene import Scene
from bussim.report.settings import mov_lines
from bussim.report.tables import Table
from bussim.report.text import expected
from bussim.results.meters.histogram import Histogram
from bussim.results.meters.timeline import fault_spans
from bussim.results.plots.scan_times import run_labels
from bussim.results.plots.style import RUNS
from bussim.results.verdict.verdict import about as about_bus
from bussim.units import seconds
from bussim.wording import about, counted, in_ms, shell_word


@dataclass(frozen=True, slots=True)
class Key:
    """A figure in large type."""

    label: str
    value: str
    remark: str = ""


@dataclass(frozen=True, slots=True)
class LinkPart:
    """One link of one run, as the template shows it."""

    bus: str
    keys: Sequence[Key]
    verdict: Sequence[str]
    charts: Sequence[Chart]
    timeline: Chart | None
    why: Sequence[str]
    no_timeline: str
    tables: Sequence[Table]
    settings: Table
    programs: Sequence[tuple[str, Sequence[str]]]


@dataclass(frozen=True, slots=True)
class RunPart:
    """One run, as the template shows it. ``ident`` begins the ids of its sections."""

    ident: str
    source: Source
    about: str
    links: Sequence[LinkPart]
    buses: Sequence[tuple[str, Chart, Sequence[str]]]
    latency: LatencyPart | None
    said: Sequence[str]
    charts: Sequence[Chart]
    tables: Sequence[Table]
    faults: Sequence[tuple[str, str, str]]
    warnings: Sequence[str]
    commands: Sequence[str]


def report_page(sources: Sequence[Source], command: Sequence[str] = ()) -> str:
    """The page. Up to seven runs stay under 5 MB unless their scenarios are as large.

    ``command`` is the command line that made it, for the part on how to get it again.
    """
    drawn = Charts()
    runs = [_run(source, f"run{number}", drawn, command) for number, source in enumerate(sources, 1)]
    buses = _common(sources)
    comparison = None
    if len(sources) > 1:
        comparison = {
            "tables": [
                compare.head_table(sources),
                compare.verdict_table(sources),
                *(compare.link_table(sources, bus) for bus in buses),
                *compare.latency_tables(sources),
                *compare.entry_tables(sources),
            ],
            "charts": [
                *(
                    drawn.overlay(times, f"Link scan times on bus {bus}", "the link scan times", charts.SCANS)
                    for bus in buses
                    if (times := _scan_times(sources, bus))
                ),
                *overlays(sources, drawn),
            ],
            "changes": compare.scenario_changes(sources),
        }
    title = (
        f"{sources[0].record.scenario}: simulation report"
        if len(sources) == 1
        else f"{len(sources)} runs compared: simulation report"
    )
    return document(
        "page.html.jinja",
        ("page.js",),
        {"charts": drawn.payload, "runs": RUNS},
        title=title,
        runs=runs,
        comparison=comparison,
        command=" ".join(command),
    )


def _run(source: Source, ident: str, drawn: Charts, command: Sequence[str]) -> RunPart:
    summary = source.summary
    what_was_run = (
        f"Scenario {summary['scenario']}, {summary['duration_s']:g} s simulated, seed {summary['seed']}, "
        f"bussim {summary['bussim']}."
    )
    whole = [tables.plcs(source), *node_tables(summary)]
    said = summary["verdict"]
    links = [_link(source, bus, drawn) for bus in summary["links"]]
    buses = [
        (bus, _timeline(scene, drawn), scene.why)
        for bus, scene in source.scenes.items()
        if bus not in summary["links"]
    ]
    return RunPart(
        ident,
        source,
        what_was_run,
        links,
        buses,
        latency_part(source, drawn),
        [item["text"] for item in said if item["values"].get("bus") not in summary["links"]],
        response_charts(source, drawn),
        [table for table in whole if table.rows],
        _faults(source),
        summary["warnings"],
        _commands(source, command),
    )


def _link(source: Source, bus: str, drawn: Charts) -> LinkPart:
    link = source.summary["links"][bus]
    record = source.record.links[bus]
    distribution = source.valid_distribution(bus)
    some = [tables.link_figures(source, bus)]
    if link["scans"]:
        some.insert(0, tables.scan_times(source, bus))
    if link["station_errors"]:
        some.append(tables.stations(source, bus))
    if distribution is not None:
        some.append(tables.exact_figures(bus, distribution))
    if link["refresh_gap_ms"]:
        some.append(tables.refresh_gaps(source, bus))
    scene = source.scenes.get(bus)
    return LinkPart(
        bus,
        _keys(source, bus),
        [
            *about_bus(source.summary["verdict"], bus),
            *expected(link, source.distributions.get(bus)),
            *([source.no_distribution] if source.no_distribution else []),
        ],
        _link_charts(source, bus, drawn) if link["scans"] else [],
        None if scene is None else _timeline(scene, drawn),
        [] if scene is None else scene.why,
        source.no_trace if link["scans"] else "No link scan was completed: there is none to draw.",
        some,
        tables.settings(source, bus),
        [
            (plc, mov_lines(found["registers"], found.get("set_under", "M8002")))
            for plc in record.plc_names
            if (found := source.summary["plcs"].get(plc))
        ],
    )


def _keys(source: Source, bus: str) -> list[Key]:
    link = source.summary["links"][bus]
    times = link["scan_time_ms"]
    if not link["scans"]:
        return []
    name, key = ("median", "p50") if times["p50"] is not None else ("mean", "mean")
    keys = [
        Key(f"{name} link scan", in_ms(times[key])),
        Key("longest in the run", in_ms(times["max"], most=True), f"at {times['max_at_s']:.2f} s"),
    ]
    distribution = source.valid_distribution(bus)
    if distribution is not None:
        figures = distribution.figures
        undisturbed = ", undisturbed" if distribution.notes else ""
        keys.append(Key(f"longest at worst{undisturbed}", in_ms(figures["worst_case_ms"], most=True)))
        onsets = figures["false_error_onsets_per_year"]
        if onsets is not None:
            rare = onsets < 0.01
            keys.append(Key("false station errors a year", "under 0.01" if rare else about(onsets)))
        if figures["one_dead_ms"] is not None:
            one = "one more station" if figures["stations_dead"] else "one station"
            keys.append(Key(f"link scan with {one} dead", in_ms(figures["one_dead_ms"])))
    keys.append(Key("bus load", f"{100 * link['bus_load']:.1f} %"))
    return keys


def _link_charts(source: Source, bus: str, drawn: Charts) -> list[Chart]:
    record = source.record.links[bus]
    histogram, distribution = record.scan_times.histogram, source.valid_distribution(bus)
    times = source.summary["links"][bus]["scan_time_ms"]
    beside = ", with the exact law over it" if distribution is not None else ""
    where = f"from {in_ms(times['min'])} to {in_ms(times['max'], most=True)}, mean {in_ms(times['mean'])}"
    one = drawn.add(
        charts.histogram_chart(
            {source.label: histogram}, distribution, f"Histogram of the link scan time on bus {bus}"
        ),
        f"Histogram of {counted(histogram.count, 'link scan time')}, {where}{beside}.",
        tables.histogram_data(histogram, f"the link scan time on bus {bus}", charts.SCANS),
        "Bars: link scans counted."
        + (
            " Line: how many the exact law expects in each bar of this width."
            if distribution is not None
            else ""
        ),
    )
    two = drawn.add(
        charts.tail_chart(histogram, distribution, f"How often a link scan on bus {bus} takes longer"),
        f"Share of link scans that take longer than x, on a logarithmic axis, {where}{beside}.",
        None,
        "The share of all link scans that take longer than the time below.",
    )
    faults = fault_spans(source.record.notes, {bus, *record.plc_names})
    three = drawn.add(
        charts.over_run_chart(
            record,
            faults,
            source.record.duration,
            f"Link scan time on bus {bus} over the run",
            source.summary["links"][bus].get("master_lost", ()),
        ),
        f"Longest and shortest link scans over the {source.summary['duration_s']:g} s of the run, {where}; "
        f"{counted(len(faults), 'fault')} acted.",
        None,
        "Bars below: when faults acted, the master had a station in error, and slaves had lost the master."
        if faults or record.in_error or source.summary["links"][bus].get("master_lost")
        else "",
    )
    return [one, two, three]


def _timeline(scene: Scene, drawn: Charts) -> Chart:
    where = f"{seconds(scene.begin):.3f} s to {seconds(scene.end):.3f} s"
    return drawn.add(
        charts.scene_chart(scene, f"Timeline of bus {scene.bus}, {where}"),
        f"What each station sent on bus {scene.bus} from {where}, a lane each. {' '.join(scene.why)}",
        tables.scene_data(scene),
        "Drag to zoom, double-click for the whole; point at a frame to read what it is.",
    )


def _scan_times(sources: Sequence[Source], bus: str) -> dict[str, Histogram]:
    links = ((source.label, source.record.links.get(bus)) for source in sources)
    times = {label: link.scan_times.histogram for label, link in links if link is not None}
    return {label: histogram for label, histogram in times.items() if histogram.count}


def _common(sources: Sequence[Source]) -> list[str]:
    """The links that more than one run has, in order of appearance."""
    every = [bus for source in sources for bus in source.summary["links"]]
    return [bus for bus in dict.fromkeys(every) if every.count(bus) > 1]


def _faults(source: Source) -> list[tuple[str, str, str]]:
    """Faults as texts, from when and until when."""
    # The table is of all buses, so each PLC and bus that a fault names counts.
    subjects = {str(note.detail.get(key)) for note in source.record.notes for key in ("node", "bus")}
    rows = []
    for text, span in fault_spans(source.record.notes, subjects):
        until = "to the end" if span.end is None else f"{seconds(span.end):.3f} s"
        rows.append((text, f"{seconds(span.start):.3f} s", "at once" if span.end == span.start else until))
    return rows


def _commands(source: Source, command: Sequence[str]) -> list[str]:
    """How to get the run again from the scenario in the page."""
    lines = [
        f"pip install bussim=={source.summary['bussim']}",
        "# save the scenario below as scenario.yaml; it holds the seed and every default",
        "bussim run scenario.yaml --trace --out again",
        "bussim report again -o again.html",
    ]
    return [*lines, f"# this page: {' '.join(map(shell_word, command))}"] if command else lines


def labels_of(names: Sequence[str], sources: Iterable[Any]) -> list[str]:
    """A different label for each run: its folder's name, or more where that is not enough."""
    if len(set(names)) == len(names):
        return list(names)
    return run_labels(list(sources))

"""The report: one HTML page that needs nothing else, from finished runs."""

from collections.abc import Iterable, Mapping, Sequence
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
from bussim.results.text.lines import fault_in_words
from bussim.results.verdict.catalogue import sentence
from bussim.results.verdict.verdict import about as about_bus
from bussim.units import seconds
from bussim.wording import about, in_ms, shell_word
from bussim.words.language import current_language, say, shown
from bussim.words.origins import assumption_in_words, in_words, origin_in_words
from bussim.words.tables import page_words


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
    rests: Sequence[str]


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
    others: str


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
                    drawn.overlay(
                        times, say("report_scans_several", bus=bus), say("report_of_scans"), charts.SCANS
                    )
                    for bus in buses
                    if (times := _scan_times(sources, bus))
                ),
                *overlays(sources, drawn),
            ],
            "changes": compare.scenario_changes(sources),
        }
    title = (
        say("report_title", scenario=sources[0].record.scenario)
        if len(sources) == 1
        else say("report_title_several", number=len(sources))
    )
    lang = current_language()
    words = {lang: page_words("report", lang)}
    return document(
        "page.html.jinja",
        ("page.js",),
        {"charts": shown(drawn.payload), "runs": RUNS, "lang": lang, "words": words},
        lang=lang,
        title=shown(title),
        runs=runs,
        comparison=comparison,
        command=" ".join(command),
    )


def _run(source: Source, ident: str, drawn: Charts, command: Sequence[str]) -> RunPart:
    summary = source.summary
    what = {"scenario": summary["scenario"], "seed": summary["seed"], "version": summary["bussim"]}
    what_was_run = say("report_about", **what, duration=summary["duration_s"])
    whole = [tables.plcs(source), *node_tables(summary)]
    said = summary["verdict"]
    links = [_link(source, bus, drawn) for bus in summary["links"]]
    buses = [
        (bus, _timeline(scene, drawn), scene.why)
        for bus, scene in source.scenes.items()
        if bus not in summary["links"]
    ]
    others = summary.get("rests_on", {}).get("other figures")
    return RunPart(
        ident,
        source,
        what_was_run,
        links,
        buses,
        latency_part(source, drawn),
        [sentence(item) for item in said if item["values"].get("bus") not in summary["links"]],
        response_charts(source, drawn),
        [table for table in whole if table.rows],
        _faults(source),
        summary["warnings"],
        _commands(source, command),
        origin_in_words(others) if others else "",
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
        source.no_trace if link["scans"] else say("report_no_scan"),
        some,
        tables.settings(source, bus),
        [
            (plc, mov_lines(found["registers"], found.get("set_under", "M8002")))
            for plc in record.plc_names
            if (found := source.summary["plcs"].get(plc))
        ],
        _rests(source.summary.get("rests_on", {}).get("links", {}).get(bus)),
    )


def _rests(found: Mapping[str, Any] | None) -> list[str]:
    """What the figures of a link rest on; a folder of an earlier version does not say."""
    if not found:
        return []
    most = [assumption_in_words(sentence) for sentence in found["assumptions"]]
    return [*in_words(found), *([say("report_most"), *most] if most else [])]


def _keys(source: Source, bus: str) -> list[Key]:
    link = source.summary["links"][bus]
    times = link["scan_time_ms"]
    if not link["scans"]:
        return []
    name, key = ("key_median", "p50") if times["p50"] is not None else ("key_mean", "mean")
    when = say("key_at", at=times["max_at_s"])
    keys = [Key(say(name), in_ms(times[key])), Key(say("key_longest"), in_ms(times["max"], most=True), when)]
    distribution = source.valid_distribution(bus)
    if distribution is not None:
        figures = distribution.figures
        worst = say("key_worst_undisturbed" if distribution.notes else "key_worst")
        keys.append(Key(worst, in_ms(figures["worst_case_ms"], most=True)))
        onsets = figures["false_error_onsets_per_year"]
        if onsets is not None:
            rare = onsets < 0.01
            keys.append(Key(say("key_errors"), say("key_rare") if rare else about(onsets)))
        if figures["one_dead_ms"] is not None:
            one = say("key_dead_more" if figures["stations_dead"] else "key_dead")
            keys.append(Key(one, in_ms(figures["one_dead_ms"])))
    keys.append(Key(say("key_load"), f"{100 * link['bus_load']:.1f} %"))
    return keys


def _link_charts(source: Source, bus: str, drawn: Charts) -> list[Chart]:
    record = source.record.links[bus]
    histogram, distribution = record.scan_times.histogram, source.valid_distribution(bus)
    times = source.summary["links"][bus]["scan_time_ms"]
    span = {
        "least": in_ms(times["min"]),
        "most": in_ms(times["max"], most=True),
        "mean": in_ms(times["mean"]),
    }
    where = say("chart_where", **span)
    with_law = where if distribution is None else say("chart_where_law", **span)
    one = drawn.add(
        charts.histogram_chart({source.label: histogram}, distribution, say("chart_histogram", bus=bus)),
        say("chart_histogram_said", scans=histogram.count, where=with_law),
        tables.histogram_data(histogram, say("chart_scan_times_of", bus=bus), charts.SCANS),
        say("chart_bars" if distribution is None else "chart_bars_law"),
    )
    two = drawn.add(
        charts.tail_chart(histogram, distribution, say("chart_tail", bus=bus)),
        say("chart_tail_said", where=with_law),
        None,
        say("chart_tail_caption"),
    )
    faults = fault_spans(source.record.notes, {bus, *record.plc_names})
    three = drawn.add(
        charts.over_run_chart(
            record,
            faults,
            source.record.duration,
            say("chart_over_run", bus=bus),
            source.summary["links"][bus].get("master_lost", ()),
        ),
        say(
            "chart_over_run_said",
            duration=f"{source.summary['duration_s']:g}",
            where=where,
            faults=len(faults),
        ),
        None,
        say("chart_lanes")
        if faults or record.in_error or source.summary["links"][bus].get("master_lost")
        else "",
    )
    return [one, two, three]


def _timeline(scene: Scene, drawn: Charts) -> Chart:
    where = {"bus": scene.bus, "begin": seconds(scene.begin), "end": seconds(scene.end)}
    return drawn.add(
        charts.scene_chart(scene, say("chart_timeline", **where)),
        say("chart_timeline_said", **where, why=say("sentences", texts=scene.why)),
        tables.scene_data(scene),
        say("chart_timeline_caption"),
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
    # The table is of all buses, so each PLC and bus that a fault names counts.
    subjects = {str(note.detail.get(key)) for note in source.record.notes for key in ("node", "bus")}
    rows = []
    for text, span in fault_spans(source.record.notes, subjects):
        until = say("fault_to_end") if span.end is None else f"{seconds(span.end):.3f} s"
        until = say("fault_at_once") if span.end == span.start else until
        rows.append((fault_in_words(text), f"{seconds(span.start):.3f} s", until))
    return rows


def _commands(source: Source, command: Sequence[str]) -> list[str]:
    """How to get the run again from the scenario in the page."""
    lines = [
        f"pip install bussim=={source.summary['bussim']}",
        say("report_pip"),
        "bussim run scenario.yaml --trace --out again",
        "bussim report again -o again.html",
    ]
    return [*lines, say("report_this_page", command=" ".join(map(shell_word, command)))] if command else lines


def labels_of(names: Sequence[str], sources: Iterable[Any]) -> list[str]:
    """A different label for each run: its folder's name, or more where that is not enough."""
    return list(names) if len(set(names)) == len(names) else run_labels(list(sources))

"""A report's part on latencies: sentences, tables, and of each entry its histogram and what it is made of."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from bussim.report import charts, tables
from bussim.report.parts import Chart, Charts
from bussim.report.runs import Source
from bussim.report.tables import NONE, Cell, Table, found, number, pointer
from bussim.results.meters.latency_record import PARTS, LatencyRecord
from bussim.results.numbers import adding_up
from bussim.results.text.latency import (
    bounds_in_words,
    case_in_words,
    caveats,
    counts_in_words,
    edge_in_words,
    heading,
    lost_in_words,
    part_names,
    shown_bounds,
)
from bussim.units import milliseconds
from bussim.wording import in_ms
from bussim.words.language import say
from bussim.words.tables import recognised

_COUNTS = {key: say(f"late_{key}") for key in ("changes", "delivered", "lost", "unseen", "open")}
_READINGS = {"changes": say("late_source_changes"), "delivered": say("late_reads")}
_TIMES = {key: tables.TIMES[key] for key in ("min", "p50", "mean", "p95", "p99", "max")}


@dataclass(frozen=True, slots=True)
class LatencyEntry:
    """One entry of a run's latencies, as the template shows it."""

    heading: str
    charts: Sequence[Chart]


@dataclass(frozen=True, slots=True)
class LatencyPart:
    """A run's latencies, as the template shows them."""

    said: Sequence[str]
    tables: Sequence[Table]
    entries: Sequence[LatencyEntry]


def latency_part(source: Source, drawn: Charts) -> LatencyPart | None:
    """The latencies of a run; None where it measures none."""
    summary: Mapping[str, Any] = source.summary.get("latency") or {}
    if not summary:
        return None
    some = [
        figures(source, say("late_table"), _COUNTS, word=False),
        figures(source, say("late_age_table"), _READINGS, word=True),
        bounds(source),
    ]
    return LatencyPart(
        [sentence for name, entry in summary.items() for sentence in in_words(name, entry)],
        [table for table in some if table.rows],
        [
            LatencyEntry(heading(name, summary[name]), _charts(source, name, drawn))
            for name, record in source.record.latency.items()
            if record.histogram.count
        ],
    )


# -- sentences -----------------------------------------------------------------------------------------


def in_words(name: str, entry: Mapping[str, Any]) -> Iterator[str]:
    """An entry of the summary's latencies in sentences."""
    word, times, cases = entry["edge"] is None, entry["ms"], list[str]()
    what = say("late_nothing_read" if word else "late_nothing_arrived")
    if times["max"] is not None and entry["max_at_s"] is not None:
        which = "mean" if times["p50"] is None else "median"
        usual = in_ms(times[{"mean": "mean", "median": "p50"}[which]])
        longest = in_ms(times["max"], most=True)
        what = say(f"late_{which}", usual=usual, longest=longest, at=entry["max_at_s"])
        cases = [
            say("late_with", bound=in_ms(bound, most=True), case=case_in_words(case))
            for case, bound in bounds_in_words(entry).items()
        ]
    about = {"heading": heading(name, entry), "edge": edge_in_words(entry)}
    yield say("late_said", **about, what=what, counts=counts_in_words(entry))
    if hint := lost_in_words(entry):
        yield say("late_of", name=name, said=hint)
    if cases:
        yield say("late_is_old" if word else "late_takes", name=name, cases=cases)
    yield from (say("late_of", name=name, said=said) for said in caveats(entry))


# -- tables --------------------------------------------------------------------------------------------


def figures(source: Source, caption: str, counts: Mapping[str, str], *, word: bool) -> Table:
    """A row for each entry of one kind: what became of its changes, and how long they took."""
    rows = []
    for name, entry in source.summary["latency"].items():
        if (entry["edge"] is None) != word:
            continue
        at = ("latency", name)
        cells = [found(source.summary, *at, key) for key in counts]
        cells += [found(source.summary, *at, "ms", key, decimals=3) for key in _TIMES]
        cells.append(found(source.summary, *at, "max_at_s", decimals=3))
        rows.append((name, cells))
    head = [say("late_entry"), *counts.values(), *_TIMES.values(), say("late_longest_at")]
    return Table(caption, head, rows, say("table_dash_few"))


def bounds(source: Source) -> Table:
    """A row for each entry: what it may be at worst, in every case that has a bound."""
    entries = source.summary["latency"]
    cases = list(dict.fromkeys(case for entry in entries.values() for case in entry.get("bound_ms", {})))
    cases.sort(key=lambda case: max(entry.get("bound_ms", {}).get(case, 0.0) for entry in entries.values()))
    rows = [
        (
            name,
            [
                found(source.summary, "latency", name, "bound_ms", case, decimals=3)
                if case in entry.get("bound_ms", {})
                else Cell(NONE, title=_why_none(entry))
                for case in cases
            ],
        )
        for name, entry in entries.items()
        if cases
    ]
    head = [say("late_entry"), *map(case_in_words, cases)]
    return Table(say("late_worst"), head, rows, say("late_worst_note"))


def _why_none(entry: Mapping[str, Any]) -> str:
    """Why an entry has no bound in a case."""
    reasons = [recognised(reason) for reason in entry.get("bound_reasons", ())]
    return say("semicolon_list", texts=reasons) if reasons else say("late_no_case")


def parts_data(name: str, record: LatencyRecord, summary: Mapping[str, Any]) -> Table:
    """What the shortest, the mean and the longest one are made of, and the most that each part took."""
    rows = []
    for what, ticks in record.examples().items():
        whole = milliseconds(sum(ticks))
        texts = adding_up([milliseconds(each) for each in ticks], whole)
        cells = [
            Cell(text, pointer("latency", name, "parts_ms", part, "mean") if what == "mean" else "")
            for part, text in zip(PARTS, texts, strict=True)
        ]
        rows.append((say(f"example_{what}"), [*cells, Cell(number(whole, 3))]))
    most = [found(summary, "latency", name, "parts_ms", part, "max", decimals=3) for part in PARTS]
    rows.append((say("late_most"), [*most, Cell("")]))
    head = ["", *(part_names(word=record.word)[part] for part in PARTS), say("late_sum")]
    return Table(say("late_made_of", name=name), head, rows)


def compared(
    sources: Sequence[Source],
) -> Iterator[tuple[str, list[tuple[str, tuple[str, ...], int | None]]]]:
    """What several runs are compared by, of each entry that two of them have: label, keys, decimals."""
    every = [name for source in sources for name in source.summary.get("latency") or {}]
    for name in dict.fromkeys(every):
        entries = [entry for source in sources if (entry := (source.summary.get("latency") or {}).get(name))]
        if len(entries) < 2:
            continue
        at = ("latency", name)
        words = all(entry["edge"] is None for entry in entries)
        rows: list[tuple[str, tuple[str, ...], int | None]] = [
            (label, (*at, key), None) for key, label in (_READINGS if words else _COUNTS).items()
        ]
        rows += [(say("table_time_ms", time=label), (*at, "ms", key), 3) for key, label in _TIMES.items()]
        names = part_names(word=words)
        rows += [
            (say("late_part_mean", part=names[part]), (*at, "parts_ms", part, "mean"), 3) for part in PARTS
        ]
        cases = dict.fromkeys(case for entry in entries for case in entry.get("bound_ms", {}))
        rows += [(say("late_case", case=case_in_words(case)), (*at, "bound_ms", case), 3) for case in cases]
        yield name, rows


# -- charts --------------------------------------------------------------------------------------------


def _charts(source: Source, name: str, drawn: Charts) -> list[Chart]:
    record, entry = source.record.latency[name], source.summary["latency"][name]
    times = entry["ms"]
    near = shown_bounds(entry, times["max"])
    far = {case: bound for case, bound in bounds_in_words(entry).items() if case not in near}
    longest = max([times["max"], *near.values()])
    quantity = _quantity(record)
    where = say("chart_latency_where", least=times["min"], most=times["max"], mean=times["mean"])
    beyond = [say("chart_latency_case", bound=bound, case=case_in_words(case)) for case, bound in far.items()]
    marked = [
        say("chart_latency_bound", bound=bound, case=case_in_words(case)) for case, bound in near.items()
    ]
    count = quantity.times(record.histogram.count)
    one = drawn.add(
        charts.histogram_chart(
            {source.label: record.histogram},
            None,
            say("chart_latency", name=name),
            quantity,
            near,
            (0.0, longest),
        ),
        say("chart_latency_said", count=count, time=quantity.time, parts=[where, *marked]),
        tables.histogram_data(record.histogram, name, quantity),
        say("chart_latency_beyond", cases=beyond) if beyond else "",
    )
    names = part_names(word=record.word)
    two = drawn.add(
        charts.parts_chart(record, near, longest, say("chart_made_of", name=name)),
        say(
            "chart_made_of_said",
            time=quantity.time,
            parts=[
                say("chart_part_mean", part=word, mean=entry["parts_ms"][part]["mean"])
                for part, word in names.items()
                if entry["parts_ms"][part]["max"] and entry["parts_ms"][part]["mean"] is not None
            ],
        ),
        parts_data(name, record, source.summary),
        say("chart_point"),
    )
    return [one, two]


def overlays(sources: Sequence[Source], drawn: Charts) -> list[Chart]:
    """The histograms of each entry that more than one run has measured, on one axis."""
    found = []
    for name in dict.fromkeys(name for source in sources for name in source.record.latency):
        records = {
            source.label: record
            for source in sources
            if (record := source.record.latency.get(name)) is not None and record.histogram.count
        }
        if len(records) < 2 or len({record.word for record in records.values()}) > 1:
            continue
        quantity = _quantity(next(iter(records.values())))
        histograms = {label: record.histogram for label, record in records.items()}
        found.append(drawn.overlay(histograms, name, name, quantity))
    return found


def _quantity(record: LatencyRecord) -> charts.Quantity:
    return charts.AGES if record.word else charts.LATENCIES

"""A report's part on latencies: sentences, tables, and of each entry its histogram and what it is made of."""

from __future__ import annotations

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

_COUNTS = {
    "changes": "changes",
    "delivered": "arrived",
    "lost": "never arrived",
    "unseen": "too short to be seen",
    "open": "under way at the end",
}
_READINGS = {"changes": "changes of the source", "delivered": "times that it was read"}
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
        figures(source, "Latency (ms)", _COUNTS, word=False),
        figures(source, "Age of words when they are read (ms)", _READINGS, word=True),
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
    what = f"nothing {'was read' if word else 'arrived'}"
    if times["max"] is not None and entry["max_at_s"] is not None:
        which = "mean" if times["p50"] is None else "median"
        usual = in_ms(times[{"mean": "mean", "median": "p50"}[which]])
        longest = in_ms(times["max"], most=True)
        what = f"{which} {usual}, maximum {longest}, {entry['max_at_s']:.2f} s after the start"
        cases = [f"{in_ms(bound, most=True)} with {case}" for case, bound in bounds_in_words(entry).items()]
    yield f"{heading(name, entry)}, {edge_in_words(entry)}: {what} ({counts_in_words(entry)})."
    if hint := lost_in_words(entry):
        yield f"{name}: {hint}."
    if cases:
        yield f"At worst {name} {'is as old as' if word else 'takes'} {', '.join(cases)}."
    yield from (f"{name}: {said}." for said in caveats(entry))


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
    head = ["entry", *counts.values(), *_TIMES.values(), "longest at (s)"]
    return Table(caption, head, rows, "A dash: too few of them beyond it to say.")


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
                else Cell(NONE, title="; ".join(entry.get("bound_reasons", ["no such case"])))
                for case in cases
            ],
        )
        for name, entry in entries.items()
        if cases
    ]
    note = (
        "In closed form, for the parts of a run without faults. No error: nor is an error flag still on at "
        "the change. Every retry spent: the source is in error for one link scan and replies to the last "
        "attempt of the next, any reply of all others may be lost. A frame that only the target misses adds "
        "to it."
    )
    return Table("At worst (ms)", ["entry", *cases], rows, note)


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
        rows.append((what, [*cells, Cell(number(whole, 3))]))
    most = [found(summary, "latency", name, "parts_ms", part, "max", decimals=3) for part in PARTS]
    rows.append(("most of each part", [*most, Cell("")]))
    head = ["", *(part_names(word=record.word)[part] for part in PARTS), "sum"]
    return Table(f"What {name} is made of (ms)", head, rows)


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
        rows += [(f"{label} (ms)", (*at, "ms", key), 3) for key, label in _TIMES.items()]
        names = part_names(word=words)
        rows += [(f"{names[part]}, mean (ms)", (*at, "parts_ms", part, "mean"), 3) for part in PARTS]
        cases = dict.fromkeys(case for entry in entries for case in entry.get("bound_ms", {}))
        rows += [(f"at worst with {case} (ms)", (*at, "bound_ms", case), 3) for case in cases]
        yield name, rows


# -- charts --------------------------------------------------------------------------------------------


def _charts(source: Source, name: str, drawn: Charts) -> list[Chart]:
    record, entry = source.record.latency[name], source.summary["latency"][name]
    times = entry["ms"]
    near = shown_bounds(entry, times["max"])
    far = {case: bound for case, bound in bounds_in_words(entry).items() if case not in near}
    longest = max([times["max"], *near.values()])
    quantity = _quantity(record)
    where = f"from {times['min']:.1f} to {times['max']:.1f} ms, mean {times['mean']:.1f} ms"
    beyond = ", ".join(f"{bound:,.3f} ms with {case}" for case, bound in far.items())
    marked = "".join(f"; at worst {bound:.1f} ms with {case}" for case, bound in near.items())
    one = drawn.add(
        charts.histogram_chart(
            {source.label: record.histogram},
            None,
            f"Histogram of {name}",
            quantity,
            near,
            (0.0, longest),
        ),
        f"Histogram of {record.histogram.count:,} {quantity.counted}, {quantity.time} {where}{marked}.",
        tables.histogram_data(record.histogram, name, quantity),
        f"Beyond this axis: at worst {beyond}." if beyond else "",
    )
    names = part_names(word=record.word)
    two = drawn.add(
        charts.parts_chart(record, near, longest, f"What {name} is made of"),
        f"The shortest, the mean and the longest {quantity.time} as bars of their parts: "
        + "; ".join(
            f"{word} on average {entry['parts_ms'][part]['mean']:.1f} ms"
            for part, word in names.items()
            if entry["parts_ms"][part]["max"] and entry["parts_ms"][part]["mean"] is not None
        )
        + ".",
        parts_data(name, record, source.summary),
        "Point at a part to read how long it took.",
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

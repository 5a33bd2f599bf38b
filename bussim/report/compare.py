"""Several runs side by side: settings, figures and scenarios, with what differs from the first run."""

import difflib
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from bussim.report.latency import compared
from bussim.report.nodes import node_metrics, value_at
from bussim.report.runs import Source
from bussim.report.tables import CODE, NONE, SETTINGS, TIMES, Cell, Table, number, pointer
from bussim.results.verdict.catalogue import sentence
from bussim.results.verdict.verdict import faults
from bussim.words.language import say

_HEAD = {key: say(f"compare_{key}") for key in ("scenario", "seed", "duration_s")} | {"bussim": "bussim"}
_FIGURES = (
    ("scans", say("table_scans"), None),
    ("bus_load", say("node_load"), 4),
    ("polls", say("compare_polls"), None),
    ("collisions", say("table_collisions"), None),
    ("undetected_frames", say("table_undetected_frames"), None),
)


def _onsets(link: Mapping[str, Any]) -> int | None:
    """The onsets of all stations; None of a folder of an earlier version."""
    onsets = link.get("station_error_onsets")
    return None if onsets is None else sum(onsets.values())


_SUMS: tuple[tuple[str, Callable[[Mapping[str, Any]], int | None]], ...] = (
    (
        say("compare_failed"),
        lambda link: sum(sum(codes.values()) for codes in link["failed_attempts"].values()),
    ),
    (say("compare_errors"), lambda link: sum(link["station_errors"].values())),
    (say("compare_onsets"), _onsets),
)
_EXACT = {
    say("compare_exact_mean"): ("mean_ms",),
    say("compare_exact_worst"): ("worst_case_ms",),
    say("compare_exact_dead"): ("one_dead_ms",),
    say("compare_exact_detect"): ("detect_ms", "max"),
    say("compare_exact_onsets"): ("false_error_onsets_per_year",),
}


def head_table(sources: Sequence[Source]) -> Table:
    """What was run."""
    codes = {"seed": CODE}
    rows = [(label, _row(sources, (key,), codes.get(key), change=False)) for key, label in _HEAD.items()]
    return Table(say("compare_runs"), ["", *(source.label for source in sources)], rows)


def verdict_table(sources: Sequence[Source]) -> Table:
    """What was wrong in each run, in the words of its verdict."""
    rows = []
    for source in sources:
        texts = [sentence(item) for item in faults(source.summary["verdict"])]
        text = say("sentences", texts=texts) if texts else say("compare_nothing")
        rows.append((source.label, [Cell(text)]))
    return Table(say("compare_verdicts"), ["", say("compare_wrong")], rows)


def link_table(sources: Sequence[Source], bus: str) -> Table:
    """Settings and figures of one link in every run that has it."""
    rows = [(label, _row(sources, ("links", bus, key), change=False)) for key, label in SETTINGS.items()]
    rows += [(label, _row(sources, ("links", bus, key), decimals)) for key, label, decimals in _FIGURES]
    for key in ("min", "p50", "mean", "p99", "p999", "max"):
        rows.append(
            (say("compare_scan", label=TIMES[key]), _row(sources, ("links", bus, "scan_time_ms", key), 3))
        )
    links = [source.summary["links"].get(bus) for source in sources]
    for label, count in _SUMS:
        rows.append((label, _marked([None if link is None else count(link) for link in links])))
    laws = [source.valid_distribution(bus) for source in sources]
    for label, keys in _EXACT.items():
        cells = _marked([None if law is None else value_at(law.figures, keys, None) for law in laws])
        if any(cell.text != NONE for cell in cells):
            rows.append((label, cells))
    return Table(say("table_link", bus=bus), ["", *(source.label for source in sources)], rows)


def entry_tables(sources: Sequence[Source]) -> list[Table]:
    """Ports and devices that more than one run has, a table each."""
    tables = []
    for section in ("ports", "devices"):
        every = [name for source in sources for name in source.summary.get(section) or {}]
        for name in dict.fromkeys(every):
            if every.count(name) < 2:
                continue
            entries = [
                entry for source in sources if (entry := (source.summary.get(section) or {}).get(name))
            ]
            rows = [
                (metric.label, _row(sources, (section, name, *metric.keys), metric.decimals))
                for metric in node_metrics(entries)
            ]
            tables.append(Table(name, ["", *(source.label for source in sources)], rows))
    return tables


def latency_tables(sources: Sequence[Source]) -> list[Table]:
    """Latencies that more than one run has, a table each."""
    head = ["", *(source.label for source in sources)]
    return [
        Table(name, head, [(label, _row(sources, keys, decimals)) for label, keys, decimals in rows])
        for name, rows in compared(sources)
    ]


def scenario_changes(sources: Sequence[Source]) -> list[tuple[str, list[str]]]:
    """The lines in which each further scenario differs from the first, as a unified diff."""
    first = sources[0]
    changes = []
    for source in sources[1:]:
        lines = difflib.unified_diff(
            first.scenario.splitlines(),
            source.scenario.splitlines(),
            first.label,
            source.label,
            n=1,
            lineterm="",
        )
        changes.append((source.label, list(lines)))
    return changes


def _row(
    sources: Sequence[Source], keys: Sequence[str], decimals: int | None = None, *, change: bool = True
) -> list[Cell]:
    values = [value_at(source.summary, keys, None) for source in sources]
    return _marked(values, keys, decimals, change=change)


def _marked(
    values: Sequence[Any], keys: Sequence[str] = (), decimals: int | None = None, *, change: bool = True
) -> list[Cell]:
    """The cells of a row; what is not the first run's value is marked, if wished with its change."""
    cells = []
    for value in values:
        text = number(value, decimals) if keys else _short(value)
        by = _change(values[0], value) if change else None
        differs = value != values[0] and by != ""
        cells.append(Cell(text, pointer(*keys) if keys else "", by or "", differs=differs))
    return cells


def _short(value: Any) -> str:
    if isinstance(value, float):
        exact = abs(value) >= 0.1 or value == 0
        return f"{value:,.{3 if abs(value) < 1e5 else 0}f}" if exact else f"{value:.2g}"
    return number(value)


def _change(first: Any, value: Any) -> str | None:
    """By how much a number differs; empty where that rounds to nothing, None where it is no number."""
    if not all(isinstance(v, int | float) and not isinstance(v, bool) for v in (first, value)):
        return None
    if not first:
        return f"{value - first:+,.6g}" if value != first else ""
    if abs(value) >= 10 * abs(first):
        return f"× {value / first:,.3g}"
    percent = f"{100 * (value - first) / first:+,.1f}"
    return "" if percent in ("+0.0", "-0.0") else f"{percent} %"

"""A report's tables as plain values; the page's template draws them all in one way."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from bussim.report.charts import Quantity
from bussim.report.runs import ExactDistribution, Source
from bussim.report.scene import END, Scene
from bussim.report.settings import MEANINGS, used
from bussim.results.meters.histogram import BIN_TICKS, Histogram, bar_width, statistics
from bussim.results.meters.timeline import time_on
from bussim.results.registers import own_name, own_names
from bussim.results.text.run import lost_by_station
from bussim.trace.records import AttemptRecord
from bussim.units import milliseconds
from bussim.wording import about
from bussim.words.formats import meaning

#: Where a quantile has too few samples beyond it, or a figure does not exist.
NONE = "–"
#: Settings of a link by their keys in ``summary.json``, and statistics of times likewise.
SETTINGS = {
    "stations": "stations",
    "mode": "refresh mode (D8178)",
    "retries": "retries (D8179)",
    "attempts": "attempts a poll",
    "timeout_ms": "timeout (ms)",
}
TIMES = {
    "min": "shortest",
    "p50": "median",
    "mean": "mean",
    "p95": "p95",
    "p99": "p99",
    "p999": "p999",
    "max": "longest",
}
_MOST_BARS = 40
_MOST_EVENTS = 500


@dataclass(frozen=True, slots=True)
class Cell:
    """A cell: its text, where in ``summary.json`` that stands (a JSON pointer), and a remark.

    ``differs`` marks a value that is not that of the first run.
    """

    text: str
    path: str = ""
    title: str = ""
    differs: bool = False


@dataclass(frozen=True, slots=True)
class Table:
    """A table: the first column of each row is its heading. ``rows`` are (heading, cells)."""

    caption: str
    head: Sequence[str]
    rows: Sequence[tuple[str, Sequence[Cell]]]
    note: str = ""


def pointer(*keys: object) -> str:
    """A JSON pointer (RFC 6901)."""
    return "".join("/" + str(key).replace("~", "~0").replace("/", "~1") for key in keys)


#: The decimals of a number that is a name, such as a seed or a rate: its thousands are not apart.
CODE = -1


def number(value: object, decimals: int | None = None) -> str:
    """A value of ``summary.json`` as a cell shows it."""
    if value is None:
        return NONE
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)
    if isinstance(value, int):
        return str(value) if decimals == CODE else f"{value:,}"
    return f"{value:,.{decimals}f}" if decimals is not None else f"{value:,.6g}"


def found(summary: Mapping[str, Any], *keys: str, decimals: int | None = None) -> Cell:
    """The cell of a value of ``summary.json``."""
    value: Any = summary
    for key in keys:
        value = value[key]
    few = "too few samples" if value is None else ""
    return Cell(number(value, decimals), pointer(*keys), few)


def scan_times(source: Source, bus: str) -> Table:
    """The link scan time over the whole run and after start-up."""
    at = ("links", bus, "scan_time_ms")
    keys = {
        "min": "shortest",
        "mean": "mean",
        "p50": "median",
        "p95": "p95: 19 in 20 take at most",
        "p99": "p99: 99 in 100 take at most",
        "p999": "p999: 999 in 1,000 take at most",
        "max": "longest",
    }
    rows = [
        (
            label,
            [
                found(source.summary, *at, key, decimals=3),
                found(source.summary, *at, "after_startup", key, decimals=3),
            ],
        )
        for key, label in keys.items()
    ]
    return Table(
        f"Link scan time on bus {bus} (ms)",
        ["", "whole run", "once all stations were healthy"],
        rows,
        "A dash: too few link scans beyond it.",
    )


def link_figures(source: Source, bus: str) -> Table:
    """Settings and counts of a link."""
    at = ("links", bus)
    labels = SETTINGS | {
        "scans": "link scans",
        "polls": "polls, repeats not counted",
        "collisions": "collisions",
        "undetected_frames": "damaged frames taken as good",
        "healthy_at_s": "all stations healthy for the first time (s)",
    }
    rows = [(label, [found(source.summary, *at, key)]) for key, label in labels.items()]
    load = source.summary["links"][bus]["bus_load"]
    rows.append(("bus load", [Cell(f"{100 * load:.2f} %", pointer(*at, "bus_load"))]))
    return Table(f"The link on bus {bus}", ["", "value"], rows)


def exact_figures(bus: str, distribution: ExactDistribution) -> Table:
    """The figures of a link's exact distribution."""
    f = distribution.figures
    more = " more" if f["stations_dead"] else ""
    rows: list[tuple[str, str]] = [
        ("mean link scan (ms)", number(f["mean_ms"], 3)),
        (
            "without errors, shortest and longest (ms)",
            " to ".join(number(f["no_error_ms"][k], 3) for k in ("min", "max")),
        ),
        *(
            (f"exceeded by 1 scan in {_one_in(float(key))} (ms)", number(x, 3))
            for key, x in f["quantiles_ms"].items()
        ),
        ("at worst (ms)", number(f["worst_case_ms"], 3)),
        (f"one{more} station dead (ms)", number(f["one_dead_ms"], 3)),
        (f"two{more} stations dead (ms)", number(f["two_dead_ms"], 3)),
        ("a dead station is in error: after the mean (ms)", number(f["detect_ms"]["mean"], 3)),
        (
            "a dead station is in error: at the latest after (ms), while no other reply is lost",
            number(f["detect_ms"]["max"], 3),
        ),
        ("silence without a station error (ms)", number(f["ride_through_ms"]["silence"], 3)),
        ("false station errors begin, a year", _rate(f["false_error_onsets_per_year"])),
    ]
    return Table(
        f"The exact law of the link on bus {bus}",
        ["", "value"],
        [(label, [Cell(text)]) for label, text in rows],
    )


def _rate(value: float | None) -> str:
    return NONE if value is None else about(value)


def refresh_gaps(source: Source, bus: str) -> Table:
    """The times between two arrivals of one station's block at another."""
    gaps = source.summary["links"][bus]["refresh_gap_ms"]
    rows = [
        (
            pair.replace("->", " → "),
            [
                found(source.summary, "links", bus, "refresh_gap_ms", pair, key, decimals=3)
                for key in ("p50", "p99", "max", "open")
            ],
        )
        for pair in gaps
    ]
    old = source.summary["links"][bus].get("stale_ms", {})
    for pair, (_, cells) in zip(gaps, rows, strict=True) if old else ():
        path = ("links", bus, "stale_ms", pair)
        for key in ("total", "longest"):
            known = pair in old and old[pair][key] is not None
            cells.append(found(source.summary, *path, key, decimals=3) if known else Cell(NONE))
    note = (
        "Choose the preset of a heartbeat from the longest, not from the link scan time: "
        "retries do not cover it."
    )
    head = ["from → to", "median", "p99", "longest", "still open at the end"]
    if old:
        head += ["worked on data from before one of the two was away, in all", "at the longest"]
    return Table(f"Refresh gaps on bus {bus} (ms)", head, rows, note)


def settings(source: Source, bus: str) -> Table:
    """The special registers with which each station was set."""
    plc_names = source.record.links[bus].plc_names
    rows = []
    for name, what in MEANINGS.items():
        cells = []
        for plc in plc_names:
            registers = source.registers(plc)
            here = name in used(registers)
            cells.append(
                Cell(str(registers[name]), pointer("plcs", plc, "registers", name)) if here else Cell(NONE)
            )
        rows.append((f"{name}: {what}", cells))
    return Table(
        f"Settings of the stations on bus {bus}",
        ["register", *plc_names],
        rows,
        "A slave needs only its number and its port; it learns the rest from the master.",
    )


def plcs(source: Source) -> Table:
    """The PLCs' own scans and serial errors."""
    rows = []
    for name, plc in source.summary["plcs"].items():
        cells = [found(source.summary, "plcs", name, "scan_ms", key, decimals=3) for key in ("mean", "max")]
        for register in ("D8201", "D8202", "D8063"):
            own = own_name(source.summary, name, register)
            value = plc["registers"].get(register)
            path = pointer("plcs", name, "registers", register)
            cells.append(
                Cell(NONE) if value is None else Cell(str(value), path, own)
            )  # a code is no quantity
        rows.append((name, cells))
    shown = {"D8201": " (link scan now)", "D8202": " (longest)", "D8063": ""}
    names = [own_names(source.summary, source.summary["plcs"], each) + what for each, what in shown.items()]
    head = ["PLC", "scan mean (ms)", "scan max (ms)", *names]
    return Table("The PLCs", head, rows)


def histogram_data(histogram: Histogram, of: str, quantity: Quantity) -> Table:
    """A histogram in at most some tens of rows, for readers who cannot see the chart."""
    width = bar_width(max(histogram.bins) - min(histogram.bins) + 1, _MOST_BARS)
    rows = []
    for bar, count in sorted(histogram.bars(width).items()):
        low, high = (milliseconds((edge * width - 0.5) * BIN_TICKS) for edge in (bar, bar + 1))
        rows.append((f"{low:.3f} to {high:.3f}", [Cell(f"{count:,}")]))
    return Table(f"Histogram of {of}, counted", [f"{quantity.time} (ms)", quantity.counted], rows)


def scene_data(scene: Scene) -> Table:
    """A timeline as a list, for readers who cannot see the chart."""
    shapes = [(box.start, box.end, scene.lanes[box.lane], box.text) for box in scene.boxes]
    shapes += [
        (mark.tick, mark.tick, scene.lanes[mark.lane], mark.text) for mark in scene.marks if mark.kind != END
    ]
    rows = [
        (
            f"{milliseconds(start - scene.begin):.3f}",
            [Cell(f"{milliseconds(end - start):.3f}"), Cell(lane), Cell(text)],
        )
        for start, end, lane, text in sorted(shapes)
    ]
    note = f"The first {_MOST_EVENTS} of {len(rows):,}." if len(rows) > _MOST_EVENTS else ""
    head = ["from (ms)", "for (ms)", "lane", "what"]
    return Table(f"What happened on bus {scene.bus}", head, rows[:_MOST_EVENTS], note)


def turnarounds_of(attempts: Iterable[AttemptRecord]) -> dict[str, dict[int, Histogram]]:
    """The turnarounds of all replies, by bus and station."""
    found: dict[str, dict[int, Histogram]] = {}
    for attempt in attempts:
        if attempt.code == 0 and attempt.turnaround is not None:
            found.setdefault(attempt.bus, {}).setdefault(attempt.station, Histogram()).add(attempt.turnaround)
    return found


def stations(source: Source, bus: str) -> Table:
    """One row a slave: failed attempts by code, station errors, and what a trace adds."""
    link = source.summary["links"][bus]
    names, turnarounds = source.station_names(bus), source.turnarounds.get(bus, {})
    failed: Mapping[str, Mapping[str, int]] = link["failed_attempts"]
    codes = sorted({code for by_code in failed.values() for code in by_code})
    head = [
        "station",
        *(f"failed {code}" for code in codes),
        "station errors (link scans)",
        "onsets",
        "in error (s)",
    ]
    if turnarounds:
        head[1:1] = ["replies", "turnaround median (ms)", "p99 (ms)", "max (ms)"]
    head += ["errors counted", "last code", "flag now"]
    lost = lost_by_station(link)
    if lost:
        there = [own_names(source.summary, lost, name) for name in ("D8203", "D8211", "M8183")]
        head += ["lost the master (s)", *(f"{name} there" for name in there)]
    rows = []
    for key in link["station_errors"]:
        station = int(key)
        label = f"{key} ({names[station]})" if station in names else key
        cells = [*_counts(source, bus, key, codes), *_registers(source, names.get(0, ""), station)]
        if turnarounds:
            cells[:0] = _turnarounds(turnarounds.get(station, Histogram()))
        if lost:
            name = names.get(station, "")
            cells += [Cell(number(lost.get(name, 0.0), 3)), *_registers(source, name, 0)]
        rows.append((label, cells))
    note = "; ".join(f"{code}: {meaning(code)}" for code in codes)
    if not turnarounds:
        note += f"{'. ' if note else ''}Replies and turnarounds need a trace (bussim run … --trace)"
    return Table(f"The slaves on bus {bus}, as the master saw them", head, rows, f"{note}." if note else "")


def _turnarounds(turnarounds: Histogram) -> list[Cell]:
    times = statistics(turnarounds)
    return [Cell(number(turnarounds.count)), *(Cell(number(times[key], 3)) for key in ("p50", "p99", "max"))]


def _counts(source: Source, bus: str, station: str, codes: Sequence[str]) -> Iterator[Cell]:
    link, record = source.summary["links"][bus], source.record.links[bus]
    failed = link["failed_attempts"].get(station, {})
    for code in codes:
        path = pointer("links", bus, "failed_attempts", station, code) if code in failed else ""
        yield Cell(number(failed.get(code, 0)), path)
    yield Cell(number(link["station_errors"][station]), pointer("links", bus, "station_errors", station))
    onsets = link.get("station_error_onsets")  # a folder of an earlier version has none
    path = pointer("links", bus, "station_error_onsets", station)
    yield Cell(NONE) if onsets is None else Cell(number(onsets[station]), path)
    yield Cell(number(time_on(record.in_error.get(int(station), []), source.record.duration), 3))


def _registers(source: Source, master: str, station: int) -> Iterator[Cell]:
    registers = source.registers(master)
    for name, form in (
        (f"D{8203 + station}", "d"),
        (f"D{8211 + station}", "02X"),
        (f"M{8183 + station}", ""),
    ):
        value, own = registers.get(name), own_name(source.summary, master, name)
        if value is None:
            yield Cell(NONE, title=own)
        else:
            text = format(value, form) if form else "ON" if value else "off"
            yield Cell(text, pointer("plcs", master, "registers", name), own)


def _one_in(probability: float) -> str:
    """The N of "1 in N", rounded down, so that as many or more are said."""
    return f"{math.floor(float(f'{1 / probability:.12g}')):,}"

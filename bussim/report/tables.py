"""A report's tables as plain values; the page's template draws them all in one way."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from bussim.report.charts import Quantity
from bussim.report.runs import ExactDistribution, Source
from bussim.report.scene import END, Scene
from bussim.report.settings import SETTINGS as REGISTERS
from bussim.report.settings import used
from bussim.results.meters.histogram import BIN_TICKS, Histogram, bar_width, statistics
from bussim.results.meters.timeline import time_on
from bussim.results.registers import own_name, own_names
from bussim.results.text.run import lost_by_station
from bussim.trace.records import AttemptRecord
from bussim.units import milliseconds
from bussim.wording import about
from bussim.words.formats import meaning_of
from bussim.words.language import say

#: Where a quantile has too few samples beyond it, or a figure does not exist.
NONE = "–"
#: Settings of a link by their keys in ``summary.json``, and statistics of times likewise.
SETTINGS = {key: say(f"table_{key}") for key in ("stations", "mode", "retries", "attempts", "timeout_ms")}
TIMES = {key: say(f"table_{key}") for key in ("min", "p50", "mean", "p95", "p99", "p999", "max")}
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
    few = say("table_few") if value is None else ""
    return Cell(number(value, decimals), pointer(*keys), few)


def scan_times(source: Source, bus: str) -> Table:
    """The link scan time over the whole run and after start-up."""
    at = ("links", bus, "scan_time_ms")
    keys = {key: TIMES[key] for key in ("min", "mean", "p50")}
    keys |= {key: say(f"table_{key}_long") for key in ("p95", "p99", "p999")} | {"max": TIMES["max"]}
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
        say("table_scan_times", bus=bus),
        ["", say("table_whole"), say("table_after")],
        rows,
        say("table_dash"),
    )


def link_figures(source: Source, bus: str) -> Table:
    """Settings and counts of a link."""
    at = ("links", bus)
    counts = ("scans", "polls", "collisions", "undetected_frames", "healthy_at_s")
    labels = SETTINGS | {key: say(f"table_{key}") for key in counts}
    rows = [(label, [found(source.summary, *at, key)]) for key, label in labels.items()]
    load = source.summary["links"][bus]["bus_load"]
    rows.append((say("table_bus_load"), [Cell(f"{100 * load:.2f} %", pointer(*at, "bus_load"))]))
    return Table(say("table_link", bus=bus), ["", say("table_value")], rows)


def exact_figures(bus: str, distribution: ExactDistribution) -> Table:
    """The figures of a link's exact distribution."""
    f = distribution.figures
    more = "_more" if f["stations_dead"] else ""
    least, most = (number(f["no_error_ms"][key], 3) for key in ("min", "max"))
    rows: list[tuple[str, str]] = [
        (say("table_mean_scan"), number(f["mean_ms"], 3)),
        (say("table_no_errors"), say("table_range", least=least, most=most)),
        *(
            (say("table_exceeded", number=_one_in(float(key))), number(x, 3))
            for key, x in f["quantiles_ms"].items()
        ),
        (say("table_worst"), number(f["worst_case_ms"], 3)),
        (say(f"table_one_dead{more}"), number(f["one_dead_ms"], 3)),
        (say(f"table_two_dead{more}"), number(f["two_dead_ms"], 3)),
        (say("table_detect_mean"), number(f["detect_ms"]["mean"], 3)),
        (say("table_detect_max"), number(f["detect_ms"]["max"], 3)),
        (say("table_silence"), number(f["ride_through_ms"]["silence"], 3)),
        (say("table_onsets_year"), _rate(f["false_error_onsets_per_year"])),
    ]
    return Table(
        say("table_exact", bus=bus), ["", say("table_value")], [(label, [Cell(text)]) for label, text in rows]
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
    head = [say("table_from_to"), *(TIMES[key] for key in ("p50", "p99", "max")), say("table_open")]
    if old:
        head += [say("table_stale"), say("table_stale_longest")]
    return Table(say("table_refresh", bus=bus), head, rows, say("table_refresh_note"))


def settings(source: Source, bus: str) -> Table:
    """The special registers with which each station was set."""
    plc_names = source.record.links[bus].plc_names
    rows = []
    for name in REGISTERS:
        cells = []
        for plc in plc_names:
            registers = source.registers(plc)
            here = name in used(registers)
            cells.append(
                Cell(str(registers[name]), pointer("plcs", plc, "registers", name)) if here else Cell(NONE)
            )
        meaning = say(f"setting_{name}")
        rows.append((say("table_register_is", register=name, meaning=meaning), cells))
    return Table(
        say("table_settings", bus=bus), [say("table_register"), *plc_names], rows, say("table_settings_note")
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
    now, longest, code = (
        own_names(source.summary, source.summary["plcs"], each) for each in ("D8201", "D8202", "D8063")
    )
    times = say("table_scan_now", names=now), say("table_scan_longest", names=longest)
    head = ["PLC", say("table_scan_mean"), say("table_scan_max"), *times, code]
    return Table(say("table_plcs"), head, rows)


def histogram_data(histogram: Histogram, of: str, quantity: Quantity) -> Table:
    """A histogram in at most some tens of rows, for readers who cannot see the chart."""
    width = bar_width(max(histogram.bins) - min(histogram.bins) + 1, _MOST_BARS)
    rows = []
    for bar, count in sorted(histogram.bars(width).items()):
        low, high = (milliseconds((edge * width - 0.5) * BIN_TICKS) for edge in (bar, bar + 1))
        span = say("table_range", least=f"{low:.3f}", most=f"{high:.3f}")
        rows.append((span, [Cell(f"{count:,}")]))
    time = say("table_time_ms", time=quantity.time)
    return Table(say("table_histogram", of=of), [time, quantity.counted], rows)


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
    note = say("table_first", shown=_MOST_EVENTS, number=len(rows)) if len(rows) > _MOST_EVENTS else ""
    head = [say(f"table_{name}") for name in ("begin", "for", "lane", "what")]
    return Table(say("table_happened", bus=scene.bus), head, rows[:_MOST_EVENTS], note)


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
        say("table_station"),
        *(say("table_failed", code=code) for code in codes),
        *(say(f"table_{name}") for name in ("errors_scans", "onsets", "in_error")),
    ]
    if turnarounds:
        head[1:1] = [say(f"table_{name}") for name in ("replies", "turnaround", "p99_ms", "max_ms")]
    head += [say(f"table_{name}") for name in ("errors_counted", "last_code", "flag")]
    lost = lost_by_station(link)
    if lost:
        there = [own_names(source.summary, lost, name) for name in ("D8203", "D8211", "M8183")]
        head += [say("table_lost_s"), *(say("table_there", name=name) for name in there)]
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
    texts = [say("run_code", code=code, meaning=meaning_of(code)) for code in codes]
    if turnarounds:
        note = say("table_codes", codes=texts) if texts else ""
    else:
        note = say("table_codes_need_trace", codes=texts) if texts else say("table_need_trace")
    return Table(say("table_slaves", bus=bus), head, rows, note)


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
            text = format(value, form) if form else "ON" if value else say("table_off")
            yield Cell(text, pointer("plcs", master, "registers", name), own)


def _one_in(probability: float) -> str:
    """The N of "1 in N", rounded down, so that as many or more are said."""
    return f"{math.floor(float(f'{1 / probability:.12g}')):,}"

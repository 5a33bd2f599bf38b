"""The table of a link's slaves: what the master counted, and what the attempts of a trace add."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from bussim.report.source import Source
from bussim.report.tables import NONE, Cell, Table, number, pointer
from bussim.report.text import CODES
from bussim.results.meters.histogram import Histogram
from bussim.results.meters.timeline import time_on
from bussim.results.summary.statistics import statistics
from bussim.trace.records import AttemptRecord


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
    head = ["station", *(f"failed {code}" for code in codes), "link scans in error", "in error (s)"]
    if turnarounds:
        head[1:1] = ["replies", "turnaround median (ms)", "p99 (ms)", "max (ms)"]
    head += ["errors counted", "last code", "flag now"]
    rows = []
    for key in link["station_errors"]:
        station = int(key)
        label = f"{key} ({names[station]})" if station in names else key
        cells = [*_counts(source, bus, key, codes), *_registers(source, names.get(0, ""), station)]
        if turnarounds:
            cells[:0] = _turnarounds(turnarounds.get(station, Histogram()))
        rows.append((label, cells))
    note = "; ".join(f"{code}: {CODES[code]}" for code in codes if code in CODES)
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
    yield Cell(number(time_on(record.in_error.get(int(station), []), source.record.duration), 3))


def _registers(source: Source, master: str, station: int) -> Iterator[Cell]:
    registers = source.registers(master)
    for name, form in (
        (f"D{8203 + station}", "d"),
        (f"D{8211 + station}", "02X"),
        (f"M{8183 + station}", ""),
    ):
        value = registers.get(name)
        if value is None:
            yield Cell(NONE, title=name)
        else:
            text = format(value, form) if form else "ON" if value else "off"
            yield Cell(text, pointer("plcs", master, "registers", name), name)

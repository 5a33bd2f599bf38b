"""A run's result as text and small tables, for a terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from bussim.results.registers import own_name
from bussim.results.run_record import RunRecord
from bussim.results.text.latency import latency_lines
from bussim.results.text.ports import SHOWN, alone_lines, port_lines, rare, times_in_words
from bussim.results.verdict.link import has_external_master
from bussim.wording import counted
from bussim.words.formats import meaning

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table


_ON_OFF = {0: "off", 1: "ON"}
#: Sentences of a verdict whose figures stand above it on a console.
_SHOWN_AS_FIGURES = frozenset(
    {"median", "median_p99", "mean", "longest", "longest_because", "messages", "no_bus"}
)


def show_result(console: Console, record: RunRecord, station_names: Mapping[str, Mapping[int, str]]) -> None:
    """Print the figures of a run that matter most. ``station_names`` are by bus and station number."""
    summary = record.summary
    _print(console, f"{summary['scenario']}: {summary['duration_s']:g} s simulated, seed {summary['seed']}")
    for bus, link in summary["links"].items():
        console.print()
        _show_link(console, record, bus, link, station_names.get(bus, {}))
    for line in (*alone_lines(summary), *port_lines(summary), *latency_lines(summary)):
        _print(console, line)
    said = [item for item in summary["verdict"] if item["key"] not in _SHOWN_AS_FIGURES]
    if said:
        console.print()
        _print(console, "verdict")
        for item in said:
            _print(console, f"  {item['text']}")
    for bus, found in summary.get("rests_on", {}).get("links", {}).items():
        console.print()
        for line in (f"what the figures of {bus} rest on", *found["text"]):
            _print(console, line)
    if summary["warnings"]:
        console.print()
        for warning in summary["warnings"]:
            _print(console, f"warning: {warning}")


def _show_link(
    console: Console, record: RunRecord, bus: str, link: dict[str, Any], names: Mapping[int, str]
) -> None:
    if link["attempts"] is None:
        outside = has_external_master(link)
        found = "no working master: no link scans"
        if outside:
            found = "the master is outside, and alone measures link scans"
        _print(console, f"{bus}: {counted(link['stations'], 'station')}, {found}")
        if outside:
            _show_refresh(console, link["refresh_gap_ms"])
        return
    _print(
        console,
        f"{bus}: {counted(link['stations'], 'station')}, mode {link['mode']}, "
        f"{counted(link['retries'], 'retry')} = {counted(link['attempts'], 'attempt')} a poll, "
        f"timeout {link['timeout_ms']:g} ms",
    )
    _show_times(console, link)
    if link["station_errors"]:
        console.print(_stations(record, link, names))
        codes = sorted({code for by_code in link["failed_attempts"].values() for code in by_code})
        if codes:
            _print(console, f"  codes            {'; '.join(f'{code}: {meaning(code)}' for code in codes)}")
    _show_registers(console, record, bus)
    _show_refresh(console, link["refresh_gap_ms"])
    if "stale_ms" in link:
        pair, old = max(link["stale_ms"].items(), key=lambda item: float(item[1]["total"]))
        single = old["longest"] in (None, old["total"])
        times = "" if single else f" in all, {old['longest']:.3f} ms at the longest"
        text = f"{old['total']:.3f} ms{times} ({pair}): from before one of the two was away"
        _print(console, f"  on old data      {text}")


def _show_times(console: Console, link: dict[str, Any]) -> None:
    times, later = link["scan_time_ms"], link["scan_time_ms"]["after_startup"]
    if not link["scans"]:
        _print(console, "  no complete link scan")
        return
    missing = [SHOWN[key] for key in ("p50", "p99") if times[key] is None]
    few = f" (too few scans for {' and '.join(missing)})" if missing else ""
    _print(console, f"  link scan time   {times_in_words(times, ('p50', 'mean', 'p99', 'max'))}{few}")
    _print(console, f"  longest          {_when_and_why(times)}")
    if later["max"] is not None and later["max_at_s"] != times["max_at_s"]:
        _print(console, f"  after start-up   {later['max']:.3f} ms {_when_and_why(later)}")
    healthy = link["healthy_at_s"]
    health = "never all stations healthy" if healthy is None else f"all stations healthy at {healthy:.3f} s"
    _print(console, f"  link scans       {link['scans']:,}, bus load {link['bus_load']:.1%}, {health}")
    if also := rare(link):
        assumed = " (rests on the assumed frame layout)" if link["undetected_frames"] else ""
        _print(console, f"  also             {', '.join(also)}{assumed}")


def _when_and_why(times: dict[str, Any]) -> str:
    why = f": {times['max_cause']}" if times["max_cause"] else ""
    return f"at {times['max_at_s']:.3f} s{why}"


def _stations(record: RunRecord, link: dict[str, Any], names: Mapping[int, str]) -> Table:
    from rich.table import Table
    from rich.text import Text

    failed = link["failed_attempts"]
    codes = sorted({code for by_code in failed.values() for code in by_code})
    table = Table(box=None, padding=(0, 3, 0, 0), pad_edge=False)
    table.add_column("  station")
    for code in codes:
        table.add_column(f"failed {code}", justify="right", no_wrap=True)
    onsets = link.get("station_error_onsets")  # a folder of an earlier version has none
    lost = lost_by_station(link)
    table.add_column("station errors", justify="right", no_wrap=True)
    if onsets:
        table.add_column("onsets", justify="right", no_wrap=True)
    if lost:
        table.add_column("master lost", justify="right", no_wrap=True)
    table.add_column("flag", no_wrap=True)
    flags = _registers(record, names.get(0, ""))
    for station, errors in link["station_errors"].items():
        name = names.get(int(station))
        cells = [f"  {station} ({name})" if name else f"  {station}"]
        cells += [f"{failed.get(station, {}).get(code, 0):,}" for code in codes]
        cells.append(f"{errors:,}")
        if onsets:
            cells.append(f"{onsets[station]:,}")
        if lost:
            cells.append(f"{lost.get(name or '', 0.0):.3f} s")
        cells += [_ON_OFF.get(flags.get(f"M{8183 + int(station)}", -1), "–")]
        table.add_row(*map(Text, cells))
    return table


def lost_by_station(link: Mapping[str, Any]) -> dict[str, float]:
    """For how long each slave had lost the master, in s, by name; a folder of an earlier version has none."""
    found: dict[str, float] = {}
    for lost in link.get("master_lost", ()):
        for name in lost["stations"]:
            found[name] = found.get(name, 0.0) + lost["for_s"]
    return found


def lost_in_words(stations: Sequence[str]) -> str:
    """Which slaves a time without the master concerns."""
    return f"master lost by {', '.join(stations)}" if stations else "the master made no link scan"


def _show_registers(console: Console, record: RunRecord, bus: str) -> None:
    words: dict[str, list[str]] = {}
    for name in record.links[bus].plc_names:
        registers = _registers(record, name)
        if "D8201" in registers and "D8202" in registers:
            devices = "/".join(own_name(record.summary, name, each) for each in ("D8201", "D8202"))
            words.setdefault(devices, []).append(f"{name} {registers['D8201']}/{registers['D8202']}")
        elif not registers and words:  # a PLC outside, of which nothing is known
            next(iter(words.values())).append(f"{name} –")
    for devices, texts in words.items():
        _print(console, f"  {devices:16} {', '.join(texts)}")


def _show_refresh(console: Console, gaps: dict[str, dict[str, Any]]) -> None:
    if not gaps:
        return
    pair, worst = max(gaps.items(), key=lambda item: max(item[1]["max"] or 0.0, item[1]["open"]))
    if worst["max"] is None or worst["open"] > worst["max"]:
        text = f"{worst['open']:.3f} ms, still open at the end"
    else:
        text = f"{worst['max']:.3f} ms"
    median = f", median {worst['p50']:.3f} ms" if worst["p50"] is not None else ""
    many = f", the longest of {len(gaps)} pairs" if len(gaps) > 1 else ""
    _print(console, f"  refresh gap      {text} ({pair}{many}{median})")


def caption_of(summary: Mapping[str, Any]) -> str:
    """What a picture or a table is of: scenario, seed, duration, version."""
    return (
        f"{summary['scenario']}, seed {summary['seed']}, {summary['duration_s']:g} s, "
        f"bussim {summary['bussim']}"
    )


def _registers(record: RunRecord, plc: str) -> dict[str, int]:
    found: dict[str, int] = record.summary["plcs"].get(plc, {}).get("registers", {})
    return found


def _print(console: Console, text: str) -> None:
    console.print(text, markup=False, highlight=False, soft_wrap=True)

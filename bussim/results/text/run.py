"""A run's result as text and small tables, for a terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from bussim.results.registers import own_name
from bussim.results.run_record import RunRecord
from bussim.results.text.latency import latency_lines
from bussim.results.text.lines import labelled, number_named, times_in_words
from bussim.results.text.ports import alone_lines, port_lines, rare
from bussim.results.verdict.catalogue import sentence
from bussim.results.verdict.link import has_external_master
from bussim.words.formats import meaning_of
from bussim.words.language import said_text, say, shown

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table


#: Sentences of a verdict whose figures stand above it on a console.
_SHOWN_AS_FIGURES = frozenset(
    {"median", "median_p99", "mean", "longest", "longest_because", "messages", "no_bus"}
)


def show_result(console: Console, record: RunRecord, station_names: Mapping[str, Mapping[int, str]]) -> None:
    """Print the figures of a run that matter most. ``station_names`` are by bus and station number."""
    summary = record.summary
    what = {"scenario": summary["scenario"], "duration": summary["duration_s"], "seed": summary["seed"]}
    _print(console, say("run_simulated", **what))
    for bus, link in summary["links"].items():
        console.print()
        _show_link(console, record, bus, link, station_names.get(bus, {}))
    for line in (*alone_lines(summary), *port_lines(summary), *latency_lines(summary)):
        _print(console, line)
    said = [item for item in summary["verdict"] if item["key"] not in _SHOWN_AS_FIGURES]
    if said:
        console.print()
        _print(console, say("run_verdict"))
        for item in said:
            _print(console, f"  {shown(sentence(item))}")
    for bus, found in summary.get("rests_on", {}).get("links", {}).items():
        console.print()
        for line in (say("run_rests", bus=bus), *found["text"]):
            _print(console, line)
    if summary["warnings"]:
        console.print()
        for warning in summary["warnings"]:
            _print(console, say("run_warning", text=warning))


def _show_link(
    console: Console, record: RunRecord, bus: str, link: dict[str, Any], names: Mapping[int, str]
) -> None:
    if link["attempts"] is None:
        outside = has_external_master(link)
        key = "run_link_outside" if outside else "run_link_no_master"
        _print(console, say(key, bus=bus, stations=link["stations"]))
        if outside:
            _show_refresh(console, link["refresh_gap_ms"])
        return
    settings = {key: link[key] for key in ("stations", "mode", "retries", "attempts")}
    _print(console, say("run_link", bus=bus, **settings, timeout=link["timeout_ms"]))
    _show_times(console, link)
    if link["station_errors"]:
        console.print(_stations(record, link, names))
        codes = sorted({code for by_code in link["failed_attempts"].values() for code in by_code})
        if codes:
            texts = [say("run_code", code=code, meaning=meaning_of(code)) for code in codes]
            _print(console, labelled(say("run_codes"), say("semicolon_list", texts=texts)))
    _show_registers(console, record, bus)
    _show_refresh(console, link["refresh_gap_ms"])
    if "stale_ms" in link:
        pair, old = max(link["stale_ms"].items(), key=lambda item: float(item[1]["total"]))
        text = say("run_old", total=old["total"], pair=pair)
        if old["longest"] not in (None, old["total"]):
            text = say("run_old_several", total=old["total"], longest=old["longest"], pair=pair)
        _print(console, labelled(say("run_on_old_data"), text))


def _show_times(console: Console, link: dict[str, Any]) -> None:
    times, later = link["scan_time_ms"], link["scan_time_ms"]["after_startup"]
    if not link["scans"]:
        _print(console, f"  {shown(say('run_no_scan'))}")
        return
    missing = [number_named(key) for key in ("p50", "p99") if times[key] is None]
    said = times_in_words(times, ("p50", "mean", "p99", "max"))
    said = say("run_few", times=said, missing=missing) if missing else said
    _print(console, labelled(say("run_scan_time"), said))
    _print(console, labelled(say("run_longest"), _when_and_why(times)))
    if later["max"] is not None and later["max_at_s"] != times["max_at_s"]:
        text = say("run_longest_after", max=later["max"], when=_when_and_why(later))
        _print(console, labelled(say("run_after_startup"), text))
    healthy = link["healthy_at_s"]
    health = say("run_never_healthy") if healthy is None else say("run_healthy", at=healthy)
    text = say("run_counts", scans=link["scans"], load=link["bus_load"], health=health)
    _print(console, labelled(say("run_link_scans"), text))
    if also := rare(link):
        text = say("comma_list", texts=also)
        text = say("run_assumed", said=text) if link["undetected_frames"] else text
        _print(console, labelled(say("run_also"), text))


def _when_and_why(times: dict[str, Any]) -> str:
    if times["max_cause"]:
        return say("run_at_because", at=times["max_at_s"], cause=times["max_cause"])
    return say("run_at", at=times["max_at_s"])


def _stations(record: RunRecord, link: dict[str, Any], names: Mapping[int, str]) -> Table:
    from rich.table import Table
    from rich.text import Text

    failed = link["failed_attempts"]
    codes = sorted({code for by_code in failed.values() for code in by_code})
    table = Table(box=None, padding=(0, 3, 0, 0), pad_edge=False)
    table.add_column(f"  {shown(say('run_station'))}")
    for code in codes:
        table.add_column(said_text("run_failed", code=code), justify="right", no_wrap=True)
    onsets = link.get("station_error_onsets")  # a folder of an earlier version has none
    lost = lost_by_station(link)
    table.add_column(said_text("run_station_errors"), justify="right", no_wrap=True)
    if onsets:
        table.add_column(said_text("run_onsets"), justify="right", no_wrap=True)
    if lost:
        table.add_column(said_text("run_master_lost"), justify="right", no_wrap=True)
    table.add_column(said_text("run_flag"), no_wrap=True)
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
        flag = flags.get(f"M{8183 + int(station)}")
        cells += ["–" if flag is None else "ON" if flag else said_text("run_off")]
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
    return say("master_lost_by", stations=stations) if stations else say("master_no_scan")


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
        _print(console, labelled(devices, ", ".join(texts)))


def _show_refresh(console: Console, gaps: dict[str, dict[str, Any]]) -> None:
    if not gaps:
        return
    pair, worst = max(gaps.items(), key=lambda item: max(item[1]["max"] or 0.0, item[1]["open"]))
    if worst["max"] is None or worst["open"] > worst["max"]:
        text = say("run_open", ms=worst["open"])
    else:
        text = f"{worst['max']:.3f} ms"
    if len(gaps) > 1:
        pair = say("run_pair_of", pair=pair, number=len(gaps))
    if worst["p50"] is not None:
        pair = say("run_pair_median", pair=pair, median=worst["p50"])
    _print(console, labelled(say("run_refresh"), say("run_pair", text=text, pair=pair)))


def caption_of(summary: Mapping[str, Any]) -> str:
    """What a picture or a table is of: scenario, seed, duration, version."""
    return say(
        "run_caption",
        scenario=summary["scenario"],
        seed=summary["seed"],
        duration=summary["duration_s"],
        version=summary["bussim"],
    )


def _registers(record: RunRecord, plc: str) -> dict[str, int]:
    found: dict[str, int] = record.summary["plcs"].get(plc, {}).get("registers", {})
    return found


def _print(console: Console, text: str) -> None:
    console.print(shown(text), markup=False, highlight=False, soft_wrap=True)

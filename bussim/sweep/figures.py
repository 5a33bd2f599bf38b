"""The figures of a run as one flat row: the columns of ``runs.csv``."""

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

from bussim.words.tables import read_table

Number = int | float

_OF_SCAN_TIMES = ("mean", "min", "p50", "p95", "p99", "p999", "max")
#: Figures of an N:N link, in the order of the columns; each stands behind the bus's name and a dot.
#: Those that end in ``_`` are followed by an error code or a station number.
LINK_FIGURES = (
    "scans",
    *(f"scan_time_{name}_ms" for name in (*_OF_SCAN_TIMES, "max_after_startup")),
    *("D8202", "polls", "failed_attempts", "failed_attempts_", "station_errors", "station_errors_"),
    *("station_error_onsets", "station_error_onsets_", "bus_load", "undetected_frames", "collisions"),
    *("refresh_gap_max_ms", "stale_max_ms", "healthy_at_s"),
)
_OF_BUSES = ("bus_load", "frames", "collisions", "undetected_frames")
#: Counts of events, which may be too rare to occur in any repeat.
_EVENTS = re.compile(
    r"(.*\.)?(failed_attempts|station_errors|station_error_onsets|undetected_frames|collisions|timeouts|crc_errors"
    r"|mismatched_responses|failed_turns|damaged)(_[0-9A-F]+)?"
    r"|latency\..+\.(lost|unseen)(_share)?"
)
#: Events by code or by words, which only runs have in which they occurred; the first group is what
#: they occurred to.
_RARE = re.compile(r"(.*)\.(failed_attempts_[0-9A-F]+|(exceptions|errors|other_errors|rejected)\..+)")
_MASTER = ".transactions"
#: What the names of the figures of latencies begin with, whose own names are free.
LATENCY = "latency."
_DELIVERED = ".delivered"
#: What is counted of an entry, in the order of the columns; of words only the first two.
_CHANGES = ("changes", "delivered", "lost", "unseen", "open")
_OF_LATENCIES = ("ms", "parts_ms", "bound_ms")
_NUMBERED = re.compile(r"(failed_attempts_|station_errors_|station_error_onsets_)([0-9A-F]+)")


def is_event_count(name: str) -> bool:
    """Whether a figure (with or without its bus) counts events."""
    return _EVENTS.fullmatch(name) is not None or _RARE.fullmatch(name) is not None


def rare_count_of(name: str) -> str | None:
    """Of a count that only runs have in which it is not 0: the bus, port or device whose it is.

    None for any other figure.
    """
    found = _RARE.fullmatch(name)
    return None if found is None else found[1]


#: What tables and pictures show of each kind of subject: figures and their titles.
SHOWN: Mapping[str, Mapping[str, str]] = read_table("bussim.sweep", "shown.yaml")


def kinds_in(names: Collection[str], buses: Iterable[str]) -> dict[str, str]:
    """Those of ``buses`` that are links, the Modbus masters and the entries of ``latency``, with their kinds.

    A subject is what the names of its figures begin with.
    """
    found = {bus: "link" for bus in buses if f"{bus}.scans" in names}
    for name in names:
        if name.startswith(LATENCY) and name.endswith(_DELIVERED):
            entry = name.removesuffix(_DELIVERED)
            found[entry] = "latency" if f"{entry}.lost" in names else "data age"
        elif name.endswith(_MASTER) and ".polls." not in name:
            found[name.removesuffix(_MASTER)] = "Modbus master"
    return found


def figures_of(summary: Mapping[str, Any], masters: Mapping[str, str]) -> dict[str, Number | None]:
    """The figures of a run, of its summary; ``masters`` names the PLC with station number 0 by bus.

    Ports and devices give every number of theirs, its keys joined by dots behind their name, such as
    ``press1.COM3.response_ms.p99`` and ``press1.COM3.polls.position.age_ms.open``. So do entries of
    ``latency`` behind that word, such as ``latency.door.ms.p99`` and ``latency.door.bound_ms.no error``;
    those of bits also the shares of their changes that never arrived (``lost_share``) and that were too
    short to be seen (``unseen_share``), of all whose outcome is known: None where there is none.

    Times are in ms, ``healthy_at_s`` in s. A quantile for which there are too few scans is None.
    ``refresh_gap_max_ms`` is the longest time that any station waited for the block of any other
    one, also if it still waited when the run ended; ``stale_max_ms`` the longest time in all that a
    station worked on data of another from before one of the two was in STOP or without supply.
    """
    found: dict[str, Number | None] = {}
    for bus, link in summary["links"].items():
        registers = summary["plcs"].get(masters.get(bus), {}).get("registers", {})
        for name, value in _link(link, registers).items():
            found[f"{bus}.{name}"] = value
    for bus, figures in summary["buses"].items():
        for name in _OF_BUSES:
            found[f"{bus}.{name}"] = figures[name]
    for kind in ("ports", "devices"):
        for name, figures in summary[kind].items():
            _flatten(name, figures, found)
    for name, entry in summary.get("latency", {}).items():
        _flatten(LATENCY + name, _latency(entry), found)
    return found


def _latency(entry: Mapping[str, Any]) -> dict[str, Any]:
    """What counts of an entry, in the order of its columns."""
    word = entry["edge"] is None
    found = {key: entry[key] for key in (_CHANGES[:2] if word else _CHANGES)}
    if not word:
        settled = entry["changes"] - entry["open"]
        for key in ("lost", "unseen"):
            found[f"{key}_share"] = round(entry[key] / settled, 9) if settled else None
    return found | {key: entry[key] for key in _OF_LATENCIES if key in entry}


def _link(link: Mapping[str, Any], registers: Mapping[str, int]) -> dict[str, Number | None]:
    times = link["scan_time_ms"]
    failed: dict[str, int] = {}
    for codes in link["failed_attempts"].values():
        for code, count in codes.items():
            failed[code] = failed.get(code, 0) + count
    gaps = [
        gap
        for pair in link["refresh_gap_ms"].values()
        for gap in (pair["max"], pair["open"])
        if gap is not None
    ]
    return {
        "scans": link["scans"],
        **{f"scan_time_{name}_ms": times[name] for name in _OF_SCAN_TIMES},
        "scan_time_max_after_startup_ms": times["after_startup"]["max"],
        "D8202": registers.get("D8202"),
        "polls": link["polls"],
        "failed_attempts": sum(failed.values()),
        **{f"failed_attempts_{code}": count for code, count in failed.items()},
        "station_errors": sum(link["station_errors"].values()),
        **{f"station_errors_{station}": count for station, count in link["station_errors"].items()},
        "station_error_onsets": sum(link["station_error_onsets"].values()),
        **{
            f"station_error_onsets_{station}": count
            for station, count in link["station_error_onsets"].items()
        },
        "bus_load": link["bus_load"],
        "undetected_frames": link["undetected_frames"],
        "collisions": link["collisions"],
        "refresh_gap_max_ms": max(gaps, default=None),
        "stale_max_ms": max((old["total"] for old in link.get("stale_ms", {}).values()), default=0.0),
        "healthy_at_s": link["healthy_at_s"],
    }


def _flatten(prefix: str, data: Any, found: dict[str, Number | None]) -> None:
    """Every number of nested mappings, under its keys joined by dots."""
    if isinstance(data, Mapping):
        for key, value in data.items():
            _flatten(f"{prefix}.{key}", value, found)
    elif data is None or (isinstance(data, int | float) and not isinstance(data, bool)):
        found[prefix] = data


def in_order(names: Iterable[str], buses: Sequence[str]) -> list[str]:
    """Names of figures in the order of the columns, the links in the order of ``buses``."""
    ranks = {name: rank for rank, name in enumerate(LINK_FIGURES)}
    order = {bus: index for index, bus in enumerate(buses)}

    def rank(name: str) -> tuple[int, int, int, str]:
        bus, _, figure = name.partition(".")
        numbered = _NUMBERED.fullmatch(figure)
        stem, number = (numbered[1], int(numbered[2], 16)) if numbered else (figure, 0)
        if bus not in order or stem not in ranks:
            return (len(order), 0, 0, name)
        return (order[bus], ranks[stem], number, "")

    return sorted(names, key=rank)

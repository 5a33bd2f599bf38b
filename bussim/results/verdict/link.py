"""What the stations of an N:N link showed, as findings: keys of the catalogue with their values."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from bussim.results.meters.link import LinkRecord
from bussim.results.meters.timeline import time_on
from bussim.results.verdict.catalogue import is_fault, render
from bussim.results.verdict.ports import overlap_findings
from bussim.trace.records import IN_FRAME
from bussim.units import TICKS_PER_SECOND

Finding = tuple[str, dict[str, Any]]
#: From this share of failed attempts on, damage is the cause of a station's errors.
_MOSTLY = 0.5
#: What explains the errors of any station, and those that it explains.
_OF_THE_BUS = ("two_masters", "same_number", "no_frame", "late_release")
_EXPLAINED = ("cause_cut", "cause_format", "cause_damaged", "cause_late", "cause_no_reply")
#: D8063 after bad parameters: of a PW10 on each port (its manual, section 8), of an FX (assumed).
_BAD_PARAMETERS = (7348, 7448, 7548, 7648, 6308, 3808)


def link_findings(
    bus: str,
    link: Mapping[str, Any],
    record: LinkRecord,
    summary: Mapping[str, Any],
    refused: Mapping[str, int],
    overlaps: Mapping[str, Mapping[str, int]],
) -> Iterator[Finding]:
    """Of one link: how long its scans took, then what was wrong, then that nothing was."""
    for key, values in _times(link):
        yield key, {"bus": bus, **values}
    found = [*_whole(bus, link, record, summary, refused, overlaps)]
    shared = any(key in _OF_THE_BUS for key, _ in found)
    found += _Stations(bus, link, record, summary, overlaps).all(known=shared)
    yield from found
    if link["undetected_frames"]:
        yield "undetected", {"bus": bus, "frames": link["undetected_frames"]}
    elif link["scans"] and not any(is_fault(key) for key, _ in found):
        yield "no_station_in_error", {"bus": bus}


def _times(link: Mapping[str, Any]) -> Iterator[Finding]:
    times = link["scan_time_ms"]
    if not link["scans"]:
        return
    if times["p50"] is None:
        yield "mean", {"mean_ms": times["mean"]}
    elif times["p99"] is None:
        yield "median", {"median_ms": times["p50"]}
    else:
        yield "median_p99", {"median_ms": times["p50"], "p99_ms": times["p99"]}
    longest = {"max_ms": times["max"], "max_at_s": times["max_at_s"]}
    if times["max_cause"]:
        yield "longest_because", {**longest, "cause": times["max_cause"]}
    else:
        yield "longest", longest


def _registers(summary: Mapping[str, Any], plc: str) -> Mapping[str, int]:
    found: Mapping[str, int] = summary["plcs"].get(plc, {}).get("registers", {})
    return found


def _numbers(summary: Mapping[str, Any], record: LinkRecord) -> dict[int, list[str]]:
    """The PLCs of a link by station number, in cable order."""
    numbers: dict[int, list[str]] = {}
    for plc in record.plc_names:
        registers = _registers(summary, plc)
        if "D8176" in registers:
            numbers.setdefault(int(registers["D8176"]), []).append(plc)
    return numbers


def _whole(
    bus: str,
    link: Mapping[str, Any],
    record: LinkRecord,
    summary: Mapping[str, Any],
    refused: Mapping[str, int],
    overlaps: Mapping[str, Mapping[str, int]],
) -> Iterator[Finding]:
    """What concerns the link as a whole: its master, its numbers, and which station sends when."""
    numbers = _numbers(summary, record)
    masters = [plc for plc in numbers.get(0, []) if not _has_refused(summary, refused, plc)]
    master = masters[0] if masters else ""
    for plc in record.plc_names:
        if _has_refused(summary, refused, plc):
            code = refused.get(plc) or _registers(summary, plc).get("D8063", 0)
            if refused.get(plc) == 0:
                yield "mode_refused", {"bus": bus, "plc": plc}
            else:
                yield "settings_refused", {"bus": bus, "plc": plc, "code": code}
    if link["attempts"] is None or not (masters or link["scans"]):
        yield "no_master", {"bus": bus}
    elif not link["scans"] and not link.get("master_lost"):
        heard = any(pair["count"] or pair["open"] < 1000 * summary["duration_s"] for pair in _gaps(link))
        yield "too_short" if heard else "no_scan", {"bus": bus, "master": master}
    for lost in link.get("master_lost", ()):
        yield _lost_key(lost, summary["duration_s"]), {"bus": bus, "master": master, **lost}
    working = [plc for plc in masters if _registers(summary, plc).get("M8191")]
    if len(working) > 1:
        yield "two_masters", {"bus": bus, "number": len(working), "masters": working}
    shared = {number: plcs for number, plcs in numbers.items() if number and len(plcs) > 1}
    for number, plcs in shared.items():
        yield "same_number", {"bus": bus, "station": number, "plcs": plcs}
    slaves = len(link["station_errors"])
    for number, plcs in numbers.items():
        if slaves and number > slaves and not _has_refused(summary, refused, plcs[0]):
            yield "not_polled", {"bus": bus, "plc": plcs[0], "station": number, "slaves": slaves}
    known = bool(shared) or len(working) > 1
    yield from overlap_findings(bus, link["collisions"], overlaps, known=known)


def _gaps(link: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    yield from link["refresh_gap_ms"].values()


def _has_refused(summary: Mapping[str, Any], refused: Mapping[str, int], plc: str) -> bool:
    registers = _registers(summary, plc)
    bad = registers.get("M8063") and registers.get("D8063") in _BAD_PARAMETERS
    return plc in refused or bool(bad)


def _lost_key(lost: Mapping[str, Any], duration: float) -> str:
    if not lost["stations"]:
        return "master_paused"
    if not lost["scans_missed"]:
        return "master_not_received"
    return "master_still_lost" if lost["from_s"] + lost["for_s"] >= duration - 1e-6 else "master_lost"


class _Stations:
    """The slaves of one link that were in error, and why."""

    def __init__(
        self,
        bus: str,
        link: Mapping[str, Any],
        record: LinkRecord,
        summary: Mapping[str, Any],
        overlaps: Mapping[str, Mapping[str, int]],
    ) -> None:
        self._bus, self._link, self._record, self._summary = bus, link, record, summary
        # A slave that still sends when another node begins was polled too long ago.
        self._late = {plc for plc, counts in overlaps.items() if counts.get(IN_FRAME)}
        self._numbers = _numbers(summary, record)
        lost = [each for each in link.get("master_lost", ()) if not each["scans_missed"]]
        self._cut_off = {name for each in lost for name in each["stations"]}

    def all(self, *, known: bool) -> Iterator[Finding]:
        """Two findings for each slave that was in error; one if attempts failed and were repeated.

        ``known``: the bus as a whole has a cause for errors of any station.
        """
        link, record = self._link, self._record
        repeated: dict[str, int] = {}
        for station, errors in link["station_errors"].items():
            codes = link["failed_attempts"].get(station, {})
            if not errors:
                for code, number in codes.items():
                    repeated[code] = repeated.get(code, 0) + number
                continue
            spans = record.in_error.get(int(station), [])
            duration = round(self._summary["duration_s"] * TICKS_PER_SECOND)
            onsets = link.get("station_error_onsets", {}).get(station, len(spans))
            label = {"bus": self._bus, "station": self._label(int(station))}
            still = bool(spans) and spans[-1].end is None
            yield (
                "station_still_in_error" if still else "station_error",
                {
                    **label,
                    "errors": errors,
                    "onsets": onsets,
                    "for_s": round(time_on(spans, duration), 6),
                    "codes": dict(codes),
                },
            )
            cause, values = self._cause(int(station), codes)
            if not (known and cause in _EXPLAINED):
                yield cause, {**label, **values}
        if repeated:
            yield "repeated", {"bus": self._bus, "codes": dict(sorted(repeated.items()))}

    def _label(self, station: int) -> str:
        plcs = self._numbers.get(station)
        if not plcs:
            return render("station_number", {"number": station})
        return render("station", {"number": station, "plc": plcs[0]})

    def _cause(self, station: int, codes: Mapping[str, int]) -> Finding:
        plcs, timeout = self._numbers.get(station), {"timeout_ms": self._link["timeout_ms"]}
        if not plcs:
            return "cause_missing", {}
        plc = plcs[0]
        registers = _registers(self._summary, plc)
        if registers.get("M8063") and registers.get("D8063") in _BAD_PARAMETERS:
            return "cause_refused", {"code": registers["D8063"]}
        damaged = sum(codes.values()) * _MOSTLY <= codes.get("04", 0)
        if plc in self._cut_off and not damaged:
            return ("cause_format" if plc in self._record.master_damaged else "cause_cut"), {}
        if codes.get("02") or codes.get("03") or plc in self._late:
            return "cause_late", timeout
        if damaged:
            return "cause_damaged", {}
        if plc in self._record.restarted:
            return "cause_stopped", {}
        if not registers.get("D8174", 1):
            had = any(
                pair["count"]
                for name, pair in self._link["refresh_gap_ms"].items()
                if name.startswith(f"{plc}->")
            )
            runs = self._summary["plcs"][plc]["scan_ms"]["mean"] is not None
            return ("cause_still_stopped" if had or not runs else "cause_unreached"), {}
        return "cause_no_reply", timeout

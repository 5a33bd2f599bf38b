"""What the stations of an N:N link showed, as findings: keys of the catalogue with their values."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from bussim.results.meters.failures import Cause, Irregulars, Times
from bussim.results.meters.link import LinkRecord
from bussim.results.numbers import by_code
from bussim.results.registers import own_name, own_names
from bussim.results.verdict.catalogue import is_fault
from bussim.results.verdict.parts import (
    DISTURBING,
    Away,
    Finding,
    driver_findings,
    in_all,
    not_running,
    serial_errors,
    serial_names,
    summed,
)
from bussim.units import TICKS_PER_SECOND
from bussim.words.formats import render

#: Causes that a finding of its own has said: of a node's driver, of a PLC that was not in RUN.
_SAID = (Cause.SHOWN, Cause.STOPPED)
#: Causes that a noisy receiver has in turn.
_OF_NOISE = (Cause.FORMAT, Cause.NO_REPLY)
#: Causes of all stations together.
_TOGETHER = (Cause.MASTER, Cause.RECEIVER)
#: Causes that two masters, or a number given twice, explain.
_EXPLAINED = frozenset(Cause) - {Cause.MISSING, Cause.REFUSED, *_SAID}
#: What a station shows of station k: D8203 + k, D8211 + k, M8183 + k (the master is 0).
_COUNT, _CODE, _FLAG = 8203, 8211, 8183
#: A slave's counts of another slave's errors may be ahead of the master's by so many (start-up, the end).
_AHEAD = 2


def link_findings(
    bus: str,
    link: Mapping[str, Any],
    record: LinkRecord,
    summary: Mapping[str, Any],
    refused: Mapping[str, int],
    irregular: Irregulars,
    away: Mapping[str, Away],
) -> Iterator[Finding]:
    """Of one link: how long its scans took, then what was wrong, then that nothing was."""
    yield from ((key, {"bus": bus, **values}) for key, values in _times(link))
    found = [*_Link(bus, link, record, summary, refused, away).findings(irregular)]
    yield from found
    if link["scans"] and not any(is_fault(key) for key, _ in found):
        yield "no_station_in_error", {"bus": bus}


def has_external_master(link: Mapping[str, Any]) -> bool:
    """Whether a link without a master in the scenario's served part was polled: blocks arrived."""
    return link["attempts"] is None and any(pair["count"] for pair in link["refresh_gap_ms"].values())


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


class _Link:
    """One link: its master, its slaves, and what each of them showed."""

    def __init__(
        self,
        bus: str,
        link: Mapping[str, Any],
        record: LinkRecord,
        summary: Mapping[str, Any],
        refused: Mapping[str, int],
        away: Mapping[str, Away],
    ) -> None:
        self._away, self._summary = away, summary
        self._bus, self._link, self._record, self._refused = bus, link, record, refused
        self._duration = summary["duration_s"]
        self._registers: dict[str, Mapping[str, int]] = {
            plc: summary["plcs"].get(plc, {}).get("registers", {}) for plc in record.plc_names
        }
        self._numbers: dict[int, list[str]] = {}  # PLCs by station number, in cable order
        for plc, registers in self._registers.items():
            if "D8176" in registers:
                self._numbers.setdefault(int(registers["D8176"]), []).append(plc)
        self._masters = [plc for plc in self._numbers.get(0, ()) if plc not in refused]
        self._master = self._masters[0] if self._masters else render("station_number", {"number": 0})

    def findings(self, irregular: Irregulars) -> Iterator[Finding]:
        """Of the link as a whole, then of each slave."""
        bus, link = self._bus, self._link
        for plc in self._record.plc_names:
            if plc in self._refused:
                if code := self._refused[plc]:
                    names = serial_names(self._summary, plc)
                    yield "settings_refused", {"bus": bus, "plc": plc, "code": code, **names}
                else:
                    yield "mode_refused", {"bus": bus, "plc": plc}
            yield from not_running(plc, self._away.get(plc, {}), self._duration, {"bus": bus})
        yield from self._without_master()
        shared = [*self._shared_numbers()]
        yield from shared
        known = any(key in DISTURBING for key, _ in shared)
        yield from driver_findings(bus, link["collisions"], irregular, known=known)
        if self._record.master_damaged:
            most = max(self._record.master_damaged.values(), key=lambda times: times.total)
            stations = {name: times.number for name, times in self._record.master_damaged.items()}
            values = {"bus": bus, "master": self._master, "stations": stations, "when": in_all(most)}
            yield "master_damaged", {**values, **self._own_names(stations)}
        yield from self._stations(known=known)
        if link["undetected_frames"]:
            yield "undetected", {"bus": bus, "frames": link["undetected_frames"]}
        if not known:
            yield from self._unexplained()
        for plc in self._registers:
            yield from serial_errors(plc, self._summary, self._refused, {"bus": bus})

    # -- the link as a whole -------------------------------------------------------------------------

    def _without_master(self) -> Iterator[Finding]:
        bus, link = self._bus, self._link
        if has_external_master(link):
            return
        if link["attempts"] is None or not (self._masters or link["scans"]):
            yield "no_master", {"bus": bus}
        elif not link["scans"]:
            open_gaps = (pair["open"] < 1000 * self._duration for pair in link["refresh_gap_ms"].values())
            yield "too_short" if any(open_gaps) else "no_scan", {"bus": bus, "master": self._master}
            return
        found: dict[tuple[str, tuple[str, ...]], list[Mapping[str, Any]]] = {}
        for lost in link.get("master_lost", ()):
            found.setdefault((self._lost_key(lost), tuple(lost["stations"])), []).append(lost)
        for (key, stations), every in found.items():
            longest = max(every, key=lambda lost: lost["for_s"])
            missed, when = sum(lost["scans_missed"] for lost in every), Times()
            for lost in every:
                start, lasts = (round(lost[name] * TICKS_PER_SECOND) for name in ("from_s", "for_s"))
                when.add(start, start + lasts)
            values = {"bus": bus, "master": self._master, **longest, "stations": [*stations]}
            names = self._own_names(stations or [plc for plc in self._registers if plc != self._master])
            yield key, {**values, "scans_missed": missed, "when": in_all(when), **names}

    def _lost_key(self, lost: Mapping[str, Any]) -> str:
        """Which sentence a time without the master has."""
        start, end = lost["from_s"] * TICKS_PER_SECOND, (lost["from_s"] + lost["for_s"]) * TICKS_PER_SECOND
        open_end = end >= (self._duration - 1e-6) * TICKS_PER_SECOND
        if not lost["stations"]:
            return "master_stopped" if open_end else "master_paused"
        if not lost["scans_missed"] and not any(
            span.start < end and (span.end is None or span.end > start)
            for spans in self._away.get(self._master, {}).values()
            for span in spans
        ):
            return "master_not_received"
        return "master_still_lost" if open_end else "master_lost"

    def _shared_numbers(self) -> Iterator[Finding]:
        bus, slaves = self._bus, len(self._link["station_errors"])
        working = [plc for plc in self._masters if self._registers[plc].get("M8191")]
        if len(working) > 1:
            yield "two_masters", {"bus": bus, "number": len(working), "masters": working}
        for number, plcs in self._numbers.items():
            if number and len(plcs) > 1:
                yield "same_number", {"bus": bus, "station": number, "plcs": plcs}
            if slaves and number > slaves and plcs[0] not in self._refused:
                yield "not_polled", {"bus": bus, "plc": plcs[0], "station": number, "slaves": slaves}

    # -- slaves --------------------------------------------------------------------------------------

    def _stations(self, *, known: bool) -> Iterator[Finding]:
        """Each slave that was in error, and the causes of its errors, each judged by itself.

        ``known``: the bus as a whole has a cause for errors of any station.
        """
        failures, bus = self._record.failures, self._bus
        together: dict[Cause, dict[str, Times]] = {}
        for text in self._link["station_errors"]:
            station = int(text)
            label = self._label(station)
            yield from self._in_error(text, label)
            undecided = {
                cause: times for (number, cause), times in failures.undecided.items() if number == station
            }
            for times in undecided.values():
                yield "undecided", {"bus": bus, "station": label, "when": in_all(times)}
            causes = {cause: times for (number, cause), times in failures.errors.items() if number == station}
            if all(causes.get(cause, Times()).number > 1 for cause in _OF_NOISE):
                # Now it received a data frame while it failed, now none: one receiver, one sentence.
                times = Times()
                for each in (causes.pop(cause) for cause in _OF_NOISE):
                    times.join(each)
                yield "cause_noisy", {"bus": bus, "station": label, "when": in_all(times)}
            for cause, times in {**undecided, **causes}.items():
                if cause in _SAID or (known and cause in _EXPLAINED):
                    continue
                if cause in _TOGETHER:
                    together.setdefault(cause, {})[label] = times
                    continue
                values = {"bus": bus, "station": label, **self._values(station, cause)}
                yield f"cause_{cause}", {**values, "when": in_all(times)}
        for cause, by_label in together.items():
            most = max(by_label.values(), key=lambda times: times.total)
            values = {"bus": bus, "master": self._master, "stations": [*by_label]}
            yield f"cause_{cause}", {**values, "when": in_all(most)}
        if repeated := self._repeated():
            yield "repeated", {"bus": bus, "codes": dict(sorted(repeated.items()))}

    def _in_error(self, station: str, label: str) -> Iterator[Finding]:
        """How often and how long a slave was in error."""
        errors = self._link["station_errors"][station]
        if errors:
            spans = self._record.in_error.get(int(station), [])
            values = {
                "errors": errors,
                "onsets": self._link.get("station_error_onsets", {}).get(station, len(spans)),
            }
            values |= {"for_s": in_all(summed(spans, self._duration))["total_s"]}
            # Those of its errors alone; a folder of an earlier version has but all of them.
            codes = self._record.failures.codes.get(int(station))
            every = self._link["failed_attempts"].get(station, {})
            values |= {"codes": dict(every) if codes is None else by_code(codes)}
            still = bool(spans) and spans[-1].end is None
            key = "station_still_in_error" if still else "station_error"
            yield key, {"bus": self._bus, "station": label, **values}

    def _repeated(self) -> dict[str, int]:
        """Failed attempts by code that were repeated with success, of all slaves."""
        link, failures = self._link, self._record.failures
        if failures.errors or failures.undecided or failures.repeated:  # by a run of this version
            return by_code(sum(failures.repeated.values(), Counter()))
        found: Counter[str] = Counter()
        for station, errors in link["station_errors"].items():
            found.update({} if errors else link["failed_attempts"].get(station, {}))
        return found

    def _values(self, station: int, cause: Cause) -> dict[str, Any]:
        if cause is Cause.REFUSED:
            plc = self._numbers[station][0] if station in self._numbers else ""
            code = self._registers.get(plc, {}).get("D8063", 0)
            return {"code": code, **serial_names(self._summary, plc)}
        return {"timeout_ms": self._link["timeout_ms"], **self._own_names(self._numbers.get(station, ())[:1])}

    def _own_names(self, plcs: Iterable[str]) -> dict[str, str]:
        """What stations call what they show of the master."""
        names = {"count": f"D{_COUNT}", "error": f"D{_CODE}", "flag": f"M{_FLAG}"}
        return {key: own_names(self._summary, plcs, name) for key, name in names.items()}

    def _label(self, station: int) -> str:
        plcs = self._numbers.get(station)
        if not plcs:
            return render("station_number", {"number": station})
        return render("station", {"number": station, "plc": plcs[0]})

    # -- what else stations show ---------------------------------------------------------------------

    def _unexplained(self) -> Iterator[Finding]:
        """What is on or counted in a station's special devices and follows from nothing that was found."""
        link, record = self._link, self._record
        lost = [(each, name) for each in link.get("master_lost", ()) for name in each["stations"]]
        told = {name for _, name in lost}
        # Whose own reception, or whose exchanges, have a sentence.
        named = {*record.master_damaged}
        named |= {name for each, name in lost if self._lost_key(each) == "master_not_received"}
        named |= {plc for station, _ in record.failures.errors for plc in self._numbers.get(station, ())}
        most = {int(station): errors for station, errors in link["station_errors"].items()}
        for station, onsets in link.get("station_error_onsets", {}).items():
            most[int(station)] += onsets + _AHEAD
        failed = {station for station, _ in (*record.failures.errors, *record.failures.undecided)}
        failed |= {station for station, errors in most.items() if errors}
        for plc, registers in self._registers.items():
            if plc in named:
                continue
            devices: dict[str, int] = {}
            for station in range(8):
                names = f"D{_COUNT + station}", f"D{_CODE + station}", f"M{_FLAG + station}"
                count, code, flag = (registers.get(name, 0) for name in names)
                # A station that lost the master meanwhile missed a frame or two of others at the edges.
                most_here = max(
                    most.get(station, _AHEAD) if station in failed else 0, _AHEAD if plc in told else 0
                )
                known = plc in told if not station else 0 < most_here >= count
                if (count or code or flag) and not known:
                    devices |= {
                        own_name(self._summary, plc, name): value
                        for name, value in zip(names, (count, code, flag), strict=True)
                        if value
                    }
            if devices:
                yield "shown", {"bus": self._bus, "plc": plc, "devices": devices}

"""A link's verdict in sentences for a reader who knows the machine and not the manual."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

from bussim.report.runs import ExactDistribution
from bussim.results.meters.timeline import Span, time_on

#: Error codes of the N:N link (FX communication manual JY992D69901, chapter 4) in words.
CODES = {
    "01": "no reply within the timeout",
    "02": "a reply with another station's number",
    "03": "a reply with another counter, such as one that came too late",
    "04": "a damaged reply",
    "11": "the master's frames stopped",
    "14": "a damaged frame of the master",
    "21": "a station whose poll got no reply",
    "22": "another station's number heard",
    "23": "another counter heard",
    "31": "polled before it had parameters",
}

_GIVEN_UP = re.compile(r"(station \d+(?: \(.*\))?): (\d+) attempts?, (all )?([0-9A-F]{2}(?:, [0-9A-F]{2})*)")
_REPEATED = re.compile(
    r"(station \d+(?: \(.*\))?): (\d+) failed attempts? before the (?:answer|reply), "
    r"(all )?([0-9A-F]{2}(?:, [0-9A-F]{2})*)"
)


def cause_in_words(cause: str) -> str:
    """The cause of a link scan in ``summary.json`` as the part of a sentence after "because"."""
    return " and ".join(_reason(reason) for reason in cause.split("; "))


def _reason(reason: str) -> str:
    given_up = _GIVEN_UP.fullmatch(reason)
    if given_up is not None:
        label, number, _, codes = given_up.groups()
        every = "its only attempt" if number == "1" else f"all its {number} attempts"
        return f"{label} failed {every} ({_meanings(codes)})"
    repeated = _REPEATED.fullmatch(reason)
    if repeated is not None:
        label, number, _, codes = repeated.groups()
        return f"{label} replied only at attempt {int(number) + 1} (before: {_meanings(codes)})"
    return "the master sent its parameters again" if reason == "parameter frame" else reason


def _meanings(codes: str) -> str:
    return ", then ".join(dict.fromkeys(CODES.get(code, f"code {code}") for code in codes.split(", ")))


def seen(link: Mapping[str, Any]) -> list[str]:
    """How long link scans took in the run, in sentences."""
    times = link["scan_time_ms"]
    if not link["scans"]:
        return ["No link scan was completed: the master polls no station, or the run is too short."]
    return [_median(times), _longest(times)]


def expected(link: Mapping[str, Any], distribution: ExactDistribution | None) -> list[str]:
    """What the exact distribution says beyond the run, in sentences, the most asked first."""
    if distribution is None or not link["scans"]:
        return []
    figures = distribution.figures
    if not distribution.valid:
        reasons = "; ".join(figures["reasons"])
        return [f"How long a link scan can take at worst is not known, since no exact law holds: {reasons}."]
    worst = ms(figures["worst_case_ms"])
    said = [f"With these settings no link scan can take longer than {worst}, even if every attempt fails."]
    if distribution.said:
        said.append(f"Expect {distribution.said}.")
    said += _dead(figures)
    silence = figures["ride_through_ms"]["silence"]
    if silence is not None:
        said.append(
            f"An interruption of the line of up to {math.floor(silence):,} ms raises no station error; a "
            "station's supply or STOP is not covered, since without its parameters it is in error at once."
        )
    if distribution.notes:
        notes = "; ".join(distribution.notes)
        said.append(f"What is said beyond this run holds for its undisturbed parts: {notes}.")
    return said


def median_or_mean(times: Mapping[str, Any]) -> tuple[str, float]:
    """The median with its name, or the mean where there are too few values for a median."""
    name, key = ("median", "p50") if times["p50"] is not None else ("mean", "mean")
    return name, times[key]


def _median(times: Mapping[str, Any]) -> str:
    name, value = median_or_mean(times)
    text = f"The {name} link scan takes {ms(value)}"
    return (
        f"{text}; 1 in 100 takes longer than {ms(times['p99'])}." if times["p99"] is not None else f"{text}."
    )


def _longest(times: Mapping[str, Any]) -> str:
    text = f"The longest took {ms(times['max'])}, {times['max_at_s']:.2f} s after the start"
    return f"{text}, because {cause_in_words(times['max_cause'])}." if times["max_cause"] else f"{text}."


def _dead(figures: Mapping[str, Any]) -> list[str]:
    said = []
    if figures["one_dead_ms"] is not None:
        extra = figures["one_dead_ms"] - figures["mean_ms"]
        more = f", {ms(extra)} more than the mean" if extra > 0 else ""
        said.append(
            f"While one station is dead, every link scan takes about {ms(figures['one_dead_ms'])}{more}."
        )
    noticed = figures["detect_ms"]
    if noticed["mean"] is not None:
        said.append(
            f"A station that dies is in error after {ms(noticed['mean'])} on average, {ms(noticed['max'])} "
            "at the latest."
        )
    return said


def health(
    link: Mapping[str, Any], in_error: Mapping[int, Sequence[Span]], names: Mapping[int, str], duration: int
) -> list[str]:
    """What happened to the stations during the run, one sentence each."""
    said = []
    for station, spans in in_error.items():
        times = "once" if len(spans) == 1 else f"{len(spans)} times"
        name = f"Station {station} ({names[station]})" if station in names else f"Station {station}"
        still = ", and still is at the end" if spans and spans[-1].end is None else ""
        said.append(f"{name} was in error {times}, for {time_on(spans, duration):.3f} s in all{still}.")
    if not in_error and link["scans"]:
        said.append("No station was in error.")
    if link["collisions"]:
        said.append(f"{link['collisions']:,} frames began while another station was sending (collisions).")
    if link["undetected_frames"]:
        said.append(
            f"{link['undetected_frames']:,} damaged frames were taken as good; how often that happens "
            "rests on the assumed frame layout."
        )
    return said


def ports(summary: Mapping[str, Any]) -> list[str]:
    """What every Modbus master got, one sentence each."""
    said = []
    for name, port in (summary.get("ports") or {}).items():
        asked = port.get("transactions")
        if not asked:
            continue
        failed = asked - port["ok"]
        text = f"{name} sent {asked:,} requests, "
        text += (
            "all of them with success"
            if not failed
            else f"{port['ok']:,} of them with success ({failed:,} failed"
        )
        if failed:
            timeouts = port.get("timeouts")
            text += f", {timeouts:,} of them without a response in time)" if timeouts else ")"
        times = port.get("response_ms") or {}
        if times.get("max") is not None:
            which, value = median_or_mean(times)
            text += f"; the {which} response time is {ms(value)}, the longest {ms(times['max'])}"
        said.append(f"{text}.")
    return said


def alone(summary: Mapping[str, Any]) -> list[str]:
    """That a run had no bus, which explains what its page lacks."""
    if summary["links"] or summary["buses"] or not summary["plcs"]:
        return []
    return ["The scenario has no bus: every PLC ran by itself, and there were no link scans."]


def ms(value: float) -> str:
    """Milliseconds for a sentence: three significant digits and at most three decimals."""
    if value >= 1000:
        return f"{value / 1000:,.2f} s"
    return f"{value:.0f} ms" if value >= 100 else f"{value:.1f} ms"

"""A link's verdict in plain words, for somebody who pays for the machine and not for the manual."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from bussim.report.source import ExactDistribution
from bussim.units import seconds

#: Error codes of the N:N link (FX communication manual JY992D69901, chapter 4), as a reader may take them.
CODES = {
    "01": "no answer within the timeout",
    "02": "an answer with another station's number",
    "03": "an answer with another counter, such as one that came too late",
    "04": "a damaged answer",
    "11": "the master's frames stopped",
    "14": "a damaged frame of the master",
    "21": "a station whose poll got no answer",
    "22": "another station's number heard",
    "23": "another counter heard",
    "31": "polled before it had parameters",
}

_GIVEN_UP = re.compile(r"(station \d+(?: \(.*\))?): (\d+) attempts?, (all )?([0-9A-F]{2}(?:, [0-9A-F]{2})*)")
_REPEATED = re.compile(
    r"(station \d+(?: \(.*\))?): (\d+) failed attempts? before the answer, "
    r"(all )?([0-9A-F]{2}(?:, [0-9A-F]{2})*)"
)


def cause_in_words(cause: str) -> str:
    """The cause of a link scan in ``summary.json`` as a part of a sentence after "because"."""
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
        return f"{label} answered only at attempt {int(number) + 1} (before: {_meanings(codes)})"
    return "the master sent its parameters again" if reason == "parameter frame" else reason


def _meanings(codes: str) -> str:
    return ", then ".join(dict.fromkeys(CODES.get(code, f"code {code}") for code in codes.split(", ")))


def seen(link: Mapping[str, Any]) -> list[str]:
    """How long link scans took in the run, in sentences."""
    times = link["scan_time_ms"]
    if not link["scans"]:
        return ["No link scan was ever completed: the master polls nobody, or the run is too short."]
    return [_usual(times), _longest(times)]


def expected(link: Mapping[str, Any], distribution: ExactDistribution | None) -> list[str]:
    """What the exact distribution says beyond the run, in sentences, the most asked first."""
    if distribution is None or not link["scans"]:
        return []
    figures = distribution.figures
    if not distribution.valid:
        reasons = "; ".join(figures["reasons"])
        return [f"How long a link scan can become at worst is not told, for no exact law holds: {reasons}."]
    worst = ms(figures["worst_case_ms"])
    said = [f"With these settings no link scan can take longer than {worst}: every attempt at every station."]
    if distribution.said:
        said.append(f"Expect {distribution.said}.")
    said += _dead(figures)
    silence = figures["ride_through_ms"]["silence"]
    if silence is not None:
        said.append(f"The line may fall silent for up to {ms(silence)} without any station being reported.")
    if distribution.notes:
        notes = "; ".join(distribution.notes)
        said.append(f"What is said beyond this run holds for its undisturbed stretches: {notes}.")
    return said


def _usual(times: Mapping[str, Any]) -> str:
    usual = times["p50"] if times["p50"] is not None else times["mean"]
    text = f"A link scan typically takes {ms(usual)}"
    return text + (
        f"; 99 of 100 take no longer than {ms(times['p99'])}." if times["p99"] is not None else "."
    )


def _longest(times: Mapping[str, Any]) -> str:
    text = f"The longest one seen took {ms(times['max'])}, {times['max_at_s']:.2f} s after the start"
    return f"{text}, because {cause_in_words(times['max_cause'])}." if times["max_cause"] else f"{text}."


def _dead(figures: Mapping[str, Any]) -> list[str]:
    said = []
    if figures["one_dead_ms"] is not None:
        extra = figures["one_dead_ms"] - figures["mean_ms"]
        more = f", {ms(extra)} more than usual" if extra > 0 else ""
        said.append(
            f"While one station is dead, every link scan takes about {ms(figures['one_dead_ms'])}{more}."
        )
    noticed = figures["detect_ms"]
    if noticed["mean"] is not None:
        said.append(
            f"A station that dies is reported after {ms(noticed['mean'])} on average, {ms(noticed['max'])} "
            "at the latest."
        )
    return said


def health(
    link: Mapping[str, Any], in_error: Mapping[int, Any], names: Mapping[int, str], duration: int
) -> list[str]:
    """What happened to the stations during the run, one sentence each."""
    said = []
    for station, spans in in_error.items():
        ticks = sum((duration if span.end is None else span.end) - span.start for span in spans)
        times = "once" if len(spans) == 1 else f"{len(spans)} times"
        name = f"Station {station} ({names[station]})" if station in names else f"Station {station}"
        still = ", and still is at the end" if spans and spans[-1].end is None else ""
        said.append(f"{name} was reported as failed {times}, for {seconds(ticks):.3f} s in all{still}.")
    if not in_error and link["scans"]:
        said.append("No station was reported as failed.")
    if link["collisions"]:
        said.append(f"{link['collisions']:,} frames began while another station was sending (collisions).")
    if link["undetected_frames"]:
        said.append(
            f"{link['undetected_frames']:,} damaged frames were taken for good ones; how often that happens "
            "rests on the assumed frame layout."
        )
    return said


def ports(summary: Mapping[str, Any]) -> list[str]:
    """How every Modbus master fared, one sentence each."""
    said = []
    for name, port in (summary.get("ports") or {}).items():
        asked = port.get("transactions")
        if not asked:
            continue
        failed = asked - port["ok"]
        text = f"{name} asked {asked:,} times and got what it asked for "
        text += "each time" if not failed else f"{port['ok']:,} times ({failed:,} failed"
        if failed:
            timeouts = port.get("timeouts")
            text += f", {timeouts:,} of them without an answer in time)" if timeouts else ")"
        times = port.get("response_ms") or {}
        usual = times.get("p50") if times.get("p50") is not None else times.get("mean")
        if usual is not None:
            text += f"; an answer typically takes {ms(usual)}, the slowest took {ms(times['max'])}"
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

"""What the exact law of a link says beyond a run's verdict, in sentences."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from bussim.report.runs import ExactDistribution
from bussim.wording import in_ms


def expected(link: Mapping[str, Any], distribution: ExactDistribution | None) -> list[str]:
    """What the exact distribution says beyond the run, in sentences, the most asked first."""
    if distribution is None or not link["scans"]:
        return []
    figures = distribution.figures
    if not distribution.valid:
        reasons = "; ".join(figures["reasons"])
        return [f"How long a link scan can take at worst is not known, since no exact law holds: {reasons}."]
    worst = in_ms(figures["worst_case_ms"], most=True)
    bound = f"no link scan can take longer than {worst}, even if every attempt fails"
    longest = link["scan_time_ms"]["max"]
    if distribution.notes or longest > figures["worst_case_ms"]:
        longest = in_ms(longest, most=True)
        said = [f"In undisturbed parts of the run {bound}; the longest of the whole run took {longest}."]
    else:
        said = [f"With these settings {bound}."]
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


def _dead(figures: Mapping[str, Any]) -> list[str]:
    said = []
    if figures["one_dead_ms"] is not None:
        extra = figures["one_dead_ms"] - figures["mean_ms"]
        more = f", {in_ms(extra)} more than the mean" if extra > 0 else ""
        one = "one more station" if figures["stations_dead"] else "one station"
        said.append(
            f"While {one} is dead, every link scan takes about {in_ms(figures['one_dead_ms'])}{more}."
        )
    noticed = figures["detect_ms"]
    if noticed["mean"] is not None:
        said.append(
            f"A station that dies is in error after {in_ms(noticed['mean'])} on average, "
            f"{in_ms(noticed['max'], most=True)} at the latest while no other reply is lost, else "
            f"{in_ms(noticed['bound'], most=True)}."
        )
    return said

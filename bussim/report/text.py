"""What the exact law of a link says beyond a run's verdict, in sentences."""

import math
from collections.abc import Mapping
from typing import Any

from bussim.report.runs import ExactDistribution
from bussim.wording import in_ms
from bussim.words.language import say


def expected(link: Mapping[str, Any], distribution: ExactDistribution | None) -> list[str]:
    """What the exact distribution says beyond the run, in sentences, the most asked first."""
    if distribution is None or not link["scans"]:
        return []
    figures = distribution.figures
    if not distribution.valid:
        return [say("expect_no_law", reasons=figures["reasons"])]
    worst = in_ms(figures["worst_case_ms"], most=True)
    longest = link["scan_time_ms"]["max"]
    if distribution.notes or longest > figures["worst_case_ms"]:
        said = [say("expect_bound_parts", worst=worst, longest=in_ms(longest, most=True))]
    else:
        said = [say("expect_bound", worst=worst)]
    if distribution.said:
        said.append(say("expect_errors", said=distribution.said))
    said += _dead(figures)
    silence = figures["ride_through_ms"]["silence"]
    if silence is not None:
        said.append(say("expect_ride", silence=math.floor(silence)))
    if distribution.notes:
        said.append(say("expect_parts", notes=distribution.notes))
    return said


def _dead(figures: Mapping[str, Any]) -> list[str]:
    said = []
    if figures["one_dead_ms"] is not None:
        extra = figures["one_dead_ms"] - figures["mean_ms"]
        key = "expect_dead_more" if figures["stations_dead"] else "expect_dead"
        dead = in_ms(figures["one_dead_ms"])
        said.append(say(f"{key}_longer", dead=dead, more=in_ms(extra)) if extra > 0 else say(key, dead=dead))
    noticed = figures["detect_ms"]
    if noticed["mean"] is not None:
        times = {"longest": noticed["max"], "bound": noticed["bound"]}
        latest = {name: in_ms(time, most=True) for name, time in times.items()}
        said.append(say("expect_noticed", mean=in_ms(noticed["mean"]), **latest))
    return said

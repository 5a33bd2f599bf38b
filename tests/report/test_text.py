"""What the exact law says beyond a run, in sentences."""

from __future__ import annotations

from typing import Any

import pytest

import bussim
from bussim.report.runs import ExactDistribution
from bussim.report.text import expected


@pytest.fixture(scope="module")
def link() -> dict[str, Any]:
    found: dict[str, Any] = bussim.run("press_line", rows=False).summary["links"]["link"]
    return found


FIGURES: dict[str, Any] = {
    "valid": True,
    "reasons": [],
    "worst_case_ms": 642.698,
    "mean_ms": 50.42,
    "one_dead_ms": 348.592,
    "detect_ms": {"mean": 307.9, "max": 344.6, "bound": 642.698},
    "stations_dead": [],
    "ride_through_ms": {"silence": 207.8, "corruption": 67.4},
}


def test_what_is_to_be_expected(link: dict[str, Any]) -> None:
    distribution = ExactDistribution(
        FIGURES, "about one false station error in 3 years if the noise stays as entered", ["x is left out"]
    )
    said = " ".join(expected(link, distribution))
    for part in (
        "In undisturbed parts of the run no link scan can take longer than 642.7 ms",
        f"the longest of the whole run took {link['scan_time_ms']['max']:,.1f} ms",
        "Expect about one false station error in 3 years",
        "While one station is dead, every link scan takes about 348.6 ms, 298.2 ms more than the mean.",
        "A station that dies is in error after 307.9 ms on average, 344.6 ms at the latest while",
        "at the latest while no other reply is lost, else 642.7 ms.",
        "An interruption of the line of up to 207 ms raises no station error",
        "holds for its undisturbed parts: x is left out.",
    ):
        assert part in said


def test_a_bound_that_the_run_went_beyond_is_not_said_of_all_scans(link: dict[str, Any]) -> None:
    """As of one whose master speaks at another rate for a time."""
    bound = expected(link, ExactDistribution(FIGURES))[0]
    assert bound.startswith("With these settings no link scan can take longer than 642.7 ms")
    beyond = {**link, "scan_time_ms": {**link["scan_time_ms"], "max": 700.0}}
    assert "the longest of the whole run took 700.0 ms" in expected(beyond, ExactDistribution(FIGURES))[0]


def test_with_a_dead_station_another_one_is_one_more(link: dict[str, Any]) -> None:
    said = " ".join(expected(link, ExactDistribution({**FIGURES, "stations_dead": [2]})))
    assert "While one more station is dead" in said


def test_where_no_law_holds_the_reason_is_given(link: dict[str, Any]) -> None:
    (said,) = expected(link, ExactDistribution({"valid": False, "reasons": ["replies wait for END"]}))
    assert said.endswith("no exact law holds: replies wait for END.")
    assert expected(link, None) == []


def test_a_link_that_never_ran(link: dict[str, Any]) -> None:
    idle = {**link, "scans": 0}
    assert expected(idle, ExactDistribution(FIGURES)) == []

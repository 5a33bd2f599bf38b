"""The verdict in sentences."""

from __future__ import annotations

from typing import Any

import pytest

import bussim
from bussim.report.runs import ExactDistribution
from bussim.report.text import cause_in_words, expected, health, ports, seen
from bussim.results.meters.timeline import Span
from bussim.units import TICKS_PER_SECOND


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
    "detect_ms": {"mean": 307.9, "max": 344.6},
    "ride_through_ms": {"silence": 207.8, "corruption": 67.4},
}


@pytest.mark.parametrize(
    ("cause", "words"),
    [
        (
            "station 1 (press2): 6 attempts, all 01; parameter frame",
            (
                "station 1 (press2) failed all its 6 attempts (no reply within the timeout) and the master sent "
                "its parameters again"
            ),
        ),
        (
            "station 2 (trolley): 2 failed attempts before the answer, 01, 04",
            "station 2 (trolley) replied only at attempt 3 (before: no reply within the timeout, then a damaged reply)",
        ),
        (
            "station 7: 1 attempt, 02",
            "station 7 failed its only attempt (a reply with another station's number)",
        ),
        ("station 1 (a) answered 42 ms after its poll", "station 1 (a) answered 42 ms after its poll"),
    ],
)
def test_a_cause_becomes_a_part_of_a_sentence(cause: str, words: str) -> None:
    assert cause_in_words(cause) == words


def test_what_was_seen(link: dict[str, Any]) -> None:
    median, longest = seen(link)
    assert median == "The median link scan takes 50.4 ms; 1 in 100 takes longer than 349 ms."
    assert longest.startswith("The longest took 349 ms, 21.04 s after the start, because station 1 (press2)")


def test_what_is_to_be_expected(link: dict[str, Any]) -> None:
    distribution = ExactDistribution(
        FIGURES, "about one false station error in 3 years if the noise stays as entered", ["x is left out"]
    )
    said = " ".join(expected(link, distribution))
    for part in (
        "no link scan can take longer than 643 ms",
        "Expect about one false station error in 3 years",
        "While one station is dead, every link scan takes about 349 ms, 298 ms more than the mean.",
        "A station that dies is in error after 308 ms on average, 345 ms at the latest",
        "An interruption of the line of up to 207 ms raises no station error",
        "holds for its undisturbed parts: x is left out.",
    ):
        assert part in said


def test_where_no_law_holds_the_reason_is_told(link: dict[str, Any]) -> None:
    (said,) = expected(link, ExactDistribution({"valid": False, "reasons": ["replies wait for END"]}))
    assert said.endswith("no exact law holds: replies wait for END.")
    assert expected(link, None) == []


def test_what_happened_to_the_stations(link: dict[str, Any]) -> None:
    spans = {1: [Span(0, TICKS_PER_SECOND), Span(3 * TICKS_PER_SECOND, None)], 2: [Span(0, 72_000)]}
    said = health({**link, "collisions": 2}, spans, {1: "press2"}, 10 * TICKS_PER_SECOND)
    assert said == [
        "Station 1 (press2) was in error 2 times, for 8.000 s in all, and still is at the end.",
        "Station 2 was in error once, for 0.001 s in all.",
        "2 frames began while another station was sending (collisions).",
    ]
    assert health(link, {}, {}, 1) == ["No station was in error."]


def test_a_link_that_never_ran(link: dict[str, Any]) -> None:
    idle = {**link, "scans": 0}
    assert seen(idle)[0].startswith("No link scan was completed")
    assert expected(idle, ExactDistribution(FIGURES)) == []


def test_what_modbus_masters_got() -> None:
    good = {"transactions": 100, "ok": 100, "timeouts": 0, "response_ms": {"p50": 44.375, "max": 51.2}}
    bad = {
        "transactions": 10,
        "ok": 7,
        "timeouts": 2,
        "response_ms": {"p50": None, "mean": None, "max": None},
    }
    slave = {"requests": 5}
    assert ports({"ports": {"a.COM3": good, "b.COM3": bad, "c.COM3": slave}}) == [
        "a.COM3 sent 100 requests, all of them with success; the median response time is 44.4 ms, the longest 51.2 ms.",
        "b.COM3 sent 10 requests, 7 of them with success (3 failed, 2 of them without a response in time).",
    ]
    assert ports({}) == []

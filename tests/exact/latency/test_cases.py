"""The cases of a latency's bound, against an independent reckoning that tries out every loss."""

from __future__ import annotations

import pytest

from bussim.exact.latency.bounds import EVERY_RETRY, NO_ERROR, LatencyBound
from tests.exact.scan.worst_scans import Line, longest_wait

LINES = [
    Line(bare, parameters, silent, replied, attempts, probe)
    for bare, parameters, silent, replied in (
        (1_000, 70, 900, (300,)),
        (1_000, 70, 900, (300, 500)),
        (100, 7, 5_000, (4_000, 3_000, 4_999)),
    )
    for attempts in (1, 2, 3)
    for probe in (False, True)
]


def bound_of(line: Line, source: int) -> LatencyBound:
    """The bound of nothing but the wait for a station's turn."""
    others = [time for station, time in enumerate(line.replied, 1) if station != source]
    return LatencyBound(
        "",
        word=False,
        turn=line.scan,
        link_scan=line.scan,
        silent=line.silent,
        replied=line.replied[source - 1] if source else 0,
        others=tuple(others),
        parameters=line.parameters,
        attempts=line.attempts,
        probe=line.probe,
    )


@pytest.mark.parametrize("line", LINES, ids=str)
def test_lost_replies_delay_as_much_as_the_worst_choice_of_them(line: Line) -> None:
    for source in range(len(line.replied) + 1):
        bound = bound_of(line, source)
        for losses in range(line.attempts + 3):
            longest = longest_wait(line, source, losses)
            if source:
                assert bound.lost(losses) == longest
            else:  # a flag that is on costs the master's data nothing where all stations reply in between
                assert longest <= bound.lost(losses) <= longest + line.parameters


@pytest.mark.parametrize("line", LINES, ids=str)
def test_every_retry_is_the_worst_of_all_losses(line: Line) -> None:
    for source in range(len(line.replied) + 1):
        bound = bound_of(line, source)
        assert bound.every_retry == longest_wait(line, source, None, line.attempts)


@pytest.mark.parametrize("line", LINES, ids=str)
def test_the_cases_are_in_order(line: Line) -> None:
    for source in range(len(line.replied) + 1):
        cases = bound_of(line, source).cases()
        assert next(iter(cases)) == NO_ERROR
        assert list(cases)[-1] == EVERY_RETRY
        assert len(cases) == line.attempts + 2
        assert sorted(cases.values()) == list(cases.values())
        assert bound_of(line, source).no_error == line.scan < bound_of(line, source).lost(0)


def test_where_no_link_lies_between_there_is_nothing_to_lose() -> None:
    bound = LatencyBound("home", word=False, scan=500, program=40)
    assert bound.cases() == {NO_ERROR: 540}
    assert bound.lost(3) == bound.every_retry == 540

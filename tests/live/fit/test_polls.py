"""Polls and requests that are repeated behind a sound reply, from turns by hand."""

from __future__ import annotations

import pytest

from bussim.live.fit.polls import Request, Turn, numbered, polls_of, repeats_of

A, B, C = ((1, 3, address, 2) for address in (0, 10, 20))
MS = 72_000


def turns(*rows: tuple[Request, float]) -> list[Turn]:
    """Good exchanges of 20 ms at these times (ms)."""
    return [
        Turn(request, 1, round(at * MS), round((at + 8) * MS), round((at + 20) * MS), 90, "ok")
        for request, at in rows
    ]


def rotation(count: int = 40, every: float = 100) -> list[tuple[Request, float]]:
    return [((A, B, C)[number % 3], number * every) for number in range(count)]


def test_a_rotation_has_no_repeats_and_the_period_of_its_round() -> None:
    found = turns(*rotation())
    assert repeats_of(found) == []
    assert [poll.every for poll in polls_of(found, frozenset(), 1)] == [300 * MS] * 3


def test_a_request_that_comes_again_at_once_is_a_repeat() -> None:
    rows = rotation()
    rows[7:7] = [(rows[6][0], rows[6][1] + 40)]
    found = turns(*rows)
    assert repeats_of(found) == [7]
    polls = polls_of(found, frozenset({7}), 1)
    assert sum(poll.turns for poll in polls) == 40
    assert all(poll.periodic for poll in polls)


def test_a_single_request_at_no_regular_times_cannot_tell() -> None:
    times = [0, 100, 135, 460, 480, 940, 970, 1330, 2160, 2230]
    assert repeats_of(turns(*((A, float(at)) for at in times))) is None
    regular = [(A, float(100 * number)) for number in range(12)]
    regular.insert(4, (A, 340.0))
    assert repeats_of(turns(*regular)) == [4]


def test_a_request_between_slower_ones_may_follow_itself() -> None:
    """A every 200 ms and B every 250 ms: A often follows A, and none of these turns is a repeat."""
    rows = sorted(
        [(A, 200.0 * n) for n in range(50)] + [(B, 30 + 250.0 * n) for n in range(40)], key=lambda row: row[1]
    )
    assert repeats_of(turns(*rows)) == []


@pytest.mark.parametrize("span", [0, 5000 * MS])
def test_a_request_seen_once_has_the_length_of_the_recording(span: int) -> None:
    (found,) = polls_of(turns((A, 0)), frozenset(), span)
    assert found.every == max(1, span)
    (untimed,) = polls_of(turns((A, 0)), frozenset(), span, timed=False)
    assert untimed.every is None


def test_turns_at_no_regular_times_are_told() -> None:
    (found,) = polls_of(turns(*((A, float(at)) for at in (0, 100, 150, 500, 520, 900, 1700))), frozenset(), 1)
    assert found.irregular
    assert not polls_of(turns(*rotation()), frozenset(), 1)[0].irregular


def test_turns_that_are_late_by_turns_keep_the_period_of_their_grid() -> None:
    """Every second one waits for another exchange, and one in ten is not heard: no distance is the period."""
    rows = [(A, 1000.0 * number + 30 * (number % 2)) for number in range(120) if number % 10 != 5]
    (found,) = polls_of(turns(*rows), frozenset(), 1)
    assert found.periodic
    assert found.every == pytest.approx(1000 * MS, rel=5e-4)


def test_a_turn_that_was_held_up_makes_the_next_one_no_repeat() -> None:
    """B at 1.2 s waits for A's retries; the next B is on time, and comes soon."""
    regular: list[tuple[Request, float]] = [(B, 200.0 * number) for number in range(20)]
    regular[6] = (B, 1360.0)
    assert repeats_of(turns(*regular)) == []


def failing(pattern: str, distance: float, every: float = 200) -> list[Turn]:
    """A request every 200 ms; each letter is an attempt: good (g) or without a reply (n), then again."""
    found = []
    for number, word in enumerate(pattern.split() * 10):
        for attempt, letter in enumerate(word):
            sent = round((number * every + attempt * distance) * MS)
            replied = sent + 20 * MS if letter == "g" else None
            outcome = "ok" if letter == "g" else "no_answer"
            found.append(Turn(A, attempt + 1, sent, sent + 8 * MS, replied, 90, outcome))
    return found


@pytest.mark.parametrize(
    ("pattern", "retries"), [("g g ng g nng nnn g", 2), ("g ng g", 1), ("g nnnn g ng", 3)]
)
def test_retries_are_those_behind_which_the_master_gives_up(pattern: str, retries: int) -> None:
    (found,) = polls_of(numbered(failing(pattern, 40)), frozenset(), 1)
    assert (found.retries, found.every) == (retries, 200 * MS)


def test_a_request_that_comes_again_when_it_is_due_is_no_repeat() -> None:
    """A listener numbers attempts from failure to success; this master has no retries."""
    rows = failing("g", 0)
    rows[3] = rows[3]._replace(replied=None, outcome="no_answer")
    rows[4] = rows[4]._replace(attempt=2)
    found = numbered(rows)
    assert {turn.attempt for turn in found} == {1}
    assert polls_of(found, frozenset(), 1)[0].retries == 0

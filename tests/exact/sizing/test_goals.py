"""Goals as a user writes them."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bussim.exact.sizing.goals import FORMS, LINK_GOALS, PORT_GOALS, Goals
from tests.exact.links import MS


@pytest.mark.parametrize(
    ("text", "goals"),
    [
        ("errors<=1/y", Goals(errors=1.0)),
        ("errors <= 0.5 / y", Goals(errors=0.5)),
        ("errors<=2/d", Goals(errors=730.0)),
        ("errors<=3", Goals(errors=3.0)),
        ("onsets<=2/d", Goals(onsets=730.0)),
        ("ride>=0", Goals(ride=0)),
        ("ride>=0 ms", Goals(ride=0)),
        ("errors<=1 per year", Goals(errors=1.0)),
        ("scan<=200ms@1e-6", Goals(scan=(200 * MS, 1e-6))),
        ("scan <= 0.2 s @ 0.001", Goals(scan=(200 * MS, 1e-3))),
        ("dead<=400 ms", Goals(dead=400 * MS)),
        ("ride>=100ms", Goals(ride=100 * MS)),
        ("heartbeat=500ms", Goals(heartbeat=(500 * MS, 0.1))),
        ("heartbeat=500ms@2/y", Goals(heartbeat=(500 * MS, 2.0))),
    ],
)
def test_what_is_understood(text: str, goals: Goals) -> None:
    assert Goals().with_text(text) == goals


def test_every_form_in_the_help_is_understood_and_printed_again() -> None:
    goals = Goals()
    for form in FORMS.values():
        goals = goals.with_text(form)
    assert list(goals.texts()) == list(LINK_GOALS)
    assert tuple(goals.port_texts()) == goals.of_ports() == PORT_GOALS
    assert {*LINK_GOALS, *PORT_GOALS} == set(FORMS)
    limits = {"errors": "1 a year", "cycle": "500 ms", "dead": "400 ms", "age": "1 s"}
    assert goals.port_limits() == limits
    assert {name: goals.limits()[name] for name in ("errors", "dead")} == {
        name: limits[name] for name in ("errors", "dead")
    }
    assert goals.limits()["heartbeat"] == "500 ms missed 0.1 times a year"
    assert goals.texts()["ride"] == "an interruption of the line of 100 ms without a station error"
    assert goals.texts()["heartbeat"] == "a heartbeat of 500 ms missed at most 0.1 times a year"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "not a goal; write one of errors<=1/y"),
        ("fast", "not a goal"),
        (
            "erors<=1/y",
            "whose goal 'erors' is none of errors, onsets, scan, dead, ride, heartbeat, cycle, age; did you mean errors<=1/y",
        ),
        ("latency<=1ms", "whose goal 'latency' is none of"),
        ("errors>=1/y", "write errors<=…, such as errors<=1/y"),
        ("ride<=100ms", "write ride>=…"),
        ("heartbeat<=1s", "write heartbeat=…"),
        ("scan<=200ms", "without a probability; write scan<=200ms@1e-6"),
        ("scan<=200ms@2", "whose probability must lie between 0 and 1"),
        ("scan<=200ms@often", "'often' is not a number"),
        ("scan<=200ms@1%", "'1%' is not a number; write scan<=200ms@1e-6"),
        ("errors<=1/week", "is not a rate; write a number and /h, /d or /y: errors<=1/y"),
        ("scan<=200@1e-6", "a time without a unit"),
        ("dead<=400ms@1e-6", "@ belongs to scan and heartbeat only"),
        ("dead<=-1ms", "must lie between 0 and 1 y"),
        ("dead<=0ms", "must lie between 0 and 1 y"),
        ("errors<=0/y", "must be above 0"),
        ("errors<=1e/y", "'1e' is not a number"),
        ("errors<=one/y", "is not a rate"),
        ("heartbeat=1s@x/y", "is not a rate"),
    ],
)
def test_what_is_not(text: str, message: str) -> None:
    with pytest.raises(ValueError, match=r"^is ") as caught:
        Goals().with_text(text)
    assert message in str(caught.value)


def test_goals_are_shown_as_they_were_given() -> None:
    goals = Goals()
    for text in ("errors<=1/d", "onsets<=0.5/h", "scan<=150.5ms@2e-05", "ride>=20ms", "heartbeat=1s@3/d"):
        goals = goals.with_text(text)
        assert text in goals.forms().values()
    texts = goals.texts()
    assert texts["errors"] == "false station errors: at most 1 a day"
    assert texts["onsets"] == "false station errors that begin: at most 0.5 an hour"
    assert texts["heartbeat"] == "a heartbeat of 1 s missed at most 3 times a day"
    assert "ride" not in Goals(ride=0).texts()


def test_a_goal_given_twice_is_refused() -> None:
    with pytest.raises(ValueError, match="a second goal ride; give each once"):
        Goals().with_text("ride>=20ms").with_text("ride>=300ms")


@given(st.text(max_size=30))
def test_any_text_is_a_goal_or_a_message(text: str) -> None:
    try:
        Goals().with_text(text)
    except ValueError as error:
        assert str(error).startswith("is ")

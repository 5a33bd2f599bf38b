"""Advice over random links: monotone in the noise, figures on the safe side."""

from __future__ import annotations

import io
import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console

from bussim.commands.size.show import show_sizing
from bussim.exact.link import LinkModel
from bussim.exact.sizing.choice import recommend
from bussim.exact.sizing.evaluation import evaluate_goals
from bussim.exact.sizing.goals import OUTAGE, Goals
from bussim.exact.sizing.grid import evaluate
from bussim.exact.sizing.noise_levels import scaled_noise, weaker_bursts
from bussim.exact.sizing.size import size
from bussim.exact.text import a_year, at_least, at_most, ms_at_least, ms_at_most, one_in
from bussim.plc.profiles import AbsentStation
from tests.exact.links import FULL, MS, PROBE, link, with_burst
from tests.exact.sizing.draws import goal_texts, goals_of, links, noisy, with_rate

DECADES = [0.0, *(10.0**-k for k in range(12, 1, -1))]


# -- more noise never means fewer attempts, nor a goal met that was refused --------------------------


def attempts_never_fall(line: tuple[LinkModel, str, int | None], rates: list[float]) -> None:
    attempts = 0.0
    for ber in rates:
        choice = recommend(with_rate(line, ber), Goals())
        assert choice is None or choice.ride >= OUTAGE
        now = math.inf if choice is None else choice.attempts
        assert now >= attempts, f"at {ber:g}"
        attempts = now


@pytest.mark.slow
@settings(deadline=None, max_examples=10)
@given(noisy())
def test_more_noise_never_means_fewer_attempts(line: tuple[LinkModel, str, int | None]) -> None:
    attempts_never_fall(line, DECADES)


@st.composite
def growing(draw: st.DrawFn) -> list[LinkModel]:
    """A link with bursts, and often lost replies, that grow: all noise, or of the bursts one of their values."""
    slaves = draw(st.integers(1, 3))
    absent, loss = draw(st.sampled_from([FULL, PROBE])), draw(st.sampled_from([0.0, 1e-4]))
    model = link(slaves, mode=draw(st.integers(0, 2)), absent=absent, loss=loss)
    part = draw(st.sampled_from(["bus", "bus", "rx", "tx"]))
    station = None if part == "bus" else draw(st.integers(0, slaves))
    bursts = {
        "good": 10 ** draw(st.floats(3.5, 6)),
        "bad": 10 ** draw(st.floats(0.3, 2)),
        "ber_good": draw(st.sampled_from([0.0, 1e-7, 1e-6])),
        "ber_bad": 10 ** draw(st.floats(-4, -3)),
    }
    grows = draw(st.sampled_from(["all", "ber_bad", "bad", "good"]))
    found = []
    for step in range(5):
        now = dict(bursts)
        for name in (grows,) if grows != "all" else ():
            now[name] *= {"ber_bad": 4.0, "bad": 1.7, "good": 0.5}[name] ** step
        grown = with_burst(model, **now, part=part, station=station)
        found.append(scaled_noise(grown, 10.0 ** (step / 2)) if grows == "all" else grown)
    return found


def attempts_of(model: LinkModel) -> float:
    choice = recommend(model, Goals())
    return math.inf if choice is None else choice.attempts


@pytest.mark.slow
@settings(deadline=None, max_examples=5)
@given(growing())
def test_more_bursts_or_lost_replies_never_mean_fewer_attempts(models: list[LinkModel]) -> None:
    attempts = [attempts_of(model) for model in models]
    assert attempts == sorted(attempts)


@pytest.mark.slow
def test_stronger_bursts_with_fewer_errors_do_not_mean_fewer_attempts() -> None:
    found = [with_burst(link(4), 60_000, 20, 0.0, ber) for ber in (1e-3, 2e-3, 1e-2, 1e-1)]
    grids = [evaluate(model, (7,), (50 * MS,), details=False) for model in found]
    assert grids[3].errors[0, 0] < grids[2].errors[0, 0] / 10  # so it is: nearly each poll is damaged, too
    attempts = [attempts_of(model) for model in found]
    assert attempts[1] > attempts[0] > 6
    assert attempts[2:] == [math.inf, math.inf]


def test_weaker_bursts_are_those_of_each_weaker_noise_too() -> None:
    one, ten = (with_burst(link(2, loss=1e-5), 60_000, 20, 1e-6, ber) for ber in (3e-3, 3e-2))
    assert set(weaker_bursts(one)) < set(weaker_bursts(ten))
    assert weaker_bursts(with_burst(link(2), 60_000, 20, 1e-6, 1e-4)) == ()
    assert weaker_bursts(link(2, ber=1e-2)) == ()
    polls_alone = with_burst(link(2), 60_000, 20, 0.0, 1e-1, part="tx", station=0)
    assert weaker_bursts(polls_alone) == ()  # each failed attempt takes the whole timeout
    assert all(
        source.good == 1e-6 < source.bad for view in weaker_bursts(ten) for source in view.noise.sources
    )
    quiet_bursts = with_burst(link(2), 60_000, 20, 1e-2, 0.0)  # the line is bad but for some moments
    assert all(view.noise.sources[0].bad == 0 for view in weaker_bursts(quiet_bursts))


#: From no noise to one bit in a hundred wrong, closest about the level bad.
FINE = [0.0, *np.geomspace(1e-9, 9e-6, 12), *np.geomspace(9e-6, 1.2e-5, 13), *np.geomspace(1.3e-5, 1e-2, 30)]


def refused_stays_refused(
    line: tuple[LinkModel, str, int | None], texts: list[str], rates: list[float] = FINE
) -> None:
    """More noise meets no goals that were refused, whether all goals together or a setting's single ones."""
    goals, refused, before = goals_of(texts), math.inf, None
    for ber in rates:
        model = with_rate(line, float(ber))
        checked = evaluate_goals(model, goals)
        if recommend(model, goals) is None:
            refused = min(refused, ber)
        else:
            assert refused == math.inf, f"refused at {refused:g}, met at {ber:g}"
        for name in checked.met if before is not None else ():
            # Beyond so many errors a probed station is one in error, which costs less than a living one.
            again = checked.met[name] & ~before.met[name] & (checked.grid.error_per_scan <= 0.05)
            assert not again.any(), f"{name} at {ber:g}"
        before = checked


@pytest.mark.slow
@pytest.mark.parametrize("absent", [FULL, PROBE])
@pytest.mark.parametrize(
    "texts",
    [
        ["scan<=150ms@1e-6"],  # refused at the level bad, whose failed attempts take the whole timeout
        ["scan<=130ms@0.001", "errors<=250/h", "ride>=0"],
        ["dead<=299ms", "ride>=50ms"],
        ["onsets<=20/y", "errors<=1000/y", "ride>=0"],
        ["errors<=900000000/y", "scan<=400ms@0.1", "ride>=0"],
    ],
)
def test_a_goal_that_was_refused_is_not_met_with_more_noise(absent: AbsentStation, texts: list[str]) -> None:
    refused_stays_refused((link(2, absent=absent), "bus", None), texts, [0.0, *FINE[1:13:3], *FINE[13::3]])


@pytest.mark.slow
@settings(deadline=None, max_examples=4)
@given(noisy(), goal_texts())
def test_goals_of_many_links_that_were_refused_are_not_met_with_more_noise(
    line: tuple[LinkModel, str, int | None], texts: list[str]
) -> None:
    refused_stays_refused(line, texts, [0.0, *FINE[1::3]])


@pytest.mark.slow
def test_little_noise_that_is_entered_is_as_none() -> None:
    model = link(2)
    found = [size(with_rate((model, "bus", None), ber)).recommended for ber in (0.0, 1e-12, 1e-9)]
    assert [choice.retries for choice in found if choice is not None] == [4, 4, 4]
    freed = size(with_rate((model, "bus", None), 1e-12), Goals(ride=0, errors=1e9)).recommended
    assert freed is not None
    assert freed.retries == 0  # the outage goal is given up where the user says so


# -- figures on the safe side ------------------------------------------------------------------------


@given(st.floats(1e-30, 1e12), st.integers(1, 4))
def test_rounding_is_to_the_safe_side(value: float, digits: int) -> None:
    up, down = at_most(value, digits), at_least(value, digits)
    assert down <= value <= up
    assert up - down <= value * 10.0 ** (1 - digits) * 1.001
    assert float(f"{up:.{digits - 1}e}") == up
    assert float(a_year(value).replace(",", "")) >= value * (1 - 1e-12)


@pytest.mark.parametrize("value", [5e-324, 1e-310, 1e-300, 1e300])
def test_figures_at_the_ends_of_floats_are_rounded(value: float) -> None:
    assert at_least(value) <= value <= at_most(value)
    assert "inf" not in one_in(min(value, 1.0)) + a_year(value)


@given(st.integers(0, 10**12), st.floats(0, 1))
def test_times_are_rounded_to_whole_ms_on_the_safe_side(ticks: int, part: float) -> None:
    time = ticks + part
    assert (float(ms_at_most(time)[:-3].replace(",", "")) - 1) * MS < time
    assert float(ms_at_most(time)[:-3].replace(",", "")) * MS >= time
    assert float(ms_at_least(time)[:-3].replace(",", "")) * MS <= time


def test_errors_within_a_goal_do_not_look_beyond_it() -> None:
    assert a_year(310.3) == "400"
    assert a_year(310.3, 365.0) == "320"
    assert a_year(0.011) == "0.02"
    assert a_year(3.1e-7) == "4e-07"
    assert a_year(0.0) == "0"


@pytest.mark.slow
@settings(deadline=None, max_examples=8)
@given(links(), st.sampled_from([0.0, 2e-5]))
def test_printed_figures_are_on_the_safe_side(model: LinkModel, ber: float) -> None:
    sizing = size(with_rate((model, "bus", None), ber))
    best = sizing.recommended
    if best is None:
        return
    out = io.StringIO()
    show_sizing(Console(file=out, width=400), "link", sizing, [])
    said = out.getvalue()

    def figure(pattern: str) -> float:
        found = re.search(pattern, said)
        assert found is not None, pattern
        return float(found[1].replace(",", ""))

    assert figure(r"mean ([\d,.]+) ms") * MS >= best.mean
    assert figure(r"with a dead station ([\d,.]+) ms") * MS >= best.dead
    assert figure(r"noticed after ([\d,.]+) ms") * MS >= best.detect
    assert figure(r"on average, ([\d,.]+) ms") * MS >= best.detect_longest
    assert figure(r"line of ([\d,.]+) ms passes") * MS <= best.ride
    assert figure(r"false station errors: ([\d,.e-]+) a year") >= best.errors
    # One figure for one thing: the chosen row of the table says the same.
    front = said[said.index("Pareto front") :]
    row = re.search(rf"^ +{best.retries} +{best.d8180} .*?([\d,]+ ms) +([\d,]+ ms)", front, re.MULTILINE)
    assert row is not None
    assert (row[1], row[2]) == (ms_at_most(best.dead), ms_at_most(best.detect))

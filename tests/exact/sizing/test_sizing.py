"""Recommendations: the traps, the front, what cannot be met and what would help."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from bussim.exact.link import LinkModel
from bussim.exact.metrics import Request, figures_of
from bussim.exact.sizing.choice import recommend
from bussim.exact.sizing.evaluation import (
    evaluate_goals,
    least,
    missed_at_least,
    missed_per_year,
    noise_views,
    rows_of,
    timeout_floor,
)
from bussim.exact.sizing.goals import Goals
from bussim.exact.sizing.grid import evaluate
from bussim.exact.sizing.noise_levels import LEVELS, OUTAGES, noise_levels_of, scaled_noise, with_level
from bussim.exact.sizing.size import size
from bussim.exact.sizing.trade_off import trade_off
from bussim.exact.sizing.unmet_goals import helpful_changes, with_mode
from bussim.plc.profiles import AbsentStation, Attempts, attempts_per_poll
from tests.exact.links import MS, PROBE, change, link, with_burst

PLUS_1, EXACTLY = Attempts.RETRIES_PLUS_1, Attempts.RETRIES


def worst(model: LinkModel, attempts: int, timeout: int) -> dict[str, float]:
    """A setting's figures one by one, the worst of all noise under which the goals must be met."""
    found: dict[str, float] = {}
    for view in noise_views(model):
        figures = figures_of(view.with_setting(attempts, timeout), Request({}, refresh=False))
        for name in ("mean", "errors_per_year", "one_dead", "detect_mean"):
            value = getattr(figures, name)
            found[name] = max(found.get(name, 0.0), value)
        assert figures.silence is not None
        found["silence"] = figures.silence
    return found


@pytest.mark.slow
def test_the_recommended_setting_meets_the_goals_and_nothing_less_does() -> None:
    model = link(7, ber=1e-5)
    goals = Goals(errors=1.0, ride=60 * MS)
    sizing = size(model, goals)
    best = sizing.recommended
    assert best is not None
    met = []
    for retries in range(11):
        for d8180 in range(5, 40):
            found = worst(model, retries + 1, d8180 * 10 * MS)
            if found["errors_per_year"] <= 1 and found["silence"] >= 60 * MS:
                met.append((found["one_dead"], retries, d8180))
    assert (best.retries, best.d8180) == min(met)[1:]
    assert best.dead == pytest.approx(min(met)[0])
    exact = worst(model, best.attempts, best.timeout)
    assert best.errors == pytest.approx(exact["errors_per_year"])
    assert best.detect == pytest.approx(exact["detect_mean"])
    assert best.mean == pytest.approx(exact["mean"])


# -- no noise given ----------------------------------------------------------------------------------


def test_a_perfect_line_does_not_mean_no_retries() -> None:
    sizing = size(link(7))
    best, noise_levels = sizing.recommended, sizing.noise_levels
    assert best is not None
    assert noise_levels is not None
    assert best.retries >= 3
    assert best.ride >= 100 * MS
    assert best.errors <= 1  # under the bad level
    rung = noise_levels.rungs[best.retries]
    assert rung.errors["bad"] == pytest.approx(best.errors)
    assert 100 * MS in rung.survived
    # One retry less does not survive both.
    less = noise_levels.rungs[best.retries - 1]
    assert less.errors["bad"] > 1 or 100 * MS not in less.survived
    assert sizing.to_json()["assumed_noise"] == "ladder"


def test_the_noise_levels() -> None:
    model = link(3)
    noise_levels = noise_levels_of(model, 50 * MS)
    assert [rung.retries for rung in noise_levels.rungs] == list(range(11))
    assert [rung.attempts for rung in noise_levels.rungs] == list(range(1, 12))
    for rung in noise_levels.rungs:
        assert rung.errors["quiet"] < rung.errors["typical"] < rung.errors["bad"]
        assert rung.survived == tuple(outage for outage in OUTAGES if outage <= rung.ride)
    two = noise_levels.rungs[1]
    noisy = figures_of(with_level(model, LEVELS["bad"]).with_setting(2, 50 * MS))
    assert two.errors["bad"] == pytest.approx(noisy.errors_per_year)
    assert two.dead == pytest.approx(noisy.one_dead)
    # A level fails as many attempts as its bit errors damage: 50 bits of poll and 540 of reply.
    chance = noise_levels.failing["bad"]
    assert chance == pytest.approx(1 - (1 - 1e-5) ** 590)
    assert noise_levels.rungs[0].errors["bad"] / two.errors["bad"] == pytest.approx(1 / chance, rel=1e-2)
    exactly = noise_levels_of(replace(model, reading=EXACTLY), 50 * MS)
    assert [rung.attempts for rung in exactly.rungs] == [1, *range(1, 11)]
    assert exactly.rungs[1].errors == exactly.rungs[0].errors


def test_a_perfect_line_with_a_goal_that_conflicts() -> None:
    sizing = size(link(7), Goals(dead=250 * MS))
    assert sizing.recommended is None
    assert sizing.noise_levels is not None
    errors, ride = sizing.unmet
    assert errors.goals == ("errors", "dead")
    assert "not together" in errors.text
    assert "the best is 380 ms (attempts 5, D8180 5)" in errors.text
    assert ride.goals == ("dead", "ride")
    assert sizing.mov_lines() == []


# -- the timeout's floor -----------------------------------------------------------------------------


@pytest.mark.slow
def test_the_timeout_leaves_room_for_a_plc_scan() -> None:
    model = change(link(2, mode=4, ber=1e-6), 2, scan=31 * MS, extra=4 * MS)
    longest = 39.0625 + 0.5175 + 4
    assert timeout_floor(model) == 90 * MS
    assert longest + 31 + 10 <= 90 < longest + 31 + 20
    sizing = size(model)
    assert sizing.recommended is not None
    assert sizing.recommended.timeout >= 90 * MS
    assert all(choice.timeout >= 90 * MS for choice in sizing.front)


def test_no_timeout_is_long_enough() -> None:
    sizing = size(change(link(2, ber=1e-6), 1, scan=2_300 * MS))
    assert not sizing.valid
    assert sizing.reasons == ("the longest reply needs a timeout of at least 2330 ms, D8180 allows 2250 ms",)
    assert sizing.to_json()["recommended"] is None


# -- the assumptions ---------------------------------------------------------------------------------


@pytest.mark.slow
def test_robust_holds_under_every_reading() -> None:
    model = link(7, ber=2e-5)
    goals = Goals(ride=100 * MS)
    sizing = size(model, goals)
    assert sizing.recommended is not None
    assert sizing.robust is not None
    assert set(sizing.robust.choices) == {(r, a) for r in Attempts for a in AbsentStation}
    for (reading, absent), choice in sizing.robust.choices.items():
        assert choice.attempts == attempts_per_poll(reading, sizing.robust.retries)
        exact = worst(replace(model, absent=absent), choice.attempts, sizing.robust.timeout)
        assert exact["errors_per_year"] == pytest.approx(choice.errors)
        assert choice.errors <= 1
        assert choice.ride >= 100 * MS
    # Read as exactly D8179, one more retry is needed for as many attempts.
    assert sizing.robust.retries == sizing.recommended.retries + 1
    assert sizing.apart().startswith(
        f"D8179 = {sizing.robust.retries}, D8180 = {sizing.robust.timeout // (10 * MS)} would meet the goals"
    )


def test_the_other_reading_has_its_own_recommendation() -> None:
    model = replace(link(3, ber=1e-5, attempts=3), retries=3, reading=EXACTLY)
    sizing = size(model)
    plus_1 = size(link(3, ber=1e-5))
    assert sizing.recommended is not None
    assert plus_1.recommended is not None
    assert sizing.recommended.attempts == plus_1.recommended.attempts
    assert sizing.recommended.retries == plus_1.recommended.retries + 1
    assert sizing.mov_lines() == [
        "LD M8002  ; the first scan",
        "MOV K5 D8179  ; retries: 5 attempts per poll (D8179 read as retries)",
        "MOV K5 D8180  ; timeout: 50 ms",
    ]
    # D8179 = 0 is one attempt by both readings; the profile's holds.
    assert size(replace(model, retries=0, attempts=1)).recommended == sizing.recommended


# -- the front ---------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("model", [link(4, ber=3e-5), with_burst(link(3, ber=1e-6), 10_000, 40, 0, 5e-3)])
def test_no_setting_beats_one_of_the_front(model: LinkModel) -> None:
    sizing = size(model)
    assert sizing.checked is not None
    grid = sizing.checked.grid
    assert [choice.dead for choice in sizing.front] == sorted(choice.dead for choice in sizing.front)
    for choice in sizing.front:
        chance = grid.error_per_scan[grid.at(choice.attempts, choice.timeout)]
        beaten = (
            (grid.one_dead < choice.dead * (1 - 1e-12))
            & (grid.detect_mean < choice.detect)
            & (grid.error_per_scan < chance / 1.25)
        )
        assert not beaten.any()
        assert choice.dead <= 1_000 * MS
    assert len(sizing.front) >= 5


def test_the_front_has_the_recommended_setting_and_counts_what_is_above_a_second() -> None:
    sizing = size(link(7), Goals(ride=1_000 * MS))
    best = sizing.recommended
    assert best is not None
    assert best.dead > 1_000 * MS
    assert best in sizing.front
    assert all(choice.dead <= 1_000 * MS or choice == best for choice in sizing.front)
    assert size(change(link(3), 1, scan=200 * MS)).front_longer > 0
    assert sizing.to_json()["pareto_above_1_s"] == sizing.front_longer


# -- heartbeat ---------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_heartbeat_that_must_not_be_missed() -> None:
    model = link(2, ber=1e-5)
    strict = Goals(heartbeat=(500 * MS, 0.1))
    sizing = size(model, strict)
    assert sizing.recommended is not None
    chosen = model.with_setting(sizing.recommended.attempts, sizing.recommended.timeout)
    assert missed_per_year(chosen, 500 * MS) <= 0.1
    impossible = size(model, Goals(heartbeat=(120 * MS, 0.1)))
    assert impossible.recommended is None
    assert impossible.unmet[0].goals == ("heartbeat",)
    assert "no setting does; each setting misses it" in impossible.unmet[0].text


@pytest.mark.parametrize("slaves", [1, 3])
@pytest.mark.parametrize("ber", [1e-6, 1e-5, 2e-4])
@pytest.mark.parametrize("preset", [20, 90, 150, 320])
def test_the_bound_on_missed_heartbeats_is_one(slaves: int, ber: float, preset: int) -> None:
    for model in noise_views(link(slaves, ber=ber)):
        bound, exact = missed_at_least(model, preset * MS), missed_per_year(model, preset * MS)
        assert bound <= exact * (1 + 1e-9)
        if preset == 20:  # less than a scan: every one is missed
            assert bound == pytest.approx(exact)


@pytest.mark.slow
def test_heartbeats_with_bursts_are_evaluated_for_some_timeouts() -> None:
    model = with_burst(link(1, ber=1e-6), 60_000, 20, 0, 5e-3)
    goals = Goals(heartbeat=(900 * MS, 1.0), errors=200.0)
    checked = evaluate_goals(model, goals)
    found = least([(checked, rows_of(checked, PLUS_1))])
    assert found is not None
    i, j = found
    assert checked.missed_at(i, j) <= 1.0
    assert checked.evaluated[0].sum() <= 8


# -- what cannot be met ------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_goal_that_fails_alone_is_named_with_its_best() -> None:
    sizing = size(link(7, ber=1e-5), Goals(scan=(150 * MS, 1e-6)))
    assert sizing.recommended is None
    assert sizing.robust is None
    (unmet,) = sizing.unmet
    assert unmet.goals == ("scan",)
    assert unmet.text.startswith(
        "a scan over 150 ms with probability at most 1e-06: no setting does; the best is"
    )
    assert sizing.robust_unmet
    for help_ in unmet.helps:
        assert "then D8179" in help_
    assert any("stations on the link instead of 8" in help_ for help_ in unmet.helps)


@pytest.mark.slow
def test_what_helps_does_help() -> None:
    goals = Goals(dead=300 * MS)
    model = link(7, ber=1e-5)
    sizing = size(model, goals)
    assert sizing.recommended is None
    fewer = next(h for h in sizing.unmet[0].helps if "stations on the link" in h)
    count = int(fewer.split()[0])
    assert size(replace(model, stations=model.stations[: count - 1]), goals).recommended is not None
    assert size(replace(model, stations=model.stations[:count]), goals).recommended is None
    mode = next(h for h in sizing.unmet[0].helps if "refresh mode" in h)
    assert mode.startswith("refresh mode 1 instead of 2")
    assert size(with_mode(model, 1), goals).recommended is not None
    ride = size(model, Goals(ride=400 * MS, dead=400 * MS))
    said = "an interruption of the line of 156 ms without a station error instead of 400 ms (then"
    assert any(h.startswith(said) for h in ride.unmet[0].helps)


def test_scaled_noise_and_smaller_modes() -> None:
    model = with_burst(link(3, ber=1e-4, loss=0.1), 10, 5, 1e-5, 1e-2)
    less = scaled_noise(model, 1 / 10)
    assert [s.good for s in less.noise.sources] == [pytest.approx(1e-5), pytest.approx(1e-6)]
    assert less.noise.sources[1].bad == pytest.approx(1e-3)
    assert less.stations[0].loss == pytest.approx(0.01)
    assert scaled_noise(model, 1e6).noise.sources[0].good == 0.5
    assert with_mode(link(3, mode=2), 0) == replace(link(3, mode=0))


# -- what cannot be sized ----------------------------------------------------------------------------


def test_links_that_cannot_be_sized() -> None:
    odd = replace(link(2), obstacles=("a jabbering station collides with every frame",))
    assert size(odd).reasons == odd.obstacles
    assert size(replace(link(2), stations=())).reasons == ("no slave is polled: there is nothing to size",)


def test_the_json_form_and_the_neighbours() -> None:
    sizing = size(link(7, ber=1e-5))
    form = sizing.to_json()
    assert json.loads(json.dumps(form)) == form
    assert form["recommended"] == {**form["recommended"], "D8179": 4, "D8180": 5, "attempts": 5}  # type: ignore[dict-item]
    assert isinstance(form["pareto"], list)
    assert form["pareto"][0]["D8179"] == 0
    assert form["unmet"] == []
    assert sizing.neighbours() == [(4, 50 * MS), (3, 50 * MS), (0, 50 * MS)]


def test_the_probed_policy_does_not_hide_the_first_long_scan() -> None:
    # A probed station costs one attempt a scan, so more retries cost nothing there: the fewest that
    # meet the goals are still taken, since each makes a death noticed later.
    sizing = size(link(3, ber=1e-5, absent=PROBE))
    full = size(link(3, ber=1e-5))
    assert sizing.recommended is not None
    assert full.recommended is not None
    assert sizing.recommended.retries == full.recommended.retries
    assert sizing.recommended.dead < full.recommended.dead


def test_goal_evaluation_keeps_to_the_floor() -> None:
    checked = evaluate_goals(link(2, mode=3, ber=1e-6), Goals())
    assert checked.grid.timeouts[0] == timeout_floor(link(2, mode=3)) == 50 * MS
    assert np.all(checked.candidates(checked.names) <= (checked.grid.errors <= 1))


@pytest.mark.slow
def test_the_trade_off_has_the_figures_of_each_setting_at_each_noise() -> None:
    model = link(3, ber=1e-5)
    sizing = size(model)
    points = trade_off(sizing)
    assert sizing.recommended is not None
    assert points.timeout == sizing.recommended.timeout
    assert points.retries == tuple(range(11))
    assert list(points.series) == ["noise as entered", "10 times the noise", "100 times the noise"]
    for factor, dots in zip((1, 10, 100), points.series.values(), strict=True):
        for retries, (dead, errors) in zip(points.retries, dots, strict=True):
            noisy = link(3, ber=factor * 1e-5).with_setting(retries + 1, points.timeout)
            exact = figures_of(noisy, Request({}, refresh=False))
            assert dead == pytest.approx(exact.one_dead)
            assert errors == pytest.approx(exact.errors_per_year)


def test_the_trade_off_without_noise_has_the_assumed_levels() -> None:
    sizing = size(link(3))
    points = trade_off(sizing)
    assert sizing.noise_levels is not None
    assert points.chosen_for == list(points.series)[-1]
    for name, dots in zip(LEVELS, points.series.values(), strict=True):
        assert [errors for _, errors in dots] == pytest.approx(
            [level.errors[name] for level in sizing.noise_levels.rungs]
        )


# -- a line with stations that do not reply ----------------------------------------------------------


@pytest.mark.parametrize("dead", [(1,), (2, 3)])
@pytest.mark.parametrize("goals", [Goals(), Goals(ride=0, errors=10.0), Goals(dead=700 * MS)])
def test_goals_hold_for_a_line_with_broken_stations_and_for_the_complete_one(
    dead: tuple[int, ...], goals: Goals
) -> None:
    whole = change(link(3, ber=1e-6), 3, extra=5 * MS, scan=40 * MS)
    timeouts = range(timeout_floor(whole), 300 * MS, 10 * MS)
    found = []
    grids = [evaluate(v, range(1, 12), timeouts) for v in noise_views(whole.with_dead(*dead), whole)]
    for i, j in np.ndindex(11, len(timeouts)):
        one_dead = max(float(grid.one_dead[i, j]) for grid in grids)
        met = [grid.errors[i, j] <= goals.errors and grid.silence[i, j] >= goals.ride for grid in grids]
        if all(met) and one_dead <= (goals.dead or math.inf):
            found.append((one_dead, i, timeouts[j]))
    best = recommend(whole.with_dead(*dead), goals)
    assert (best is None) == (not found)
    if best is not None:
        assert (best.dead, best.retries, best.timeout) == min(found)


@pytest.mark.slow
def test_the_repaired_line_wants_an_attempt_more_and_that_is_said() -> None:
    model = change(link(2, ber=1e-6), 2, scan=12 * MS)
    sizing, whole = size(model.with_dead(1)), recommend(model, Goals())
    assert sizing.recommended is not None
    assert whole is not None
    assert (sizing.recommended.retries, whole.retries) == (4, 4)
    assert "the line with all stations replying needs this setting; as it is, D8179 = 3" in sizing.decided
    help_ = helpful_changes(model.with_dead(1), Goals(dead=400 * MS))[0].text
    assert help_ == f"all stations replying (then D8179 {whole.retries}, D8180 {whole.d8180})"


def test_a_line_on_which_no_slave_replies_is_sized_as_the_complete_one() -> None:
    sizing = size(link(2, ber=1e-6).with_dead(1, 2))
    assert sizing.recommended == recommend(link(2, ber=1e-6), Goals())
    assert "no slave replies" in sizing.decided

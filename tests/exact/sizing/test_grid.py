"""All settings at once against one setting at a time."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bussim.exact.link import LinkModel
from bussim.exact.metrics import YEAR, Request, figures_of
from bussim.exact.scan.memoryless import fails_of, probabilities_of
from bussim.exact.sizing.evaluation import Checked
from bussim.exact.sizing.goals import Goals
from bussim.exact.sizing.grid import evaluate
from bussim.plc.profiles import Turnaround
from tests.exact.links import MS, PROBE, change, link, with_burst, with_noise
from tests.selection import quick_names

EVERY = range(50 * MS, 2_251 * MS, 10 * MS)
ATTEMPTS = range(1, 12)
REQUEST = Request(levels={}, deadlines=(150 * MS,), refresh=False)

LINKS = {
    "plain": link(7, ber=1e-5),
    "two": link(1, ber=1e-6, mode=0),
    "perfect": link(3),
    "mode 4, noisy": link(4, mode=4, ber=1e-4),
    "probe": link(3, ber=2e-4, absent=PROBE),
    "different stations": change(with_noise(link(3, ber=1e-5), "rx", 2, 1e-4), 1, extra=30 * MS),
    "one dead": link(3, ber=1e-5).with_dead(2),
    "one dead, probe": link(3, ber=1e-5, absent=PROBE).with_dead(2),
    "two laws": change(link(3, ber=1e-4), 1, turnaround=Turnaround(90_000, 54_000)),
    "measured": link(3, ber=1e-4, turnaround=Turnaround(0, 0, (21_600, 72_000, 180_000), (5, 3, 1))),
    "very noisy": link(3, ber=1e-3),
}


@pytest.mark.parametrize("name", quick_names(("two", "different stations", "one dead, probe"), LINKS))
def test_a_grid_is_its_settings(name: str) -> None:
    model = LINKS[name]
    grid = evaluate(model, ATTEMPTS, EVERY, (150 * MS,))
    for attempts, timeout in ((1, 50), (2, 60), (4, 100), (7, 330), (11, 2250)):
        figures = figures_of(model.with_setting(attempts, timeout * MS), REQUEST)
        i, j = grid.at(attempts, timeout * MS)
        assert grid.valid[j] == figures.valid
        assert figures.mean is not None
        assert grid.mean[i, j] == pytest.approx(figures.mean, rel=1e-9)
        assert grid.error_per_scan[i, j] == pytest.approx(sum(figures.error_per_scan.values()), rel=1e-9)
        onsets = figures.onsets_per_year
        assert grid.onset_per_scan[i, j] * YEAR / grid.mean[i, j] == pytest.approx(onsets, rel=1e-9)
        assert grid.one_dead[i, j] == pytest.approx(figures.one_dead, rel=1e-9)
        assert grid.detect_mean[i, j] == pytest.approx(figures.detect_mean, rel=1e-7)
        assert grid.detect_longest[i, j] == pytest.approx(figures.detect_longest, rel=1e-9)
        assert grid.silence[i, j] == figures.silence
        over = figures.over[150 * MS]
        assert grid.over[150 * MS][i, j] == pytest.approx(over, rel=1e-3, abs=1e-12)


def test_a_chance_near_its_limit_is_decided_by_the_law() -> None:
    """Of thousands of light components none is forgotten: just below the true chance a goal is not met."""
    model, deadline = link(4, mode=4, ber=3e-4, attempts=10, timeout=80), 1_088 * MS
    grid = evaluate(model, (10,), [80 * MS], (deadline,))
    over = figures_of(model, Request(levels={}, deadlines=(deadline,), refresh=False)).over[deadline]
    assert grid.over[deadline][0, 0] == pytest.approx(over, rel=1e-3)
    for level, met in ((over * (1 - 1e-6), False), (over * (1 + 1e-6), True)):
        assert Checked([model], grid, Goals(scan=(deadline, level))).met["scan"][0, 0] == met


@pytest.mark.slow
def test_burst_grids() -> None:
    model = with_burst(link(3, ber=1e-6), 5_000, 30, 0, 8e-3)
    columns = [50 * MS, 700 * MS]
    grid = evaluate(model, (1, 3), columns, (150 * MS,))
    for i, attempts in enumerate((1, 3)):
        for j, timeout in enumerate(columns):
            figures = figures_of(model.with_setting(attempts, timeout), REQUEST)
            assert grid.mean[i, j] == pytest.approx(figures.mean, rel=1e-10)
            assert grid.error_per_scan[i, j] == pytest.approx(sum(figures.error_per_scan.values()), rel=1e-8)
            onsets = figures.onsets_per_year
            assert grid.onset_per_scan[i, j] * YEAR / grid.mean[i, j] == pytest.approx(onsets, rel=1e-6)
            assert grid.one_dead[i, j] == pytest.approx(figures.one_dead, rel=1e-9)
            assert grid.detect_mean[i, j] == pytest.approx(figures.detect_mean, rel=1e-6)
            assert grid.silence[i, j] == figures.silence
            assert grid.over[150 * MS][i, j] == pytest.approx(figures.over[150 * MS])


def test_burst_grids_with_probed_stations_are_nearly_exact() -> None:
    model = with_burst(link(3, ber=1e-6, absent=PROBE), 5_000, 30, 0, 8e-3)
    grid = evaluate(model, (3,), [60 * MS])
    figures = figures_of(model.with_setting(3, 60 * MS), REQUEST)
    # The other stations' flags are taken as off: an error of the order of errors together.
    assert grid.errors[0, 0] == pytest.approx(figures.errors_per_year, rel=1e-2)
    assert grid.onsets[0, 0] == pytest.approx(figures.onsets_per_year, rel=1e-2)
    assert grid.mean[0, 0] == pytest.approx(figures.mean, rel=1e-5)


def test_settings_without_a_law_have_no_number() -> None:
    model = change(link(2, ber=1e-5), 1, extra=70 * MS)
    grid = evaluate(model, ATTEMPTS, [50 * MS, 80 * MS, 90 * MS], (150 * MS,))
    assert grid.valid.tolist() == [False, False, True]
    for figures in (grid.mean, grid.errors, grid.one_dead, grid.silence, *grid.over.values()):
        assert np.isnan(figures[:, :2]).all()
        assert not np.isnan(figures[:, 2]).any()


@settings(deadline=None, max_examples=6)
@given(st.integers(1, 7), st.integers(0, 4), st.floats(-7, -3.3), st.booleans())
def test_more_attempts_and_longer_timeouts(slaves: int, mode: int, exponent: float, probe: bool) -> None:
    model: LinkModel = link(slaves, mode=mode, ber=10**exponent, absent=PROBE if probe else link().absent)
    grid = evaluate(model, ATTEMPTS, [50 * MS, 90 * MS, 400 * MS])
    assert np.all(np.diff(grid.errors, axis=0) < 0)
    assert np.all(np.diff(grid.errors, axis=1) == 0)  # slower scans are no merit
    assert np.all(np.diff(grid.silence, axis=0) >= 0)
    assert np.all(np.diff(grid.detect_mean, axis=0) > 0)
    for increasing in (grid.mean, grid.one_dead, grid.detect_mean, grid.detect_longest):
        assert np.all(np.diff(increasing, axis=1) > 0)
    expected = fails_of(probabilities_of(model)[0], 3, model.absent).error
    assert grid.errors[2] == pytest.approx(slaves * expected * YEAR / grid.mean[2, 0])

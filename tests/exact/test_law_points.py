"""Points of a distribution for drawings, against the distribution between them."""

from __future__ import annotations

import numpy as np
import pytest

import bussim
from bussim.engines.nn.frames import data_chars
from bussim.exact.law_points import law_points
from bussim.exact.link import frame_ticks
from bussim.exact.sizing.noise_levels import LEVELS, with_level
from bussim.exact.solve import Solved
from bussim.plc.profiles import Turnaround
from tests.exact.links import MS, PROBE, link, with_burst

LINKS = {
    "no noise": link(7),
    "seldom": link(4, ber=1e-6),
    "often": link(7, ber=1e-3, attempts=10),
    "bursts": with_burst(link(7, attempts=10), 10_000, 20, 0, 1e-2),
    "probe": with_burst(link(3, absent=PROBE), 500, 20, 1e-6, 5e-3),
}


@pytest.mark.parametrize("points", [1_300, 300, 100])
@pytest.mark.parametrize("name", LINKS)
def test_lines_between_the_points_are_the_distribution(name: str, points: int) -> None:
    law = Solved(LINKS[name]).distribution
    x, y = map(np.array, law_points(law, 1e-9, points))
    assert 2 <= x.size <= points
    assert np.all(np.diff(x) > 0)
    assert np.all(np.diff(y) <= 1e-15)
    assert y == pytest.approx(law.tail(x * MS), rel=1e-12)
    assert y[0] == pytest.approx(1, rel=1e-12)
    assert x[-1] == pytest.approx(law.quantile(1e-9) / MS, rel=1e-12)
    between = np.linspace(x[0], x[-1], 5_003)
    drawn = np.interp(between, x, np.log10(np.maximum(y, 1e-12)))
    away = np.abs(drawn - np.log10(np.maximum(law.tail(between * MS), 1e-12)))
    # A quarter of a decade is 11 pixels of 400 over nine decades: only beside a step, and in few places.
    assert away[law.tail(between * MS) >= 1e-9].max() < 0.25
    assert np.mean(away > 0.05) < 0.05


def test_a_time_with_a_probability_of_its_own_is_an_upright_step() -> None:
    law = Solved(link(1, attempts=2, loss=0.1, turnaround=Turnaround(30_000, 0))).distribution
    x, y = law_points(law, points=20)
    jumps = sorted(set((law.shift / MS).tolist()))
    for jump in jumps:
        at = x.index(pytest.approx(jump, abs=1e-9)) if jump not in x else x.index(jump)
        assert at == 0 or x[at - 1] == pytest.approx(jump - 1 / MS, abs=1e-9)
        assert at == 0 or y[at - 1] > 1.05 * y[at]


@pytest.mark.parametrize(("least", "points"), [(0.0, 100), (1.0, 100), (float("nan"), 100), (1e-9, 1)])
def test_what_cannot_be_drawn(least: float, points: int) -> None:
    with pytest.raises(ValueError, match="least is"):
        law_points(Solved(link(1)).distribution, least, points)


def test_the_fan_has_the_assumed_levels_where_no_noise_is_entered() -> None:
    found = bussim.exact("two_stations", refresh=False)
    model = found.links["link"].model
    fan = found.fan("link", points=200)
    assert list(fan) == ["quiet", "typical", "bad"]
    for name, (x, y) in fan.items():
        law = Solved(with_level(model, LEVELS[name])).distribution
        assert y == pytest.approx(law.tail(np.array(x) * MS).tolist(), rel=1e-12)
    assert fan["quiet"].x[-1] < fan["bad"].x[-1]
    own = found.links["link"].distribution
    assert own is not None
    assert found.law_points("link", points=200) == law_points(own, points=200)
    assert bussim.exact("electrical_noise", refresh=False).fan("link") == {}
    refused = bussim.exact("bad_parameter", refresh=False)
    assert refused.law_points("link").x == []
    assert refused.fan("link") == {}


def test_what_profiles_allow() -> None:
    found = bussim.profiles()
    assert list(found) == ["pw10", "fx2n", "fx3u", "fx1s"]
    assert found["fx1s"]["modes"] == {0: {"bits": 0, "words": 4, "documented": True}}
    assert found["pw10"]["timeout"] == [5, 225]
    for name, limits in found.items():
        retries, timeout = max(limits["retries"]), max(limits["timeout"])
        for mode, block in limits["modes"].items():
            text = f"""
schema: 1
name: limits
duration: 1 s
buses: [{{name: link, nn: true}}]
plcs:
  - {{name: m, profile: {name}, nn: {{bus: link, port: COM4, station: 0, slaves: 1, mode: {mode},
     retries: {retries}, timeout: {10 * timeout} ms}}}}
  - {{name: s, profile: {name}, nn: {{bus: link, port: COM4, station: 1}}}}
"""
            model = bussim.exact(bussim.loads(text), refresh=False).links["link"].model
            assert model.data == frame_ticks(data_chars(mode))
            assert data_chars(mode) == 6 + 2 * (block["bits"] // 8 + 2 * block["words"])
            assert str(model.reading) == limits["assumed"]["attempts"]
        more = text.replace(f"retries: {retries}", f"retries: {retries + 1}")
        assert not bussim.examine(more).scenario
        more = text.replace(f"timeout: {10 * timeout} ms", f"timeout: {10 * timeout + 10} ms")
        assert not bussim.examine(more).scenario

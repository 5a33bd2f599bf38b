"""Tails, quantiles and merging of lobes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bussim.exact.scan.mixture import Law, merged
from bussim.exact.scan.turnaround_sums import TurnaroundSums
from bussim.plc.profiles import Turnaround
from tests.exact.links import PW10

SUMS = TurnaroundSums([PW10.turnaround])
MEASURED = TurnaroundSums([Turnaround(0, 0, (100, 300, 700), (1, 2, 3))])

lobe = st.tuples(st.integers(0, 3_000_000), st.integers(0, 9), st.floats(-25, 0))


def law_of(lobes: list[tuple[int, int, float]], sums: TurnaroundSums = SUMS) -> Law:
    shift, code, exponent = zip(*lobes, strict=True)
    weight = 10.0 ** np.array(exponent)
    return Law(np.array(shift, float), np.array(code), weight / weight.sum(), sums)


@given(st.lists(lobe, min_size=1, max_size=12), st.lists(st.floats(-1e5, 4e6), min_size=1, max_size=30))
def test_a_tail_is_the_sum_over_its_lobes(lobes: list[tuple[int, int, float]], x: list[float]) -> None:
    law = law_of(lobes)
    at = np.array(x)
    alone = sum(
        w * SUMS.tail(int(c), at - s)
        for s, c, w in zip(law.shift, law.code.tolist(), law.weight, strict=True)
    )
    assert law.tail(at) == pytest.approx(alone, rel=1e-11, abs=1e-300)
    excess = sum(
        w * SUMS.excess(int(c), at - s)
        for s, c, w in zip(law.shift, law.code.tolist(), law.weight, strict=True)
    )
    assert law.excess(at) == pytest.approx(excess, rel=1e-7, abs=1e-6)
    assert law.tail(at.reshape(1, -1)).shape == (1, at.size)


@settings(deadline=None)
@given(st.lists(lobe, min_size=1, max_size=12), st.floats(-14, -0.01))
def test_a_quantile_inverts_the_tail(lobes: list[tuple[int, int, float]], exponent: float) -> None:
    law, q = law_of(lobes), 10.0**exponent
    x = law.quantile(q)
    # Just above it at most q lies beyond, just below it more than q does.
    assert law.tail(x + 1e-2) <= q * (1 + 1e-4)
    assert law.tail(x - 1e-2) >= q * (1 - 1e-4)


@settings(deadline=None)
@given(st.lists(lobe, min_size=1, max_size=8), st.floats(-12, -0.01))
def test_quantiles_of_a_discrete_law(lobes: list[tuple[int, int, float]], exponent: float) -> None:
    law, q = law_of(lobes, MEASURED), 10.0**exponent
    x = law.quantile(q)
    assert law.tail(x + 1e-2) <= q * (1 + 1e-9)
    assert law.tail(x - 1e-2) >= q * (1 - 1e-9)
    assert abs(x - round(x)) <= 2e-3


@given(st.lists(lobe, min_size=1, max_size=12))
def test_moments_are_integrals_of_the_tail(lobes: list[tuple[int, int, float]]) -> None:
    law = law_of(lobes)
    low, high = law.support
    assert low + float(law.excess(low)) == pytest.approx(law.mean, rel=1e-12)
    # E[(X - low)²] = 2 ∫ excess; by Simpson's rule on a fine grid.
    x = np.linspace(low, high, 4001)
    if high > low:
        y = law.excess(x)
        step = (high - low) / 4000
        integral = step / 3 * float(y[0] + y[-1] + 4 * y[1::2].sum() + 2 * y[2:-1:2].sum())
        assert 2 * integral == pytest.approx(law.variance + (law.mean - low) ** 2, rel=1e-5, abs=step * step)


def test_the_quantile_between_lobes_is_the_lower_lobes_end() -> None:
    law = law_of([(0, 1, 0.0), (1_000_000, 1, -3.0)])
    heavy = 1 / 1.001
    assert law.quantile(1 - heavy + 1e-12) == pytest.approx(14_400, abs=1e-3)
    assert law.quantile(1 - heavy - 1e-9) > 1_000_000


@pytest.mark.parametrize("q", [0.0, 1.0, -1.0, float("nan")])
def test_a_quantile_needs_a_probability(q: float) -> None:
    with pytest.raises(ValueError, match="between 0 and 1"):
        law_of([(0, 1, 0.0)]).quantile(q)


def test_equal_lobes_are_put_together() -> None:
    shift, code, weight = merged(
        np.array([5.0, 1.0, 5.0, 5.0]), np.array([1, 1, 2, 1]), np.array([0.1, 0.2, 0.3, 0.4])
    )
    assert shift.tolist() == [1.0, 5.0, 5.0]
    assert code.tolist() == [1, 1, 2]
    assert weight == pytest.approx([0.2, 0.5, 0.3])

"""Tails, quantiles and merging of components."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bussim.exact.scan.mixture import Distribution, merged
from bussim.exact.scan.turnaround_sums import TurnaroundSums
from bussim.plc.profiles import Turnaround
from tests.exact.links import PW10

SUMS = TurnaroundSums([PW10.turnaround])
MEASURED = TurnaroundSums([Turnaround(0, 0, (100, 300, 700), (1, 2, 3))])

component = st.tuples(st.integers(0, 3_000_000), st.integers(0, 9), st.floats(-25, 0))


def distribution_of(components: list[tuple[int, int, float]], sums: TurnaroundSums = SUMS) -> Distribution:
    shift, code, exponent = zip(*components, strict=True)
    weight = 10.0 ** np.array(exponent)
    return Distribution(np.array(shift, float), np.array(code), weight / weight.sum(), sums)


@given(st.lists(component, min_size=1, max_size=12), st.lists(st.floats(-1e5, 4e6), min_size=1, max_size=30))
def test_a_tail_is_the_sum_over_its_components(
    components: list[tuple[int, int, float]], x: list[float]
) -> None:
    distribution = distribution_of(components)
    at = np.array(x)
    alone = sum(
        w * SUMS.tail(int(c), at - s)
        for s, c, w in zip(distribution.shift, distribution.code.tolist(), distribution.weight, strict=True)
    )
    assert distribution.tail(at) == pytest.approx(alone, rel=1e-11, abs=1e-300)
    excess = sum(
        w * SUMS.excess(int(c), at - s)
        for s, c, w in zip(distribution.shift, distribution.code.tolist(), distribution.weight, strict=True)
    )
    assert distribution.excess(at) == pytest.approx(excess, rel=1e-7, abs=1e-6)
    assert distribution.tail(at.reshape(1, -1)).shape == (1, at.size)


@settings(deadline=None)
@given(st.lists(component, min_size=1, max_size=12), st.floats(-14, -0.01))
def test_a_quantile_inverts_the_tail(components: list[tuple[int, int, float]], exponent: float) -> None:
    distribution, q = distribution_of(components), 10.0**exponent
    x = distribution.quantile(q)
    # Just above it at most q lies beyond, just below it more than q does.
    assert distribution.tail(x + 1e-2) <= q * (1 + 1e-4)
    assert distribution.tail(x - 1e-2) >= q * (1 - 1e-4)


@settings(deadline=None)
@given(st.lists(component, min_size=1, max_size=8), st.floats(-12, -0.01))
def test_quantiles_of_a_discrete_law(components: list[tuple[int, int, float]], exponent: float) -> None:
    distribution, q = distribution_of(components, MEASURED), 10.0**exponent
    x = distribution.quantile(q)
    assert distribution.tail(x + 1e-2) <= q * (1 + 1e-9)
    assert distribution.tail(x - 1e-2) >= q * (1 - 1e-9)
    assert abs(x - round(x)) <= 2e-3


@given(st.lists(component, min_size=1, max_size=12))
def test_moments_are_integrals_of_the_tail(components: list[tuple[int, int, float]]) -> None:
    distribution = distribution_of(components)
    low, high = distribution.support
    assert low + float(distribution.excess(low)) == pytest.approx(distribution.mean, rel=1e-12)
    # E[(X - low)²] = 2 ∫ excess; by Simpson's rule on a fine grid.
    x = np.linspace(low, high, 4001)
    if high > low:
        y = distribution.excess(x)
        step = (high - low) / 4000
        integral = step / 3 * float(y[0] + y[-1] + 4 * y[1::2].sum() + 2 * y[2:-1:2].sum())
        assert 2 * integral == pytest.approx(
            distribution.variance + (distribution.mean - low) ** 2, rel=1e-5, abs=step * step
        )


def test_the_quantile_between_components_is_the_lower_ones_end() -> None:
    distribution = distribution_of([(0, 1, 0.0), (1_000_000, 1, -3.0)])
    heavy = 1 / 1.001
    assert distribution.quantile(1 - heavy + 1e-12) == pytest.approx(14_400, abs=1e-3)
    assert distribution.quantile(1 - heavy - 1e-9) > 1_000_000


@pytest.mark.parametrize("q", [0.0, 1.0, -1.0, float("nan")])
def test_a_quantile_needs_a_probability(q: float) -> None:
    with pytest.raises(ValueError, match="between 0 and 1"):
        distribution_of([(0, 1, 0.0)]).quantile(q)


def test_equal_components_become_one() -> None:
    shift, code, weight = merged(
        np.array([5.0, 1.0, 5.0, 5.0]), np.array([1, 1, 2, 1]), np.array([0.1, 0.2, 0.3, 0.4])
    )
    assert shift.tolist() == [1.0, 5.0, 5.0]
    assert code.tolist() == [1, 1, 2]
    assert weight == pytest.approx([0.2, 0.5, 0.3])

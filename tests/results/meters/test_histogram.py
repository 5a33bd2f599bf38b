from __future__ import annotations

import json
from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bussim.results.meters.histogram import BIN_TICKS, QUANTILES, SAMPLES_BEYOND, Histogram

TIMES = st.integers(0, 40_000_000)


def histogram_of(times: list[int]) -> Histogram:
    histogram = Histogram()
    for time in times:
        histogram.add(time)
    return histogram


def assert_equal(one: Histogram, other: Histogram) -> None:
    assert one.to_json() == other.to_json()


@given(st.lists(TIMES, max_size=300))
def test_counts_sum_and_extremes_are_exact(times: list[int]) -> None:
    histogram = histogram_of(times)
    assert histogram.count == len(times)
    assert histogram.total == sum(times)
    assert histogram.minimum == min(times, default=None)
    assert histogram.maximum == max(times, default=None)
    assert histogram.bins == Counter((2 * time + BIN_TICKS) // (2 * BIN_TICKS) for time in times)


@given(st.lists(TIMES, min_size=1, max_size=300), st.sampled_from([1, 250, 500, 950, 990, 999]))
def test_quantiles_are_numpys_within_half_a_bin(times: list[int], thousandths: int) -> None:
    # Exact in whole numbers: numpy's own rank is a product of floats, which may miss by one.
    rank = -(-thousandths * len(times) // 1000)
    value = histogram_of(times).quantile(thousandths)
    if len(times) - rank < SAMPLES_BEYOND:
        assert value is None
    else:
        expected = int(np.sort(np.array(times))[rank - 1])
        assert value is not None
        assert abs(value - expected) <= BIN_TICKS // 2
        assert min(times) <= value <= max(times)


@pytest.mark.parametrize("thousandths", QUANTILES.values())
def test_quantiles_of_many_samples_are_numpys_own(thousandths: int) -> None:
    # 20,011 samples: no product with a quantile is a whole number.
    times = np.random.default_rng(4).normal(3_600_000, 20_000, 20_011).astype(int).tolist()
    expected = np.quantile(np.array(times), thousandths / 1000, method="inverted_cdf")
    value = histogram_of(times).quantile(thousandths)
    assert value is not None
    assert abs(value - float(expected)) <= BIN_TICKS / 2


@pytest.mark.parametrize(("thousandths", "enough"), [(500, 20), (950, 200), (990, 1000), (999, 10_000)])
def test_a_quantile_needs_ten_samples_beyond_it(thousandths: int, enough: int) -> None:
    histogram = histogram_of([720 * n for n in range(enough - 1)])
    assert histogram.quantile(thousandths) is None
    histogram.add(720 * enough)
    assert histogram.quantile(thousandths) is not None


def test_an_empty_histogram_has_no_statistics() -> None:
    empty = Histogram()
    assert (empty.mean, empty.minimum, empty.maximum, empty.quantile(500)) == (None, None, None, None)


@pytest.mark.parametrize("thousandths", [0, 1000, -1])
def test_only_quantiles_inside_exist(thousandths: int) -> None:
    with pytest.raises(ValueError, match=r"must be in \[1\.\.\.999\]"):
        Histogram().quantile(thousandths)


@given(st.lists(TIMES, max_size=50), st.lists(TIMES, max_size=50))
def test_merging_is_adding_all(first: list[int], second: list[int]) -> None:
    merged = histogram_of(first)
    merged.merge(histogram_of(second))
    assert_equal(merged, histogram_of(first + second))
    at_once = histogram_of(first)
    at_once.add_all(second)
    assert_equal(at_once, merged)


@given(st.lists(TIMES, max_size=50))
def test_json_and_back(times: list[int]) -> None:
    histogram = histogram_of(times)
    assert_equal(Histogram.from_json(json.loads(json.dumps(histogram.to_json()))), histogram)


def test_json_with_a_wrong_count_is_refused() -> None:
    data = histogram_of([1, 2, 3]).to_json()
    data["count"] = 4
    with pytest.raises(ValueError, match="count"):
        Histogram.from_json(data)


def test_memory_depends_on_how_many_times_differ() -> None:
    histogram = Histogram()
    for number in range(100_000):
        histogram.add(3_600_000 + number % 7_200)
    assert len(histogram.bins) == 11

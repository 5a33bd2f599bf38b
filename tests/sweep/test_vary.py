from __future__ import annotations

from decimal import Decimal
from fractions import Fraction
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bussim.errors import UsageError
from bussim.sweep.vary import MAX_RUNS, Axis, grid, parse_axes
from bussim.units import parse_time


def texts(vary: str) -> list[str]:
    return [value.text for value in Axis.parse(vary).values]


@pytest.mark.parametrize(
    ("vary", "expected"),
    [
        ("k=0:5:1", ["0", "1", "2", "3", "4", "5"]),
        ("k=0:5:2", ["0", "2", "4"]),
        ("k=5:0:-2", ["5", "3", "1"]),
        ("k=7:7:1", ["7"]),
        ("k=0.1:0.4:0.1", ["0.1", "0.2", "0.3", "0.4"]),
        ("k=1e-3:3e-3:1e-3", ["0.001", "0.002", "0.003"]),
        ("k=0,1,2,5", ["0", "1", "2", "5"]),
        ("k=pw10, generic", ["pw10", "generic"]),
        ("k={base: pw10, attempts: retries},pw10", ["{base: pw10, attempts: retries}", "pw10"]),
        ("k='a,b',\"c:d\"", ["'a,b'", '"c:d"']),
        ("k=[0, 1],[2]", ["[0, 1]", "[2]"]),
        ("k=1e-6:1e-3:log4", ["1e-6", "1e-5", "1e-4", "0.001"]),
        ("k=1:10:log3", ["1", "3.16228", "10"]),
        ("k=1e-3:1e-6:log4", ["0.001", "1e-4", "1e-5", "1e-6"]),
        ("k=50ms:80ms:10ms", ["50 ms", "60 ms", "70 ms", "80 ms"]),
        ("k=500us:2ms:0.5ms", ["500 us", "1000 us", "1500 us", "2000 us"]),
        ("k=58s:1min:1s", ["58 s", "59 s", "60 s"]),
        ("k=1 ms:1 s:log4", ["1 ms", "10 ms", "100 ms", "1000 ms"]),
        ("k=1µs:3μs:1us", ["1 us", "2 us", "3 us"]),
    ],
)
def test_values(vary: str, expected: list[str]) -> None:
    assert texts(vary) == expected


@given(st.integers(-1000, 1000), st.integers(0, 300), st.integers(1, 50), st.sampled_from([1, 10, 1000]))
def test_a_range_has_every_step_up_to_its_end_exactly(first: int, width: int, step: int, unit: int) -> None:
    low, high, by = Fraction(first, unit), Fraction(first + width, unit), Fraction(step, unit)
    spelled = ":".join(str(Decimal(each.numerator) / each.denominator) for each in (low, high, by))
    found = [Fraction(text) for text in texts(f"k={spelled}")]
    assert found[0] == low
    assert all(after - before == by for before, after in pairwise(found))
    assert found[-1] <= high < found[-1] + by


@given(st.integers(1, 999), st.integers(-9, 9), st.integers(1, 9999), st.integers(2, 40))
def test_a_logarithmic_range_has_equal_ratios(first: int, power: int, factor: int, count: int) -> None:
    low = Decimal(first).scaleb(power)
    high = low * (1 + factor)
    found = [float(text) for text in texts(f"k={low}:{high}:log{count}")]
    assert len(found) == count
    assert (found[0], found[-1]) == (float(low), float(high))
    ratio = (1 + factor) ** (1 / (count - 1))
    for before, after in pairwise(found):
        assert after / before == pytest.approx(ratio, rel=1.1e-5)  # two values rounded to 6 digits


def test_numbers_of_an_axis_are_in_one_unit() -> None:
    axis = Axis.parse("plcs.press.nn.timeout=50 ms,0.2s,1000us")
    assert [value.text for value in axis.values] == ["50 ms", "0.2s", "1000us"]
    assert axis.unit == "us"
    assert [value.number for value in axis.values] == [50_000, 200_000, 1000]
    assert axis.column == "plcs.press.nn.timeout_us"
    assert Axis.parse("k=1,2.5").unit == ""
    assert Axis.parse("k=1,2.5").column == "k"
    for mixed in ("k=1,pw10", "k=1,2ms", "k=true,false"):
        assert Axis.parse(mixed).unit is None
        assert [value.number for value in Axis.parse(mixed).values] == [None, None]


def test_the_same_value_is_the_same_however_it_is_written() -> None:
    same = {
        "50ms": "50 ms",
        "0.05 s": "50 ms",
        "5": "5.0",
        "0x10": "16",
        "1e-5": "0.00001",
        "'pw10'": "pw10",
    }
    for one, other in same.items():
        first, second = Axis.parse(f"k={one}").values[0], Axis.parse(f"k={other}").values[0]
        assert first.same == second.same
    assert Axis.parse("k=50ms:60ms:10ms").values[0].same == Axis.parse("k=50 ms").values[0].same
    assert Axis.parse("k=5:6:1").values[0].same == Axis.parse("k=5").values[0].same
    assert Axis.parse("k=0.1:0.3:0.1").values[2].same == Axis.parse("k=0.3").values[0].same
    assert len({Axis.parse(f"k={v}").values[0].same for v in ("5", "5 ms", "'5'", "true", "5.5")}) == 5
    assert parse_time(Axis.parse("k=1us:2us:1us").values[1].text) == parse_time("2 us")


@pytest.mark.parametrize(
    ("vary", "message"),
    [
        ("retries", "--vary retries: expected key.path=a:b:step"),
        ("=1,2", "expected key.path=a:b:step"),
        ("k=", "a value is missing"),
        ("k=1,,2", "a value is missing"),
        ("k=1,2,1", "1 is there twice"),
        ("k=5,5.0", "5.0 is the same as 5"),
        ("k=50ms,0.05 s", "0.05 s is the same as 50ms"),
        ("k=0:5:0", "the step is 0"),
        ("k=5:0:1", "steps of 1 from 5 never reach 0"),
        ("k=0:5:x", "x is not a number or a time"),
        ("k=0::1", "nothing is not a number or a time"),
        ("k=0:5ms:1ms", "0 has no unit, other values have"),
        ("k=0ms:5ms:1 fortnight", "has the unit 'fortnight'; allowed are ns, us, ms, s, min, h, d, y"),
        ("k=0:1:log3", "begins and ends above 0"),
        ("k=1:2:log1", "N of logN is at least 2"),
        ("k=0:1e9:1", "1,000,000,001 values, allowed 100,000"),
        ("k=1:2:log999999999", "999,999,999 values, allowed 100,000"),
        ("k=0:9e99:1e-99", "values, allowed 100,000"),
        ("k=" + "," * 200_000, "values, allowed 100,000"),
        ("k=[1", "a [ is never closed"),
    ],
)
def test_mistakes(vary: str, message: str) -> None:
    with pytest.raises(UsageError) as caught:
        Axis.parse(vary)
    assert message in str(caught.value)
    assert str(caught.value).startswith("--vary ")
    assert len(str(caught.value)) < 300


def test_all_mistakes_at_once() -> None:
    with pytest.raises(UsageError) as caught:
        parse_axes(["a=1:0:1", "b", "c=1,2", "c=3", "d=4"], taken=["d"])
    lines = str(caught.value).split("\n")
    assert [line.split(":")[0] for line in lines] == ["--vary a=1", "--vary b", "--vary c=3", "--vary d=4"]
    assert lines[2].endswith("c is varied twice")
    assert lines[3].endswith("d is varied and set")
    with pytest.raises(UsageError, match="needs a key to vary"):
        parse_axes([])


def test_a_grid_is_the_product_with_the_last_axis_fastest() -> None:
    axes = parse_axes(["a=1,2", "b=x,y,z"])
    assert [tuple(value.text for value in point) for point in grid(axes, 1)] == [
        ("1", "x"), ("1", "y"), ("1", "z"), ("2", "x"), ("2", "y"), ("2", "z"),
    ]  # fmt: skip


def test_a_grid_is_bounded_before_it_is_made() -> None:
    axes = parse_axes([f"{key}=1:1000:1" for key in "abcdef"])
    with pytest.raises(UsageError) as caught:
        grid(axes, 5)
    assert "1,000 × 1,000" in str(caught.value)
    assert "with 5 repeats each are more than 10^12 runs, allowed 100,000" in str(caught.value)
    assert len(grid(parse_axes(["a=1:1000:1", "b=1:100:1"]), 1)) == MAX_RUNS
    with pytest.raises(UsageError, match=r"--repeat is 0, allowed 1\.\.100000"):
        grid(axes[:1], 0)

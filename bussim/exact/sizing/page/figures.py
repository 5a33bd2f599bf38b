"""How a sizing page keeps its figures: rounded to the safe side, and where they differ only."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from bussim.exact.sizing.noise_levels import BAD, LEVELS
from bussim.exact.text import a_year
from bussim.units import TICKS_PER_MS

#: Multiples of the noise as entered, and bit error rates where none is: the assumed levels and ten and a
#: hundred times the worst of them.
FACTORS = (0.1, 1.0, 10.0, 100.0)
RATES = (*LEVELS.values(), 10 * LEVELS[BAD], 100 * LEVELS[BAD])
#: Errors a year and probabilities below this are shown as none.
LEAST = 1e-9

Figures = np.ndarray[Any, np.dtype[np.float64]]


def noise_value(name: str, value: float) -> float:
    """A multiple of the noise as such, a rate as one wrong bit in so many."""
    return value if name == "times" else round(1 / value)


def plain_ms(ticks: float) -> float | int:
    """A time that a user sets, in ms."""
    found = ticks / TICKS_PER_MS
    return int(found) if found == int(found) else round(found, 3)


def tenths(ticks: float) -> float:
    """A time in tenths of a ms, rounded up."""
    return math.ceil(round(10 * ticks / TICKS_PER_MS, 6)) / 10


def times(ticks: Figures) -> list[Any]:
    """Times in ms, rounded up to tenths."""
    return packed(np.ceil(np.round(10 * ticks / TICKS_PER_MS, 6)) / 10)


def rates(a_year_each: Figures, goal: float) -> list[Any]:
    """Errors a year as ``size`` prints them, those of less than one in 1e9 years as none."""
    return packed(
        changed(
            a_year_each, lambda value: float(a_year(value, goal).replace(",", "")) if value >= LEAST else 0.0
        )
    )


def changed(values: Figures, change: Callable[[float], float]) -> Figures:
    """Each figure as it is shown; those that are not known stay NaN."""
    flat = [value if math.isnan(value) else change(value) for value in values.ravel().tolist()]
    return np.array(flat).reshape(values.shape)


def packed(values: np.ndarray[Any, Any]) -> list[Any]:
    """As nested lists; of an axis along which nothing changes only the first."""
    for axis in range(values.ndim):
        first = values.take([0], axis)
        if np.array_equal(np.broadcast_to(first, values.shape), values, equal_nan=values.dtype.kind == "f"):
            values = first
    return [_plain(each) for each in values.tolist()]


def _plain(value: Any) -> Any:
    if isinstance(value, list):
        return [_plain(each) for each in value]
    if isinstance(value, float):
        return None if math.isnan(value) else int(value) if value == int(value) and value < 1e15 else value
    return value

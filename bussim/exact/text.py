"""Figures in words that a technician follows, rounded so that they claim no more than they know."""

import math
from decimal import ROUND_FLOOR, Decimal

from bussim.units import TICKS_PER_MS
from bussim.wording import about
from bussim.words.language import say

#: No noise stays the same for longer.
LONGEST_YEARS = 100

#: A probability above this is called almost certain.
ALMOST_CERTAIN = 0.99


def ms(ticks: float) -> str:
    """A time as a key or a cell: milliseconds without trailing zeros."""
    return f"{ticks / TICKS_PER_MS:.12g}"


def ms_cell(ticks: float | None) -> str:
    """A time in ms for a table, to the microsecond; a dash where there is none."""
    return "–" if ticks is None else f"{ticks / TICKS_PER_MS:,.3f}"


def in_ms(ticks: float | None) -> float | None:
    """A time in ms as JSON has it, to the nanosecond; None where there is none."""
    return None if ticks is None else round(ticks / TICKS_PER_MS, 6)


def at_most(value: float, digits: int = 2) -> float:
    """A figure rounded up to so many significant digits: what it stands for is not more."""
    return -at_least(-value, digits)


def at_least(value: float, digits: int = 2) -> float:
    """A figure rounded down to so many significant digits."""
    if value == 0 or not math.isfinite(value):
        return value
    written = Decimal(repr(float(value)))  # as 0.3 times 10 is not quite 3
    return float(written.quantize(Decimal(1).scaleb(written.adjusted() - digits + 1), ROUND_FLOOR))


def a_year(per_year: float, goal: float = math.inf) -> str:
    """False station errors a year to one digit, rounded up: noise is never known to a factor.

    Where that would exceed the goal although the figure does not, it has more digits.
    """
    digits = 1
    while at_most(per_year, digits) > goal >= per_year:
        digits += 1
    shown = at_most(per_year, digits)
    return f"{shown:.{digits - 1}e}" if 0 < shown < 1e-3 or shown >= 1e9 else f"{shown:,.12g}"


def ms_at_most(ticks: float) -> str:
    """A time in whole ms, rounded up; a whole number of ms stays one."""
    return f"{math.ceil(ticks / TICKS_PER_MS):,} ms"


def ms_at_least(ticks: float) -> str:
    """A time in whole ms, rounded down."""
    return f"{math.floor(ticks / TICKS_PER_MS):,} ms"


def one_in(probability: float) -> str:
    """The N of "1 in N", rounded down to two digits: it happens at least as seldom as is said."""
    count = at_least(float(f"{1 / max(probability, 1e-300):.12g}"))
    return f"{count:,.0f}" if 10 <= count < 1e15 else about(count)


def scans_over(probability: float, ticks: float) -> str:
    """How often a scan takes longer than a deadline, at most."""
    if probability <= 0:
        return say("exact_never_over", time=ms(ticks))
    if probability >= 0.5:
        percent = math.ceil(float(f"{100 * probability:.12g}"))
        return say("exact_percent_over", percent=percent, time=ms(ticks))
    return say("exact_one_over", number=one_in(probability), time=ms(ticks))


def years_between(per_year: float, *, noisy: bool = True) -> str:
    """How often a false station error begins, at most; ``noisy``: whether there is noise at all."""
    if per_year <= 0:
        return say("exact_no_error_noise" if noisy else "exact_no_error_quiet")
    years = 1 / per_year
    if years > LONGEST_YEARS:
        return say("exact_years_over", years=LONGEST_YEARS)
    if years >= 2:
        return say("exact_years", years=one_in(per_year))
    if per_year < 400:
        return say("exact_a_year", number=about(at_most(per_year)))
    return say("exact_a_day", number=about(at_most(per_year / 365)))

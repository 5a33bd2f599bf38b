"""Figures in words that a technician follows, rounded so that they claim no more than they know."""

from __future__ import annotations

from bussim.units import TICKS_PER_MS
from bussim.wording import about

#: Nobody's noise stays the same for longer.
LONGEST_YEARS = 100


def ms(ticks: float) -> str:
    """A time as a key or a cell: milliseconds without trailing zeros."""
    return f"{ticks / TICKS_PER_MS:.12g}"


def ms_cell(ticks: float | None) -> str:
    """A time in ms for a table, to the microsecond; a dash where there is none."""
    return "–" if ticks is None else f"{ticks / TICKS_PER_MS:,.3f}"


def in_ms(ticks: float | None) -> float | None:
    """A time in ms as JSON has it, to the nanosecond; None where there is none."""
    return None if ticks is None else round(ticks / TICKS_PER_MS, 6)


def scans_over(probability: float, ticks: float) -> str:
    """How often a scan takes longer than a deadline."""
    if probability <= 0:
        return f"no scan takes over {ms(ticks)} ms"
    if probability >= 0.5:
        return f"{100 * probability:.0f} % of all scans take over {ms(ticks)} ms"
    return f"1 scan in {about(1 / probability)} takes over {ms(ticks)} ms"


def years_between(per_year: float) -> str:
    """How often a living station is reported as failed."""
    if per_year <= 0:
        return "no false station error at all with the noise as entered"
    years = 1 / per_year
    if years > LONGEST_YEARS:
        return f"one false station error in over {LONGEST_YEARS} years if the noise stays as entered"
    if years >= 2:
        return f"about one false station error in {about(years)} years if the noise stays as entered"
    if per_year < 400:
        return f"about {about(per_year)} false station errors a year if the noise stays as entered"
    return f"about {about(per_year / 365)} false station errors a day if the noise stays as entered"

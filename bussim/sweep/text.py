"""The means of a sweep as text: with intervals where the repeats are enough, else what was seen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import ceil, floor, log10

from bussim.sweep.intervals import CONFIDENCE, WITHIN, Mean

#: What a text ends with where the repeats are too few, and where an event was in no run.
TOO_FEW, NEVER = "*", "°"


def with_interval(mean: Mean, values: Sequence[float | None]) -> str:
    """A mean as ``50.424 ± 0.056``, the interval rounded up.

    ``values`` are the runs. Where they are too few it is the least and the greatest of them, with
    :data:`TOO_FEW` behind; of events that were in no run ``0`` with :data:`NEVER`.
    """
    if mean.mean is None:
        return "–"
    if mean.too_few(len(values)):
        known = [value for value in values if value is not None]
        return "–".join(dict.fromkeys(_plain(value) for value in (min(known), max(known)))) + TOO_FEW
    if mean.low is None or mean.high is None:
        return _plain(mean.mean) + (NEVER if not mean.mean and len(values) > 1 else "")
    half = max(mean.high - mean.mean, mean.mean - mean.low)
    if not half:
        return f"{_plain(mean.mean)} ± 0"
    decimals = min(max(0, 1 - floor(log10(half))), 6)
    return f"{mean.mean:,.{decimals}f} ± {ceil(round(half * 10**decimals, 6)) / 10**decimals:,.{decimals}f}"


def _plain(value: float) -> str:
    """A number by itself: whole, with two decimals, or below 1 with three digits."""
    if value == int(value):
        return f"{value:,.0f}"
    return f"{value:,.2f}" if abs(value) >= 1 else f"{value:.3g}"


def footnotes(texts: str, repeats: int, needed: Mapping[str, int] | None = None) -> list[str]:
    """What the marks in texts mean; ``needed`` is how many repeats are enough, by figure.

    Of n runs (1 − p)^n is the chance that an event which a run has with the chance p is in none.
    """
    found = []
    if TOO_FEW in texts:
        more = ", ".join(f"{number:,} ({title})" for title, number in (needed or {}).items())
        text = f"{repeats} repeats are too few for a mean within ±{100 * WITHIN:g} %"
        found.append(f"{TOO_FEW} least and greatest run: {text}{more and f'; it takes at least {more}'}")
    if NEVER in texts:
        most = ceil(100 * (1 - (1 - CONFIDENCE) ** (1 / repeats)))
        found.append(f"{NEVER} in none of {repeats} runs; with 95 % confidence in at most {most} % of all")
    return found

"""Times that options take."""

from __future__ import annotations

from bussim.errors import UsageError
from bussim.units import parse_time


def time_of(option: str, text: str, *, positive: bool = False) -> int:
    """The ticks of an option's time, not below 0, or above it. Raises UsageError."""
    try:
        ticks = parse_time(text)
    except ValueError as error:
        raise UsageError(f"{option} {error}") from None
    if ticks < 0 or (positive and ticks == 0):
        raise UsageError(f"{option} is {text!r}, it must {'be above' if positive else 'not be below'} 0")
    return ticks

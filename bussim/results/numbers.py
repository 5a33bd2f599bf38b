"""Numbers as ``summary.json`` has them: times in ms, instants in s, both to the nanosecond."""

from collections.abc import Mapping, Sequence
from itertools import accumulate, pairwise

from bussim.units import milliseconds, seconds

#: Decimals of a number: ns for times in ms.
DECIMALS = 6


def ms(ticks: float | None) -> float | None:
    """Ticks as ms."""
    return None if ticks is None else round(milliseconds(ticks), DECIMALS)


def s(ticks: int | None) -> float | None:
    """Ticks as s."""
    return None if ticks is None else round(seconds(ticks), DECIMALS)


def whole(value: float) -> float:
    """A whole number without a decimal point, as D8180 is entered."""
    return int(value) if value == int(value) else round(value, DECIMALS)


def share(part: int, of: int) -> float:
    """A part of a whole, 0…1; 0 of nothing."""
    return round(part / of, DECIMALS) if of else 0.0


def adding_up(parts: Sequence[float], whole: float) -> list[str]:
    """Parts of a time in ms as text, each rounded so that the texts add up to that of ``whole``."""
    ends = [0.0, *(round(end, 3) for end in accumulate(parts[:-1])), round(whole, 3)]
    return [f"{end - start:.3f}" for start, end in pairwise(ends)]


def by_code(counts: Mapping[int, int]) -> dict[str, int]:
    """Counts by a code of two hexadecimal digits, the zeros left out."""
    return {f"{code:02X}": number for code, number in sorted(counts.items()) if number}

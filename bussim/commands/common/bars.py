"""A histogram in a terminal."""

from math import floor, log10

from bussim.results.meters.histogram import BIN_TICKS, Histogram
from bussim.units import TICKS_PER_MS, TICKS_PER_US

_MOST_ROWS = 16
_WIDTH = 50


def bars(times: Histogram) -> list[str]:
    """Rows of equal width in ms with a bar each, at most about sixteen; empty without samples."""
    if times.minimum is None or times.maximum is None or times.count < 2:
        return []
    step = _step((times.maximum - times.minimum) / _MOST_ROWS)
    counts: dict[int, int] = {}
    for position, count in times.bins.items():
        row = position * BIN_TICKS // step
        counts[row] = counts.get(row, 0) + count
    most = max(counts.values())
    decimals = max(0, -floor(log10(step / TICKS_PER_MS)))
    lines = []
    for row in range(min(counts), max(counts) + 1):
        count = counts.get(row, 0)
        bar = "█" * round(_WIDTH * count / most) or ("▏" if count else "")
        lines.append(f"{row * step / TICKS_PER_MS:10.{decimals}f} ms  {count:8,}  {bar}".rstrip())
    return lines


def _step(least: float) -> int:
    """The least of 10, 20, 50, 100 … µs that is not below ``least`` ticks."""
    micros = 10
    while micros * TICKS_PER_US < least:
        for factor in (2, 5, 10):
            if micros * factor * TICKS_PER_US >= least:
                return micros * factor * TICKS_PER_US
        micros *= 10
    return micros * TICKS_PER_US

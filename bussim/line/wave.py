"""The level of a line over time, kept as the intervals in which it is low.

Times are ticks; an interval is low from its first tick up to, not including, its second. What a line has
where several drivers are on stands in :mod:`bussim.line.contention`.
"""

from bisect import bisect_right
from collections.abc import Iterable, Sequence
from functools import cache
from itertools import groupby

from bussim.line.characters import CharFormat, LineTiming

Interval = tuple[int, int]
#: A pause inside a frame: the number of the character that it comes after (from 0), and its ticks.
Pause = tuple[int, int]


def paused(pauses: Iterable[Pause], index: int) -> int:
    """Ticks of the pauses before the character at an index."""
    return sum(ticks for after, ticks in pauses if after < index)


def edge_of(index: int, timing: LineTiming, start: int, pauses: Iterable[Pause] = ()) -> int:
    """The first edge of the character at an index of a frame that begins at ``start``."""
    return start + timing.characters(index) + paused(pauses, index)


def paused_by(tick: int, timing: LineTiming, start: int, pauses: Iterable[Pause]) -> int:
    """Ticks of the pauses of a frame that are over at a tick."""
    return sum(ticks for after, ticks in pauses if edge_of(after + 1, timing, start, pauses) <= tick)


@cache
def _low_runs(fmt: CharFormat) -> tuple[tuple[Interval, ...], ...]:
    """For every character value the runs of low bits, as (first bit, bit after the last)."""
    return tuple(_runs(fmt.encode(value)) for value in range(1 << fmt.data_bits))


def _runs(bits: Sequence[int]) -> tuple[Interval, ...]:
    runs: list[Interval] = []
    end = 0
    for bit, same in groupby(bits):
        begin, end = end, end + len(list(same))
        if bit == 0:
            runs.append((begin, end))
    return tuple(runs)


def encode_bits(chars: bytes, fmt: CharFormat) -> list[int]:
    """The bits of back-to-back characters on the wire, from the first start bit."""
    return [bit for value in chars for bit in fmt.encode(value)]


def low_intervals(
    chars: bytes, timing: LineTiming, start: int, inverted: Iterable[int] = (), pauses: Sequence[Pause] = ()
) -> list[Interval]:
    """Where a transmitter pulls the line low that sends these characters from ``start`` on.

    ``inverted`` are the numbers of bits (from 0, the first start bit) that noise inverted;
    numbers beyond the frame are ignored.
    """
    fmt = timing.format
    width, flips = fmt.bits, set(inverted)
    if flips:
        bits = encode_bits(chars, fmt)
        for number in flips:
            if number < len(bits):
                bits[number] ^= 1
        each = [_runs(bits[first : first + width]) for first in range(0, len(bits), width)]
    else:
        table, mask = _low_runs(fmt), (1 << fmt.data_bits) - 1
        each = [table[value & mask] for value in chars]
    runs = [
        (index * width + first, index * width + last)
        for index, runs in enumerate(each)
        for first, last in runs
    ]
    if pauses:
        starts = [start + paused(pauses, index) for index in range(len(chars))]
        return [
            (starts[first // width] + timing.bits(first), starts[first // width] + timing.bits(last))
            for first, last in runs
        ]
    bit = timing.bit
    if bit.denominator == 1:
        ticks = bit.numerator
        return [(start + first * ticks, start + last * ticks) for first, last in runs]
    return [(start + timing.bits(first), start + timing.bits(last)) for first, last in runs]


def clip(intervals: Iterable[Interval], since: int, until: int | None) -> list[Interval]:
    """The parts of intervals that lie between two ticks (``until`` None: no end)."""
    clipped = []
    for low, high in intervals:
        first = max(low, since)
        last = high if until is None else min(high, until)
        if first < last:
            clipped.append((first, last))
    return clipped


class Wave:
    """The level at one receiver's input: high, except on the union of some intervals."""

    __slots__ = ("_ends", "_starts")

    def __init__(self, parts: Iterable[Iterable[Interval]]) -> None:
        lows = sorted(interval for part in parts for interval in part)
        self._starts: list[int] = []
        self._ends: list[int] = []
        for low, high in lows:
            if self._ends and low <= self._ends[-1]:
                self._ends[-1] = max(self._ends[-1], high)
            else:
                self._starts.append(low)
                self._ends.append(high)

    def level(self, tick: int) -> int:
        """0 or 1 at a tick."""
        index = bisect_right(self._starts, tick) - 1
        return 0 if index >= 0 and tick < self._ends[index] else 1

    def next_fall(self, tick: int) -> int | None:
        """The first falling edge at or after a tick."""
        index = bisect_right(self._starts, tick - 1)
        return self._starts[index] if index < len(self._starts) else None

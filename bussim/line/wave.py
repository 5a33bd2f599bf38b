"""The level of a line over time, kept as the intervals in which it is low.

Times are ticks; an interval is low from its first tick up to, not including, its second. What a line has
where several drivers are on stands in :mod:`bussim.line.contention`.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Sequence
from functools import cache
from itertools import groupby
from typing import NamedTuple

from bussim.line.characters import CharFormat, LineTiming

Interval = tuple[int, int]
#: A pause inside a frame: the number of the character that it comes after (from 0), and its ticks.
Pause = tuple[int, int]


class Piece(NamedTuple):
    """Characters of a frame back to back: from ``first`` to before ``behind``, from tick to tick."""

    first: int
    behind: int
    start: int
    end: int


def pieces_of(count: int, timing: LineTiming, start: int, pauses: Iterable[Pause] = ()) -> list[Piece]:
    """The pieces into which pauses cut a frame of ``count`` characters; one after its last does not.

    The characters after a pause are timed from its end.
    """
    found: list[Piece] = []
    first = 0
    for index, ticks in (*sorted(pauses), (count - 1, 0)):
        if first <= index < count:
            end = start + timing.characters(index + 1 - first)
            found.append(Piece(first, index + 1, start, end))
            first, start = index + 1, end + ticks
    return found or [Piece(0, 0, start, start)]


def character_at(pieces: Sequence[Piece], timing: LineTiming, tick: int) -> int:
    """The number of the character that is on the line at a tick, in a pause as if it went on before it."""
    piece = next((piece for piece in reversed(pieces) if piece.start <= tick), pieces[0])
    return piece.first + (tick - piece.start) // timing.character


@cache
def _low_runs(fmt: CharFormat) -> tuple[tuple[Interval, ...], ...]:
    """For every character value the runs of low bits, as (first bit, bit after the last)."""
    return tuple(tuple(_runs(fmt.encode(value))) for value in range(1 << fmt.data_bits))


def _runs(bits: Sequence[int]) -> list[Interval]:
    runs: list[Interval] = []
    end = 0
    for bit, same in groupby(bits):
        begin, end = end, end + len(list(same))
        if bit == 0:
            runs.append((begin, end))
    return runs


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
    if pauses:
        found: list[Interval] = []
        for first, behind, at, _ in pieces_of(len(chars), timing, start, pauses):
            before, after = first * fmt.bits, behind * fmt.bits
            own = [number - before for number in inverted if before <= number < after]
            found += low_intervals(chars[first:behind], timing, at, own)
        return found
    flips = set(inverted)
    if flips:
        bits = encode_bits(chars, fmt)
        for number in flips:
            if number < len(bits):
                bits[number] ^= 1
        runs = _runs(bits)
    else:
        table, width, mask = _low_runs(fmt), fmt.bits, (1 << fmt.data_bits) - 1
        runs = [
            (index * width + first, index * width + last)
            for index, value in enumerate(chars)
            for first, last in table[value & mask]
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

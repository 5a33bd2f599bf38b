"""The level of a line on which several drivers may be on at once."""

from collections.abc import Callable, Iterator, Sequence
from enum import StrEnum
from hashlib import blake2b
from itertools import chain, pairwise
from typing import NamedTuple, assert_never

from bussim.line.characters import LineTiming
from bussim.line.wave import Interval, Pause, Wave, edge_of, paused_by


class Contention(StrEnum):
    """What a line has where drivers that are on disagree (assumed).

    RS485 leaves it open: two equal drivers hold the pair near 0 V, where a receiver's output is undefined
    (TIA/EIA-485-A: its thresholds are ±200 mV).
    """

    UNDEFINED = "undefined"  # either level, at random, anew in each bit of the frame that began later
    ZERO_WINS = "zero_wins"


#: The level, 0 or 1, of a disputed bit that begins at a tick. None: a 0 wins.
Disputed = Callable[[int], int] | None


def disputed_level(contention: Contention, seed: int, bus: str) -> Disputed:
    """How disputed bits of a bus are decided in a run of this seed: by a hash, the same at each query."""
    match contention:
        case Contention.ZERO_WINS:
            return None
        case Contention.UNDEFINED:
            name = f"contention\x1f{seed}\x1f{bus}\x1f"
            return lambda tick: blake2b(f"{name}{tick}".encode(), digest_size=1).digest()[0] & 1
        case _:
            assert_never(contention)


class Driver(NamedTuple):
    """A driver for one frame: on from ``since`` to before ``until``, high but for ``lows`` between the two.

    ``begun`` are the frame's first edge and its sender.
    """

    begun: tuple[int, str]
    since: int
    until: int
    lows: Sequence[Interval]
    timing: LineTiming
    pauses: Sequence[Pause] = ()

    def bit_at(self, tick: int) -> Interval:
        """The bit of its frame that a tick lies in; in a pause and after the frame bits go on as before."""
        start = self.begun[0]
        start += paused_by(tick, self.timing, start, self.pauses)
        # In whole numbers, because each bit of a collision asks: the last edge, rounded half up, that is not
        # behind the tick.
        ticks, parts = self.timing.bit.as_integer_ratio()
        number = -((-2 * (tick - start) - 1) * parts // (2 * ticks)) - 1
        edge, following = (start + (2 * n * ticks + parts) // (2 * parts) for n in (number, number + 1))
        return edge, following


def line_lows(drivers: Sequence[Driver], disputed: Disputed) -> list[Interval]:
    """Where a line is low, in any order.

    What drivers disagree on is cut at the bits of the frame that began last: each has one level.
    """
    if disputed is None or len(drivers) < 2:
        return [low for driver in drivers for low in driver.lows]
    waiting = sorted(drivers, key=lambda driver: driver.since, reverse=True)
    on: list[tuple[Driver, Wave]] = []
    marks = {tick for driver in drivers for tick in (driver.since, driver.until, *chain(*driver.lows))}
    marks |= {
        edge_of(after + 1, driver.timing, driver.begun[0], driver.pauses)
        for driver in drivers
        for after, _ in driver.pauses
    }
    found: list[Interval] = []
    for tick, until in pairwise(sorted(marks)):
        while waiting and waiting[-1].since <= tick:
            driver = waiting.pop()
            on.append((driver, Wave([driver.lows])))
        on = [each for each in on if each[0].until > tick]
        levels = {wave.level(tick) for _, wave in on}
        if levels == {0}:
            found.append((tick, until))
        elif len(levels) == 2:
            later = max((driver for driver, _ in on), key=lambda driver: driver.begun)
            found += _disputed(later, tick, until, disputed)
    return found


def _disputed(later: Driver, tick: int, until: int, level: Callable[[int], int]) -> Iterator[Interval]:
    while tick < until:
        edge, following = later.bit_at(tick)
        following = min(following, until)
        if level(edge) == 0:
            yield tick, following
        tick = following

"""Stimuli of a PLC's inputs: levels over simulated time. Times in ticks from the start of the run.

An input changes when its stimulus says so, and the PLC samples it at the beginning of each scan.
``changes(since, until)`` are the ticks after ``since`` up to ``until`` at which the level changes, in
order, with the new level.
"""

from abc import ABC, abstractmethod
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass

#: A change: when, and to what level.
Change = tuple[int, int]
#: A tick that no run reaches.
NEVER = 1 << 62


class Stimulus(ABC):
    """A level over time, off before its first change."""

    __slots__ = ()

    @abstractmethod
    def level(self, tick: int) -> int:
        """0 or 1 at a tick; a change at the tick has happened."""

    @abstractmethod
    def next_change(self, tick: int) -> int:
        """When it changes first after a tick, :data:`NEVER` if not; not before an earlier ``until``."""

    def changes(self, since: int, until: int) -> list[Change]:
        """The changes after ``since`` up to ``until``. Never called for a time before an earlier call's."""
        found: list[Change] = []
        tick = self.next_change(since)
        while tick <= until:
            found.append((tick, self.level(tick)))
            tick = self.next_change(tick)
        return found


@dataclass(frozen=True, slots=True)
class Pulse(Stimulus):
    """On for ``width`` ticks at ``at``, and again every ``every`` ticks (None: once), ``times`` times."""

    width: int
    at: int = 0
    every: int | None = None
    times: int | None = None

    def _number(self, tick: int) -> int:
        """Which pulse has begun last by a tick; -1 before the first."""
        if tick < self.at:
            return -1
        if self.every is None:
            return 0
        number = (tick - self.at) // self.every
        return number if self.times is None else min(number, self.times - 1)

    def level(self, tick: int) -> int:
        """See the base class."""
        number = self._number(tick)
        return int(number >= 0 and tick < self.at + number * (self.every or 0) + self.width)

    def next_change(self, tick: int) -> int:
        """See the base class."""
        number = self._number(tick)
        off = self.at + number * (self.every or 0) + self.width
        if number >= 0 and tick < off:
            return off
        if number < 0:
            return self.at
        if self.every is None or (self.times is not None and number + 1 >= self.times):
            return NEVER
        return self.at + (number + 1) * self.every


@dataclass(frozen=True, slots=True)
class Square(Stimulus):
    """Off, then on, each for half of ``period`` ticks, from ``at`` on (off before): on at ``at`` first."""

    period: int
    at: int = 0

    def level(self, tick: int) -> int:
        """See the base class."""
        return int(tick >= self.at and 2 * ((tick - self.at) % self.period) < self.period)

    def next_change(self, tick: int) -> int:
        """See the base class."""
        if tick < self.at:
            return self.at
        begun = tick - (tick - self.at) % self.period
        off = begun + (self.period + 1) // 2
        return off if tick < off else begun + self.period


@dataclass(frozen=True, slots=True)
class Times(Stimulus):
    """Changes its level at each of these ticks, which rise; off before the first."""

    ticks: tuple[int, ...]

    def level(self, tick: int) -> int:
        """See the base class."""
        return bisect_right(self.ticks, tick) & 1

    def next_change(self, tick: int) -> int:
        """See the base class."""
        index = bisect_right(self.ticks, tick)
        return self.ticks[index] if index < len(self.ticks) else NEVER


class Random(Stimulus):
    """On and off for exponential times of mean ``on`` and ``off`` ticks, each at least one tick.

    ``draws`` are uniform numbers of its own stream. What lies before the latest call is dropped.
    """

    __slots__ = ("_ahead", "_draws", "_level", "_means", "_next")

    def __init__(self, on: int, off: int, draws: Iterator[float]) -> None:
        self._means = (off, on)
        self._draws = draws
        self._level = 0
        self._ahead: list[Change] = []
        self._next = 0
        self._draw()

    def _draw(self) -> None:
        from math import log

        level = self._ahead[-1][1] if self._ahead else self._level
        self._next += max(1, round(-self._means[level] * log(1.0 - next(self._draws))))
        self._ahead.append((self._next, level ^ 1))

    def level(self, tick: int) -> int:
        """See the base class."""
        while self._ahead[-1][0] <= tick:
            self._draw()
        level = self._level
        for at, after in self._ahead:
            if at > tick:
                break
            level = after
        return level

    def changes(self, since: int, until: int) -> list[Change]:
        """See the base class."""
        found = super().changes(since, until)
        while self._ahead[0][0] <= since:
            self._level = self._ahead.pop(0)[1]
        return found

    def next_change(self, tick: int) -> int:
        """See the base class."""
        while self._ahead[-1][0] <= tick:
            self._draw()
        return next(change for change, _ in self._ahead if change > tick)


@dataclass(frozen=True, slots=True)
class RandomInput:
    """What a scenario says of a random input: mean times on and off, in ticks.

    With a ``seed`` of its own its course depends on that alone, else on the scenario's seed and its name.
    """

    on: int
    off: int
    seed: int | None = None


InputSpec = Pulse | Square | Times | RandomInput

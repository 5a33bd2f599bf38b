"""Sources of values in a PLC's own block where no program writes them. Times in ticks of simulated time.

``value(tick)`` is what the PLC writes at an END at that tick, ``next_change(tick)`` the first later
tick with another value (None: never). Both count from the start of the simulation, not from RUN, so
that the time at which a value was written follows from it.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from bussim.plc.inputs import NEVER
from bussim.plc.memory import Device, Memory


@dataclass(frozen=True, slots=True)
class Toggle:
    """A bit (or word 0/1) that changes its value every ``every`` ticks, beginning with 0."""

    every: int

    def value(self, tick: int) -> int:
        """0 or 1."""
        return tick // self.every & 1

    def next_change(self, tick: int) -> int | None:
        """The first tick after ``tick`` with another value."""
        return (tick // self.every + 1) * self.every


@dataclass(frozen=True, slots=True)
class Counter:
    """A word that counts up once every ``every`` ticks, modulo 65536, from 0; a bit: its lowest bit."""

    every: int

    def value(self, tick: int) -> int:
        """0…65535."""
        return tick // self.every & 0xFFFF

    def next_change(self, tick: int) -> int | None:
        """The first tick after ``tick`` with another value."""
        return (tick // self.every + 1) * self.every


@dataclass(frozen=True, slots=True)
class Constant:
    """A fixed value: a bit 0 or 1, a word -32768…65535 (stored as 16 bits)."""

    fixed: int

    def value(self, tick: int) -> int:
        """The value as 16 bits."""
        return self.fixed & 0xFFFF

    def next_change(self, tick: int) -> int | None:
        """Never: None."""
        return None


@dataclass(frozen=True, slots=True)
class Ramp:
    """A word that goes linearly from ``start`` to ``stop`` over ``over`` ticks, then stays there."""

    start: int
    stop: int
    over: int

    def value(self, tick: int) -> int:
        """The value at a tick as 16 bits, rounded down towards ``start``."""
        span = self.stop - self.start
        steps = abs(span) * min(tick, self.over) // self.over
        return (self.start + (steps if span > 0 else -steps)) & 0xFFFF

    def next_change(self, tick: int) -> int | None:
        """The first tick after ``tick`` with another value."""
        span = abs(self.stop - self.start)
        steps = span * min(tick, self.over) // self.over
        # The least tick whose product with the span reaches the next step.
        return None if steps >= span else -(-(steps + 1) * self.over // span)


Source = Toggle | Counter | Constant | Ramp


class Sources:
    """Those of one PLC, by their devices."""

    def __init__(self, sources: Mapping[Device, Source]) -> None:
        self.by_device = dict(sources)
        #: The END at which they were written last.
        self.written = -1

    def write(self, memory: Memory, end: int) -> None:
        """Write what they say at an END, once: else what a port has written since would be overwritten."""
        if end == self.written:
            return
        self.written = end
        for device, source in self.by_device.items():
            value = source.value(end)
            memory.set(device, value if device.is_word else value & 1)

    def next_change(self, end: int) -> int:
        """When one of them has another value first after a tick, far away if none ever has."""
        changes = [source.next_change(end) for source in self.by_device.values()]
        return min((change for change in changes if change is not None), default=NEVER)

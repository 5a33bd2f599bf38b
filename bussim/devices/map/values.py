"""Where the values of a register map that a scenario defines come from, as functions of the tick."""

from collections.abc import Callable
from dataclasses import dataclass
from hashlib import blake2b
from statistics import NormalDist
from typing import Protocol

_STANDARD_NORMAL = NormalDist()
_SCALE = 1 << 64


class Value(Protocol):
    """A value over time. The sources of :mod:`bussim.plc.sources` are such values, too."""

    def value(self, tick: int) -> int:
        """The value at a tick; a map keeps as many of its low bits as the register has."""


@dataclass(frozen=True, slots=True)
class Fixed:
    """Always the same."""

    fixed: int

    def value(self, tick: int) -> int:
        """The value."""
        return self.fixed


@dataclass(frozen=True, slots=True)
class Sweep:
    """Goes linearly from ``start`` to ``stop`` over ``over`` ticks (≥ 1).

    Then it stays there, or begins again at ``start`` if ``repeat``. Rounded towards ``start``.
    """

    start: int
    stop: int
    over: int
    repeat: bool = False

    def value(self, tick: int) -> int:
        """The value, which may need more than 16 bits."""
        elapsed = tick % self.over if self.repeat else min(tick, self.over)
        span = self.stop - self.start
        steps = abs(span) * elapsed // self.over
        return self.start + (steps if span > 0 else -steps)


def noise_key(seed: int, *name: str | int) -> bytes:
    """The key of one noise: from the scenario's seed and a name of its own."""
    text = "\x1f".join(str(part) for part in (seed, *name))
    return blake2b(text.encode("utf-8"), digest_size=32).digest()


@dataclass(frozen=True, slots=True)
class Noise:
    """A new random value every ``every`` ticks (≥ 1), the same for all who ask in that time.

    Uniform in ``center`` ± ``spread``, or with ``normal`` of that mean and standard deviation,
    rounded. It depends on the key and the tick alone, not on who read before.
    """

    center: int
    spread: int
    every: int
    key: bytes
    normal: bool = False

    def value(self, tick: int) -> int:
        """The value at a tick."""
        number = (tick // self.every).to_bytes(16, "big")
        drawn = int.from_bytes(blake2b(number, digest_size=8, key=self.key).digest(), "big")
        if self.normal:
            return self.center + round(self.spread * _STANDARD_NORMAL.inv_cdf((drawn + 0.5) / _SCALE))
        return self.center - self.spread + drawn * (2 * self.spread + 1) // _SCALE


@dataclass(frozen=True, slots=True)
class Computed:
    """What a function makes of the tick: ``function(tick)`` must return an integer."""

    function: Callable[[int], int]

    def value(self, tick: int) -> int:
        """What the function returns. Raises TypeError if that is no integer, and what it raises."""
        value = self.function(tick)
        if not isinstance(value, int):
            raise TypeError(f"returned {value!r}, not an integer")
        return value

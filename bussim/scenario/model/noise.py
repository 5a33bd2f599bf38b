"""Lines and what disturbs them by chance, as frozen values. Times are ticks (1/72 MHz)."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from bussim.line.characters import LineTiming
from bussim.line.protocols import BusProtocol


@dataclass(frozen=True, slots=True)
class Bus:
    """One RS485 line. That of an N:N link is 38400 7E1 by protocol."""

    name: str
    protocol: BusProtocol
    timing: LineTiming


@dataclass(frozen=True, slots=True)
class Window:
    """When a noise or a fault acts: from ``at`` for ``duration`` ticks (None: to the end)."""

    at: int = 0
    duration: int | None = None

    @property
    def until(self) -> int | None:
        """The first tick at which it no longer acts, None for never."""
        return None if self.duration is None else self.at + self.duration


ALWAYS = Window()


class Direction(StrEnum):
    """Which side of a station a disturbance sits on."""

    RX = "rx"  # in its receiver only
    TX = "tx"  # on what it sends, for every receiver


@dataclass(frozen=True, slots=True)
class Target:
    """What a noise acts on: a whole bus, or one direction of one station on it.

    ``station`` is the name of a node: a PLC (its link port), ``press1.COM3``, or a device.
    """

    bus: str
    station: str | None = None
    direction: Direction = Direction.RX


@dataclass(frozen=True, slots=True)
class BitErrors:
    """Independent bit errors with probability ``ber`` (0…1) for every transmitted bit."""

    ber: float

    @property
    def harmless(self) -> bool:
        """Whether it never does anything."""
        return self.ber == 0


@dataclass(frozen=True, slots=True)
class Burst:
    """Gilbert–Elliott noise: exponential sojourns of mean ``good`` and ``bad`` ticks, a BER in each."""

    good: int
    bad: int
    ber_good: float
    ber_bad: float

    @property
    def harmless(self) -> bool:
        """Whether it never does anything."""
        return self.ber_good == self.ber_bad == 0


@dataclass(frozen=True, slots=True)
class Impulse:
    """Periodic impulses: bits whose centre lies in one are inverted with probability ``ber``.

    ``phase`` is the start of the first impulse after ``at`` (0 <= phase < every), None for random.
    """

    every: int
    width: int
    ber: float
    phase: int | None = None

    @property
    def harmless(self) -> bool:
        """Whether it never does anything."""
        return self.ber == 0


@dataclass(frozen=True, slots=True)
class ReplyLoss:
    """Replies of the target station (of every station: no station) vanish whole, with a probability."""

    probability: float

    @property
    def harmless(self) -> bool:
        """Whether it never does anything."""
        return self.probability == 0


NoiseKind = BitErrors | Burst | Impulse | ReplyLoss


@dataclass(frozen=True, slots=True)
class Noise:
    """One entry of ``noise:``. ``name`` is unique and names its random stream."""

    name: str
    target: Target
    kind: NoiseKind
    window: Window = ALWAYS

"""Faults, as frozen values. Times are ticks (1/72 MHz).

Those that damage single frames act ``count`` times; the others last for their window. A node is a PLC (its
link port), a port such as ``press1.COM3``, or a device.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

from bussim.line.characters import LineTiming
from bussim.scenario.model.noise import ALWAYS, Direction, Window


@dataclass(frozen=True, slots=True)
class PowerOff:
    """The PLC has no supply: silent, deaf, its memory back at power-on values afterwards."""

    node: str


@dataclass(frozen=True, slots=True)
class Stop:
    """The PLC is in STOP: silent and deaf, counts nothing; RUN again when it is over."""

    node: str


@dataclass(frozen=True, slots=True)
class DropReply:
    """The next ``count`` replies of a station (or all of them while it lasts) are never sent."""

    node: str
    count: int | None


@dataclass(frozen=True, slots=True)
class Slow:
    """A slave answers ``extra`` ticks later than its turnaround."""

    node: str
    extra: int


@dataclass(frozen=True, slots=True)
class Jabber:
    """A station's port sends random characters back to back, whatever its engine wants."""

    node: str


@dataclass(frozen=True, slots=True)
class CableCut:
    """The cable is broken behind a station (in the order of ``plcs``)."""

    bus: str
    after: str


@dataclass(frozen=True, slots=True)
class WrongFormat:
    """A station's port sends and receives with another character format or rate."""

    node: str
    timing: LineTiming


@dataclass(frozen=True, slots=True)
class ClockPpm:
    """A station's bit clock is off by ``ppm`` parts per million (positive: fast)."""

    node: str
    ppm: Fraction


@dataclass(frozen=True, slots=True)
class LateRelease:
    """A station's driver stays on, idle level, for ``by`` ticks after each of its frames."""

    node: str
    by: int


@dataclass(frozen=True, slots=True)
class LoseChar:
    """A character is missing: from what a station sends (tx) or only in its receiver (rx).

    ``index`` counts the frame's characters from 0; None: a random one.
    """

    node: str
    direction: Direction
    count: int | None
    index: int | None = None


@dataclass(frozen=True, slots=True)
class InsertChar:
    """A character too many: in what a station sends (tx) or only in its receiver (rx).

    It stands before the character ``index`` (None: a random place) and has ``value`` (None: random).
    """

    node: str
    direction: Direction
    count: int | None
    index: int | None = None
    value: int | None = None


@dataclass(frozen=True, slots=True)
class FlipBits:
    """Chosen bits of frames are inverted: of a station's frames (tx), in its receiver only (rx).

    ``bits`` count from 0, the first start bit of the frame; only frames of ``frame`` kind ("data",
    "poll", "parameters"; None: any) are touched and counted.
    """

    node: str
    direction: Direction
    bits: tuple[int, ...]
    count: int | None
    frame: str | None = None


@dataclass(frozen=True, slots=True)
class BoardError:
    """The exchange between a PLC and its port board fails with a code that no frame can cause.

    M8063 is set and D8063 becomes 7xyy (PW10, section 8); ``code`` is yy, ``port`` COM3…COM6.
    """

    node: str
    port: str
    code: int


FaultKind = (
    PowerOff
    | Stop
    | DropReply
    | Slow
    | Jabber
    | CableCut
    | WrongFormat
    | ClockPpm
    | LateRelease
    | LoseChar
    | InsertChar
    | FlipBits
    | BoardError
)


@dataclass(frozen=True, slots=True)
class Fault:
    """One entry of ``faults:``. ``name`` is unique, names its random stream and labels plots."""

    name: str
    kind: FaultKind
    window: Window = ALWAYS

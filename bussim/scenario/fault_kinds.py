"""The kinds of faults of a scenario, as frozen values.

Those that damage single frames act ``count`` times; the others last for their window.
"""

from dataclasses import dataclass
from enum import StrEnum
from fractions import Fraction

from bussim.line.characters import LineTiming


class Direction(StrEnum):
    """Which side of a station a disturbance sits on."""

    RX = "rx"  # in its receiver only
    TX = "tx"  # on what it sends, for every receiver


@dataclass(frozen=True, slots=True)
class _OfNode:
    """``node`` is a PLC (its link port), a port such as ``press1.COM3``, or a device."""

    node: str


@dataclass(frozen=True, slots=True)
class PowerOff(_OfNode):
    """The PLC has no supply: it neither sends nor receives; its memory starts again at power-on values."""


@dataclass(frozen=True, slots=True)
class Stop(_OfNode):
    """The PLC is in STOP: it neither sends nor receives and counts nothing; RUN again when it is over."""


@dataclass(frozen=True, slots=True)
class DropReply(_OfNode):
    """The next ``count`` replies of a station (or all of them while it lasts) are never sent."""

    count: int | None


@dataclass(frozen=True, slots=True)
class Slow(_OfNode):
    """A slave replies ``extra`` ticks later than its turnaround."""

    extra: int


@dataclass(frozen=True, slots=True)
class Jabber(_OfNode):
    """A station's port sends random characters back to back, whatever its engine wants."""


@dataclass(frozen=True, slots=True)
class CableCut:
    """The cable is broken behind a station (in the order of ``plcs``)."""

    bus: str
    after: str


@dataclass(frozen=True, slots=True)
class WrongFormat(_OfNode):
    """A station's port sends and receives with another character format or rate."""

    timing: LineTiming


@dataclass(frozen=True, slots=True)
class ClockPpm(_OfNode):
    """A station's bit clock is off by ``ppm`` parts per million (positive: fast)."""

    ppm: Fraction


@dataclass(frozen=True, slots=True)
class LateRelease(_OfNode):
    """A station's driver stays on, idle level, for ``by`` ticks after each of its frames."""

    by: int


@dataclass(frozen=True, slots=True)
class LoseChar(_OfNode):
    """A character is missing: from what a station sends (tx) or only in its receiver (rx).

    ``index`` counts the frame's characters from 0; None: a random one.
    """

    direction: Direction
    count: int | None
    index: int | None = None


@dataclass(frozen=True, slots=True)
class InsertChar(_OfNode):
    """A character too many: in what a station sends (tx) or only in its receiver (rx).

    It stands before the character ``index`` (None: a random one) and has ``value`` (None: random).
    """

    direction: Direction
    count: int | None
    index: int | None = None
    value: int | None = None


@dataclass(frozen=True, slots=True)
class Pause(_OfNode):
    """A station pauses for ``by`` ticks inside frames that it sends, after the character at ``index``.

    ``index`` counts the frame's characters from 0; None: a random one but the last. A frame that ends with
    that character or before it has no pause, and is not counted.
    """

    by: int
    count: int | None
    index: int | None = None


@dataclass(frozen=True, slots=True)
class FlipBits(_OfNode):
    """Chosen bits of frames are inverted: of a station's frames (tx), in its receiver only (rx).

    ``bits`` count from 0, the first start bit of the frame; only frames of ``frame`` kind ("data",
    "poll", "parameters"; None: any) are touched and counted.
    """

    direction: Direction
    bits: tuple[int, ...]
    count: int | None
    frame: str | None = None


@dataclass(frozen=True, slots=True)
class BoardError(_OfNode):
    """The exchange between a PLC and its port board fails with a code that no frame can cause.

    M8063 is set and D8063 becomes 7xyy (PW10, section 8); ``code`` is yy, ``port`` COM3…COM6.
    """

    port: str
    code: int


#: Those that damage single frames, those of a PLC or device as a whole, and the others.
FaultKind = (
    (DropReply | LoseChar | InsertChar | FlipBits | Pause)
    | (PowerOff | Stop | BoardError)
    | (Slow | Jabber | CableCut | WrongFormat | ClockPpm | LateRelease)
)

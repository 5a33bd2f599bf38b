"""Everything that the free protocol's engine reports. Frozen values; times are ticks."""

from dataclasses import dataclass, field
from enum import StrEnum

from bussim.engines.modbus.codes import PortError


class Ended(StrEnum):
    """What ended a reception."""

    COUNT = "all bytes are there"
    END_CHARACTER = "end character"
    TIMEOUT = "timeout"


@dataclass(frozen=True, slots=True)
class Sent:
    """All bytes have left."""

    start: int
    end: int
    chars: bytes  # start and end character included


@dataclass(frozen=True, slots=True)
class Received:
    """A reception is complete; nothing more is received until the program resets its flag."""

    tick: int
    start: int | None  # first edge of its first character, None if nothing came
    data: bytes  # without start and end character
    ended: Ended
    chars: bytes = field(default=b"", compare=False)  # with them
    damaged: int = field(default=0, compare=False)  # characters with parity or framing errors


@dataclass(frozen=True, slots=True)
class CharacterDamaged:
    """A character of a reception came with a parity (5) or framing (8) error; its value is kept (assumed)."""

    tick: int
    error: PortError
    value: int


FreeEvent = Sent | Received | CharacterDamaged

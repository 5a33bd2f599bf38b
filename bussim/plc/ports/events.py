"""What a PLC's port tells whoever reports a run. Frozen values; times are ticks."""

from __future__ import annotations

from dataclasses import dataclass

from bussim.engines.free.events import Received, Sent
from bussim.engines.modbus.codes import PortError
from bussim.engines.modbus.events import CycleEnded, TransactionEnded


@dataclass(frozen=True, slots=True)
class TransactionTaken:
    """A master's port has taken over what came of an attempt.

    ``ended`` is the engine's account of it. Where RS2 cannot send the request, no engine was asked: its
    number is 0, its request has no values, and nothing was sent.
    """

    taken: int  # the END
    poll: str  # name of the poll; "" where a program drove it
    attempt: int  # 1 = first of its turn
    ended: TransactionEnded


@dataclass(frozen=True, slots=True)
class TurnEnded:
    """A turn of a poll is over, all its attempts included."""

    poll: str
    start: int  # the beginning of the scan that drove its first attempt
    end: int  # the END that took over its last one
    attempts: int
    error: PortError | None  # of the last attempt
    late: int  # ticks from the moment it was due to ``start``


@dataclass(frozen=True, slots=True)
class FreeSent:
    """The free protocol has sent; told at the END that saw it."""

    poll: str  # "" where a program drove it
    sent: Sent


@dataclass(frozen=True, slots=True)
class FreeReceived:
    """The free protocol has received; told at the END that took it over.

    Also told, with no data and by timeout, where an instruction of ``polls:`` waited in vain for
    an answer: the wait is its own, of the port's timeout, and no flag of the port tells of it.
    """

    poll: str
    received: Received
    damaged: int  # characters with parity or framing errors


@dataclass(frozen=True, slots=True)
class PortErrorRaised:
    """M8063 on and D8063 = ``code``."""

    tick: int
    port: str
    error: PortError
    code: int  # 7xyy
    text: str  # of refused parameters: which; else ""


PortEvent = TransactionTaken | TurnEnded | CycleEnded | FreeSent | FreeReceived | PortErrorRaised

"""Events of a PLC's ports. Frozen values; times are ticks."""

from typing import NamedTuple

from bussim.engines.free.events import Received, Sent
from bussim.engines.modbus.codes import PortError
from bussim.engines.modbus.events import CycleEnded, TransactionEnded


class TransactionTaken(NamedTuple):
    """A master's port has taken over the outcome of an attempt.

    ``ended`` is the engine's account of it. Where RS2 cannot send the request, no engine was asked: its
    number is 0, its request has no values, and nothing was sent.
    """

    taken: int  # the END
    poll: str  # name of the poll; "" where a program drove it
    attempt: int  # 1 = first of its turn
    ended: TransactionEnded


class TurnEnded(NamedTuple):
    """A turn of a poll is over, all its attempts included."""

    poll: str
    start: int  # the beginning of the scan that drove its first attempt
    end: int  # the END that took over its last one
    attempts: int
    error: PortError | None  # of the last attempt
    late: int  # ticks from the moment it was due to ``start``


class FreeSent(NamedTuple):
    """The free protocol has sent; reported at the END that sees it."""

    poll: str  # "" where a program drove it
    sent: Sent


class FreeReceived(NamedTuple):
    """The free protocol has received; reported at the END that takes it over.

    Also reported, with no data and by timeout, where an instruction of ``polls:`` waited in vain for
    a reply: it waits for the port's timeout by itself, and no flag of the port shows it.
    """

    poll: str
    received: Received


class PortErrorRaised(NamedTuple):
    """M8063 on and D8063 = ``code``."""

    tick: int
    port: str
    error: PortError
    code: int  # 7xyy
    text: str  # of refused parameters: which; else ""


PortEvent = TransactionTaken | TurnEnded | CycleEnded | FreeSent | FreeReceived | PortErrorRaised

"""Everything that the Modbus engines report. Frozen values; times are ticks."""

from dataclasses import dataclass
from typing import NamedTuple

from bussim.engines.modbus.codes import PortError, Rejection
from bussim.engines.modbus.pdu import Request, Response


class FrameRejected(NamedTuple):
    """Characters that are no frame, or a frame that is not served; nothing is sent in reply."""

    tick: int
    start: int  # first edge
    reason: Rejection
    chars: bytes


class Unanswered(NamedTuple):
    """A request that timed out, and when its last stop bit had left: its response may still come."""

    station: int
    request: Request
    asked: int


class ForeignFrame(NamedTuple):
    """Master: a sound frame that is not the awaited response; it goes on waiting, unless ``taken``.

    ``late`` is the earlier request that the frame answers, None where it is of another station.
    """

    tick: int
    start: int
    station: int
    late: Unanswered | None = None
    taken: bool = False


class TransactionEnded(NamedTuple):
    """Master: a transaction was decided.

    ``error`` is None where a good response came (or, for a broadcast, its turnaround is over);
    ``exception`` the code of an exception response, else 0. Where nothing was sent because RS2
    cannot send it, ``sent`` and ``asked`` are None.
    """

    number: int  # counts from 1
    station: int
    request: Request
    sent: int | None  # first edge of the request
    asked: int | None  # its last stop bit: from here the timeout counts
    answer_start: int | None  # first edge of what decided it, if anything was received
    answer_end: int | None  # last stop bit of that
    end: int  # when it was decided
    error: PortError | None
    exception: int
    response: Response | None


class RequestServed(NamedTuple):
    """Slave: a request was carried out or refused.

    ``request`` is None where the function is unknown or its count impossible; ``exception`` 0 where
    it was carried out. A broadcast is reported once for each of the slave's stations.
    """

    tick: int
    number: int  # the ``counter`` of its reply, counts from 1
    station: int  # whose registers
    start: int  # first edge of the request
    end: int  # its last stop bit
    function: int
    request: Request | None
    exception: int
    broadcast: bool


class StationRefused(NamedTuple):
    """Slave: a station number outside 1–247 (port error 0); it receives and sends nothing."""

    tick: int
    station: int
    error: PortError


@dataclass(frozen=True, slots=True)
class PollEnded:
    """Poll list: a turn of a poll is over, all its retries included."""

    tick: int
    index: int  # in the list, from 0
    start: int  # when its first attempt was begun
    attempts: int
    error: PortError | None  # of the last attempt; None: a response was taken
    late: int  # ticks from the moment it was due to ``start``


class CycleEnded(NamedTuple):
    """Poll list: every poll has had a turn since the first one of this cycle was begun."""

    tick: int
    number: int  # counts from 0
    duration: int  # from the first turn's beginning to the last one's end


MasterEvent = TransactionEnded | ForeignFrame | FrameRejected
SlaveEvent = RequestServed | FrameRejected | StationRefused
PollEvent = PollEnded | CycleEnded

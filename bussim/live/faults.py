"""Faults of a served slave: what happens to its next replies, as a test arranges it beforehand."""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass
from enum import StrEnum
from typing import assert_never

from bussim.engines.contract import Transmit
from bussim.engines.modbus.adu import Adu, Mode, encode_adu
from bussim.engines.modbus.codes import ExceptionCode
from bussim.engines.modbus.events import FrameRejected, RequestServed, SlaveEvent, StationRefused
from bussim.engines.modbus.pdu import EXCEPTION_BIT, encode_exception
from bussim.live.modbus import ModbusHandling

#: Requests that are remembered.
REMEMBERED = 10_000


class ReplyFault(StrEnum):
    """What can happen to a reply."""

    DROP = "drop_reply"  # it is never sent
    CORRUPT = "corrupt_check"  # its CRC or LRC is wrong
    DELAY = "delay"  # it comes later
    WRONG_STATION = "wrong_station"  # it carries the number of the next station
    EXCEPTION = "exception"  # it refuses the request, which was carried out all the same
    TRUNCATE = "truncate"  # its second half is missing


@dataclass(frozen=True, slots=True)
class Injected:
    """One fault of one reply. ``by`` are ticks of a delay, ``code`` is an exception code."""

    kind: ReplyFault
    by: int = 0
    code: int = ExceptionCode.DEVICE_FAILURE


class FaultyReplies(ModbusHandling):
    """Sends replies as they are, but for the faults that wait: each befalls one reply, in order.

    It remembers what was asked, and what was ignored.

    Faults may be added from another thread.
    """

    def __init__(self, mode: Mode) -> None:
        super().__init__()
        self._mode = mode
        self._waiting: deque[Injected] = deque()
        self._lock = threading.Lock()
        self._now: dict[int, Injected] = {}  # by the counter of the reply
        self._last = 0
        #: Faults that have happened, by kind.
        self.happened: dict[ReplyFault, int] = {}
        #: Requests that were carried out or refused, the first :data:`REMEMBERED` of them.
        self.requests: list[RequestServed] = []

    def inject(self, fault: Injected, count: int = 1) -> None:
        """Let the next ``count`` replies that have no fault yet have this one."""
        with self._lock:
            self._waiting.extend([fault] * count)

    def clear(self) -> None:
        """Forget the faults that have not happened yet."""
        with self._lock:
            self._waiting.clear()

    @property
    def waiting(self) -> int:
        """Faults that have not happened yet."""
        return len(self._waiting)

    def event(self, event: SlaveEvent, now: int) -> None:
        """See the base class."""
        match event:
            case RequestServed():
                if len(self.requests) < REMEMBERED:
                    self.requests.append(event)
            case FrameRejected():
                self.count(event)
            case StationRefused():
                pass  # its caller chose the station
            case _:
                assert_never(event)

    def when(self, transmit: Transmit, now: int) -> int | None:
        """See the base class."""
        with self._lock:
            fault = self._waiting.popleft() if self._waiting else None
        self._last = transmit.counter
        if fault is None:
            return transmit.at
        self.happened[fault.kind] = self.happened.get(fault.kind, 0) + 1
        if fault.kind is ReplyFault.DROP:
            return None
        self._now[transmit.counter] = fault
        return max(transmit.at, now) + fault.by if fault.kind is ReplyFault.DELAY else transmit.at

    def chars(self, frame: Adu) -> bytes:
        """See the base class. One reply is due at a time, so it is the one planned last."""
        fault = self._now.pop(self._last, None)
        if fault is None:
            return frame.chars
        match fault.kind:
            case ReplyFault.DROP:
                return b""
            case ReplyFault.DELAY:
                return frame.chars
            case ReplyFault.CORRUPT:
                return _corrupted(self._mode, frame)
            case ReplyFault.WRONG_STATION:
                return encode_adu(self._mode, frame.station % 247 + 1, frame.pdu).chars
            case ReplyFault.TRUNCATE:
                return frame.chars[: max(1, len(frame.chars) // 2)]
            case ReplyFault.EXCEPTION:
                function = frame.pdu[0] & ~EXCEPTION_BIT
                return encode_adu(self._mode, frame.station, encode_exception(function, fault.code)).chars
            case kind:
                assert_never(kind)


def _corrupted(mode: Mode, frame: Adu) -> bytes:
    chars = bytearray(frame.chars)
    if mode is Mode.RTU:
        chars[-1] ^= 0xFF
    else:  # the second digit of the LRC, which stays a digit
        chars[-3] = ord("1") if chars[-3] == ord("0") else ord("0")
    return bytes(chars)

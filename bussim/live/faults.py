"""Faults of a served slave: what happens to its next replies, as a test arranges it beforehand."""

import threading
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import assert_never

from bussim.engines.contract import EVENTS, Transmit
from bussim.engines.modbus.adu import BROADCAST, Adu, Mode, encode_adu
from bussim.engines.modbus.codes import ExceptionCode
from bussim.engines.modbus.events import FrameRejected, RequestServed, SlaveEvent, StationRefused
from bussim.engines.modbus.pdu import Malformed, Request, decode_request, encode_exception
from bussim.engines.modbus.server import RegisterMap
from bussim.engines.modbus.slave import Slave, SlaveConfig
from bussim.live.modbus import ModbusHandling

#: Requests that are remembered.
REMEMBERED = 10_000


class ReplyFault(StrEnum):
    """What can happen to a reply."""

    DROP = "drop_reply"  # it is never sent
    CORRUPT = "corrupt_check"  # its CRC or LRC is wrong
    DELAY = "delay"  # it comes later
    WRONG_STATION = "wrong_station"  # it carries the number of the next station
    EXCEPTION = "exception"  # the request is refused, and not carried out
    TRUNCATE = "truncate"  # its second half is missing


@dataclass(frozen=True, slots=True)
class Injected:
    """One fault of one reply, of any station or a certain one.

    ``by`` are ticks of a delay, ``code`` is an exception code.
    """

    kind: ReplyFault
    by: int = 0
    code: int = ExceptionCode.DEVICE_FAILURE
    station: int | None = None


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
        self._station = 0  # whose reply is due next
        #: Faults that have happened, by kind.
        self.happened: dict[ReplyFault, int] = {}
        #: The first :data:`REMEMBERED` requests; ``number`` 0: to a station that is not there.
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

    def refused(self, station: int) -> int | None:
        """The exception code with which a station's next request is refused, None if it is not."""
        with self._lock:
            fault = self._next(station)
        return fault.code if fault is not None and fault.kind is ReplyFault.EXCEPTION else None

    def _next(self, station: int) -> Injected | None:
        return next((fault for fault in self._waiting if fault.station in (None, station)), None)

    def event(self, event: SlaveEvent, now: int) -> None:
        """See the base class."""
        match event:
            case RequestServed():
                self._station = event.station
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
            fault = self._next(self._station)
            if fault is not None:
                self._waiting.remove(fault)
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
            case ReplyFault.DELAY | ReplyFault.EXCEPTION:
                return frame.chars
            case ReplyFault.CORRUPT:
                return _corrupted(self._mode, frame)
            case ReplyFault.WRONG_STATION:
                return encode_adu(self._mode, frame.station % 247 + 1, frame.pdu).chars
            case ReplyFault.TRUNCATE:
                return frame.chars[: max(1, len(frame.chars) // 2)]
            case kind:
                assert_never(kind)


class FaultySlave(Slave):
    """A slave that refuses what a waiting fault says, and notes requests to stations that are not there."""

    def __init__(self, config: SlaveConfig, maps: Mapping[int, RegisterMap], faults: FaultyReplies) -> None:
        super().__init__(config, maps)
        self._faults = faults

    def _accepted(self, adu: Adu, start: int, end: int, now: int) -> int:
        if adu.station == BROADCAST or adu.station in self.maps:
            return super()._accepted(adu, start, end, now)
        asked = decode_request(adu.pdu)
        request = asked if isinstance(asked, Request) else None
        function = asked.function
        self._events.append(
            RequestServed(now, 0, adu.station, start, end, function, request, exception=0, broadcast=False)
        )
        return EVENTS

    def _response(self, station: int, request: Request | Malformed, now: int) -> tuple[int, bytes]:
        broadcast = self._next is not None and self._next.station == BROADCAST
        code = None if broadcast else self._faults.refused(station)
        if code is None:
            return super()._response(station, request, now)
        return code, encode_exception(request.function, code)


def _corrupted(mode: Mode, frame: Adu) -> bytes:
    chars = bytearray(frame.chars)
    if mode is Mode.RTU:
        chars[-1] ^= 0xFF
    else:  # the second digit of the LRC, which stays a digit
        chars[-3] = ord("1") if chars[-3] == ord("0") else ord("0")
    return bytes(chars)

"""Modbus traffic as a listener sees it: requests paired with their responses.

A frame is a response if a request of its station and function is open and it fits that request; all
else is a request. A write to one coil or register and its response are the same bytes: a repeated
one counts as a repeated request where it comes later than :data:`SLOWEST` responses so far would.
"""

from __future__ import annotations

from dataclasses import dataclass

from bussim.engines.modbus.adu import BROADCAST, Adu
from bussim.engines.modbus.codes import MEANINGS, PortError
from bussim.engines.modbus.pdu import (
    EXCEPTION_BIT,
    ExceptionResponse,
    Malformed,
    Request,
    Response,
    decode_request,
    decode_response,
)
from bussim.live.sniff.heard import Heard
from bussim.trace.records import BusTotals, Sink, TransactionRecord
from bussim.units import TICKS_PER_SECOND

#: An echo is a response up to so many times the slowest response of its station…
SLOWEST = 3
#: …and where none was seen yet, up to so many ticks.
_FIRST_ECHO = TICKS_PER_SECOND

_ONES = (5, 6)


@dataclass(frozen=True, slots=True)
class _Open:
    """A request without a response so far."""

    station: int
    request: Request
    start: int
    end: int
    chars: int
    attempt: int


class ModbusDecoder:
    """Records the transactions and frames on one bus."""

    def __init__(self, bus: str, sink: Sink, *, baud: int, fmt: str) -> None:
        self._bus, self._sink = bus, sink
        self._baud, self._format = baud, fmt
        self._open: _Open | None = None
        self._failed: tuple[int, Request, int] | None = None  # the latest failed one and its attempt
        self._damage: str | None = None
        self._slowest: dict[int, int] = {}
        self.frames = 0
        self.damaged = 0
        self.busy = 0
        self.unasked = 0  # sound frames that are neither request nor response
        self.stations: set[int] = set()

    def heard(self, heard: Heard) -> None:
        """Take in what was heard next."""
        self.frames += 1
        self.busy += heard.end - heard.start
        frame = heard.frame
        if not isinstance(frame, Adu):
            self.damaged += 1
            self._record(heard, "damaged", None)
            if self._open is not None:
                self._damage = heard.reason
            return
        asked = self._open
        if asked is not None and self._responds(frame, heard, asked):
            return
        request = decode_request(frame.pdu)
        if isinstance(request, Malformed):
            self.unasked += 1
            self._record(heard, "unknown", frame)
            return
        self._record(heard, "request", frame)
        self._expired(heard.start)
        self._asked(frame.station, request, heard)

    def _asked(self, station: int, request: Request, heard: Heard) -> None:
        attempt = 1
        if self._failed is not None and self._failed[:2] == (station, request):
            attempt = self._failed[2] + 1
        self._failed = None
        asked = _Open(station, request, heard.start, heard.end, len(heard.chars), attempt)
        if station == BROADCAST:
            self._transaction(asked, None, "ok", None, 0)
            return
        self._open, self._damage = asked, None

    def _responds(self, frame: Adu, heard: Heard, asked: _Open) -> bool:
        """Whether a frame is the response to the open request; then it is recorded."""
        request = asked.request
        if frame.station != asked.station or frame.pdu[0] & ~EXCEPTION_BIT != request.function:
            return False
        response = decode_response(frame.pdu, request)
        if isinstance(response, Malformed):
            return False
        took = heard.start - asked.end
        slowest = self._slowest.get(asked.station)
        if isinstance(response, Response) and request.function in _ONES:
            if response.address != request.address or response.values != request.values:
                return False
            if took > (_FIRST_ECHO if slowest is None else SLOWEST * slowest):
                return False
        self._open = None
        self.stations.add(asked.station)
        if slowest is None or took > slowest:
            self._slowest[asked.station] = took
        if isinstance(response, ExceptionResponse):
            self._record(heard, "exception", frame, response=True)
            self._transaction(asked, heard, "exception", None, response.code)
        else:
            self._record(heard, "response", frame, response=True)
            self._transaction(asked, heard, "ok", None, 0)
        return True

    def _expired(self, now: int) -> None:
        asked, self._open = self._open, None
        if asked is None:
            return
        self._failed = (asked.station, asked.request, asked.attempt)
        error = PortError.TIMEOUT if self._damage is None else PortError.CHECK
        self._transaction(asked, None, MEANINGS[error], error, 0, decided=now)

    def _transaction(
        self,
        asked: _Open,
        response: Heard | None,
        outcome: str,
        error: int | None,
        exception: int,
        *,
        decided: int | None = None,
    ) -> None:
        request = asked.request
        end = response.end if response else asked.end if decided is None else decided
        self._take(
            TransactionRecord(
                bus=self._bus,
                master="master",
                poll=poll_name(asked.station, request),
                attempt=asked.attempt,
                station=asked.station,
                function=int(request.function),
                address=request.address,
                quantity=request.quantity,
                sent=asked.start,
                asked=asked.end,
                answer_start=response.start if response else None,
                answer_end=response.end if response else None,
                end=end,
                taken=end,
                outcome=outcome,
                error=error,
                exception=exception,
                served=None,
                mismatched=False,
                chars=asked.chars + (len(response.chars) if response else 0),
            )
        )

    def _take(self, record: TransactionRecord) -> None:
        """Record a transaction that is over."""
        self._sink.take(record)

    def _record(self, heard: Heard, kind: str, frame: Adu | None, *, response: bool = False) -> None:
        if not self._sink.traced:
            return
        name = "unknown" if frame is None else f"station {frame.station}" if response else "master"
        self._sink.take(heard.record(self._bus, kind, name, self._baud, self._format))

    def totals(self) -> BusTotals:
        """Counts so far."""
        nodes = ("master", *(f"station {number}" for number in sorted(self.stations)))
        return BusTotals(
            self._bus, self._baud, self._format, nodes, self.busy, self.frames, collisions=0, undetected=0
        )


def poll_name(station: int, request: Request) -> str:
    """What a listener calls a transaction that recurs: ``1: 03 at 22 × 2``."""
    return f"{station}: {request.function:02X} at {request.address} × {request.quantity}"

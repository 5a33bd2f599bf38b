"""The Modbus slave: one or more stations behind one port, each a register map."""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from bussim.engines.contract import EVENTS, OPEN, SERVE, TRANSMIT, Engine, RxChar
from bussim.engines.modbus.adu import BROADCAST, FIRST_STATION, LAST_STATION, Adu, Damage
from bussim.engines.modbus.codes import PortError, Rejection
from bussim.engines.modbus.events import FrameRejected, RequestServed, SlaveEvent, StationRefused
from bussim.engines.modbus.framing import Framing
from bussim.engines.modbus.pdu import (
    FLAW_EXCEPTIONS,
    WRITES,
    ExceptionResponse,
    Malformed,
    Request,
    decode_request,
    encode_exception,
    encode_response,
)
from bussim.engines.modbus.server import RegisterMap, serve
from bussim.engines.modbus.states import SLAVE, SlaveInput, SlaveState


@dataclass(frozen=True, slots=True)
class SlaveConfig:
    """A slave's settings. Times in ticks.

    ``delay`` is the least time from the request's last stop bit to the reply's first edge.
    ``driven``: requests are carried out when the driver says so (a PLC: at END), else as soon as they
    are complete. ``backlog`` is how many requests wait while another one is being served; more are
    lost, as is everything that arrives while the slave itself sends.
    """

    framing: Framing
    delay: int = 0
    driven: bool = False
    backlog: int = 0


class _Asked(NamedTuple):
    """A request that is to be carried out."""

    number: int
    station: int
    request: Request | Malformed
    start: int
    end: int


class Slave(Engine[Adu, SlaveEvent]):
    """One port as Modbus slave. See :mod:`bussim.engines.contract` for the methods.

    ``maps`` are the devices by station number (1–247). Damaged frames and those of other stations
    are ignored in silence; a broadcast is carried out by every device, without a response.
    ``due_counter`` is the number of the request that is replied to.
    """

    replies = True

    def __init__(self, config: SlaveConfig, maps: Mapping[int, RegisterMap]) -> None:
        super().__init__()
        self.config = config
        self.maps = dict(maps)
        self.state = SlaveState.STOPPED
        #: Ticks of silence after which the driver calls :meth:`line_idle`.
        self.quiet = config.framing.quiet
        self._reader = config.framing.reader()
        self._number = 0
        self._waiting: deque[_Asked] = deque()  # behind the one that is being served
        self._next: _Asked | None = None  # the one that is being served
        self._reply: Adu | None = None

    def _reset(self) -> None:
        self._reader.reset()
        self._waiting.clear()
        self._next = self._reply = None
        self.due = -1

    def _move(self, cause: SlaveInput) -> None:
        self.state = SLAVE[self.state, cause]

    # -- what the device does ------------------------------------------------------------------

    def start(self, now: int) -> int:
        """RUN or power-on; returns hints. An impossible station number makes it refuse to run."""
        self._reset()
        for station in self.maps:
            if not FIRST_STATION <= station <= LAST_STATION:
                self._move(SlaveInput.BAD_STATION)
                self._events.append(StationRefused(now, station, PortError.STATION))
                return EVENTS
        self._move(SlaveInput.START)
        return 0

    def stop(self, now: int) -> int:
        """STOP or power-off: it sends and receives no more, nothing pending survives; returns hints."""
        self._reset()
        self._move(SlaveInput.STOP)
        return 0

    # -- receiving -----------------------------------------------------------------------------

    def receive(self, char: RxChar, start: int, end: int) -> int:
        """One character; see the contract."""
        if self.state in _NOT_RECEIVING:
            return 0
        reader = self._reader
        completed = reader.character(char, start, end)
        hints = 0 if completed is None else self._heard(completed, end)
        return hints | OPEN if reader.open else hints

    def receive_frame(self, frame: Adu, start: int, end: int) -> int:
        """A whole undamaged frame; the same as its characters one by one.

        No OPEN is returned for a frame of another station: the next characters end it as well.
        """
        if self.state in _NOT_RECEIVING:
            return 0
        reader = self._reader
        before = reader.whole(frame, start, end)
        hints = 0 if before is None else self._heard(before, end)
        if reader.immediate:
            return hints | self._accepted(frame, start, end, end)
        if reader.lone and frame.station not in self.maps and frame.station != BROADCAST:
            return hints
        return hints | OPEN

    def ready_for(self, start: int) -> bool:
        """Whether a frame that begins at ``start`` follows on silence, and none before it is unfinished."""
        reader = self._reader
        over = not reader.open or (reader.lone and start - reader.end >= reader.quiet)
        return over and self.state is SlaveState.LISTENING

    def receive_complete(self, frame: Adu, start: int, end: int, now: int) -> int:
        """A whole undamaged frame that it is :meth:`ready_for`, known to be over at ``now``; returns hints.

        The same as :meth:`receive_frame` and :meth:`line_idle`.
        """
        self._reader.reset()
        return self._accepted(frame, start, end, now)

    def overhear(self, request: Adu, asked: int, response: Adu, start: int, end: int) -> None:
        """Two whole frames of another station from ``asked`` and ``start`` on, each after silence.

        The same as two calls of :meth:`receive_frame`.
        """
        reader = self._reader
        reader.reset()
        self.heard, self.heard_start = (response, start) if reader.immediate else (request, asked)
        reader.whole(response, start, end)

    def line_idle(self, now: int) -> int:
        """The line has been idle for :attr:`quiet` ticks: an RTU frame is complete."""
        completed = self._reader.silence()
        return 0 if completed is None else self._heard(completed, now)

    def deadline(self) -> int | None:
        """Never: None. A slave waits for nothing but frames and its driver."""
        return None

    def on_deadline(self, now: int) -> int:
        """Nothing to do."""
        return 0

    def _heard(self, completed: Adu | Damage, now: int) -> int:
        if isinstance(completed, Adu):
            return self._accepted(completed, *self._reader.heard, now)
        self._events.append(FrameRejected(now, completed.start, completed.reason, completed.chars))
        return EVENTS

    def _accepted(self, adu: Adu, start: int, end: int, now: int) -> int:
        self.heard, self.heard_start = adu, start
        broadcast = adu.station == BROADCAST
        if not broadcast and adu.station not in self.maps:
            return 0
        request = decode_request(adu.pdu)
        reason: Rejection | None = None
        if isinstance(request, Malformed) and (broadcast or not FLAW_EXCEPTIONS[request.flaw]):
            reason = Rejection.MALFORMED
        elif isinstance(request, Request) and broadcast and request.function not in WRITES:
            reason = Rejection.BROADCAST_READ
        elif self._next is not None and len(self._waiting) >= self.config.backlog:
            reason = Rejection.BUSY
        if reason is not None:
            self._events.append(FrameRejected(now, start, reason, adu.chars))
            return EVENTS
        self._number += 1
        asked = _Asked(self._number, adu.station, request, start, end)
        if self._next is not None:
            self._waiting.append(asked)
            return 0
        return self._take_up(asked, now)

    # -- serving -------------------------------------------------------------------------------

    @property
    def waiting(self) -> bool:
        """Whether a request waits to be carried out: a driver of a ``driven`` slave calls :meth:`serve`."""
        return self.state is SlaveState.SERVING

    @property
    def reply(self) -> Adu | None:
        """The reply that is due or being sent."""
        return self._reply

    def _take_up(self, asked: _Asked, now: int) -> int:
        self._next = asked
        self._move(SlaveInput.REQUEST)
        return SERVE if self.config.driven else self.serve(now)

    def serve(self, now: int) -> int:
        """Carry out the request that waits (a PLC: at END); returns hints. Nothing waits: 0."""
        asked = self._next
        if asked is None or self.state is not SlaveState.SERVING:
            return 0
        number, station, request, start, end = asked
        broadcast = station == BROADCAST
        for own in sorted(self.maps) if broadcast else (station,):
            exception, pdu = self._response(own, request, now)
            self._events.append(
                RequestServed(
                    now,
                    number,
                    own,
                    start,
                    end,
                    request.function,
                    request if isinstance(request, Request) else None,
                    exception,
                    broadcast,
                )
            )
        if broadcast:
            self._move(SlaveInput.SERVED_ALL)
            return EVENTS | self._finished(now)
        self._move(SlaveInput.SERVED)
        self._reply = self.config.framing.encode(station, pdu)
        self.due = max(now, end + self.config.delay)
        self.due_counter = number
        return EVENTS | TRANSMIT

    def _response(self, station: int, request: Request | Malformed, now: int) -> tuple[int, bytes]:
        """Exception code (0: none) and PDU of one station's response."""
        if isinstance(request, Malformed):
            code = FLAW_EXCEPTIONS[request.flaw]
            return code, encode_exception(request.function, code)
        response = serve(self.maps[station], request, now)
        if isinstance(response, ExceptionResponse):
            return response.code, encode_exception(*response)
        return 0, encode_response(response)

    def _finished(self, now: int) -> int:
        self._next = self._reply = None
        self.due = -1
        return self._take_up(self._waiting.popleft(), now) if self._waiting else 0

    # -- sending -------------------------------------------------------------------------------

    def begin_transmit(self, now: int, counter: int = 0) -> Adu:
        """The reply that is due. Raises RuntimeError if none is."""
        if self._reply is None or self.state is not SlaveState.RESPONDING:
            raise RuntimeError(f"the slave is {self.state.value}: no reply is due")
        self._move(SlaveInput.BEGUN)
        self.due = -1
        self._reader.reset()
        return self._reply

    def transmit_done(self, now: int) -> int:
        """The reply has left; returns hints."""
        if self.state is not SlaveState.SENDING:
            return 0
        self._move(SlaveInput.SENT)
        return self._finished(now)

    def give_up_reply(self, now: int) -> int:
        """The reply that is due will not be sent (a fault drops it); returns hints."""
        if self.state is not SlaveState.RESPONDING:
            return 0
        self._move(SlaveInput.LOST)
        return self._finished(now)


_NOT_RECEIVING = frozenset((SlaveState.STOPPED, SlaveState.REFUSING, SlaveState.SENDING))

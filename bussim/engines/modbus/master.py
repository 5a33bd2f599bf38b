"""The Modbus master of one port: one transaction at a time, as one RS2 instruction drives it."""

from dataclasses import dataclass
from functools import lru_cache

from bussim.engines.contract import DEADLINE, EVENTS, OPEN, TRANSMIT, Engine, RxChar
from bussim.engines.modbus.adu import BROADCAST, LAST_STATION, Adu, Damage
from bussim.engines.modbus.codes import REJECTION_ERRORS, PortError, Rejection, exception_error
from bussim.engines.modbus.events import ForeignFrame, FrameRejected, MasterEvent, PollEvent, TransactionEnded
from bussim.engines.modbus.framing import Framing
from bussim.engines.modbus.pdu import (
    EXCEPTION_BIT,
    EXCEPTION_SIZE,
    FUNCTIONS,
    STANDARD_LIMITS,
    WRITES,
    ExceptionResponse,
    Limits,
    Malformed,
    Request,
    Response,
    decode_response,
    encode_request,
    response_size,
)
from bussim.engines.modbus.states import MASTER, MasterInput, MasterState
from bussim.units import TICKS_PER_MS


@dataclass(frozen=True, slots=True)
class MasterConfig:
    """A master's settings. Times in ticks.

    ``timeout`` counts from the end of the request (CPAVL +9 × 10 ms), ``interval`` from one
    transaction's end to the next request (CPAVL +2; 0 there means 5 ms), ``turnaround`` is the pause
    after a broadcast (standard: 100 to 200 ms). A response is in time if its last stop bit ends by
    the timeout; with ``begun_holds`` if its first edge does (assumed not). ``last_station`` is the highest
    number that it asks, at most 255.
    """

    framing: Framing
    timeout: int
    interval: int = 5 * TICKS_PER_MS
    turnaround: int = 100 * TICKS_PER_MS
    begun_holds: bool = False
    limits: Limits = STANDARD_LIMITS
    last_station: int = LAST_STATION


@lru_cache
def refusal(
    station: int, request: Request, limits: Limits = STANDARD_LIMITS, last_station: int = LAST_STATION
) -> PortError | None:
    """Why a master cannot send a request; None if it can.

    Function not among 01 02 03 04 05 06 0F 10, or a broadcast read: 4; quantity 0 or over the
    limits: 6; addresses beyond 65535: 2; station outside 0…``last_station``: 0 (assumed).
    """
    function, address, quantity, _ = request
    if not 0 <= station <= last_station:
        return PortError.STATION
    if function not in FUNCTIONS or (station == BROADCAST and function not in WRITES):
        return PortError.FUNCTION
    if not 1 <= quantity <= limits.of(function):
        return PortError.DATA
    if not 0 <= address <= 0x10000 - quantity:
        return PortError.ADDRESS
    return None


class Master(Engine[Adu, MasterEvent | PollEvent]):
    """One port as Modbus master. See :mod:`bussim.engines.contract` for the methods.

    It receives only while it waits for a response, and does not sense the carrier. A sound frame of
    another station, and damage that does not look like the awaited response (station and function in
    front), do not end the wait; the timeout then names what was received, or else that nothing was.
    ``due_counter`` is the number of the transaction that is due or runs (the latest one's, when idle).
    """

    def __init__(self, config: MasterConfig) -> None:
        super().__init__()
        self.config = config
        self.state = MasterState.STOPPED
        #: Ticks of silence after which the driver calls :meth:`line_idle`.
        self.quiet = config.framing.quiet
        #: The earliest tick at which the next request may leave.
        self.ready_at = 0
        self._reader = config.framing.reader()
        self._station = BROADCAST
        self._request = Request(0, 0)
        self._adu = Adu(BROADCAST, b"", b"")
        self._reset()

    def _reset(self) -> None:
        self._reader.reset()
        self._deadline: int | None = None
        self._overdue = False  # the timeout is over, but what came by then is not complete
        self._damage: Damage | None = None  # the first during this transaction
        self._sent: int | None = None
        self._asked: int | None = None

    def _move(self, cause: MasterInput) -> None:
        self.state = MASTER[self.state, cause]

    # -- what the PLC does ---------------------------------------------------------------------

    @property
    def idle(self) -> bool:
        """Whether :meth:`submit` may be called."""
        return self.state is MasterState.IDLE

    def start(self, now: int) -> int:
        """RUN; returns hints."""
        self._move(MasterInput.START)
        self._reset()
        self.ready_at = now
        return DEADLINE

    def stop(self, now: int) -> int:
        """STOP or power-off: the running transaction is forgotten, without an event; returns hints."""
        self._move(MasterInput.STOP)
        self._reset()
        self.due = -1
        return DEADLINE

    def submit(self, station: int, request: Request, now: int) -> int:
        """Begin a transaction; returns hints.

        The request leaves at ``now`` or when the interval is over. One that RS2 cannot send (see
        :func:`refusal`) ends at once. Raises RuntimeError unless :attr:`idle`, ValueError where
        ``values`` do not fit ``quantity`` or 16 bits.
        """
        if not self.idle:
            raise RuntimeError(f"the master is {self.state.value}, a transaction needs it idle")
        self.due_counter += 1
        self._station, self._request = station, request
        self._reset()
        error = refusal(station, request, self.config.limits, self.config.last_station)
        if error is not None:
            self._ended(now, error, cause=None)
            return EVENTS
        self._adu = self.config.framing.encode(station, encode_request(request))
        self._move(MasterInput.SUBMITTED)
        self.due = max(now, self.ready_at)
        return TRANSMIT

    # -- receiving -----------------------------------------------------------------------------

    def receive(self, char: RxChar, start: int, end: int) -> int:
        """One character; see the contract."""
        if self.state is not MasterState.REPLY:
            return 0
        reader = self._reader
        completed = reader.character(char, start, end)
        hints = 0 if completed is None else self._heard(completed, end)
        return hints | self._still_open(end)

    def receive_frame(self, frame: Adu, start: int, end: int) -> int:
        """A whole undamaged frame; the same as its characters one by one."""
        if self.state is not MasterState.REPLY:
            return 0
        reader = self._reader
        before = reader.whole(frame, start, end)
        hints = 0 if before is None else self._heard(before, end)
        if reader.immediate and self.state is MasterState.REPLY:
            if self._overdue and not self.config.begun_holds:
                return hints | self._timed_out(end)
            return hints | self._accepted(frame, start, end, end)
        return hints | self._still_open(end)

    @property
    def longest_response(self) -> int:
        """Characters of the longest sound response to the request."""
        return self.config.framing.chars(response_size(self._request))

    def receive_complete(self, frame: Adu, start: int, end: int, now: int) -> int:
        """A whole undamaged frame, which is known to be over at ``now``; returns hints.

        The same as :meth:`receive_frame` and :meth:`line_idle`, with silence before it.
        """
        return self._accepted(frame, start, end, now) if self.state is MasterState.REPLY else 0

    def _still_open(self, now: int) -> int:
        """After a character: hints for what is open, which may be too long or come too late."""
        reader = self._reader
        if self.state is not MasterState.REPLY:
            reader.reset()  # decided by what came before this character
            return 0
        if not reader.open:
            return 0
        if reader.reason is Rejection.OVERFLOW:
            return self._damaged(reader.silence(), now, certain=True)
        if self._overdue and not self.config.begun_holds:
            return self._timed_out(now)
        return OPEN

    def line_idle(self, now: int) -> int:
        """The line has been idle for :attr:`quiet` ticks: an RTU frame is complete."""
        completed = self._reader.silence()
        if completed is None or self.state is not MasterState.REPLY:
            return 0
        return self._heard(completed, now)

    def _heard(self, completed: Adu | Damage, now: int) -> int:
        if isinstance(completed, Adu):
            return self._accepted(completed, *self._reader.heard, now)
        return self._damaged(completed, now)

    def _accepted(self, adu: Adu, start: int, end: int, now: int) -> int:
        self.heard, self.heard_start = adu, start
        if adu.station != self._station:
            self._events.append(ForeignFrame(now, start, adu.station))
            return EVENTS | (self._timed_out(now) if self._overdue else 0)
        decoded = decode_response(adu.pdu, self._request)
        if isinstance(decoded, ExceptionResponse) and decoded.function == self._request.function:
            return self._ended(now, exception_error(decoded.code), start, end, exception=decoded.code)
        checked = check_response(decoded, self._request)
        if isinstance(checked, PortError):
            return self._ended(now, checked, start, end)
        return self._ended(now, None, start, end, response=checked)

    def _damaged(self, damage: Adu | Damage | None, now: int, *, certain: bool = False) -> int:
        assert isinstance(damage, Damage)  # noqa: S101 - narrows the type; a reason is never a frame's
        self._events.append(FrameRejected(now, damage.start, damage.reason, damage.chars))
        if certain or self._awaited(damage.head):
            return self._ended(now, self._damage_error(damage), damage.start, damage.end)
        if self._damage is None:
            self._damage = damage
        return EVENTS | (self._timed_out(now) if self._overdue else 0)

    def _awaited(self, head: bytes | None) -> bool:
        if head is None:
            return False
        return head[0] == self._station and head[1] & ~EXCEPTION_BIT == self._request.function

    def _damage_error(self, damage: Damage) -> PortError:
        """The port error of a damaged response: a wrong length is named before a wrong check."""
        if damage.reason is Rejection.CHECK and self._awaited(damage.head):
            assert damage.head is not None  # noqa: S101 - narrows the type
            refused = damage.head[1] & EXCEPTION_BIT
            size = EXCEPTION_SIZE if refused else response_size(self._request)
            if len(damage.chars) != self.config.framing.chars(size):
                return PortError.LENGTH
        return REJECTION_ERRORS[damage.reason]

    # -- deciding ------------------------------------------------------------------------------

    def deadline(self) -> int | None:
        """The end of the timeout, or of the turnaround after a broadcast."""
        return self._deadline

    def on_deadline(self, now: int) -> int:
        """The timeout or the turnaround is over."""
        self._deadline = None
        if self.state is MasterState.TURNAROUND:
            return self._ended(now, None, cause=MasterInput.TURNED)
        reader = self._reader
        if reader.open and (self.config.begun_holds or not reader.immediate):
            # A response may have come whole whose closing silence is not over, or be coming.
            self._overdue = True
            return DEADLINE | OPEN
        return self._timed_out(now)

    def _timed_out(self, now: int) -> int:
        damage = self._damage
        if damage is None and self._reader.open and self._reader.reason is not None:
            damaged = self._reader.silence()
            damage = damaged if isinstance(damaged, Damage) else None
        if damage is None:
            return self._ended(now, PortError.TIMEOUT)
        return self._ended(now, self._damage_error(damage), damage.start, damage.end)

    def _ended(
        self,
        now: int,
        error: PortError | None,
        start: int | None = None,
        end: int | None = None,
        *,
        exception: int = 0,
        response: Response | None = None,
        cause: MasterInput | None = MasterInput.DECIDED,
    ) -> int:
        """Report the transaction's outcome; ``cause`` moves on to the next one (None: none was begun)."""
        number, station, request = self.due_counter, self._station, self._request
        times = (self._sent, self._asked, start, end, now)
        self._events.append(TransactionEnded(number, station, request, *times, error, exception, response))
        self._on_ended(now, error)
        if cause is not None:
            self._move(cause)
            self._reset()
            self.ready_at = now + self.config.interval
        return EVENTS | DEADLINE

    def _on_ended(self, now: int, error: PortError | None) -> None:
        """A transaction ended; for a master that has a list of them."""

    # -- sending -------------------------------------------------------------------------------

    def begin_transmit(self, now: int, counter: int = 0) -> Adu:
        """The request that is due."""
        self._move(MasterInput.BEGUN)
        self.due = -1
        self._reader.reset()
        self._sent = now
        return self._adu

    def transmit_done(self, now: int) -> int:
        """The request has left: the timeout runs, or after a broadcast the turnaround."""
        if self.state is not MasterState.SENDING:
            return 0
        self._asked = now
        broadcast = self._station == BROADCAST
        self._move(MasterInput.BROADCAST if broadcast else MasterInput.REQUESTED)
        self._deadline = now + (self.config.turnaround if broadcast else self.config.timeout)
        return DEADLINE


def check_response(
    decoded: Response | ExceptionResponse | Malformed, request: Request
) -> Response | PortError:
    """The response, or how a sound frame of the right station fails to be its response.

    Impossible length: 1; a write's echo with another address: 2, with another value or quantity, or
    another function altogether: 6 (assumed; nothing else carries what was asked).
    """
    if isinstance(decoded, Malformed):
        mine = decoded.function & ~EXCEPTION_BIT == request.function
        return PortError.LENGTH if mine else PortError.DATA
    if isinstance(decoded, ExceptionResponse) or decoded.function != request.function:
        return PortError.DATA
    if request.function in WRITES:
        if decoded.address != request.address:
            return PortError.ADDRESS
        echo = request.values if decoded.values else ()
        if decoded.quantity != request.quantity or decoded.values != echo:
            return PortError.DATA
    return decoded

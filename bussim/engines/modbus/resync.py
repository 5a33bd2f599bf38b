"""A polling master that knows late responses: none is taken for the response to another request.

RTU and ASCII carry no transaction number. A response that comes after its timeout has the form of the next
one, and a master that takes it is one response behind from then on.
"""

from bussim.engines.contract import DEADLINE, EVENTS, OPEN, RxChar
from bussim.engines.modbus.adu import Adu, Damage
from bussim.engines.modbus.codes import PortError
from bussim.engines.modbus.events import ForeignFrame, FrameRejected, Unanswered
from bussim.engines.modbus.master import MasterConfig, check_response
from bussim.engines.modbus.pdu import ExceptionResponse, Request, decode_response
from bussim.engines.modbus.polling import PollingMaster
from bussim.engines.modbus.polls import Poll, PollList
from bussim.engines.modbus.states import MasterState
from bussim.units import TICKS_PER_SECOND

#: How long after its request a response may come: timeouts, and ticks at least (assumed).
_TIMEOUTS, PATIENCE = 3, TICKS_PER_SECOND


class ResyncingMaster(PollingMaster):
    """A :class:`PollingMaster` that receives between its transactions, too.

    A request that timed out stays unanswered until its response comes, for :attr:`patience` ticks. With
    ``resync`` a request whose response could not be told from that one (same station and function, not the
    same request) waits until then, and the late response is reported and thrown away. The same request is
    repeated at once: a late response to it carries the right name; the next one waits for the other
    response. Without ``resync`` the master goes on as a PLC does, and what it takes may be late.
    """

    def __init__(self, config: MasterConfig, polls: PollList[Poll], *, resync: bool = True) -> None:
        super().__init__(config, polls)
        self._resync = resync
        self._between = config.framing.reader()  # what comes while no response is awaited
        self._unanswered: list[Unanswered] = []
        self._doubtful: Unanswered | None = None  # what was taken may not have been its response
        #: Ticks after a request's end in which its response is expected.
        self.patience = max(_TIMEOUTS * config.timeout, PATIENCE)

    def start(self, now: int) -> int:
        """Power-on; returns hints."""
        self._unanswered.clear()
        self._between.reset()
        return super().start(now)

    def begin_transmit(self, now: int, counter: int = 0) -> Adu:
        """The request that is due."""
        self._between.reset()
        return super().begin_transmit(now, counter)

    def receive(self, char: RxChar, start: int, end: int) -> int:
        """One character; see the contract."""
        if self.state in (MasterState.REPLY, MasterState.STOPPED):
            return super().receive(char, start, end)
        completed = self._between.character(char, start, end)
        if completed is not None:
            self._unasked(completed, end)
        self.ready_at = max(self.ready_at, end + self.quiet)  # the next request waits for silence
        return self._go_on(end, OPEN if self._between.open else 0) | DEADLINE

    def line_idle(self, now: int) -> int:
        """The line has been idle for :attr:`quiet` ticks."""
        completed = self._between.silence()
        if completed is not None:
            self._unasked(completed, now)
        return super().line_idle(now)

    def _unasked(self, completed: Adu | Damage, now: int) -> None:
        if isinstance(completed, Damage):
            event = FrameRejected(now, completed.start, completed.reason, completed.chars)
            self._events.append(event)
            return
        late = self._late(completed, now)
        if late is not None:
            self._unanswered.remove(late)
        self._events.append(ForeignFrame(now, self._between.heard[0], completed.station, late))

    def _late(self, adu: Adu, now: int) -> Unanswered | None:
        """The unanswered request that a frame answers: the oldest, since slaves respond in order."""
        self._give_up(now)
        return next((one for one in self._unanswered if _answers(adu, one.station, one.request)), None)

    def _accepted(self, adu: Adu, start: int, end: int, now: int) -> int:
        late = self._late(adu, now)
        if late is None:
            return super()._accepted(adu, start, end, now)
        self._unanswered.remove(late)
        same = late.request == self._request
        taken = (same or not self._resync) and _answers(adu, self._station, self._request)
        # A slave may have ignored what it was asked while busy: any other request may be the one answered.
        others = (one for one in self._unanswered if one.request != self._request)
        other = next((one for one in others if taken and _answers(adu, one.station, one.request)), late)
        self._events.append(ForeignFrame(now, start, adu.station, other if same else late, taken))
        if not taken:
            return EVENTS | (self._timed_out(now) if self._overdue else 0)
        self._doubtful = Unanswered(self._station, self._request, self._asked or now)
        self._unanswered.append(self._doubtful)
        return super()._accepted(adu, start, end, now)

    def _give_up(self, now: int) -> None:
        self._unanswered = [one for one in self._unanswered if now < one.asked + self.patience]

    def _timed_out(self, now: int) -> int:
        self._give_up(now)  # a station that never responds takes no room
        self._unanswered.append(Unanswered(self._station, self._request, self._asked or now))
        return super()._timed_out(now)

    def _held_until(self, poll: Poll, now: int) -> int:
        if not self._resync:
            return now
        return max(
            (
                one.asked + self.patience
                for one in self._unanswered
                if one.station == poll.station
                and one.request.function == poll.request.function
                and (one.request != poll.request or one is self._doubtful)
            ),
            default=now,
        )


def _answers(adu: Adu, station: int, request: Request) -> bool:
    """Whether a sound frame has the form of a request's response."""
    if adu.station != station:
        return False
    decoded = decode_response(adu.pdu, request)
    if isinstance(decoded, ExceptionResponse):
        return decoded.function == request.function
    return not isinstance(check_response(decoded, request), PortError)

"""A PLC's port as Modbus master: RS2 instructions, and a poll list that drives them without a program.

An instruction is executed in a scan, between two ENDs. Its request leaves at the END which ends that
scan, or at the first one after the interval (CPAVL +2); its outcome is taken over at the first END after
it was decided; the scan that begins there is the next one that can drive an instruction. So a
transaction costs whole scans (PW10 board manual, section 5 and 6.2.2).

Assumed, since the manual is silent: an instruction keeps the port as long as it is driven, and asks
again each time; one that goes off before its request has left asks nothing; one that goes off later
still takes its response over. The request's operands are those of the latest execution before it leaves,
a write's data those of the END at which it leaves.
"""

from collections.abc import Hashable, Iterator, Sequence
from typing import NamedTuple, assert_never

from bussim.engines.modbus.codes import PortError
from bussim.engines.modbus.events import (
    CycleEnded,
    ForeignFrame,
    FrameRejected,
    MasterEvent,
    PollEnded,
    TransactionEnded,
)
from bussim.engines.modbus.master import Master, refusal
from bussim.engines.modbus.pdu import READS, WRITES, Limits, Request
from bussim.engines.modbus.polls import PollList
from bussim.plc.ports.cpavl import COMMUNICATION_ERROR, RUNNING, TIMED_OUT
from bussim.plc.ports.device_layout import fetch, fits, store
from bussim.plc.ports.events import TransactionTaken, TurnEnded
from bussim.plc.ports.requests import make_request
from bussim.plc.ports.rs2 import Call, Drive, Rs2, modbus_call
from bussim.plc.ports.side import Side
from bussim.plc.ports.spec import PollSpec
from bussim.plc.ports.status import PortStatus
from bussim.plc.scan import ScanCycle

#: Most turns that are done at once.
_MOST = 1024


class Times(NamedTuple):
    """How long the transactions of a poll take where nothing disturbs them, in ticks.

    ``delays``, where not None, draw what is added to ``least``, uniform up to ``jitter``. ``quiet``: without
    such a silence before the next request some slave does not know yet that the response is over.
    """

    asking: int  # first edge of the request to its last stop bit
    least: int  # from there to the response's first edge
    delays: Iterator[float] | None
    jitter: int
    responding: int  # to the response's last stop bit
    closing: int  # to the decision
    quiet: int

    @property
    def responded(self) -> int:
        """The longest from the request's last stop bit to the decision."""
        return self.least + self.jitter + self.responding + self.closing


class Turn(NamedTuple):
    """A turn with one good transaction, in ticks."""

    sent: int
    begun: int  # first edge of the response
    taken: int
    driven: int
    late: int


class MasterSide(Side):
    """See the base class."""

    def __init__(self, engine: Master, status: PortStatus, polls: Sequence[PollSpec], now: int) -> None:
        self.engine = engine
        self._status = status
        self._list = PollList(polls, now)
        self._owner: Hashable | None = None  # the instruction that is driven
        self._call: Call | None = None  # executed, but its request has not left yet
        self._earliest = now  # the END at which it may
        self._running: Call | None = None  # its request has left
        self._ended: TransactionEnded | None = None  # decided, but not taken over yet
        status.set_bit(RUNNING, 0)
        self._next_poll(now)

    @property
    def busy(self) -> bool:
        """A request has left and its outcome is not taken over yet."""
        return self._running is not None

    def wanted_end(self, now: int) -> int | None:
        """See the base class."""
        if self._running is not None:
            return None if self._ended is None else self._ended.end
        if self._call is not None:
            return max(self._earliest, self.engine.ready_at)
        return self._list.next_due() if self._owner is None else None

    def event(self, item: MasterEvent, now: int) -> None:
        """See the base class."""
        match item:
            case TransactionEnded():
                self._ended = item
            case ForeignFrame() | FrameRejected():
                pass  # the transaction goes on
            case _:
                assert_never(item)

    def release(self, now: int) -> None:
        """See the base class."""
        self._status.set_bit(RUNNING, 0)

    # -- many turns at once ------------------------------------------------------------------------

    @property
    def polls(self) -> Sequence[PollSpec]:
        """Its poll list."""
        return self._list.polls

    def leaves(self, end: int) -> bool:
        """Whether a poll's first attempt leaves at this END, of a port without an error."""
        first = self._list.running is not None and self._list.attempt == 1
        due = self._call is not None and max(self._earliest, self.engine.ready_at) <= end
        return first and due and not self._status.bit(COMMUNICATION_ERROR)

    def can_be_sent(self, poll: PollSpec) -> bool:
        """Whether RS2 can send a poll's request."""
        return self._obstacle(_call(poll)) is None

    def pass_turns(
        self, now: int, until: int, cycle: ScanCycle, load: int, longest: int, times: Sequence[Times]
    ) -> tuple[list[tuple[int, Turn]], list[CycleEnded]]:
        """Do the turns from the END ``now`` on, at which a request leaves, that are over before ``until``.

        ``longest`` is the longest scan without ``load``, by which a transaction lengthens it; ``times`` are
        those of each poll. What is read is not stored. Returns the turns with their polls' numbers in the
        list, and its cycles.
        """
        polls, turns, cycles = self._list, list[tuple[int, Turn]](), list[CycleEnded]()
        at = taken = now
        poll: PollSpec | None = None
        longest += load + max(each.asking + each.responded for each in times)
        while at + longest < until and len(turns) < _MOST and polls.running is not None:
            index = polls.running
            asking, begun, delays, jitter, responding, closing, quiet = times[index]
            begun += at + asking
            if delays is not None:
                begun += int(next(delays) * (jitter + 1))
            over = begun + responding
            cycle.set_load(at, load, now)
            taken = cycle.next_end(over + closing, now)
            cycle.set_load(taken, 0, now)
            for item in polls.ended(taken, None)[1]:
                if isinstance(item, CycleEnded):
                    cycles.append(item)
                else:
                    turns.append((index, Turn(at, begun, taken, item.start, item.late)))
            poll = polls.take(taken)
            while poll is None and (due := polls.next_due()) is not None:
                end = cycle.next_end(max(due, taken + 1), now)
                if end >= until:
                    break
                taken, poll = end, polls.take(end)
            if poll is not None:
                at = cycle.next_end(max(taken + 1, over + closing + self.engine.config.interval), now)
                if at < over + quiet:
                    break
        if turns:
            self._owner = self._call = None
            self._status.set_bit(RUNNING, 0)
            self._status.set_bit(TIMED_OUT, 0)
            if poll is not None:
                self._execute_poll(poll, taken)
        return turns, cycles

    def store(self, poll: PollSpec, values: Sequence[int]) -> None:
        """What a poll has read goes into memory."""
        if poll.device is not None:
            store(self._status.memory, poll.device, poll.function, values)

    # -- instructions ------------------------------------------------------------------------------

    def drive(self, instruction: Hashable, operands: Rs2, now: int) -> Drive:
        """See the base class. An instruction that has the port and waits may change its operands."""
        if self._owner is not None and self._owner != instruction:
            return Drive.BUSY
        self._owner = instruction
        if self._running is None:
            self._execute(modbus_call(operands, self._status.memory), now)
        return Drive.RUNNING

    def undrive(self, instruction: Hashable, now: int) -> None:
        """See the base class."""
        if self._owner == instruction:
            self._owner = None
            if self._call is not None:
                self._call = None
                self._status.set_bit(RUNNING, 0)

    def _execute(self, call: Call, earliest: int) -> None:
        self._call = call
        self._earliest = earliest
        self._status.set_bit(RUNNING, 1)

    def _next_poll(self, now: int) -> None:
        """The poll list executes for the scan that begins now."""
        if self._owner is not None:
            return
        poll = self._list.take(now)
        if poll is not None:
            self._execute_poll(poll, now)

    def _execute_poll(self, poll: PollSpec, now: int) -> None:
        self._owner = poll
        device, values = poll.device, poll.values
        if device is not None and poll.function in WRITES and fits(device, poll.function, len(values)):
            store(self._status.memory, device, poll.function, values)
        self._execute(_call(poll), now + 1)

    # -- END ---------------------------------------------------------------------------------------

    def at_end(self, end: int) -> int:
        """See the base class."""
        hints = 0
        again: PollSpec | None = None
        ended = self._ended
        if ended is not None:
            again = self._take_over(ended, end)
        elif self._call is not None and max(self._earliest, self.engine.ready_at) <= end:
            call, self._call = self._call, None
            self._running = call
            error = self._obstacle(call)
            if error is None:
                request = make_request(call.function, call.address, call.count, self._values(call))
                hints = self.engine.submit(call.station, request, end)
            else:
                again = self._take_over(_unsent(call, error, end), end)
        if again is not None:
            self._execute_poll(again, end)
        else:
            self._next_poll(end)
        return hints

    def _obstacle(self, call: Call) -> PortError | None:
        """Why RS2 cannot send a request.

        Beside the engine's own reasons: data that do not lie in memory are beyond the map (2), and a
        write whose poll has neither a device nor as many values as it writes cannot be taken (6).
        """
        error = refusal(call.station, Request(call.function, call.address, call.count), self._limits)
        if error is not None:
            return error
        if call.device is not None:
            return None if fits(call.device, call.function, call.count) else PortError.ADDRESS
        if call.function in WRITES and len(call.values) != call.count:
            return PortError.DATA
        return None

    @property
    def _limits(self) -> Limits:
        return self.engine.config.limits

    def _values(self, call: Call) -> Sequence[int]:
        if call.function not in WRITES:
            return ()
        if call.device is None:
            return call.values
        return fetch(self._status.memory, call.device, call.function, call.count)

    def _take_over(self, ended: TransactionEnded, end: int) -> PollSpec | None:
        """Results into memory; returns the poll that is to be tried again."""
        call, error, status = self._running, ended.error, self._status
        self._running = self._ended = None
        response = ended.response
        if response is not None and call is not None and call.device is not None and call.function in READS:
            store(status.memory, call.device, call.function, response.values)
        status.set_bit(RUNNING, 0)
        status.set_bit(COMMUNICATION_ERROR, int(error is not None))
        status.set_bit(TIMED_OUT, int(error is PortError.TIMEOUT))
        if error is None:
            status.good()
        else:
            status.failed(error, end)
        return self._report(ended, end)

    def _report(self, ended: TransactionEnded, end: int) -> PollSpec | None:
        polls, events = self._list, self._status.events
        if polls.running is None:
            events.append(TransactionTaken(end, "", 1, ended))
            return None
        name = polls.polls[polls.running].name
        events.append(TransactionTaken(end, name, polls.attempt, ended))
        again, over = polls.ended(end, ended.error)
        for item in over:
            match item:
                case PollEnded(tick, _, start, attempts, error, late):
                    events.append(TurnEnded(name, start, tick, attempts, error, late))
                case CycleEnded():
                    events.append(item)
                case _:
                    assert_never(item)
        self._owner = None
        return again


def _call(poll: PollSpec) -> Call:
    return Call(poll.station, poll.function, poll.address, poll.count, poll.device, poll.values)


def _unsent(call: Call, error: PortError, end: int) -> TransactionEnded:
    request = Request(call.function, call.address, call.count)
    return TransactionEnded(0, call.station, request, None, None, None, None, end, error, 0, None)

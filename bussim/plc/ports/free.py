"""A PLC's port under RS2's free protocol, and a list of instructions that drives it without a program.

The program's bits are read, and the port's shown, at END. A send request that is set in a scan sends at
the END which ends it, the data being those of that END, and is reset at the first END after the last
byte has left. While a reception is under way it waits, since the line is half-duplex (assumed, as in
the FX). Received bytes and "reception complete" appear at the first END after the reception was over.
Nothing is received until the program has reset that bit, seen at END too (PW10 board manual, section 5).
"""

from collections import deque
from collections.abc import Hashable, Sequence
from typing import assert_never

from bussim.engines.free.engine import MAX_BYTES, FreePort
from bussim.engines.free.events import CharacterDamaged, Ended, FreeEvent, Received, Sent
from bussim.engines.free.packing import pack, unpack
from bussim.engines.modbus.codes import PortError
from bussim.plc.ports.cpavl import COMPLETE, RECEIVED, RECEIVING, SEND_REQUEST, TIMED_OUT, TO_SEND, WAITING
from bussim.plc.ports.device_layout import fetch_words, store_words, words_fit
from bussim.plc.ports.events import FreeReceived, FreeSent
from bussim.plc.ports.free_list import FreeList
from bussim.plc.ports.rs2 import Drive, FreeCall, Rs2, free_call
from bussim.plc.ports.side import Side
from bussim.plc.ports.spec import FreeSpec
from bussim.plc.ports.status import PortStatus


class FreeSide(Side):
    """See the base class."""

    def __init__(
        self, engine: FreePort, status: PortStatus, specs: Sequence[FreeSpec], *, eight_bit: bool, now: int
    ) -> None:
        self.engine = engine
        self._status = status
        self._eight_bit = eight_bit
        self._list = FreeList(specs, engine.config.timeout, now)
        self._owner: Hashable | None = None  # the instruction that is executed with its contact on
        self._call: FreeCall | None = None  # what it asks for
        self._driven: Hashable | None = None  # the one that the engine runs, as of the latest END
        self._taken: FreeCall | None = None  # what that one asked for when it went on
        self._blocked = False  # it went on with "reception complete" still on
        self._sending = False
        self._complete = False  # "reception complete" is on for what was received
        self._acknowledge = False  # and the list resets it in this scan
        self._damage: PortError | None = None  # of the latest damaged character of the reception under way
        self._reported: deque[Sent | tuple[Received, PortError | None]] = deque()
        self._next = now + 1  # the earliest END that is still to come
        for bit in (WAITING, RECEIVING, TIMED_OUT):
            status.set_bit(bit, 0)
        if specs:
            status.set_bit(COMPLETE, 0)
        self._execute_list(now)

    @property
    def busy(self) -> bool:
        """Bytes are being sent, or a reception is under way, and END has not seen that it is over."""
        return self._sending or self.engine.receiving or bool(self._reported)

    def wanted_end(self, now: int) -> int | None:
        """See the base class."""
        if self._reported:
            return now
        shown = self.engine.receiving == bool(self._status.bit(RECEIVING))
        if self._owner != self._driven or self._acknowledge or not shown:
            return self._next
        if self._driven is not None:
            requested = self._status.bit(SEND_REQUEST) and not self._sending and not self.engine.receiving
            reset = (self._complete or self._blocked) and not self._status.bit(COMPLETE)
            if requested or reset:
                return self._next
        return None if self._programmed or self.engine.receiving else self._list.next_due()

    @property
    def _programmed(self) -> bool:
        """Whether a program's instruction is driven."""
        return self._owner is not None and self._owner != self._list.current

    @property
    def _name(self) -> str:
        """The name of the instruction that the engine runs, "" of a program's."""
        return self._driven.name if isinstance(self._driven, FreeSpec) else ""

    def event(self, item: FreeEvent, now: int) -> None:
        """See the base class."""
        match item:
            case Sent():
                self._reported.append(item)
            case Received():
                self._reported.append((item, self._damage))
                self._damage = None
            case CharacterDamaged(error=error):
                self._damage = error
            case _:
                assert_never(item)

    def release(self, now: int) -> None:
        """See the base class. What has been sent is reported; what no END has taken over is lost."""
        for item in self._reported:
            if isinstance(item, Sent):
                self._status.events.append(FreeSent(self._name, item))
        for bit in (WAITING, SEND_REQUEST, RECEIVING):
            self._status.set_bit(bit, 0)

    # -- instructions ------------------------------------------------------------------------------

    def drive(self, instruction: Hashable, operands: Rs2, now: int) -> Drive:
        """See the base class. How many bytes it receives is taken when it goes on, all else when it sends."""
        if self._owner is not None and self._owner != instruction:
            return Drive.BUSY
        self._owner = instruction
        self._call = free_call(operands, self._status.memory)
        return Drive.RUNNING

    def undrive(self, instruction: Hashable, now: int) -> None:
        """See the base class."""
        if self._owner == instruction:
            self._owner = self._call = None

    def _execute_list(self, now: int) -> None:
        """The list of instructions executes for the scan that begins now."""
        if self._programmed:
            return
        given_up = self._list.give_up(now, receiving=self.engine.receiving)
        if given_up is not None:
            self._status.events.append(given_up)
        spec, begun = self._list.execute(now, receiving=self.engine.receiving)
        self._owner = spec
        self._call = None if spec is None else call_of(spec)
        if spec is not None and begun:
            self._put(spec)
            self._status.set_bit(SEND_REQUEST, 1)

    def _put(self, spec: FreeSpec) -> None:
        if spec.data and spec.send is not None:
            words = pack(spec.data, eight_bit=self._eight_bit)
            if words_fit(spec.send, len(words)):
                store_words(self._status.memory, spec.send, words)

    # -- END ---------------------------------------------------------------------------------------

    def at_end(self, end: int) -> int:
        """See the base class."""
        self._next = end + 1
        status, engine = self._status, self.engine
        hints = 0
        if self._acknowledge:
            self._acknowledge = False
            status.set_bit(COMPLETE, 0)
        if (self._complete or self._blocked) and not status.bit(COMPLETE):
            hints |= self._reset(end)
        while self._reported:
            item = self._reported.popleft()
            if isinstance(item, Sent):
                self._sending = False
                status.set_bit(SEND_REQUEST, 0)
                status.events.append(FreeSent(self._name, item))
                self._list.sent(item.end)
            else:
                self._take_over(*item, end)
        if self._owner != self._driven:
            hints |= self._switch(end)
        if status.bit(SEND_REQUEST) and not self._sending and not engine.receiving:
            hints |= self._send(end)
        waits = status.bit(SEND_REQUEST) and self._driven is not None and not self._sending
        self._execute_list(end)
        status.set_bit(WAITING, waits)
        status.set_bit(RECEIVING, int(engine.receiving))
        status.set_word(TO_SEND, engine.left_to_send(end))
        status.set_word(RECEIVED, engine.received)
        return hints

    def _reset(self, end: int) -> int:
        """The program has reset "reception complete": the next reception may begin."""
        self._status.set_bit(TIMED_OUT, 0)
        if not self._blocked:
            self._complete = False
            return self.engine.reset_complete(end)
        self._blocked = False
        return self.engine.release(end) | self.engine.drive(self._expected, end)

    @property
    def _expected(self) -> int:
        count = self._taken.count if self._taken is not None else 0
        return count if count <= MAX_BYTES else 0

    def _take_over(self, received: Received, damage: PortError | None, end: int) -> None:
        status, call = self._status, self._taken
        status.events.append(FreeReceived(self._name, received))
        status.set_bit(COMPLETE, 1)
        status.set_bit(TIMED_OUT, int(received.ended is Ended.TIMEOUT))
        self._complete = True
        if call is not None and call.device is not None:
            words = pack(received.data, eight_bit=self._eight_bit)
            if words_fit(call.device, len(words)):
                store_words(status.memory, call.device, words)
            else:
                damage = PortError.ADDRESS
        if damage is not None:
            status.failed(damage, end)
        elif received.data:
            status.good()
        if self._driven is not None and self._driven == self._list.current:
            self._list.received()
        self._acknowledge = isinstance(self._driven, FreeSpec)

    def _switch(self, end: int) -> int:
        """Another instruction is driven now than at the END before, or none."""
        engine, hints = self.engine, 0
        if self._driven is not None:
            hints |= engine.release(end)
            self._sending = engine.left_to_send(end) > 0
            self._complete = self._blocked = False
            self._damage = None
        self._driven, self._taken = self._owner, self._call
        if self._taken is None:
            return hints
        if self._taken.count > MAX_BYTES:
            self._status.failed(PortError.DATA, end)
        self._blocked = bool(self._status.bit(COMPLETE))
        return hints | engine.drive(0 if self._blocked else self._expected, end)

    def _send(self, end: int) -> int:
        """The send request is set, and nothing keeps it from being carried out but itself."""
        call = self._call
        if self._driven is None or call is None:
            return 0
        error = self._obstacle(call)
        if error is not None:
            self._status.set_bit(SEND_REQUEST, 0)
            self._status.failed(error, end)
            self._list.sent(end)
            return 0
        self._sending = True
        return self.engine.send(self._bytes(call), end)

    def _words(self, count: int) -> int:
        return count if self._eight_bit else -(-count // 2)

    def _obstacle(self, call: FreeCall) -> PortError | None:
        """Why RS2 cannot send: more than 256 bytes (6), or registers that do not exist (2)."""
        if call.send_count > MAX_BYTES:
            return PortError.DATA
        if call.send is not None and not words_fit(call.send, self._words(call.send_count)):
            return PortError.ADDRESS
        return None

    def _bytes(self, call: FreeCall) -> bytes:
        if call.send is None:
            return call.data[: call.send_count]
        words = fetch_words(self._status.memory, call.send, self._words(call.send_count))
        return unpack(words, call.send_count, eight_bit=self._eight_bit)


def call_of(spec: FreeSpec) -> FreeCall:
    """What an instruction of the list asks for."""
    return FreeCall(spec.send, spec.send_count, spec.device, spec.count, spec.data)

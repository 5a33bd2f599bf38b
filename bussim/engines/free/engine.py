"""The free protocol of one port: RS2 with protocol 10H."""

from dataclasses import dataclass
from typing import NamedTuple

from bussim.engines.contract import DEADLINE, EVENTS, SERVE, TRANSMIT, Engine, RxChar
from bussim.engines.free.events import CharacterDamaged, Ended, FreeEvent, Received, Sent
from bussim.engines.free.states import FREE, FreeInput, FreeState
from bussim.engines.modbus.codes import PortError
from bussim.line.characters import LineTiming
from bussim.units import TICKS_PER_SECOND, round_half_up

#: Most bytes that one RS2 instruction sends or receives (PW10 board manual, section 5).
MAX_BYTES = 256


class FreeFrame(NamedTuple):
    """What is sent in one go."""

    chars: bytes


@dataclass(frozen=True, slots=True)
class FreeConfig:
    """A port's settings for the free protocol. Times in ticks.

    ``start`` and ``end`` are the characters that frame the data, 0 for none (CPAVL +4, +5): they are
    sent around the data, and on reception are neither counted nor kept unless ``keeps_frame`` (assumed).
    ``timeout`` (CPAVL +9 × 10 ms) ends a reception that was interrupted for so long; with
    ``awaits_first`` it also runs from the end of a transmission, or from where reception was made
    ready, to the first character (assumed not, as in the FX).
    """

    timing: LineTiming
    timeout: int = TICKS_PER_SECOND // 10
    start: int = 0
    end: int = 0
    awaits_first: bool = False
    keeps_frame: bool = False


class FreePort(Engine[FreeFrame, FreeEvent]):
    """One port under RS2 free protocol. See :mod:`bussim.engines.contract` for the methods.

    The hint SERVE: a reception has begun, which a PLC shows from its next END on. No frames are recognised:
    ``heard`` is always None.
    """

    def __init__(self, config: FreeConfig) -> None:
        super().__init__()
        self.config = config
        self.state = FreeState.STOPPED
        self._expected = 0
        self._clear()

    def _clear(self) -> None:
        self._data = bytearray()
        self._deadline: int | None = None
        self._out: bytes | None = None  # waits to be sent or is being sent
        self._sending = False
        self._begun = 0  # first edge of what is being sent
        self._start: int | None = None  # first edge of the reception
        self._framed = False  # the start character was received
        self._damaged = 0  # characters of the reception with parity or framing errors

    def _move(self, cause: FreeInput) -> None:
        self.state = FREE[self.state, cause]

    # -- what the PLC does ---------------------------------------------------------------------

    def start(self, now: int) -> int:
        """RUN; returns hints."""
        self._move(FreeInput.START)
        self._clear()
        return DEADLINE

    def stop(self, now: int) -> int:
        """STOP or power-off; returns hints."""
        self._move(FreeInput.STOP)
        self._clear()
        self.due = -1
        return DEADLINE

    def drive(self, expected: int, now: int) -> int:
        """An RS2 instruction is driven that receives ``expected`` bytes (0–256; 0: none at all).

        Returns hints. Raises ValueError for another number.
        """
        if not 0 <= expected <= MAX_BYTES:
            raise ValueError(f"{expected} bytes to receive, allowed 0…{MAX_BYTES}")
        self._expected = expected
        self._move(FreeInput.DRIVEN)
        return self._make_ready(now)

    def release(self, now: int) -> int:
        """The RS2 instruction is not driven any more: what waits or was received is forgotten.

        What is being sent goes on to its end.
        """
        self._move(FreeInput.RELEASED)
        self._data.clear()
        self._deadline = None
        if not self._sending:
            self._out = None
            self.due = -1
        return DEADLINE

    def reset_complete(self, now: int) -> int:
        """The program resets "reception complete": the next reception may begin; returns hints."""
        self._move(FreeInput.RESET)
        return self._make_ready(now)

    def _make_ready(self, now: int) -> int:
        self._data.clear()
        self._start = None
        self._framed = False
        self._damaged = 0
        waits = self.config.awaits_first and self._expected > 0
        self._deadline = now + self.config.timeout if waits else None
        return DEADLINE

    def send(self, data: bytes, now: int) -> int:
        """The program sets the send request: ``data`` leave at ``now``, framed; returns hints.

        Raises ValueError for more than 256 bytes, RuntimeError while something is still to be sent.
        """
        if len(data) > MAX_BYTES:
            raise ValueError(f"{len(data)} bytes to send, allowed 0…{MAX_BYTES}")
        if self._out is not None or self.state in (FreeState.STOPPED, FreeState.OFF):
            raise RuntimeError("the port is sending" if self._out is not None else "no RS2 is driven")
        config = self.config
        start = bytes((config.start & 0xFF,)) if config.start else b""
        end = bytes((config.end & 0xFF,)) if config.end else b""
        chars = start + data + end
        if not chars:
            self._events.append(Sent(now, now, b""))
            return EVENTS
        self._out = chars
        self.due = now
        if self.state is FreeState.READY:
            self._deadline = None  # it runs again from the end of the transmission
        return TRANSMIT | DEADLINE

    # -- what the registers of CPAVL show ------------------------------------------------------

    @property
    def waiting(self) -> bool:
        """Something waits to be sent (bit +1)."""
        return self._out is not None and not self._sending

    @property
    def receiving(self) -> bool:
        """A reception is under way (bit +4)."""
        return self.state is FreeState.RECEIVING

    @property
    def complete(self) -> bool:
        """A reception is complete (bit +3)."""
        return self.state is FreeState.COMPLETE

    @property
    def received(self) -> int:
        """Bytes received (word +3)."""
        return len(self._data)

    def left_to_send(self, now: int) -> int:
        """Bytes that have not completely left yet (word +2), start and end character included."""
        if self._out is None:
            return 0
        if not self._sending:
            return len(self._out)
        return max(0, len(self._out) - int((now - self._begun) / self.config.timing.character))

    # -- receiving -----------------------------------------------------------------------------

    def expects(self, chars: bytes) -> bytes | None:
        """Which of these characters it would take for a message; None: it is not ready to receive any."""
        if not self._expected or self.state not in (FreeState.READY, FreeState.RECEIVING):
            return None
        begin = chars.find(self.config.start) if self.config.start else 0
        if begin < 0:
            return b""
        end = chars.find(self.config.end, begin + 1) if self.config.end else -1
        return chars[begin : end + 1] if end >= 0 else chars[begin:]

    def receive(self, char: RxChar, start: int, end: int) -> int:
        """One character; see the contract."""
        if self.state not in (FreeState.READY, FreeState.RECEIVING) or self._expected == 0:
            return 0
        value, parity_ok, stop_ok = char
        clean = parity_ok and stop_ok
        config = self.config
        if not self._framed and config.start:
            if not clean or value != config.start:
                return 0
            self._framed = True
            hints = self._goes_on(start, end)
            return hints | self._keep(value, end) if config.keeps_frame else hints
        hints = self._goes_on(start, end)
        if clean and config.end and value == config.end:
            if config.keeps_frame:
                self._data.append(value)
            return hints | self._complete(end, Ended.END_CHARACTER)
        if not clean:
            error = PortError.RECEPTION if stop_ok else PortError.FRAMING
            self._events.append(CharacterDamaged(end, error, value))
            self._damaged += 1
            hints |= EVENTS
        return hints | self._keep(value, end)

    def _keep(self, value: int, end: int) -> int:
        self._data.append(value)
        return self._complete(end, Ended.COUNT) if len(self._data) == self._expected else 0

    def _goes_on(self, start: int, end: int) -> int:
        self._deadline = end + self.config.timeout
        if self.state is FreeState.RECEIVING:
            return DEADLINE
        self._move(FreeInput.BEGUN)
        self._start = start
        return DEADLINE | SERVE

    def receive_frame(self, frame: FreeFrame, start: int, end: int) -> int:
        """Undamaged characters back to back; the same as one by one."""
        character = self.config.timing.character
        hints, begun = 0, start
        for number, value in enumerate(frame.chars, 1):
            over = end if number == len(frame.chars) else start + round_half_up(character * number)
            hints |= self.receive(RxChar(value), begun, over)
            begun = over
        return hints

    def line_idle(self, now: int) -> int:
        """Nothing to do: only the timeout counts."""
        return 0

    def deadline(self) -> int | None:
        """When the reception times out."""
        return self._deadline

    def on_deadline(self, now: int) -> int:
        """The reception has timed out: what has come so far is all."""
        return 0 if self._deadline is None else self._complete(now, Ended.TIMEOUT)

    def _complete(self, now: int, ended: Ended) -> int:
        self._move(FreeInput.FULL)
        self._deadline = None
        data, config = bytes(self._data), self.config
        before = bytes((config.start & 0xFF,)) if self._framed and not config.keeps_frame else b""
        last = ended is Ended.END_CHARACTER and not config.keeps_frame
        chars = before + data + (bytes((config.end & 0xFF,)) if last else b"")
        self._events.append(Received(now, self._start, data, ended, chars, self._damaged))
        return EVENTS | DEADLINE

    # -- sending -------------------------------------------------------------------------------

    def begin_transmit(self, now: int, counter: int = 0) -> FreeFrame:
        """The bytes that wait. An open reception goes on: the program's data are no frames."""
        if self._out is None:
            raise RuntimeError("nothing waits to be sent")
        self.due = -1
        self._sending = True
        self._begun = now
        return FreeFrame(self._out)

    def transmit_done(self, now: int) -> int:
        """All bytes have left."""
        out = self._out
        if out is None or not self._sending:
            return 0
        self._out = None
        self._sending = False
        self._events.append(Sent(self._begun, now, out))
        if self.state is FreeState.READY and self.config.awaits_first and self._expected:
            self._deadline = now + self.config.timeout
        return EVENTS | DEADLINE

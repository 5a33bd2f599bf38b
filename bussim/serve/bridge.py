"""The bridge between a line of the simulation and a wire.

Out: a node's frame is written when it begins (paced: each byte when its last stop bit has left), after
faults and noise: the other side gets the characters that a receiver on the line would have read, without
those that it would have known to be wrong. In: every node of the line that is not sending receives.

Silences: an operating system passes bytes on in chunks, so that a pause inside a frame proves nothing. An
unfinished frame that is not a whole RTU frame ends only after the protocol's silence and the tolerance of
the wire's options; a chunk that comes before goes on where the one before it ended. Two chunks with a frame
of a node of this line between them are two frames, however short the pauses.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

from bussim.engines.contract import RxChar
from bussim.engines.modbus.adu import RTU_MAX, Adu, decode_rtu
from bussim.line.characters import LineTiming
from bussim.line.uart import Sampled, Uart
from bussim.line.wave import Wave
from bussim.live.arrival import Arrivals, Timed
from bussim.live.echo import Echo
from bussim.live.wire import Wire
from bussim.serve.external_frames import ExternalFrames
from bussim.serve.external_node import ExternalNode
from bussim.sim.kernel import SENDING, Kernel
from bussim.sim.serial.node import SerialNode
from bussim.sim.wire.contract import LineNode, Transmission
from bussim.units import TICKS_PER_SECOND, format_ms
from bussim.wording import counted

if TYPE_CHECKING:
    from bussim.serve.external_node import PartlyExternalLine


#: A silence that ends an unfinished frame and is longer by this factor than what may be in one was meant to.
_SAME_REQUEST = 4
#: How often it is reported at most (ticks).
_REPORT_EVERY = 10 * TICKS_PER_SECOND


class Bridge:
    """One wire and its line. Ticks are those of the kernel, whose clock the wire's clock drives."""

    def __init__(self, wire: Wire, kernel: Kernel) -> None:
        self.wire = wire
        self.line: PartlyExternalLine
        self.external_node: ExternalNode
        self._kernel = kernel
        self._arrivals = Arrivals(wire.timing)
        self._mask = (1 << wire.timing.format.data_bits) - 1
        self._timer = kernel.timer(self._write_due, SENDING)
        self._queue: deque[tuple[int, int]] = deque()  # (end, value) of characters that wait for their time
        self.echo = Echo(wire)
        self._open = bytearray()  # received since the line was idle, at most a little more than a frame
        self._last = 0  # when the last chunk was over
        self._sent_since = False  # a node of this line has sent since
        self._report_from = 0  # when the next frame that is given up may be reported
        self.frames: ExternalFrames | None = None

    def attach(self, line: PartlyExternalLine, kernel: Kernel) -> None:
        """Connect a line, whose nodes are not on its cable yet."""
        self.line = line
        self.external_node = ExternalNode(line, kernel)
        if line.sink.traced:
            self.frames = ExternalFrames(line, self.wire.timing, self.wire.options.tolerance)

    # -- out ---------------------------------------------------------------------------------------

    def send(self, tx: Transmission) -> None:
        """Write what a node begins to send."""
        if tx.silent:
            return
        if self.frames is not None:
            self.frames.cut()
        if tx.damaged or not tx.sender.nominal:
            read = read_transmission(tx, self.external_node.position, self.line.timing)
            sound = [char for char in read if char.parity_ok and char.stop_ok]
            chars, ends = bytes(char.value for char in sound), [char.end for char in sound]
        else:
            chars, ends = tx.chars, None
        if self._mask < 0xFF:
            chars = bytes(value & self._mask for value in chars)
        slave = isinstance(tx.sender, SerialNode) and tx.sender.kind == "response"
        self.echo.sent(chars, tx.frame, response=slave)
        if not (self.wire.options.paced or tx.pauses):
            if chars:
                self.wire.write(chars)
            return
        if ends is None:
            ends = [tx.start + tx.timing.characters(number) for number in range(1, len(chars) + 1)]
        self._queue.extend(zip(ends, chars, strict=True))
        if self._queue and self._timer.at < 0:
            self._timer.set(max(self._queue[0][0], self._kernel.now))

    def _write_due(self, now: int) -> None:
        queue, due = self._queue, bytearray()
        now = max(now, self.wire.clock.now())
        while queue and queue[0][0] <= now:
            due.append(queue.popleft()[1])
        if due:
            self.wire.write(bytes(due))
        if queue:
            self._timer.set(max(queue[0][0], self._kernel.now))

    def sent(self, now: int) -> None:
        """A node's transmission is over."""
        self._sent_since = True
        self._arrivals.busy_until = max(self._arrivals.busy_until, now)

    def cut(self) -> None:
        """A node's transmission is cut off: what was not written yet is dropped."""
        self.echo.unsent(len(self._queue))
        self._queue.clear()
        self._timer.cancel()

    # -- in ----------------------------------------------------------------------------------------

    def take(self, data: bytes, now: int, late: int) -> None:
        """Receive bytes that had come by ``now`` and were read ``late`` ticks later."""
        data = self.echo.without(data)
        if not data:
            return
        line, tolerance = self.line, self.wire.options.tolerance
        if not self._queue:
            self._finish_sending(now)
        character = line.character
        chars = self._arrivals.chunk(data, now, self.wire.characters)
        begun = late + (now - character if self.wire.instant else chars[0][1])
        self._separate(begun, now)
        self._open += data[: RTU_MAX + 1 - len(self._open)]
        if not line.drivers:
            line.busy += len(data) * character
        if self.frames is not None:
            self.frames.heard(chars)
        damaged = self._disturbed(chars, data)
        extra = 0 if self._whole() else tolerance
        for port in line.ports:
            if port.engine is None or port.driving:
                continue
            heard = chars
            if damaged is not None or not port.nominal:
                heard = self._as_received(port, damaged, chars, data)
            quiet_at = port.receiver.idle_at
            if 0 <= quiet_at <= begun:
                port.receiver.line_idle(now)
            elif quiet_at >= 0 and heard:
                char, _, end = heard[0]
                heard = [(char, min(self._last, end), end), *heard[1:]]
            port.receiver.receive_external(heard, now, port.quiet(port.timing) + extra + late)
        self._last = now + late

    def _finish_sending(self, now: int) -> None:
        """What nodes send has left already, since a reply came: its receivers have received all of it."""
        ports = self.line.ports
        for port in ports:
            tx = port.sending
            if tx is None:
                continue
            for other in ports:
                if other is not port and other.receiver.is_open:
                    other.receiver.replan(tx.end)
            port.finish_early(now)

    def _separate(self, begun: int, now: int) -> None:
        """End the unfinished frame if a node has sent since, or the line was idle for long enough."""
        line = self.line
        line.receive_by_character()
        if self._sent_since:
            self._sent_since = False
            self._open.clear()
            for port in line.ports:
                if port.engine is not None and not port.driving:
                    port.receiver.line_idle(now)
        elif self._open:
            quiet = max(
                (port.quiet(port.timing) for port in line.ports if port.engine is not None), default=0
            )
            silence, tolerance = begun - self._last, self.wire.options.tolerance
            if silence >= quiet + (0 if (whole := self._whole()) else tolerance):
                if not whole and self._rtu() and silence < _SAME_REQUEST * (quiet + tolerance):
                    self._given_up(silence, quiet + tolerance, now)
                self._open.clear()

    def _whole(self) -> bool:
        """Whether the bytes so far are a whole RTU frame, which its silence ends at once."""
        return self._rtu() and isinstance(decode_rtu(bytes(self._open)), Adu)

    def _rtu(self) -> bool:
        return any(self.line.protocol_of(port) == "modbus-rtu" for port in self.line.ports)

    def _given_up(self, silence: int, allowed: int, now: int) -> None:
        """Report a frame that was perhaps a request whose sender paused."""
        if now < self._report_from:
            return
        self._report_from = now + _REPORT_EVERY
        self.wire.report(
            f"{self.wire.url}: a frame was given up: behind its first "
            f"{counted(len(self._open), 'character')} nothing came for {format_ms(silence)}, at most "
            f"{format_ms(allowed)} are allowed; if it was a request with pauses, raise --tolerance, "
            f"which is {format_ms(self.wire.options.tolerance)}"
        )

    # -- noise and faults on what comes in -----------------------------------------------------------

    def _disturbed(self, chars: list[Timed], data: bytes) -> Transmission | None:
        """The chunk as a transmission with its damage; None where nothing damages it."""
        if not self.line.disturber.active:
            return None
        tx = self._transmission(chars, data)
        self.line.disturber.disturb(tx)
        return tx if tx.damaged else None

    def _transmission(self, chars: list[Timed], data: bytes) -> Transmission:
        start, timing = chars[0][1], self.line.timing
        end = start + timing.characters(len(data))
        return Transmission(
            self.external_node, None, bytes(value & self._mask for value in data), start, end, timing
        )

    def _as_received(
        self, port: LineNode, damaged: Transmission | None, chars: list[Timed], data: bytes
    ) -> list[Timed]:
        """The characters of a chunk as a port's receiver reads them from the line's level."""
        tx = damaged or self._transmission(chars, data)
        read = [
            RxChar(char.value, char.parity_ok, char.stop_ok)
            for char in read_transmission(tx, port.position, port.timing)
        ]
        fault = (tx.rx_chars or {}).get(port.position)
        if fault is not None:
            index, value = fault
            read[index : index + 1] = [] if value is None else [RxChar(value), *read[index : index + 1]]
        last = len(chars) - 1
        return [(char, *chars[min(index, last)][1:]) for index, char in enumerate(read)]


def read_transmission(tx: Transmission, position: int, timing: LineTiming) -> list[Sampled]:
    """What the receiver at a position reads of a transmission alone on its line."""
    uart, wave = Uart(timing), Wave([tx.lows(position)])
    read: list[Sampled] = []
    char = uart.next_character(wave, tx.start)
    while char is not None:
        read.append(char)
        char = uart.next_character(wave, char.ready)
    return read

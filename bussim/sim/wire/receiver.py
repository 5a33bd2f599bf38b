"""A port's receiver at times when the line is not clean: the real UART, character by character.

As long as whole undamaged frames follow each other, a node receives frames and its receiver stays
closed. It opens when that does not hold for the node: damage, a collision, a frame that began before the
node received, a wrong format. It then samples the line's level, and closes when the line is idle and no
frame is unfinished.
"""

from __future__ import annotations

from collections.abc import Sequence

from bussim.engines.contract import OPEN, RxChar
from bussim.line.characters import LineTiming
from bussim.line.contention import Driver, line_lows
from bussim.line.uart import Sampled, Uart
from bussim.line.wave import Wave, clip, paused_by
from bussim.sim.kernel import HEARING, Kernel
from bussim.sim.wire.contract import LineNode, Reading, Transmission, WireFrame


class _Part:
    """The part of a transmission that reaches one node: what lies between two ticks."""

    def __init__(self, tx: Transmission, since: int) -> None:
        self.tx = tx
        self.since = since
        self.until: int | None = None


class Receiver:
    """The receiver of one node. ``is_open``: it receives character by character."""

    def __init__(self, port: LineNode, kernel: Kernel, timing: LineTiming) -> None:
        self._port = port
        self._char_timer = kernel.timer(self._on_character, HEARING)
        self._idle_timer = kernel.timer(self._on_idle, HEARING)
        self.is_open = False
        #: When the latest character came that was not part of a whole undamaged frame.
        self.heard_at = -1
        self._parts: list[_Part] = []
        self._wave = Wave(())
        self._sampled: dict[int, Sampled | None] = {}  # what was read of it, by when the receiver was ready
        self._ready = 0
        self._last_end = 0
        self._next: Sampled | None = None
        self._frame_open = False
        self.set_timing(timing)

    def set_timing(self, timing: LineTiming) -> None:
        """Use another rate, format or clock from now on (an unfinished character is lost)."""
        self._uart = Uart(timing)
        self._quiet = self._port.quiet(timing)
        self._half_character = timing.characters(1) // 2

    @property
    def frame_open(self) -> bool:
        """Whether something unfinished waits for more characters, or for the line's silence."""
        return self._frame_open

    @property
    def idle_at(self) -> int:
        """When the silence that ends the unfinished frame is over if nothing more comes, -1 without one."""
        if not self._frame_open:
            return -1
        return self._idle_timer.at if self._idle_timer.at >= 0 else self._last_end + self._quiet

    # -- what comes from outside of the simulation ---------------------------------------------------

    def receive_external(self, chars: Sequence[tuple[RxChar, int, int]], now: int, silence: int) -> None:
        """Characters with their two ends come from outside, all of them over by ``now``.

        What they leave unfinished is over after ``silence`` ticks from now.
        """
        self.open(now)
        self._last_end = now
        for rx, start, end in chars:
            if self._port.engine is None:
                return
            self._receive(rx, start, end, now)
        if not self.is_open:
            return
        if self._frame_open:
            self._idle_timer.set(now + silence)
        else:
            self._idle_timer.cancel()
        self.settle()

    def line_idle(self, now: int) -> None:
        """The line has been idle for long enough: its bridge knows better than this receiver."""
        self._frame_open = False
        self._idle_timer.cancel()
        self._report_silence(now)

    # -- what is on the line -----------------------------------------------------------------------

    def open(self, ready: int) -> None:
        """Begin to receive character by character; the receiver waits for an edge from ``ready`` on."""
        if not self.is_open:
            self._port.line.hand_over(self._port)
            self.is_open = True
            self._ready = ready
            self._frame_open = False
            self._parts.clear()
            self._port.line.receiver_opened()

    def hold(self, now: int) -> None:
        """A whole frame left the engine's reader open: wait for the silence that ends it."""
        self.open(now)
        self._frame_open = True
        self._last_end = now
        self._idle_timer.set(now + self._quiet)

    def attach(self, tx: Transmission, since: int) -> None:
        """A transmission reaches this node from ``since`` on, if it does not already."""
        if not any(part.tx is tx and part.until is None for part in self._parts):
            self._parts.append(_Part(tx, since))

    def detach(self, tx: Transmission, until: int) -> None:
        """A transmission does not reach this node any more (cut cable), or ended there."""
        for part in self._parts:
            if part.tx is tx and part.until is None:
                part.until = until

    def replan(self, now: int) -> None:
        """The line has changed: find the next character anew, delivering what is complete by now."""
        parts = self._parts
        # What ended before the receiver looks for an edge cannot matter any more.
        ready = self._ready
        if len(parts) > 1:
            parts[:] = [p for p in parts if (p.tx.driven_until if p.until is None else p.until) > ready]
        self._wave, self._sampled = self._shared() or (self._wave_of(parts), {})
        self._plan()
        while self._next is not None and self._next.end <= now and self.is_open:
            self._deliver()
        if self.is_open and self._frame_open and self._idle_timer.at < 0:
            self._arm_idle()  # the character that was to come first may not come now

    def _wave_of(self, parts: Sequence[_Part]) -> Wave:
        return Wave([line_lows([self._driver(part) for part in parts], self._port.line.disputed)])

    def _shared(self) -> tuple[Wave, dict[int, Sampled | None]] | None:
        """The wave of the one transmission that reaches this node as others, and what they read of it."""
        *before, part = self._parts or (None,)
        if part is None or part.until is not None or part.since > part.tx.start or not self._port.nominal:
            return None
        for driver in map(self._driver, before):  # of what is over nothing may be left to read
            if driver.until > part.since or any(high > self._ready for _, high in driver.lows[-1:]):
                return None
        tx = part.tx
        if tx.rx_flips is not None and self._port.position in tx.rx_flips:
            return None
        if tx.sampled is None or tx.sampled[0] != tx.driven_until:
            tx.sampled = (tx.driven_until, self._wave_of([part]), {})
        return tx.sampled[1:]

    def _driver(self, part: _Part) -> Driver:
        """A part's driver, as far as it reaches this node."""
        tx, until = part.tx, self._until(part)
        off = tx.driven_until if part.until is None else min(part.until, tx.driven_until)
        lows = clip(tx.lows(self._port.position), part.since, until)
        return Driver((tx.start, tx.sender.name), part.since, off, lows, tx.timing, tx.pauses)

    @staticmethod
    def _until(part: _Part) -> int:
        end = part.tx.end
        return end if part.until is None else min(end, part.until)

    def _plan(self) -> None:
        ready, sampled = self._ready, self._sampled
        if ready not in sampled:
            sampled[ready] = self._uart.next_character(self._wave, ready)
        self._next = sampled[ready]
        if self._next is None:
            self._char_timer.cancel()
        else:
            self._char_timer.set(max(self._next.end, self._port.now))

    def reads_as(self, other: Receiver) -> bool:
        """Whether what reaches it is what reaches another one, too."""
        return self._sampled is other._sampled

    def coming(self, until: int) -> list[Sampled]:
        """The next characters that end before a tick, up to the first silence that would end a frame."""
        found: list[Sampled] = []
        char, last = self._next, until
        while char is not None and char.end < min(until, last + self._quiet):
            found.append(char)
            last, ready = char.end, char.ready
            if ready not in self._sampled:
                self._sampled[ready] = self._uart.next_character(self._wave, ready)
            char = self._sampled[ready]
        return found

    def passed(self, last: Sampled, *, frame_open: bool) -> None:
        """The engine has received the characters up to one ahead of their time."""
        self.heard_at = self._last_end = last.end
        self._ready, self._frame_open = last.ready, frame_open
        self._plan()
        if frame_open:
            self._arm_idle()

    # -- characters --------------------------------------------------------------------------------

    def _on_character(self, now: int) -> None:
        self._deliver()
        if self._next is None:
            self.settle()

    def _deliver(self) -> None:
        char = self._next
        if char is None:
            return
        self._ready = char.ready
        self._last_end = char.end
        self._next = None
        tx = self._parts[-1].tx if self._parts else None
        rx = RxChar(char.value, char.parity_ok, char.stop_ok)
        for each in (rx,) if tx is None or not tx.rx_chars else self._received(char, rx, tx):
            if self._port.engine is None:
                return
            self._receive(each, char.start, char.end, char.end)
        if not self.is_open:
            return
        self._plan()
        if self._frame_open:
            self._arm_idle()

    def _arm_idle(self) -> None:
        """Watch for the silence that ends the open frame, unless another character comes before."""
        at, coming = self._last_end + self._quiet, self._next
        if coming is not None and coming.end < at:
            self._idle_timer.cancel()
        else:
            self._idle_timer.set(max(at, self._port.now))

    def _receive(self, rx: RxChar, start: int, end: int, now: int) -> None:
        """Pass a character to the node's engine; what the engine asks for is done at ``now``."""
        port = self._port
        engine = port.engine
        self.heard_at = end
        engine.heard = None
        hints = engine.receive(rx, start, end)
        heard = engine.heard
        if heard is not None:
            self._accepted(heard, engine.heard_start, now, hints)
        self._frame_open = bool(hints & OPEN)
        hints &= ~OPEN
        if hints:
            port.handle(hints, now)

    def _received(self, char: Sampled, rx: RxChar, tx: Transmission) -> list[RxChar]:
        """The character as the node's software gets it: a receiver fault may lose or add one."""
        heard = [rx]
        fault = tx.rx_chars.get(self._port.position) if tx.rx_chars else None
        if fault is None:
            return heard
        index, value = fault
        at = char.start + self._half_character
        at -= tx.start + paused_by(at, tx.timing, tx.start, tx.pauses)
        if at // tx.timing.characters(1) != index:
            return heard
        return [] if value is None else [RxChar(value), *heard]

    def _accepted(self, frame: WireFrame, start: int, end: int, hints: int) -> None:
        """Report a valid frame that the engine has read to the line, with the node that really sent it."""
        true_sender: LineNode | None = None
        origin: Transmission | None = None
        for part in self._parts:
            tx = part.tx
            if tx.start < end:
                origin = tx
                # Its first edge is not the transmission's where a fault put a character before it.
                if tx.frame is not None and tx.start <= start < tx.end and tx.frame.chars == frame.chars:
                    true_sender = tx.sender
                    break
        self._port.line.accepted(Reading(self._port, frame, start, end, true_sender, origin, hints))

    def _on_idle(self, now: int) -> None:
        coming = self._next
        if coming is not None and coming.start < now:
            # A character has begun: no silence, unless a cut makes nothing of it.
            self._idle_timer.set(coming.end + self._quiet)
            return
        if now - self._last_end < self._quiet:
            return
        self._frame_open = False
        self._report_silence(now)

    def _report_silence(self, now: int) -> None:
        engine = self._port.engine
        if engine is not None:
            engine.heard = None
            hints = engine.line_idle(now)
            if engine.heard is not None:
                self._accepted(engine.heard, engine.heard_start, self._last_end, hints)
            self._port.handle(hints, now)
        self.settle()

    # -- the end of it -----------------------------------------------------------------------------

    def settle(self) -> None:
        """Close if the line is idle and no frame is unfinished."""
        if self._frame_open or self._next is not None or not self.is_open:
            return
        now = self._port.now
        for part in self._parts:
            if self._until(part) > now:
                return
        self.close()

    def close(self) -> None:
        """Stop receiving character by character: line idle, own driver on, or STOP."""
        if self.is_open:
            self.is_open = False
            self._parts.clear()
            self._next = None
            self._frame_open = False
            self._char_timer.cancel()
            self._idle_timer.cancel()
            self._port.line.receiver_closed()

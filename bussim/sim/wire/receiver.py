"""A port's receiver at times when the line is not clean: the real UART, character by character.

As long as whole undamaged frames follow each other, a port is told of frames. An receiver opens when that
does not hold for a port: damage, a collision, a frame that began before it listened, a wrong format.
It then watches the line's level, and closes when the line is quiet and nothing is half heard.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from bussim.engines.contract import OPEN, STORED, RxChar
from bussim.line.characters import LineTiming
from bussim.line.uart import Sampled, Uart
from bussim.line.wave import Wave, clip
from bussim.sim.kernel import HEARING, Kernel
from bussim.sim.wire.transmission import Transmission, WireFrame

if TYPE_CHECKING:
    from bussim.sim.wire.node import Node


class _Piece:
    """A transmission as one port hears it: only between two ticks."""

    __slots__ = ("since", "tx", "until")

    def __init__(self, tx: Transmission, since: int) -> None:
        self.tx = tx
        self.since = since
        self.until: int | None = None


class Receiver:
    """The receiver of one node. ``is_open`` tells whether it listens character by character."""

    __slots__ = (
        "_char_timer",
        "_half_character",
        "_half_heard",
        "_last_end",
        "_next",
        "_pieces",
        "_port",
        "_quiet",
        "_quiet_timer",
        "_ready",
        "_uart",
        "_wave",
        "is_open",
    )

    def __init__(self, port: Node, kernel: Kernel, timing: LineTiming) -> None:
        self._port = port
        self._char_timer = kernel.timer(self._on_character, HEARING)
        self._quiet_timer = kernel.timer(self._on_quiet, HEARING)
        self.is_open = False
        self._pieces: list[_Piece] = []
        self._wave = Wave(())
        self._ready = 0
        self._last_end = 0
        self._next: Sampled | None = None
        self._half_heard = False
        self.set_timing(timing)

    def set_timing(self, timing: LineTiming) -> None:
        """Use another rate, format or clock from now on (what is half heard is lost)."""
        self._uart = Uart(timing)
        self._quiet = self._port.quiet(timing)
        self._half_character = timing.characters(1) // 2

    @property
    def half_heard(self) -> bool:
        """Whether something unfinished waits for more, or for the line's quiet."""
        return self._half_heard

    @property
    def quiet_at(self) -> int:
        """When what is half heard is over if nothing more comes; -1 while nothing is half heard."""
        return self._quiet_timer.at if self._half_heard else -1

    # -- what comes from outside of the simulation ---------------------------------------------------

    def overhear(self, chars: Sequence[tuple[RxChar, int, int]], now: int, silence: int) -> None:
        """Characters with their two ends come from outside, all of them over by ``now``.

        What they leave half heard is over after ``silence`` ticks from now.
        """
        self.open(now)
        self._last_end = now
        for rx, start, end in chars:
            if self._port.engine is None:
                return
            self.feed(rx, start, end, now)
        if not self.is_open:
            return
        if self._half_heard:
            self._quiet_timer.set(now + silence)
        else:
            self._quiet_timer.cancel()
        self.settle()

    def line_quiet(self, now: int) -> None:
        """The line has been quiet for long enough, as somebody knows who hears more than this receiver."""
        self._half_heard = False
        self._quiet_timer.cancel()
        self._tell_quiet(now)

    # -- what is on the line -----------------------------------------------------------------------

    def open(self, ready: int) -> None:
        """Begin to listen character by character; the receiver waits for an edge from ``ready`` on."""
        if not self.is_open:
            self._port.line.listens_alone(self._port)
            self.is_open = True
            self._ready = ready
            self._half_heard = False
            self._pieces.clear()
            self._port.line.receiver_opened()

    def hold(self, now: int) -> None:
        """A whole frame left the engine's reader half open: watch for the line's quiet."""
        self.open(now)
        self._half_heard = True
        self._last_end = now
        self._quiet_timer.set(now + self._quiet)

    def hear(self, tx: Transmission, since: int) -> None:
        """A transmission reaches this port from ``since`` on."""
        self._pieces.append(_Piece(tx, since))

    def unhear(self, tx: Transmission, until: int) -> None:
        """A transmission does not reach this port any more (cut cable), or ended there."""
        for piece in self._pieces:
            if piece.tx is tx and piece.until is None:
                piece.until = until

    def replan(self, now: int) -> None:
        """The line has changed: find the next character anew, delivering what is complete by now."""
        pieces = self._pieces
        # What ended before the receiver looks for an edge cannot matter any more.
        ready = self._ready
        if len(pieces) > 1:
            pieces[:] = [p for p in pieces if (p.tx.end if p.until is None else p.until) > ready]
        self._wave = Wave(
            clip(piece.tx.lows(self._port.position), piece.since, self._until(piece)) for piece in pieces
        )
        self._plan()
        while self._next is not None and self._next.end <= now and self.is_open:
            self._deliver()

    @staticmethod
    def _until(piece: _Piece) -> int:
        end = piece.tx.end
        return end if piece.until is None else min(end, piece.until)

    def _plan(self) -> None:
        self._next = self._uart.next_character(self._wave, self._ready)
        if self._next is None:
            self._char_timer.cancel()
        else:
            self._char_timer.set(max(self._next.end, self._port.now))

    # -- characters --------------------------------------------------------------------------------

    def _on_character(self, now: int) -> None:
        del now
        self._deliver()
        self.settle()

    def _deliver(self) -> None:
        char = self._next
        if char is None:
            return
        self._ready = char.ready
        self._last_end = char.end
        self._next = None
        for rx in self._received(char):
            if self._port.engine is None:
                return
            self.feed(rx, char.start, char.end, char.end)
        if not self.is_open:
            return
        if self._half_heard:
            self._quiet_timer.set(max(char.end + self._quiet, self._port.now))
        self._plan()

    def feed(self, rx: RxChar, start: int, end: int, now: int) -> None:
        """The node's engine hears a character, and what comes of it is done at ``now``."""
        port = self._port
        engine = port.engine
        engine.heard = None
        hints = engine.receive(rx, start, end)
        heard = engine.heard
        if heard is not None:
            self._accepted(heard, engine.heard_start, now, stored=bool(hints & STORED))
        self._half_heard = bool(hints & OPEN)
        port.handle(hints & ~(OPEN | STORED), now)

    def _received(self, char: Sampled) -> list[RxChar]:
        """The character as the port's software gets it: a receiver fault may lose or add one."""
        heard = [RxChar(char.value, char.parity_ok, char.stop_ok)]
        tx = self._pieces[-1].tx if self._pieces else None
        fault = tx.rx_chars.get(self._port.position) if tx is not None and tx.rx_chars else None
        if tx is None or fault is None:
            return heard
        index, value = fault
        if (char.start - tx.start + self._half_character) // tx.timing.characters(1) != index:
            return heard
        return [] if value is None else [RxChar(value), *heard]

    def _accepted(self, frame: WireFrame, start: int, end: int, *, stored: bool) -> None:
        """A valid frame was read: is it one that somebody sent? And does its block go anywhere?"""
        true_sender: Node | None = None
        blamed: Transmission | None = None
        for piece in self._pieces:
            tx = piece.tx
            if tx.start < end:
                blamed = tx
                # Its first edge is not the transmission's where a fault put a character before it.
                if tx.frame is not None and tx.start <= start < tx.end and tx.frame.chars == frame.chars:
                    true_sender = tx.sender
                    break
        self._port.line.accepted(self._port, frame, start, end, true_sender, blamed, stored=stored)

    def _on_quiet(self, now: int) -> None:
        coming = self._next
        if coming is not None and coming.start < now:
            # A character has begun: not quiet, unless a cut makes nothing of it.
            self._quiet_timer.set(coming.end + self._quiet)
            return
        if now - self._last_end < self._quiet:
            return
        self._half_heard = False
        self._tell_quiet(now)

    def _tell_quiet(self, now: int) -> None:
        engine = self._port.engine
        if engine is not None:
            engine.heard = None
            hints = engine.line_idle(now)
            if engine.heard is not None:
                self._accepted(engine.heard, engine.heard_start, self._last_end, stored=False)
            self._port.handle(hints, now)
        self.settle()

    # -- the end of it -----------------------------------------------------------------------------

    def settle(self) -> None:
        """Close if the line is quiet and nothing is half heard."""
        if self._half_heard or self._next is not None or not self.is_open:
            return
        now = self._port.now
        for piece in self._pieces:
            if self._until(piece) > now:
                return
        self.close()

    def close(self) -> None:
        """Stop listening character by character: line quiet, own driver on, or STOP."""
        if self.is_open:
            self.is_open = False
            self._pieces.clear()
            self._next = None
            self._half_heard = False
            self._char_timer.cancel()
            self._quiet_timer.cancel()
            self._port.line.receiver_closed()

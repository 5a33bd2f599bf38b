"""One frame on the wire, and what of it each receiver gets to hear."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol

from bussim.line.characters import LineTiming
from bussim.line.wave import Interval, low_intervals

if TYPE_CHECKING:
    from bussim.sim.wire.node import Node

Bits = tuple[int, ...]


class WireFrame(Protocol):
    """A frame of any protocol, as far as a line is concerned."""

    @property
    def chars(self) -> bytes:
        """Its characters on the wire."""


class Transmission:
    """Characters that one node sends. ``frame`` is what they mean, None for jabber.

    ``chars`` are the characters on the wire, which a fault may have made other than the frame's.
    ``end`` moves when the sender is cut off. ``listeners`` hear it whole and undamaged and are told
    at its end; everybody else hears it, or parts of it, character by character.
    """

    # What most frames never change stands here, not in each of them.
    flips: Bits = ()  # bits inverted for everybody
    rx_flips: dict[int, Bits] | None = None  # bits inverted for one position only
    # Characters that one position's receiver loses (value None) or adds: (place, value).
    rx_chars: dict[int, tuple[int, int | None]] | None = None
    damaged = False  # something above is set, or ``chars`` are not the frame's
    collided = False
    cut = False
    silent = False  # nothing of it reaches the wire
    believed = False  # some receiver took it for another frame
    shared = 0  # how many more hear it together, in the bus's shared listener
    listeners: tuple[tuple[Node, Callable[[Any, int, int], int]], ...] = ()
    _lows: dict[Bits, list[Interval]] | None = None

    def __init__(
        self, sender: Node, frame: WireFrame | None, chars: bytes, start: int, end: int, timing: LineTiming
    ) -> None:
        self.sender = sender
        self.frame = frame
        self.chars = chars
        self.start = start
        self.end = end
        self.timing = timing

    def set_chars(self, chars: bytes) -> None:
        """Send these characters; the end follows, rounded once from the first edge."""
        if chars is not self.chars:
            self.chars = chars
            self.damaged = True
        timing = self.timing
        self.end = self.start + timing.bits(len(chars) * timing.format.bits)

    @property
    def corrupted(self) -> bool:
        """Whether what reaches the wire is not the frame: for everybody."""
        return bool(self.flips) or self.frame is None or self.chars is not self.frame.chars

    def invert(self, position: int | None, bits: Bits) -> None:
        """Turn bits round: for everybody (None) or in one position's receiver."""
        self.damaged = True
        if position is None:
            self.flips = tuple(sorted(set(self.flips) ^ set(bits)))
            return
        if self.rx_flips is None:
            self.rx_flips = {}
        self.rx_flips[position] = tuple(sorted(set(self.rx_flips.get(position, ())) ^ set(bits)))

    def miscount(self, position: int, index: int, value: int | None) -> None:
        """One position's receiver loses the character at a place (value None), or adds one before it."""
        self.damaged = True
        if self.rx_chars is None:
            self.rx_chars = {}
        self.rx_chars[position] = (index, value)

    def drop(self, port: Node) -> bool:
        """A port does not hear this as a whole frame after all; returns whether it would have."""
        for place, (listener, _) in enumerate(self.listeners):
            if listener is port:
                self.listeners = self.listeners[:place] + self.listeners[place + 1 :]
                return True
        return False

    def lows(self, position: int) -> list[Interval]:
        """Where a position's receiver sees the line pulled low by this transmission, the cut left out."""
        flips = self.flips
        if self.rx_flips is not None:
            own = self.rx_flips.get(position)
            if own:
                # A bit inverted on the wire and again in the receiver is right once more.
                flips = tuple(sorted(set(flips) ^ set(own)))
        if self._lows is None:
            self._lows = {}
        found = self._lows.get(flips)
        if found is None:
            found = self._lows[flips] = low_intervals(self.chars, self.timing, self.start, flips)
        return found

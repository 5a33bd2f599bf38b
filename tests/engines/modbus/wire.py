"""A wire in virtual time between engines: the least driver that keeps the contract."""

from __future__ import annotations

from collections.abc import Callable
from heapq import heappop, heappush
from typing import Any

from bussim.engines.contract import OPEN, RxChar, Transmit
from bussim.line.characters import CharFormat, LineTiming

RTU_LINE = LineTiming(9600, CharFormat(8, "N", 1))
ASCII_LINE = LineTiming(9600, CharFormat(7, "E", 1))

# Order within one tick: what was heard, then silences and deadlines, then what is sent.
RECEPTION, TIMERS, SENDING = range(3)


class Wire:
    """Engines on one line. No engine hears itself; ``whole`` delivers frames, else characters.

    Collisions are not modelled: the tests that use it do not collide.
    """

    def __init__(self, timing: LineTiming, *, whole: bool) -> None:
        self.timing = timing
        self.whole = whole
        self.now = 0
        self.events: list[tuple[Any, Any]] = []  # (engine, event) in order
        self.sent: list[tuple[int, Any, bytes]] = []  # (first edge, engine, characters)
        self._engines: list[Any] = []
        self._open: dict[Any, bool] = {}
        self._last_heard: dict[Any, int] = {}
        self._queue: list[tuple[int, int, int, Callable[[], None]]] = []
        self._order = 0

    def add(self, engine: Any) -> None:
        self._engines.append(engine)
        self._open[engine] = False
        self._last_heard[engine] = 0

    def at(self, tick: int, rank: int, action: Callable[[], None]) -> None:
        self._order += 1
        heappush(self._queue, (tick, rank, self._order, action))

    def run(self, until: int) -> None:
        while self._queue and self._queue[0][0] <= until:
            tick, _, _, action = heappop(self._queue)
            assert tick >= self.now
            self.now = tick
            action()
        self.now = until

    def handle(self, engine: Any, hints: int) -> None:
        """What a driver does with hints; it may always ask for everything."""
        self._open[engine] = bool(hints & OPEN)
        while (item := engine.poll()) is not None:
            if isinstance(item, Transmit):
                self.at(max(item.at, self.now), SENDING, lambda item=item: self._send(engine, item))
            else:
                self.events.append((engine, item))
        deadline = engine.deadline()
        if deadline is not None:
            self.at(max(deadline, self.now), TIMERS, lambda: self._deadline(engine, deadline))
        if self._open[engine]:
            heard = self._last_heard[engine]
            self.at(heard + engine.quiet, TIMERS, lambda: self._quiet(engine, heard))

    def _deadline(self, engine: Any, at: int) -> None:
        if engine.deadline() == at:
            self.handle(engine, engine.on_deadline(self.now))

    def _quiet(self, engine: Any, heard: int) -> None:
        if self._open[engine] and self._last_heard[engine] == heard:
            self.handle(engine, engine.line_idle(self.now))

    def _send(self, engine: Any, item: Transmit) -> None:
        frame = engine.begin_transmit(self.now, item.counter)
        self.sent.append((self.now, engine, frame.chars))
        self._open[engine] = False
        start, timing = self.now, self.timing
        ends = [start + timing.characters(number + 1) for number in range(len(frame.chars))]
        others = [other for other in self._engines if other is not engine]

        def deliver(other: Any) -> None:
            self._last_heard[other] = self.now
            self.handle(other, other.receive_frame(frame, start, self.now))

        def receive_by_character(other: Any, number: int) -> None:
            self._last_heard[other] = self.now
            begun = start + timing.characters(number)
            self.handle(other, other.receive(RxChar(frame.chars[number]), begun, self.now))

        for other in others:
            if self.whole and not self._open[other]:
                self.at(ends[-1], RECEPTION, lambda other=other: deliver(other))
            else:
                for number, end in enumerate(ends):
                    self.at(
                        end, RECEPTION, lambda other=other, number=number: receive_by_character(other, number)
                    )
        self.at(ends[-1], TIMERS, lambda: self.handle(engine, engine.transmit_done(self.now)))


def receive_by_character(engine: Any, chars: bytes, start: int, timing: LineTiming) -> tuple[int, int]:
    """Characters back to back into one engine; returns (all hints, end of the last one)."""
    hints, end = 0, start
    for number, value in enumerate(chars):
        end = start + timing.characters(number + 1)
        hints |= engine.receive(RxChar(value), start + timing.characters(number), end)
    return hints, end


def drain(engine: Any) -> list[Any]:
    """All that an engine's poll returns."""
    items = []
    while (item := engine.poll()) is not None:
        items.append(item)
    return items

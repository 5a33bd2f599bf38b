"""Runs one protocol engine on one port in real time."""

from collections import deque
from collections.abc import Callable
from typing import Any

from bussim.engines.contract import OPEN, Engine, Transmit
from bussim.engines.modbus.adu import RTU_MAX, Adu, Mode, decode_rtu
from bussim.engines.modbus.slave import Slave
from bussim.live.arrival import Timed
from bussim.live.clock import Lateness
from bussim.live.port import LivePort
from bussim.live.wire import Wire
from bussim.units import TICKS_PER_MS

#: How long a step waits at most, so that a request to stop is noticed.
PATIENCE = 50 * TICKS_PER_MS


class Handling:
    """What happens to an engine's transmissions and events; to be overridden where more is wanted."""

    lateness: Lateness

    def prepare(self, engine: Any, now: int) -> None:
        """Set the block that an N:N engine's next frame carries; the frame begins at ``now``."""

    def when(self, transmit: Transmit, now: int) -> int | None:
        """When a transmission is to leave, None for never (a reply that a fault swallows)."""
        return transmit.at

    def chars(self, frame: Any) -> bytes:
        """What is really sent in place of a frame."""
        own: bytes = frame.chars
        return own

    def event(self, event: Any, now: int) -> None:
        """The engine reports something."""


class EngineRunner:
    """An engine on a wire. One thread calls :meth:`run` or :meth:`step`.

    ``quiet`` is the silence after which the engine's line_idle is called, by the protocol.
    While what is open is not a whole RTU frame (``mode`` RTU), the tolerance of the wire's options is
    added: its next bytes may be held back by the system. When the port is lost the engine is
    stopped, and it is started anew when the port is back.
    """

    def __init__(
        self,
        engine: Engine[Any, Any],
        wire: Wire,
        *,
        quiet: int,
        mode: Mode | None,
        handling: Handling | None = None,
    ) -> None:
        self.engine = engine
        self.clock = wire.clock
        self.port = LivePort(
            wire,
            on_chars=self._chars,
            on_sent=self._sent,
            on_lost=self._lost,
            on_back=self._back,
            slave=isinstance(engine, Slave),
        )
        self._quiet = quiet
        self._tolerance = wire.options.tolerance
        self._rtu = mode is Mode.RTU
        self._handling = handling or Handling()
        self._handling.lateness = Lateness()
        self._pending: deque[tuple[int, int]] = deque()  # (when, counter) of transmissions that are due
        self._on_air = False
        self._open = bytearray()  # what is open, of RTU
        self._opened = False
        self._quiet_end = 0  # when it is over, if nothing more comes
        self._running = False
        self._planned = self.clock.now()

    def start(self) -> None:
        """Open the port and start the engine. Raises UsageError if the port cannot be opened."""
        self.port.wire.open()
        self._planned = self.clock.now()
        self._back(self.clock.now())

    def close(self) -> None:
        """Stop the engine and close the port."""
        if self._running:
            self._running = False
            self.engine.stop(self.clock.now())
            self._collect()
        self.port.wire.close()

    def run(self, stopped: Callable[[], bool]) -> None:
        """Run until ``stopped`` is true, which is called at least twenty times a second."""
        while not stopped():
            self.step(self.clock.now() + PATIENCE)

    def step(self, until: int) -> None:
        """Do what is due, and wait for something to happen, at the longest until a tick."""
        self._begin()
        self._planned = min(until, self._next())
        heard = self.port.step(self._planned)
        # What was heard up to now comes before a deadline that is over: it may be more than one chunk.
        for _ in range(_MORE_CHUNKS):
            if not heard:
                break
            heard = self.port.step(self.clock.now())
        if self._running:
            self._timers(self.clock.now())
        self._note_lateness(self.clock.now())

    def _note_lateness(self, now: int) -> None:
        self._handling.lateness.add(max(0, now - self._planned), now)

    # -- what is due ---------------------------------------------------------------------------

    def _next(self) -> int:
        times = [_NEVER]
        if self._running:
            deadline = self.engine.deadline()
            if deadline is not None:
                times.append(deadline)
            if self._opened:
                times.append(self._quiet_end)
            if self._pending and not self._on_air:
                times.append(self._pending[0][0])
        return min(times)

    def _silence(self) -> int:
        """The silence that ends what is open."""
        whole = self._rtu and isinstance(decode_rtu(bytes(self._open)), Adu)
        return self._quiet if whole else self._quiet + self._tolerance

    def _timers(self, now: int) -> None:
        if self._opened and not self._on_air and self._quiet_end <= now:
            self._quieted()
            self.engine.line_idle(now)
            self._collect()
        deadline = self.engine.deadline()
        if deadline is not None and deadline <= now:
            self.engine.on_deadline(now)
            self._collect()

    def _begin(self) -> None:
        if self._on_air or not self._pending or not self._running:
            return
        at, counter = self._pending[0]
        now = self.clock.now()
        if at > now:
            return
        self._pending.popleft()
        self._on_air = True
        self._quieted()
        self._handling.prepare(self.engine, now)
        frame = self.engine.begin_transmit(now, counter)
        chars = self._handling.chars(frame)
        if chars:
            self.port.send(chars, now, frame)
        else:
            self._sent(now, now)

    def _collect(self) -> None:
        """Take over what the engine wants. In real time asking costs nothing: hints are not read."""
        now = self.clock.now()
        self._note_lateness(now)
        while (item := self.engine.poll()) is not None:
            if isinstance(item, Transmit):
                at = self._handling.when(item, now)
                if at is not None:
                    self._pending.append((at, item.counter))
                else:
                    give_up = getattr(self.engine, "give_up_reply", None)
                    if give_up is not None:
                        give_up(now)
            else:
                self._handling.event(item, now)

    # -- events of the port -------------------------------------------------------------------

    def _chars(self, chars: list[Timed]) -> None:
        if not self._running:
            return
        if self._opened and not self._on_air and chars[0][1] >= self._quiet_end:
            # It ended by its silence between two steps.
            self._quieted()
            self.engine.line_idle(self._quiet_end)
        receive, hints = self.engine.receive, 0
        for char, start, end in chars:
            hints = receive(char, start, end)
        if hints & OPEN:
            self._opened = True
            if self._rtu:
                self._note_open(chars)
            self._quiet_end = chars[-1][2] + self._silence()
        else:
            self._quieted()
        self._collect()

    def _note_open(self, chars: list[Timed]) -> None:
        # One character more than a frame can have: then it is none, however many follow.
        room = RTU_MAX + 1 - len(self._open)
        self._open += bytes(char.value for char, _, _ in chars[: max(room, 0)])

    def _quieted(self) -> None:
        self._opened = False
        self._open.clear()

    def _sent(self, start: int, end: int) -> None:
        self._on_air = False
        if self._running:
            self.engine.transmit_done(end)
            self._collect()

    def _lost(self, now: int) -> None:
        if self._running:
            self._running = False
            self.engine.stop(now)
            self._collect()
        self._pending.clear()
        self._on_air = False
        self._quieted()

    def _back(self, now: int) -> None:
        self._running = True
        self.engine.start(now)
        self._collect()


_NEVER = 1 << 62
#: Chunks that are taken before a deadline that is over has its turn: four times the longest frame.
_MORE_CHUNKS = 4

"""A port in real time: characters with their times in, transmissions at their times out."""

from collections import deque
from collections.abc import Callable

from bussim.live.arrival import Arrivals, Timed
from bussim.live.echo import Echo
from bussim.live.wire import Wire


class LivePort:
    """Drives one :class:`~bussim.live.wire.Wire`; a single thread calls :meth:`step` again and again.

    ``on_chars`` gets what was received, chunk by chunk. ``on_sent(first_edge, end)`` is called when a
    transmission has left; on a wire that takes its time that is worked out from rate and format. If
    another node is heard before, all of it had left already. ``on_lost`` and ``on_back`` are called
    with the tick; what was to be sent is forgotten then. ``slave``: what it sends are responses.
    """

    def __init__(
        self,
        wire: Wire,
        *,
        on_chars: Callable[[list[Timed]], None],
        on_sent: Callable[[int, int], None] = lambda _start, _end: None,
        on_lost: Callable[[int], None] = lambda _now: None,
        on_back: Callable[[int], None] = lambda _now: None,
        slave: bool = False,
    ) -> None:
        self.wire = wire
        self.clock = wire.clock
        self._timing = wire.timing
        self._arrivals = Arrivals(wire.timing)
        self._on_chars = on_chars
        self._on_sent = on_sent
        self._on_lost = on_lost
        self._on_back = on_back
        self._mask = (1 << wire.timing.format.data_bits) - 1
        self._queue: deque[tuple[int, bytes, object]] = deque()
        # What is being sent: its bytes, how many of them the system has, first edge and end.
        self._out = b""
        self._written = 0
        self._start = 0
        self._end: int | None = None
        self.echo = Echo(wire)
        self._slave = slave

    @property
    def sending(self) -> bool:
        """Whether a transmission is under way or waits for its time."""
        return self._end is not None or bool(self._queue)

    @property
    def busy_until(self) -> int:
        """End of what was heard or sent last."""
        return self._arrivals.busy_until

    def send(self, chars: bytes, at: int, frame: object = None) -> None:
        """Send a frame at the tick ``at``, or now if that is past, after what was to be sent before."""
        if chars:
            mask = self._mask
            plain = chars if mask == 0xFF else bytes(value & mask for value in chars)
            self._queue.append((at, plain, frame))

    def step(self, until: int) -> bool:
        """Do what is due and wait for bytes, at the longest until a tick; whether any were heard."""
        wire = self.wire
        if not wire.connected:
            wire.read(until)
            if wire.connected:
                self._on_back(self.clock.now())
            return False
        wake = self._transmit(until)
        data = wire.read(min(until, wake)) if wire.connected else b""
        if data:
            self._heard(data, self.clock.now())
        elif not wire.connected:
            self._forget()
            self._on_lost(self.clock.now())
            return False
        if self._end is not None and self._written == len(self._out) and self._end <= self.clock.now():
            self._sent(self._end)
        return bool(data)

    # -- sending -------------------------------------------------------------------------------

    def _transmit(self, until: int) -> int:
        """Write what is due; returns when more is due."""
        if self._end is None:
            if not self._queue:
                return until
            if self._queue[0][0] > self.clock.now():
                return self._queue[0][0]
            _, self._out, frame = self._queue.popleft()
            self._written = 0
            self._start = self.clock.now()
            self._end = self._start + self._timing.characters(len(self._out))
            self.echo.sent(self._out, frame, response=self._slave)
        return self._write() if self._written < len(self._out) else self._end

    def _write(self) -> int:
        assert self._end is not None  # noqa: S101 - narrows the type
        timing, out = self._timing, self._out
        if not self.wire.options.paced:
            self.wire.write(out)
            self._written = len(out)
            if self.wire.instant:
                self._end = self.clock.now()
            return self._end
        # A byte is there for the other side when its last stop bit has left.
        now, first = self.clock.now(), self._written
        while self._written < len(out) and self._start + timing.characters(self._written + 1) <= now:
            self._written += 1
        if self._written > first:
            self.wire.write(out[first : self._written])
        if self._written == len(out):
            return self._end
        return self._start + timing.characters(self._written + 1)

    def _sent(self, end: int) -> None:
        self._end = None
        self._arrivals.busy_until = max(end, self._arrivals.busy_until)
        self._on_sent(self._start, end)

    def _forget(self) -> None:
        self._queue.clear()
        self._end = None
        self.echo.unsent()

    # -- listening -----------------------------------------------------------------------------

    def _heard(self, data: bytes, arrived: int) -> None:
        data = self.echo.without(data)
        if not data:
            return
        if self._end is not None and self._written == len(self._out):
            self._sent(min(self._end, arrived))
        self._on_chars(self._arrivals.chunk(data, arrived, self.wire.characters))

"""A device with a protocol of its own: it sends fixed messages, by the clock or as replies."""

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from bussim.engines.contract import DEADLINE, EVENTS, TRANSMIT, RxChar, Transmit
from bussim.engines.free.engine import FreeFrame
from bussim.engines.free.events import Ended, FreeEvent, Received, Sent
from bussim.line.characters import LineTiming

#: Messages that wait while another is sent; what falls due beyond them is never sent (assumed: a device's
#: buffer is full, and a run's memory must not grow with its length).
MOST_WAITING: Final = 64


@dataclass(frozen=True, slots=True)
class Message:
    """What a free-protocol device sends.

    On its own: first at ``at``, then every ``every`` ticks (None: once), ``times`` times (None: for
    ever), each time up to ``jitter`` later. Where ``reply_to`` is not empty: ``delay`` ticks after
    these bytes have been received.
    """

    data: bytes
    at: int = 0
    every: int | None = None
    times: int | None = None
    jitter: int = 0
    reply_to: bytes = b""
    delay: int = 0


def _ticks(message: Message, draws: Iterator[float], now: int) -> Iterator[int]:
    """When a message is due on its own, from ``now`` on; none for a reply."""
    at, every, times = message.at, message.every, message.times
    if message.reply_to or (not every and at < now):
        return
    turn = max(0, -((at - now) // every)) if every else 0
    while (every or not turn) and (times is None or turn < times):
        late = int(next(draws) * (message.jitter + 1)) if message.jitter else 0
        yield at + turn * (every or 0) + late
        turn += 1


class ScriptedDevice:
    """The device's one port. See :mod:`bussim.engines.contract` for the methods.

    ``draws`` are the random streams of the messages' jitter, in order. What falls due while something else is
    being sent follows it, up to :data:`MOST_WAITING`. Characters with errors count with the value
    that they have.
    """

    def __init__(
        self, messages: Sequence[Message], timing: LineTiming, draws: Sequence[Iterator[float]]
    ) -> None:
        self._messages = tuple(messages)
        self._timing = timing
        self._draws = draws
        self.due = -1
        self.due_counter = 0
        #: No frames are recognised here: always None.
        self.heard: FreeFrame | None = None
        self.heard_start = 0
        self._events: deque[FreeEvent] = deque()
        self._longest = max((len(message.reply_to) for message in self._messages), default=0)
        self._tail = b""
        self._clock: list[int | None] = [None] * len(self._messages)  # when each is due next on its own
        self._ticks: list[Iterator[int]] = []  # the ticks that follow
        self._queue: deque[tuple[int, bytes]] = deque()  # (not before, data) behind what is due
        self._begun = 0
        self._out: bytes | None = None  # due or being sent
        self._on = False

    # -- supply --------------------------------------------------------------------------------

    def start(self, now: int) -> int:
        """Power-on: what was due at a tick that is over begins with its next turn."""
        self._on = True
        self._ticks = [_ticks(*pair, now) for pair in zip(self._messages, self._draws, strict=True)]
        self._clock = [next(ticks, None) for ticks in self._ticks]
        return DEADLINE

    def stop(self, now: int) -> int:
        """Power-off."""
        self._on = False
        self._tail = b""
        self._queue.clear()
        self._out = None
        self.due = -1
        self._clock = [None] * len(self._messages)
        return DEADLINE

    # -- listening -----------------------------------------------------------------------------

    def expects(self, chars: bytes) -> bytes:
        """Which of these characters it replies to, if any."""
        known = (message.reply_to for message in self._messages if message.reply_to)
        return next((each for each in known if each in chars), b"")

    def receive(self, char: RxChar, start: int, end: int) -> int:
        """One character."""
        if not self._longest or not self._on:
            return 0
        self._tail = (self._tail + bytes((char.value,)))[-self._longest :]
        for message in self._messages:
            if message.reply_to and self._tail.endswith(message.reply_to):
                self._tail = b""
                heard = Received(end, start, message.reply_to, Ended.END_CHARACTER, message.reply_to)
                self._events.append(heard)
                return EVENTS | self._send(message.data, end + message.delay)
        return 0

    def receive_frame(self, frame: FreeFrame, start: int, end: int) -> int:
        """Undamaged characters back to back."""
        hints = 0
        if self._longest:
            for number, value in enumerate(frame.chars, 1):
                hints |= self.receive(RxChar(value), start, start + self._timing.characters(number))
        return hints

    def line_idle(self, now: int) -> int:
        """Nothing to do."""
        return 0

    def deadline(self) -> int | None:
        """When a message is due next on its own."""
        return min((at for at in self._clock if at is not None), default=None)

    def on_deadline(self, now: int) -> int:
        """A message is due."""
        hints = DEADLINE
        for number, at in enumerate(self._clock):
            if at is not None and at <= now:
                self._clock[number] = next(self._ticks[number], None)
                hints |= self._send(self._messages[number].data, now)
        return hints

    # -- sending -------------------------------------------------------------------------------

    def _send(self, data: bytes, at: int) -> int:
        if self._out is not None:
            if len(self._queue) < MOST_WAITING:
                self._queue.append((at, data))
            return 0
        self._out = data
        self.due = at
        return TRANSMIT

    def begin_transmit(self, now: int, counter: int = 0) -> FreeFrame:
        """What is due."""
        if self._out is None:
            raise RuntimeError("nothing waits to be sent")
        self._begun = now
        return FreeFrame(self._out)

    def transmit_done(self, now: int) -> int:
        """All has left."""
        if self._out is None:
            return 0
        self._events.append(Sent(self._begun, now, self._out))
        self._out = None
        if self._queue:
            at, data = self._queue.popleft()
            return EVENTS | self._send(data, max(at, now))
        return EVENTS

    def poll(self) -> Transmit | FreeEvent | None:
        """The next event, then what is to be sent."""
        if self._events:
            return self._events.popleft()
        if self.due >= 0:
            at, self.due = self.due, -1
            return Transmit(at)
        return None

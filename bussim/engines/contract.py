"""What every protocol engine offers, and what it asks of the driver that runs it.

An engine has no clock, draws no random numbers and logs nothing. The driver passes it what the receiver
received and when, asks it when it must be called, and does what :meth:`Engine.poll` returns, in order.
The same engine therefore runs in simulated time and on a serial port.

Methods that take what was received return *hints*: a set of bits that say what the driver has to ask for,
so that an engine that a frame does not concern costs one call and a comparison with zero. Bits from
:data:`OWN_HINTS` on belong to the protocol (:mod:`bussim.engines.nn.contract`); a driver that does not
know them passes over them.
"""

from collections import deque
from typing import NamedTuple, Protocol, TypeVar

#: A transmission is due: :attr:`Engine.due` says from when. A driver takes it from there (and sets
#: ``due`` to -1) or from ``poll``.
TRANSMIT = 1
#: :meth:`Engine.deadline` may be earlier than the driver knows.
DEADLINE = 4
#: An unfinished or damaged frame is open: the driver must call :meth:`Engine.line_idle`.
OPEN = 8
#: Events wait in :meth:`Engine.poll`.
EVENTS = 16
#: A request waits until the driver has it served.
SERVE = 32
#: The first hint that a protocol defines for itself.
OWN_HINTS = 64


class RxChar(NamedTuple):
    """One character as a receiver read it."""

    value: int
    parity_ok: bool = True
    stop_ok: bool = True


class Transmit(NamedTuple):
    """The engine wants to send. Its bytes are asked for when the first bit leaves.

    ``at`` is the earliest tick. ``reply``: the driver adds the device's own turnaround to it.
    ``counter`` names the request that it is the reply to (0 where not a reply) and goes back to
    :meth:`Engine.begin_transmit` with it, since several replies may be pending.
    """

    at: int
    reply: bool = False
    counter: int = 0


FrameT = TypeVar("FrameT")
EventT = TypeVar("EventT")


class Engine(Protocol[FrameT, EventT]):
    """One side of a protocol on a half-duplex line. All times are ticks."""

    due: int = -1  # earliest tick of the transmission that the hint TRANSMIT announces, else -1
    due_counter: int = 0  # its counter, for begin_transmit
    heard: FrameT | None = None  # the latest valid frame that receive or line_idle completed
    heard_start: int = 0  # its first edge
    replies: bool = False  # whether the driver adds the device's turnaround to ``due``
    _events: deque[EventT]

    def __init__(self) -> None:
        self._events = deque()

    def start(self, now: int) -> int:
        """RUN or power-on; returns hints."""

    def stop(self, now: int) -> int:
        """STOP or power-off: nothing pending survives but events; returns hints."""

    def receive(self, char: RxChar, start: int, end: int) -> int:
        """The receiver read a character whose first edge was at ``start``; returns hints."""

    def receive_frame(self, frame: FrameT, start: int, end: int) -> int:
        """A whole undamaged frame was received: the same as its characters one by one; returns hints.

        Only while no frame is open: after the hint OPEN the driver goes on character by character
        until a frame completes without it or the line was idle.
        """

    def line_idle(self, now: int) -> int:
        """The line has been idle for the protocol's gap; returns hints."""

    def deadline(self) -> int | None:
        """When to call :meth:`on_deadline`, None for never. It only ever moves by a call."""

    def on_deadline(self, now: int) -> int:
        """The deadline has come (after all that was completely received by then); returns hints."""

    def begin_transmit(self, now: int, counter: int = 0) -> FrameT:
        """The line driver is switched on at ``now``: the frame to send. An open frame is dropped.

        Events that this causes are announced by the next hint, at the latest by ``transmit_done``.
        """

    def transmit_done(self, now: int) -> int:
        """The last stop bit has left; returns hints."""

    def poll(self) -> Transmit | EventT | None:
        """What to do next: an event, in order, then the transmission that is due; None for nothing more."""
        if self._events:
            return self._events.popleft()
        if self.due < 0:
            return None
        at, self.due = self.due, -1
        return Transmit(at, self.replies, self.due_counter)

"""What every protocol engine offers, and what it asks of the driver that runs it.

An engine never waits, draws or logs. The driver tells it what its receiver heard and when, asks it
when it wants to be called, and does what :meth:`Engine.poll` returns, in order. The same engine
therefore runs in simulated time and on a serial port.

Methods that hear something return *hints*: a set of bits that say what the driver has to look at,
so that a listener whom a frame does not concern costs one call and a comparison with zero.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol, TypeVar

#: A transmission is due: :attr:`Engine.due` says from when. A driver takes it from there (and sets
#: ``due`` to -1) or from ``poll``.
TRANSMIT = 1
#: The frame's block was taken over as its station's newest image.
STORED = 2
#: :meth:`Engine.deadline` may be earlier than the driver knows.
DEADLINE = 4
#: An unfinished or damaged frame is open: the driver must report the line's quiet.
OPEN = 8
#: Events wait in :meth:`Engine.poll`.
EVENTS = 16
#: A request waits for the driver to have it served (a PLC does so at END).
SERVE = 32


class RxChar(NamedTuple):
    """One character as a receiver judged it."""

    value: int
    parity_ok: bool = True
    stop_ok: bool = True


class Transmit(NamedTuple):
    """The engine wants to send. Its bytes are asked for when the first bit leaves.

    ``at`` is the earliest tick. ``reply`` marks an answer: the driver adds the device's own
    turnaround to ``at``. ``counter`` names the request that is answered (0 where not a reply) and
    goes back to :meth:`Engine.begin_transmit` with it, since several replies may be pending.
    """

    at: int
    reply: bool = False
    counter: int = 0


FrameT = TypeVar("FrameT")
EventT = TypeVar("EventT", covariant=True)


class Engine(Protocol[FrameT, EventT]):
    """One side of a protocol on a half-duplex line. All times are ticks."""

    due: int  # earliest tick of the transmission that the hint TRANSMIT announces, else -1
    due_counter: int  # its counter, for begin_transmit
    wants_image: bool  # whether begin_transmit will need the block's image

    def receive(self, char: RxChar, start: int, end: int) -> int:
        """The receiver heard a character whose first edge was at ``start``; returns hints."""

    def receive_frame(self, frame: FrameT, start: int, end: int) -> int:
        """A whole undamaged frame was heard: the same as its characters one by one; returns hints.

        Only while nothing is half heard: after the hint OPEN the driver goes on character by character
        until a frame completes without it or the line was quiet.
        """

    def line_idle(self, now: int) -> int:
        """The line has been quiet for the protocol's gap; returns hints."""

    def deadline(self) -> int | None:
        """When to call :meth:`on_deadline`, None for never. It only ever moves by a call."""

    def on_deadline(self, now: int) -> int:
        """The deadline has come (after whatever was completely heard by then); returns hints."""

    def begin_transmit(self, now: int, image: bytes, counter: int = 0) -> FrameT:
        """The driver is switched on at ``now``: the frame to send. What was half heard is dropped.

        Events that this causes are announced by the next hint, at the latest by ``transmit_done``.
        """

    def transmit_done(self, now: int) -> int:
        """The last stop bit has left; returns hints."""

    def poll(self) -> Transmit | EventT | None:
        """What to do next, in order; None when there is nothing more."""

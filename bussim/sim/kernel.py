"""Timers on SimPy's event loop: re-armed events instead of processes.

One SimPy event object serves one timer for ever. Setting a timer that is already set leaves its old
entry in the queue; when that one comes up it is recognised by its time and ignored.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import Final

import simpy
from simpy.events import EventPriority

#: Order of things at one tick (fixed by the model): faults, then what was completely heard, then
#: what engines do at their deadlines, then ENDs, then transmissions. Most ENDs are no events; looked
#: up at its tick such a one counts as done.
FAULT: Final = EventPriority(1)
HEARING: Final = EventPriority(2)
DEADLINES: Final = EventPriority(3)
END: Final = EventPriority(4)
SENDING: Final = EventPriority(5)

#: A tick that is never reached.
NEVER: Final = 1 << 62

_UNSET = -1


class Timer:
    """Calls ``action(tick)`` once at the tick that it was last set to."""

    __slots__ = ("_action", "_callbacks", "_event", "_kernel", "_priority", "at")

    def __init__(self, kernel: Kernel, action: Callable[[int], None], priority: EventPriority) -> None:
        self._kernel = kernel
        self._action = action
        self._priority = priority
        self._event = event = simpy.Event(kernel.env)
        # A SimPy event may only be scheduled triggered; this one is so for ever.
        event._ok = True  # noqa: SLF001 - what Event.succeed does, without scheduling
        event._value = None  # noqa: SLF001 - the same
        self._callbacks: list[Callable[[simpy.Event], None]] = [self._fire]
        event.callbacks = self._callbacks
        #: The tick that it is set to, -1 when it is not set.
        self.at = _UNSET

    def set(self, at: int) -> None:
        """Arm (or re-arm) it for a tick, not before now."""
        if self.at != at:
            self.at = at
            chained = self._kernel.chained
            if chained is not None:
                chained.unchain()  # it was armed before this one
            self._schedule()

    def chain(self, at: int) -> None:
        """Arm it for what most likely is the next thing to happen at all.

        If it is, SimPy's queue need not be troubled; the order of things is the same either way.
        """
        self.at = at
        kernel = self._kernel
        if kernel.chained is None:
            kernel.chained = self
        else:
            # Two at once: both into the queue, in the order in which they were armed.
            kernel.chained.unchain()
            self._schedule()

    def unchain(self) -> None:
        """Put a chained timer into SimPy's queue."""
        self._kernel.chained = None
        if self.at >= 0:
            self._schedule()

    def _schedule(self) -> None:
        env = self._kernel.env
        env.schedule(self._event, self._priority, self.at - env.now)

    def cancel(self) -> None:
        """Disarm it."""
        self.at = _UNSET

    def _fire(self, event: simpy.Event) -> None:
        event.callbacks = self._callbacks
        kernel = self._kernel
        env = kernel.env
        at = self.at
        if at != env.now:
            return
        kernel.now = at
        self.at = _UNSET
        self._action(at)
        timer = kernel.chained
        while timer is not None:
            kernel.chained = None
            at = timer.at
            if at >= 0:
                if at >= env.peek():
                    timer.unchain()
                    return
                kernel.now = at
                timer.at = _UNSET
                timer._action(at)  # noqa: SLF001 - another timer of this kernel
            timer = kernel.chained


class Kernel:
    """The simulated clock.

    ``now`` is the current tick. It may be ahead of SimPy's own clock, never of SimPy's next event:
    what happens next and alone is done without going through the queue (:meth:`Timer.chain`).
    """

    __slots__ = ("chained", "env", "now")

    def __init__(self) -> None:
        self.env = simpy.Environment(initial_time=0)
        self.now = 0
        self.chained: Timer | None = None

    def timer(self, action: Callable[[int], None], priority: EventPriority) -> Timer:
        """A timer that calls ``action(tick)``."""
        return Timer(self, action, priority)

    def at(self, tick: int, action: Callable[[int], None], priority: EventPriority) -> None:
        """Call ``action(tick)`` once."""
        self.timer(action, priority).set(tick)

    def next(self) -> int:
        """The tick at which something may happen next, far away if nothing is to happen at all."""
        if self.chained is not None:  # set from outside of any action
            self.chained.unchain()
        at = self.env.peek()
        return NEVER if at == inf else int(at)

    def run(self, until: int) -> None:
        """Do everything before the tick ``until``."""
        if until <= self.env.now:
            return
        if self.chained is not None:  # set from outside of any action
            self.chained.unchain()
        self.env.run(until)
        self.env.step()  # SimPy puts the event that stopped it back into its queue
        self.now = until

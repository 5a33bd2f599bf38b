"""Timers on SimPy's event loop: re-armed events instead of processes.

One SimPy event object serves one timer for ever: making an event, and a generator to wait for it, would
cost more than what is done at it. Setting a timer that is already set leaves its old entry in the queue
(a heap has no cheap removal); when that one comes up it is recognised by its time and ignored.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from heapq import heappop, heappush
from typing import Final

import simpy
from simpy.events import EventPriority

#: Order of things at one tick (fixed by the model): the end of a run, faults, then what was completely
#: heard, then what engines do at their deadlines, then ENDs, then transmissions. Most ENDs are no events;
#: looked up at its tick such a one counts as done. Between two of them there is room for one of each serial
#: bus, or of each PLC's ENDs.
_STOP: Final = EventPriority(0)
FAULT: Final = EventPriority(1)
HEARING: Final = EventPriority(1 << 20)
DEADLINES: Final = EventPriority(2 << 20)
END: Final = EventPriority(3 << 20)
SENDING: Final = EventPriority(4 << 20)

#: A tick that is never reached.
NEVER: Final = 1 << 62

_UNSET = -1
#: Events between two looks at how far a run is.
_WATCHED = 256


class Timer:
    """Calls ``action(tick)`` once at the tick that it was last set to."""

    __slots__ = ("_action", "_callbacks", "_event", "_kernel", "at", "priority")

    def __init__(self, kernel: Kernel, action: Callable[[int], None], priority: EventPriority) -> None:
        self._kernel = kernel
        self._action = action
        self.priority = priority
        self._event = event = simpy.Event(kernel.env)
        # A SimPy event may only be scheduled triggered; this one is so for ever.
        event._ok = True  # noqa: SLF001 - what Event.succeed does, without scheduling
        event._value = self  # noqa: SLF001 - the same; by it Kernel.next knows whose event it is
        self._callbacks: list[Callable[[simpy.Event], None]] = [self._fire]
        event.callbacks = self._callbacks
        #: The tick that it is set to, -1 when it is not set.
        self.at = _UNSET

    def set(self, at: int) -> None:
        """Arm (or re-arm) it for a tick, not before now."""
        if self.at != at:
            self.at, kernel = at, self._kernel
            # As Environment.schedule does it: its calls were a tenth of all.
            heappush(kernel.queue, (at, self.priority, next(kernel.order), self._event))

    def cancel(self) -> None:
        """Disarm it."""
        self.at = _UNSET

    def _fire(self, event: simpy.Event) -> None:
        event.callbacks = self._callbacks
        kernel, at = self._kernel, self.at
        if at == kernel.env._now:  # noqa: SLF001 - the property costs a call at every event
            kernel.now = at
            self.at = _UNSET
            self._action(at)


class Kernel:
    """The simulated clock.

    ``now`` is the current tick. It may be ahead of SimPy's own clock, never of SimPy's next event.
    """

    __slots__ = ("_faults", "_stop", "behind", "env", "made", "now", "order", "queue")

    def __init__(self) -> None:
        self.env = simpy.Environment(initial_time=0)
        #: SimPy's queue of (tick, priority, order, event), and what numbers its entries.
        self.queue, self.order = self.env._queue, self.env._eid  # noqa: SLF001 - see Timer
        self.now = 0
        #: Where not None: takes the timers that are made.
        self.made: list[Timer] | None = None
        #: Among those of one tick and kind, what timers that are made now come behind.
        self.behind = 0
        self._stop = Timer(self, lambda _: None, _STOP)
        self._faults: list[int] = []  # the ticks of those to come, and of some that are past

    def timer(self, action: Callable[[int], None], priority: EventPriority) -> Timer:
        """A timer that calls ``action(tick)``."""
        timer = Timer(self, action, EventPriority(priority + self.behind))
        if self.made is not None:
            self.made.append(timer)
        return timer

    def at(self, tick: int, action: Callable[[int], None], priority: EventPriority) -> None:
        """Call ``action(tick)`` once."""
        if priority is FAULT:
            heappush(self._faults, tick)
        self.timer(action, priority).set(tick)

    def calm_until(self, now: int) -> int:
        """Up to which tick there is neither a fault nor the end of the run after ``now``."""
        faults, stop = self._faults, self._stop.at
        while faults and faults[0] <= now:
            heappop(faults)
        return min(faults[0] if faults else NEVER, stop if stop >= 0 else NEVER)

    def next(self, but: Collection[Timer] = ()) -> int:
        """The tick at which something may happen next, far away if nothing is to happen at all.

        What some timers do is passed over.
        """
        queue = self.queue  # where timers that were set anew have entries with another tick
        if but:
            timers = [(int(at), event._value) for at, _, _, event in queue]  # noqa: SLF001 - see Timer
            return min((at for at, timer in timers if at == timer.at and timer not in but), default=NEVER)
        while queue and queue[0][0] != queue[0][3]._value.at:  # noqa: SLF001
            heappop(queue)
        return int(queue[0][0]) if queue else NEVER

    def pass_events(self, tick: int, priority: int) -> None:
        """Within an action: do what happens before a tick, or at it with a more urgent priority."""
        queue, end = self.queue, (tick, priority)
        while queue and queue[0][:2] < end:
            self.env.step()

    def run(self, until: int, watch: Callable[[int], None] | None = None) -> None:
        """Do everything before the tick ``until``; ``watch`` is called with the tick now and then."""
        if until <= self.env.now:
            return
        self._stop.set(until)
        step = self.env.step
        while self._stop.at >= 0:
            for _ in range(_WATCHED):
                step()
                if self._stop.at < 0:
                    break
            if watch is not None:
                watch(self.now)
        self.now = until

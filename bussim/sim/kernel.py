"""Timers on SimPy's event loop: re-armed events instead of processes.

One SimPy event object serves one timer for ever. Setting a timer that is already set leaves its old
entry in the queue; when that one comes up it is recognised by its time and ignored.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import simpy
from simpy.events import EventPriority

#: Order of things at one tick (fixed by the model): faults, then what was completely heard, then
#: what engines do at their deadlines, then transmissions. An END is no event; looked up at its tick
#: it counts as done, so it lies between hearing and sending.
FAULT: Final = EventPriority(1)
HEARING: Final = EventPriority(2)
DEADLINES: Final = EventPriority(3)
SENDING: Final = EventPriority(4)

_UNSET = -1


class Timer:
    """Calls ``action(tick)`` once at the tick that it was last set to."""

    __slots__ = ("_action", "_callbacks", "_env", "_event", "_priority", "at")

    def __init__(
        self, env: simpy.Environment, action: Callable[[int], None], priority: EventPriority
    ) -> None:
        self._env = env
        self._action = action
        self._priority = priority
        self._event = event = simpy.Event(env)
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
            env = self._env
            env.schedule(self._event, self._priority, at - env.now)

    def cancel(self) -> None:
        """Disarm it."""
        self.at = _UNSET

    def _fire(self, event: simpy.Event) -> None:
        event.callbacks = self._callbacks
        at = self.at
        if at == self._env.now:
            self.at = _UNSET
            self._action(at)


class Kernel:
    """The simulated clock."""

    def __init__(self) -> None:
        self.env = simpy.Environment(initial_time=0)

    @property
    def now(self) -> int:
        """The current tick."""
        return int(self.env.now)

    def timer(self, action: Callable[[int], None], priority: EventPriority) -> Timer:
        """A timer that calls ``action(tick)``."""
        return Timer(self.env, action, priority)

    def at(self, tick: int, action: Callable[[int], None], priority: EventPriority) -> None:
        """Call ``action(tick)`` once."""
        self.timer(action, priority).set(tick)

    def run(self, until: int) -> None:
        """Do everything before the tick ``until``."""
        if until > self.env.now:
            self.env.run(until)

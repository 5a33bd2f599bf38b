"""Simulated time that keeps step with real time."""

import gc
from collections.abc import Callable, Sequence

from bussim.live.clock import Clock, Lateness
from bussim.live.runner import PATIENCE
from bussim.live.waiting import wait
from bussim.serve.bridge import Bridge
from bussim.sim.kernel import Kernel
from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND, format_ms

#: Simulated ticks that are done in one go before the wires are read again.
_SLICE = 5 * TICKS_PER_MS
#: Chunks of a wire that are taken before what is due is done.
_MORE_CHUNKS = 4
#: Lateness from which on it is reported, and how often at most.
_VERY_LATE = TICKS_PER_SECOND // 10
_REPORT_EVERY = 10 * TICKS_PER_SECOND


class RealTime:
    """Runs a kernel in real time, and passes on what comes on the wires.

    ``also`` is called between two slices, in this thread. ``report`` is called with a sentence if the
    machine cannot keep up.
    """

    def __init__(
        self,
        kernel: Kernel,
        clock: Clock,
        bridges: Sequence[Bridge],
        *,
        also: Callable[[], None] = lambda: None,
        report: Callable[[str], None] = lambda _: None,
    ) -> None:
        self._kernel = kernel
        self._clock = clock
        self._bridges = tuple(bridges)
        self._wires = tuple(bridge.wire for bridge in bridges)
        self._also = also
        self._report = report
        self._reported_at = -_REPORT_EVERY
        self.lateness = Lateness()

    def run(self, until: int, stopped: Callable[[], bool]) -> None:
        """Run until a tick, or until ``stopped`` says so, which is asked at least twenty times a second.

        What is being sent then is sent to its end.
        """
        kernel, clock = self._kernel, self._clock
        gc.collect()
        gc.freeze()  # the collector need not scan what was built for the run
        try:
            clock.restart()
            kernel.run(kernel.now + 1)  # nodes with a supply from the start receive what has come before
            while not stopped() and kernel.now < until:
                self._step(until)
            until = min(until, self._sending_until())
            while kernel.now < until:
                self._step(until)
        finally:
            gc.unfreeze()

    def _step(self, until: int) -> None:
        # An event at a tick is done when the tick is over.
        wait(self._wires, self._clock, min(self._kernel.next() + 1, until, self._clock.now() + PATIENCE))
        self._receive()
        self._go_on(until)
        self._also()

    def _sending_until(self) -> int:
        """When what is on the wires now has been sent, and is recorded; 0 for nothing."""
        ports = (port for bridge in self._bridges for port in bridge.line.ports)
        return max((tx.driven_until + 1 for port in ports if (tx := port.sending or port.tail)), default=0)

    def _receive(self) -> None:
        """Receive what has come by now before what is due by now is done."""
        kernel, clock = self._kernel, self._clock
        for _ in range(_MORE_CHUNKS):
            now = clock.now()
            chunks = [(bridge, data) for bridge in self._bridges if (data := bridge.wire.read(now))]
            if not chunks:
                return
            now = clock.now()
            kernel.run(min(now, kernel.next()))
            for bridge, data in chunks:
                bridge.take(data, kernel.now, max(0, now - kernel.now))

    def _go_on(self, until: int) -> None:
        """Do what is due, a slice of it if there is much."""
        kernel = self._kernel
        now = min(self._clock.now(), until)
        due = kernel.next()
        if due < now:
            self._was_due(due, now)
        kernel.run(min(now, max(kernel.now, due) + _SLICE))

    def _was_due(self, due: int, now: int) -> None:
        late = now - due
        self.lateness.add(late, now)
        if late > _VERY_LATE and now >= self._reported_at + _REPORT_EVERY:
            self._reported_at = now
            self._report(f"this computer cannot keep up: the simulation is {format_ms(late)} late")

"""Records the ENDs of every PLC of a traced run, also those that no port, input or link waited for."""

from __future__ import annotations

from collections.abc import Iterable

from bussim.plc.plc import Plc
from bussim.sim.kernel import DEADLINES, Kernel
from bussim.trace.sink import Sink
from bussim.units import TICKS_PER_SECOND

#: How often ENDs are recorded, in ticks. They are kept so long, some ten thousand of a PLC at most.
PERIOD = TICKS_PER_SECOND


class EndRecorder:
    """Records for those PLCs whose ENDs are not recorded one by one as they happen."""

    def __init__(self, plcs: Iterable[Plc], kernel: Kernel, sink: Sink) -> None:
        self._plcs = tuple(plcs)
        self._sink = sink
        for plc in self._plcs:
            plc.cycle.keep_ends()
        #: Changes nothing but what is recorded.
        self.timer = kernel.timer(self._on_time, DEADLINES)
        if self._plcs:
            self.timer.set(PERIOD)

    def _on_time(self, now: int) -> None:
        self.flush(now - 1)
        self.timer.set(now + PERIOD)

    def flush(self, tick: int) -> None:
        """Record all ENDs up to a tick."""
        for plc in self._plcs:
            self.record(plc, tick)

    def record(self, plc: Plc, tick: int) -> None:
        """Record the ENDs of one PLC up to a tick: it is about to stop."""
        if plc in self._plcs:
            ticks = plc.cycle.passed(tick)
            if ticks:
                self._sink.ends(plc.name, ticks)

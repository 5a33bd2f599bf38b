"""Tells a traced run's sink the ENDs of every PLC, also those that nobody else looked at."""

from __future__ import annotations

from collections.abc import Iterable

from bussim.plc.plc import Plc
from bussim.sim.kernel import DEADLINES, Kernel
from bussim.trace.records import Sink
from bussim.units import TICKS_PER_SECOND

#: How often ENDs are told, in ticks. They are kept so long, some ten thousand of a PLC at most.
PERIOD = TICKS_PER_SECOND


class EndRecorder:
    """Of those PLCs whose ENDs are not told one by one as they happen."""

    def __init__(self, plcs: Iterable[Plc], kernel: Kernel, sink: Sink) -> None:
        self._plcs = tuple(plcs)
        self._sink = sink
        for plc in self._plcs:
            plc.cycle.tell()
        self._timer = kernel.timer(self._on_time, DEADLINES)
        if self._plcs:
            self._timer.set(PERIOD)

    def _on_time(self, now: int) -> None:
        self.flush(now - 1)
        self._timer.set(now + PERIOD)

    def flush(self, tick: int) -> None:
        """Tell all ENDs up to a tick."""
        for plc in self._plcs:
            self.tell(plc, tick)

    def tell(self, plc: Plc, tick: int) -> None:
        """Tell the ENDs of one PLC up to a tick: it is about to stop."""
        if plc in self._plcs:
            ticks = plc.cycle.passed(tick)
            if ticks:
                self._sink.ends(plc.name, ticks)

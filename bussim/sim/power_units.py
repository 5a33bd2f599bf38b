"""What has a supply of its own: a PLC with all its ports, or a device."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from bussim.plc.plc import Plc, PlcState
from bussim.sim.nn.link_port import LinkPort
from bussim.sim.serial.device import DeviceNode
from bussim.sim.serial.plc_port import EndClock, PlcPort
from bussim.sim.wire.node import Node


class PlcUnit:
    """A PLC with its port on the link, if it has one, and its other ports.

    ``record_ends(plc, tick)`` is called when it goes to STOP: there are no more ENDs after the tick.
    """

    def __init__(
        self,
        plc: Plc,
        link: LinkPort | None,
        ports: Sequence[PlcPort],
        clock: EndClock | None,
        record_ends: Callable[[Plc, int], None],
    ) -> None:
        self._record_ends = record_ends
        self.plc = plc
        self.link = link
        self.ports = tuple(ports)
        self._clock = clock
        self.nodes: tuple[Node, ...] = (*((link,) if link is not None else ()), *self.ports)

    @property
    def powered(self) -> bool:
        """Whether it has a supply now."""
        return self.plc.state is not PlcState.OFF

    @property
    def running(self) -> bool:
        """Whether it is in RUN."""
        return self.plc.state is PlcState.RUN

    def switch(self, now: int, *, powered: bool, running: bool) -> None:
        """Go to this state: STOP before the supply goes, the supply before RUN."""
        plc = self.plc
        if plc.state is PlcState.RUN and not (running and powered):
            for node in self.nodes:
                node.halt(now)
            if self._clock is not None:
                self._clock.stop()
            self._record_ends(plc, now - 1)
            plc.stop(now)
            for port in self.ports:
                port.report_events()
            if self.link is not None:
                bus, position = self.link.bus, self.link.position
                bus.block_history.forget(position)
                bus.sink.switched(bus.name, position, now, None)
        if plc.state is not PlcState.OFF and not powered:
            plc.power_off(now)
        if plc.state is PlcState.OFF and powered:
            plc.power_on(now)
        if plc.state is PlcState.STOP and running and powered:
            self._run(now)
        else:
            plc.observe(now)

    def _run(self, now: int) -> None:
        link = self.link
        engine, first_end = self.plc.run(now, traced=link is not None and link.bus.sink.traced)
        if link is not None:
            link.run(engine, first_end, now)
            # Blocks with the image of the first END, or a later one, are new.
            link.bus.sink.switched(link.bus.name, link.position, now, first_end + link.bus.block_time)
        for port in self.ports:
            port.run(now)
        if self._clock is not None:
            self._clock.schedule_end(now)


#: What has a supply; a device is its own node, and runs whenever it has one.
Unit = PlcUnit | DeviceNode

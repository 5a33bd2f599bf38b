"""The ordinary exchange in one go: poll, turnaround, reply, on a line where nothing else can happen.

Where the shared listener stands for every listener, nothing disturbs frames and SimPy's next event lies
beyond the longest possible reply, the steps of an exchange follow each other without anybody who
could come between. Then they are done here one after the other, in the same order, at the same ticks
and with the same draws as through timers, transmissions and deliveries.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

from bussim.engines.nn.frames import POLL_CHARS, data_chars
from bussim.engines.nn.master import Master
from bussim.engines.nn.slave import Slave
from bussim.sim.kernel import Kernel

if TYPE_CHECKING:
    from bussim.sim.nn.bus import LinkBus
    from bussim.sim.nn.port import LinkPort

_NO_IMAGE = b""


class _Route(NamedTuple):
    """One slave's exchanges by the short way, as long as nobody begins to listen or send otherwise."""

    slave: LinkPort
    engine: Slave
    draw: Callable[[], int]
    missed: tuple[int, ...]  # seats that do not hear its replies
    took: tuple[int, ...] | None  # seats that do, None for all
    longest: int  # ticks from the poll's start by which the reply has ended


class FastPath:
    """The short way for one bus's exchanges."""

    __slots__ = ("_bus", "_kernel", "_peek", "_poll", "_routes")

    def __init__(self, bus: LinkBus, kernel: Kernel) -> None:
        self._bus = bus
        self._kernel = kernel
        self._peek = kernel.env.peek
        self._poll = bus.timing.characters(POLL_CHARS)
        # By station; None where its exchanges must go the long way.
        self._routes: dict[int, _Route | None] = {}

    def close(self) -> None:
        """Somebody listens or sends otherwise than before: look anew at every way."""
        if self._routes:
            self._routes.clear()

    def _way(self, port: LinkPort, master: Master, station: int) -> _Route | None:
        bus = self._bus
        slave = bus.shared_listener.by_station.get(station)
        way: _Route | None = None
        if (
            slave is not None
            and bus.plain
            and bus.shared_listener.expects(station)
            and port.prompt
            and slave.prompt
        ):
            polled_whole, polled_single, _ = bus.listeners_of(port)
            reply_whole, reply_single, _ = bus.listeners_of(slave)
            alone = [hearer for hearer, _ in reply_whole] == [port]
            engine = slave.engine
            if alone and isinstance(engine, Slave) and not (polled_whole or polled_single or reply_single):
                hearers = (port, *bus.shared_listener.members)
                others = [other.position for other in bus.ports if other is not slave]
                took = tuple(hearer.position for hearer in hearers if hearer is not slave)
                missed = tuple(position for position in others if position not in took)
                reply = bus.timing.characters(data_chars(master.config.settings.mode))
                answered = slave.longest_turnaround + reply
                if answered <= master.config.timeout:
                    longest = self._poll + answered
                    way = _Route(slave, engine, slave.turnaround, missed, took if missed else None, longest)
        self._routes[station] = way
        return way

    def exchange(self, port: LinkPort, now: int) -> bool:
        """Carry out the exchange whose poll is due at ``now``; False: it must go the long way."""
        bus, master = self._bus, port.engine
        if type(master) is not Master or not master.first_attempt:
            return False
        station = master.station
        routes = self._routes
        way = routes[station] if station in routes else self._way(port, master, station)
        if way is None:
            return False
        slave, engine, draw, missed, took, longest = way
        shared_listener, kernel, disturber = bus.shared_listener, self._kernel, bus.disturber
        if bus.drivers or slave.pending or shared_listener.pending >= 0 or self._peek() <= now + longest:
            return False
        end = now + self._poll
        frame = master.begin_transmit(now, _NO_IMAGE)
        kernel.now = end
        shared_listener.hear(frame, now, end)
        master.transmit_done(end)
        bus.frames += 1
        bus.busy += end - now
        start = end + draw()
        kernel.now = start
        if disturber.replies_at_risk and disturber.reply_vanishes(slave.position, start):
            port.watch()
            return True
        reply = engine.begin_transmit(start, slave.plc.image_at(start), frame.counter)
        over = start + len(reply.chars) * bus.character
        kernel.now = over
        bus.frames += 1
        bus.busy += over - start
        shared_listener.hear(reply, start, over)
        port.handle(master.receive_frame(reply, start, over), over)
        bus.block_history.heard(station, over, reply.data, missed)
        bus.sink.refreshed(bus.name, slave.position, over, took)
        engine.transmit_done(over)
        return True

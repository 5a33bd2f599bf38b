"""The ordinary exchange in one go: poll, turnaround, reply, on a line where nothing else can happen.

Where the gallery stands for every listener, nothing disturbs frames and SimPy's next event lies
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


class _Way(NamedTuple):
    """One slave's exchanges by the short way, as long as nobody begins to listen or send otherwise."""

    slave: LinkPort
    engine: Slave
    draw: Callable[[], int]
    missed: tuple[int, ...]  # seats that do not hear its replies
    took: tuple[int, ...] | None  # seats that do, None for all
    longest: int  # ticks from the poll's start by which the reply has ended


class Lane:
    """The short way for one bus's exchanges."""

    __slots__ = ("_bus", "_kernel", "_peek", "_poll", "_ways")

    def __init__(self, bus: LinkBus, kernel: Kernel) -> None:
        self._bus = bus
        self._kernel = kernel
        self._peek = kernel.env.peek
        self._poll = bus.timing.characters(POLL_CHARS)
        # By station; None where its exchanges must go the long way.
        self._ways: dict[int, _Way | None] = {}

    def close(self) -> None:
        """Somebody listens or sends otherwise than before: look anew at every way."""
        if self._ways:
            self._ways.clear()

    def _way(self, port: LinkPort, master: Master, station: int) -> _Way | None:
        bus = self._bus
        slave = bus.gallery.by_station.get(station)
        way: _Way | None = None
        if slave is not None and bus.plain and bus.gallery.expects(station) and port.prompt and slave.prompt:
            polled_whole, polled_single, _ = bus.audience(port)
            reply_whole, reply_single, _ = bus.audience(slave)
            alone = [hearer for hearer, _ in reply_whole] == [port]
            engine = slave.engine
            if alone and isinstance(engine, Slave) and not (polled_whole or polled_single or reply_single):
                hearers = (port, *bus.gallery.members)
                others = [other.seat for other in bus.ports if other is not slave]
                took = tuple(hearer.seat for hearer in hearers if hearer is not slave)
                missed = tuple(seat for seat in others if seat not in took)
                reply = bus.timing.characters(data_chars(master.config.settings.mode))
                answered = slave.longest_turnaround + reply
                if answered <= master.config.timeout:
                    longest = self._poll + answered
                    way = _Way(slave, engine, slave.turnaround, missed, took if missed else None, longest)
        self._ways[station] = way
        return way

    def exchange(self, port: LinkPort, now: int) -> bool:
        """Carry out the exchange whose poll is due at ``now``; False: it must go the long way."""
        bus, master = self._bus, port.engine
        if type(master) is not Master or not master.first_attempt:
            return False
        station = master.station
        ways = self._ways
        way = ways[station] if station in ways else self._way(port, master, station)
        if way is None:
            return False
        slave, engine, draw, missed, took, longest = way
        gallery, kernel, disturber = bus.gallery, self._kernel, bus.disturber
        if bus.drivers or slave.pending or gallery.pending >= 0 or self._peek() <= now + longest:
            return False
        end = now + self._poll
        frame = master.begin_transmit(now, _NO_IMAGE)
        kernel.now = end
        gallery.hear(frame, now, end)
        master.transmit_done(end)
        bus.frames += 1
        bus.busy += end - now
        start = end + draw()
        kernel.now = start
        if disturber.replies_at_risk and disturber.reply_vanishes(slave.seat, start):
            port.watch()
            return True
        reply = engine.begin_transmit(start, slave.plc.image_at(start), frame.counter)
        over = start + len(reply.chars) * bus.character
        kernel.now = over
        bus.frames += 1
        bus.busy += over - start
        gallery.hear(reply, start, over)
        port.handle(master.receive_frame(reply, start, over), over)
        bus.ledger.heard(station, over, reply.data, missed)
        bus.sink.refreshed(bus.name, slave.seat, over, took)
        engine.transmit_done(over)
        return True

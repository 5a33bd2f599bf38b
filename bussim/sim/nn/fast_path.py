"""The ordinary exchange as one function call: poll, turnaround, reply, while nothing else can happen.

Where the shared listener stands for every listener, nothing disturbs frames and SimPy's next event lies
beyond the longest possible reply, no event can come between the steps of an exchange. They are then done
here one after the other, in the same order, at the same ticks and with the same draws as through timers,
transmissions and deliveries: a run has the same result to the last bit with and without the fast path,
which a test compares.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from bussim.engines.nn.frames import POLL_CHARS, data_chars
from bussim.engines.nn.master import Master
from bussim.engines.nn.slave import Slave
from bussim.sim.kernel import Kernel
from bussim.sim.nn.block_history import BlockHistory
from bussim.sim.nn.contract import LinkStation
from bussim.sim.nn.shared_listener import SharedListener
from bussim.sim.wire.line import Line


class _Exchange(NamedTuple):
    """What all fast exchanges with one slave have in common, as long as the listeners do not change."""

    slave: LinkStation
    engine: Slave
    draw: Callable[[], int]
    missed: tuple[int, ...]  # positions that do not receive its replies
    took: tuple[int, ...] | None  # positions that do, None for all
    longest: int  # ticks from the poll's start by which the reply has ended


class FastPath:
    """The fast exchanges of one bus."""

    __slots__ = ("_bus", "_exchanges", "_history", "_kernel", "_peek", "_poll", "_shared_listener")

    def __init__(
        self, bus: Line, kernel: Kernel, shared_listener: SharedListener, history: BlockHistory
    ) -> None:
        self._bus = bus
        self._kernel = kernel
        self._peek = kernel.env.peek
        self._poll = bus.timing.characters(POLL_CHARS)
        self._shared_listener = shared_listener
        self._history = history
        # By station; None where its exchanges cannot be fast.
        self._exchanges: dict[int, _Exchange | None] = {}

    def invalidate(self) -> None:
        """Some node receives or sends otherwise than before: examine every slave again."""
        if self._exchanges:
            self._exchanges.clear()

    def _examine(self, port: LinkStation, master: Master, station: int) -> _Exchange | None:
        """Whether the exchanges with a slave can be fast, and what they have in common."""
        bus, shared_listener = self._bus, self._shared_listener
        slave = shared_listener.by_station.get(station)
        exchange: _Exchange | None = None
        if (
            slave is not None
            and bus.undisturbed
            and shared_listener.expects(station)
            and port.undelayed
            and slave.undelayed
        ):
            polled_whole, polled_single, _ = bus.listeners_of(port)
            reply_whole, reply_single, _ = bus.listeners_of(slave)
            master_only = [listener for listener, _ in reply_whole] == [port]
            engine = slave.engine
            if (
                master_only
                and isinstance(engine, Slave)
                and not (polled_whole or polled_single or reply_single)
            ):
                receivers = (port, *shared_listener.members)
                others = [other.position for other in bus.ports if other is not slave]
                took = tuple(receiver.position for receiver in receivers if receiver is not slave)
                missed = tuple(position for position in others if position not in took)
                reply = bus.timing.characters(data_chars(master.config.settings.mode))
                replied = slave.longest_turnaround + reply
                # A reply that the timeout may cut short needs the master's deadline.
                if replied <= master.config.timeout:
                    longest = self._poll + replied
                    exchange = _Exchange(
                        slave, engine, slave.turnaround, missed, took if missed else None, longest
                    )
        self._exchanges[station] = exchange
        return exchange

    def exchange(self, port: LinkStation, now: int) -> bool:
        """Carry out the exchange whose poll is due at ``now``; False: nothing was done, use timers."""
        bus, master = self._bus, port.engine
        if type(master) is not Master or not master.first_attempt:
            return False
        station = master.station
        exchanges = self._exchanges
        found = exchanges[station] if station in exchanges else self._examine(port, master, station)
        if found is None:
            return False
        slave, engine, draw, missed, took, longest = found
        shared_listener, kernel, disturber = self._shared_listener, self._kernel, bus.disturber
        # SimPy's next event (a fault, an END that is waited for, a watchdog) must come after the reply.
        if bus.drivers or slave.pending or shared_listener.pending >= 0 or self._peek() <= now + longest:
            return False
        end = now + self._poll
        frame = master.begin_transmit(now)
        kernel.now = end
        shared_listener.receive(frame, now, end)
        master.transmit_done(end)
        bus.frames += 1
        bus.busy += end - now
        start = end + draw()
        kernel.now = start
        if disturber.replies_at_risk and disturber.reply_vanishes(slave.position, start):
            port.arm_deadline()
            return True
        engine.image = slave.plc.image_at(start)
        reply = engine.begin_transmit(start, frame.counter)
        over = start + len(reply.chars) * bus.character
        kernel.now = over
        bus.frames += 1
        bus.busy += over - start
        shared_listener.receive(reply, start, over)
        port.handle(master.receive_frame(reply, start, over), over)
        self._history.received(station, over, reply.data, missed)
        bus.sink.refreshed(bus.name, slave.position, over, took)
        engine.transmit_done(over)
        return True

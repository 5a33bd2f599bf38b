"""A whole Modbus transaction at once, where the slave is alone with its master and nothing disturbs.

A request leaves an idle line for a slave that responds by itself, with only slaves beside it: then it is
known what each engine receives and when, and they are asked for request, response and outcome in turn,
without an event for each frame and silence. Only the outcome waits for its tick, since the master goes on
there. A run has the same results to the last byte with and without, which a test compares.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, cast

from bussim.engines.contract import Transmit
from bussim.engines.modbus.adu import Adu, Mode
from bussim.engines.modbus.master import Master
from bussim.engines.modbus.polling import PollingMaster
from bussim.engines.modbus.slave import Slave
from bussim.sim.wire.contract import Transmission

if TYPE_CHECKING:
    from bussim.sim.kernel import Kernel
    from bussim.sim.serial.bus import SerialBus
    from bussim.sim.serial.node import SerialNode


class _Exchange(NamedTuple):
    """The slave that responds to a station's requests of a master, and the others that receive both frames.

    Times in ticks: the silences behind request and response, and the longest one from the request's end on.
    """

    slave: SerialNode
    others: list[Slave]
    served: int
    closing: int
    longest: int


class TransactionPath:
    """The transactions of one bus."""

    def __init__(self, bus: SerialBus) -> None:
        self._bus = bus
        #: By the master's position and the station that is asked, until listeners change; None: not at once.
        self.exchanges: dict[tuple[int, int], _Exchange | None] = {}

    def pass_transaction(self, node: SerialNode, request: Adu, now: int, kernel: Kernel) -> bool:
        """Do the transaction whose request leaves now, up to its outcome; False: nothing was done."""
        bus, key = self._bus, (node.position, request.station)
        if not bus.at_once or bus.sink.traced or not bus.undisturbed:
            return False
        if key not in self.exchanges:
            self.exchanges[key] = self._exchange(node, request.station)
        exchange = self.exchanges[key]
        if exchange is None:
            return False
        slave, others, served, closing, longest = exchange
        master, responding = node.engine, slave.engine
        asked = now + len(request.chars) * bus.character
        latest = asked + longest + master.longest_response * bus.character + closing
        if (
            latest >= min(kernel.calm_until(now), asked + master.config.timeout)
            or slave.pending
            or not responding.ready_for(now)
            or not all(other.ready_for(now) for other in others)
        ):
            return False
        master.transmit_done(asked)
        responding.receive_complete(request, now, asked, asked + served)
        while not isinstance(item := responding.poll(), Transmit):
            slave.report(item, asked + served)
        begun = slave.reply_at(item.at)
        response = responding.begin_transmit(begun, item.counter)
        end = begun + len(response.chars) * bus.character
        slave.replied(item.counter, begun, end, len(response.chars))
        responding.transmit_done(end)
        for other in others:
            other.overhear(request, now, response, begun, end)
        # Others may still wait for the silence behind the response: later it is known who sent it.
        bus.delivered.append(Transmission(slave, response, response.chars, begun, end, slave.timing))
        bus.frames += 2
        bus.busy += asked - now + end - begun
        node.await_outcome(response, begun, end, end + closing)
        return True

    def _exchange(self, node: SerialNode, station: int) -> _Exchange | None:
        """How a master's transactions with a station go, None where they do not go at once."""
        bus = self._bus
        whole, single = bus.listeners_of(node)
        slaves = [cast("SerialNode", port) for port, _ in whole]
        asked = [slave for slave in slaves if station in slave.stations]
        if (
            single
            or len(asked) != 1
            or type(node.engine) not in (Master, PollingMaster)
            or any(type(slave.engine) is not Slave for slave in slaves)
            or any(each.late_release for each in (node, *slaves))
        ):
            return None
        slave = asked[0]
        config, served = slave.engine.config, _silence(slave)
        least = max(served, config.delay) + slave.extra_turnaround
        others = [each for each in slaves if each is not slave]
        if config.driven or bus.listeners_of(slave)[1] or any(_silence(each) > least for each in others):
            return None
        engines = [each.engine for each in others]
        return _Exchange(slave, engines, served, _silence(node), least + slave.longest_delay)


def _silence(node: SerialNode) -> int:
    """The silence behind a whole frame that a node waits for, in ticks."""
    return node.quiet(node.timing) if node.engine.config.framing.mode is Mode.RTU else 0

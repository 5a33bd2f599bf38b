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


class Exchange(NamedTuple):
    """The slave that responds to a station's requests of a master, and the others that receive both frames.

    Times in ticks: the silences behind request and response, the longest one from the request's end on, and
    the longest that the others wait for.
    """

    slave: SerialNode
    others: list[Slave]
    served: int
    closing: int
    longest: int
    quiet: int

    def ready_for(self, start: int) -> bool:
        """Whether all slaves have heard silence before a request that begins at ``start``."""
        engines = (self.slave.engine, *self.others)
        return not self.slave.pending and all(engine.ready_for(start) for engine in engines)


class TransactionPath:
    """The transactions of one bus."""

    def __init__(self, bus: SerialBus) -> None:
        self._bus = bus
        #: By the master's position and the station that is asked, until listeners change; None: not at once.
        self.exchanges: dict[tuple[int, int], Exchange | None] = {}

    def exchange(self, node: SerialNode, station: int) -> Exchange | None:
        """How a master's transactions with a station go, None where they do not go at once."""
        bus, key = self._bus, (node.position, station)
        if not bus.at_once or bus.sink.traced or not bus.undisturbed:
            return None
        if key not in self.exchanges:
            self.exchanges[key] = self._exchange(node, station)
        return self.exchanges[key]

    def pass_transaction(self, node: SerialNode, request: Adu, now: int, kernel: Kernel) -> bool:
        """Do the transaction whose request leaves now, up to its outcome; False: nothing was done."""
        exchange = self.exchange(node, request.station)
        if exchange is None:
            return False
        master, character = node.engine, self._bus.character
        asked = now + len(request.chars) * character
        latest = asked + exchange.longest + master.longest_response * character + exchange.closing
        if latest >= min(kernel.calm_until(now), asked + master.config.timeout) or not exchange.ready_for(
            now
        ):
            return False
        response, begun, end = self.pass_frames(exchange, node, request, now)
        node.await_outcome(response, begun, end, end + exchange.closing)
        return True

    def pass_frames(
        self, exchange: Exchange, node: SerialNode, request: Adu, now: int, begun: int | None = None
    ) -> tuple[Adu, int, int]:
        """What becomes of request and response at all nodes; returns the response and its two ends.

        ``begun`` is when it begins, None where that is still to be drawn.
        """
        bus, (slave, others, served, *_) = self._bus, exchange
        responding = slave.engine
        asked = now + len(request.chars) * bus.character
        node.engine.transmit_done(asked)
        responding.receive_complete(request, now, asked, asked + served)
        while not isinstance(item := responding.poll(), Transmit):
            slave.report(item, asked + served)
        begun = slave.reply_at(item.at) if begun is None else begun
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
        return response, begun, end

    def _exchange(self, node: SerialNode, station: int) -> Exchange | None:
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
        quiet = max(map(_silence, others), default=0)
        return Exchange(slave, engines, served, _silence(node), least + slave.longest_delay, quiet)


def _silence(node: SerialNode) -> int:
    """The silence behind a whole frame that a node waits for, in ticks."""
    return node.quiet(node.timing) if node.engine.config.framing.mode is Mode.RTU else 0

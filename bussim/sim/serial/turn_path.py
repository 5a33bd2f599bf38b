"""Many turns of a PLC's poll list at once, where nothing can come between and nothing shows in between.

At the END at which a request leaves, as long as each transaction of the list can be done at once
(:mod:`bussim.sim.serial.transaction_path`), only reads, gets its response, and neither the PLC nor its link
look at what is read, the turns follow from the list, the scans and the delays of the responses: they are done
up to the next fault. All but the last are counted only; the last one is done by the engines, which leaves
them as they would be. A run has the same results to the last byte with and without, which a test compares.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from bussim.engines.modbus.master import Master
from bussim.engines.modbus.pdu import ExceptionResponse, Request, Response, response_size
from bussim.engines.modbus.server import serve
from bussim.plc.plc import Plc
from bussim.plc.ports.master import MasterSide, Times, Turn
from bussim.sim.serial.transaction_path import Exchange
from bussim.trace.records import CycleRecord, OrdinaryTurns, TransactionRecord
from bussim.units import TICKS_PER_SECOND

if TYPE_CHECKING:
    from bussim.sim.kernel import Kernel
    from bussim.sim.serial.plc_port import PlcPort

#: How far ahead of the present turns are done: the ENDs up to there are kept.
_AHEAD = 30 * TICKS_PER_SECOND


class _Poll(NamedTuple):
    """One poll of a list: its request, who responds, how long that takes."""

    request: Request
    exchange: Exchange
    times: Times
    chars: int  # of request and response


class TurnPath:
    """The turns of the polls of one PLC, of which not every END is carried out."""

    def __init__(self, plc: Plc, ports: Sequence[PlcPort], kernel: Kernel) -> None:
        self._plc = plc
        self._ports = ports
        self._kernel = kernel

    def pass_turns(self, now: int) -> bool:
        """Do the turns from the END ``now`` on, at which a request leaves; False: nothing was done."""
        plc = self._plc
        ports = [port for port in self._ports if port.engine is not None]
        side = ports[0].port_registers.polling if len(ports) == 1 else None
        if (
            side is None
            or not (plc.ports_apart and plc.is_independent)
            or plc.cycle.on_change is not None
            or (plc.observer is not None and plc.observer.takes_ends)
            or ports[0].bus.sink.in_order
            or not side.leaves(now)
        ):
            return False
        port, until = ports[0], min(self._kernel.calm_until(now), now + _AHEAD)
        polls: list[_Poll] = []
        for spec in side.polls:
            request = Request(spec.function, spec.address, spec.count)
            exchange = port.bus.transaction_path.exchange(port, spec.station)
            if exchange is None or not (side.can_be_sent(spec) and exchange.ready_for(now)):
                return False
            until = min(until, exchange.slave.engine.maps[spec.station].alike_until(now))
            polls.append(_poll(port, side.engine, request, exchange))
        if until <= now or any(
            poll.times.responded >= side.engine.config.timeout
            or isinstance(_served(poll, spec.station, now), ExceptionResponse)
            for poll, spec in zip(polls, side.polls, strict=True)
        ):
            return False
        load, times = plc.profile.transaction_time, [poll.times for poll in polls]
        turns, cycles = side.pass_turns(now, until, plc.cycle, load, plc.longest_drawn, times)
        if not turns:
            return False
        of: dict[int, list[Turn]] = {}
        for number, turn in turns:
            of.setdefault(number, []).append(turn)
        self._leave(port, side, polls, of)
        bus, master = port.bus, port.name
        found = []
        for number, own in of.items():
            (request, exchange, each, chars), spec, first = polls[number], side.polls[number], own[0]
            asked, over = first.sent + each.asking, first.begun + each.responding
            asking = bus.name, master, spec.name, 1, spec.station, *request[:3], first.sent, asked
            outcome = first.begun, over, over + each.closing, first.taken, "ok", None, 0
            record = TransactionRecord(
                *asking, *outcome, asked + exchange.served, mismatched=False, chars=chars
            )
            found.append(OrdinaryTurns(record, exchange.slave.name, *map(list, zip(*own, strict=True))))
        ended = [(item.number, item.tick - item.duration, item.duration) for item in cycles]
        bus.sink.ordinary_turns(found, [CycleRecord(bus.name, master, *item) for item in ended])
        return True

    def _leave(
        self, port: PlcPort, side: MasterSide, polls: Sequence[_Poll], of: dict[int, list[Turn]]
    ) -> None:
        """Leave memory, engines and counts as the turns of each poll do."""
        bus, engine = port.bus, side.engine
        for number, own in sorted(of.items(), key=lambda item: item[1][-1].sent):
            poll, spec, sent = polls[number], side.polls[number], own[-1].sent
            response = _served(poll, spec.station, sent + poll.times.asking + poll.exchange.served)
            if isinstance(response, Response):
                side.store(spec, response.values)
            bus.frames += 2 * len(own)
            bus.busy += len(own) * (poll.times.asking + poll.times.responding)
            counts = port.reporter.counts(poll.exchange.slave.name)
            counts.requests += len(own)
            counts.answered += len(own)
        # The last one of all is done, and counted, by the engines.
        bus.frames -= 2
        bus.busy -= poll.times.asking + poll.times.responding
        counts.requests -= 1
        counts.answered -= 1
        engine.submit(spec.station, poll.request, sent)
        frame = engine.begin_transmit(sent, engine.due_counter)
        port.request_chars = len(frame.chars)
        whole = bus.transaction_path.pass_frames(poll.exchange, port, frame, sent, own[-1].begun)
        engine.receive_complete(*whole, whole[2] + poll.times.closing)
        while engine.poll() is not None:
            pass  # the outcome is taken over already


def _poll(port: PlcPort, master: Master, request: Request, exchange: Exchange) -> _Poll:
    framing, character, slave = master.config.framing, port.bus.character, exchange.slave
    asking, responding = framing.chars(5), framing.chars(response_size(request))
    times = Times(
        asking * character,
        exchange.longest - slave.longest_delay,
        slave.delays,
        slave.longest_delay,
        responding * character,
        exchange.closing,
        exchange.quiet,
    )
    return _Poll(request, exchange, times, asking + responding)


def _served(poll: _Poll, station: int, now: int) -> Response | ExceptionResponse:
    return serve(poll.exchange.slave.engine.maps[station], poll.request, now)

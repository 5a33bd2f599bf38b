"""A master that has just asked, and what it makes of what it hears."""

from __future__ import annotations

import pytest

from bussim.engines.contract import DEADLINE, TRANSMIT, Transmit
from bussim.engines.modbus.adu import Adu, Mode, encode_adu
from bussim.engines.modbus.codes import PortError
from bussim.engines.modbus.events import MasterEvent, TransactionEnded
from bussim.engines.modbus.framing import Framing
from bussim.engines.modbus.master import Master, MasterConfig
from bussim.engines.modbus.pdu import (
    Request,
    Response,
)
from bussim.units import TICKS_PER_MS
from tests.engines.modbus.wire import ASCII_LINE, RTU_LINE, drain, receive_by_character

MS = TICKS_PER_MS
RTU = Framing.rtu(RTU_LINE)
ASCII = Framing.ascii()
LINES = {Mode.RTU: (RTU, RTU_LINE), Mode.ASCII: (ASCII, ASCII_LINE)}
both_modes = pytest.mark.parametrize("mode", list(Mode))
READ = Request(3, 0, 2)
GOOD = Response(3, 0, 2, (180, 8))


class Bench:
    """A master that has just sent its request: ``asked`` is the end of it."""

    def __init__(
        self, mode: Mode = Mode.RTU, station: int = 1, request: Request = READ, **config: object
    ) -> None:
        self.framing, self.line = LINES[mode]
        self.master = Master(MasterConfig(self.framing, timeout=100 * MS, **config))
        self.master.start(0)
        assert self.master.submit(station, request, 0) & TRANSMIT
        assert drain(self.master) == [Transmit(0, counter=1)]
        frame = self.master.begin_transmit(0)
        self.asked = self.line.characters(len(frame.chars))
        assert self.master.transmit_done(self.asked) & DEADLINE
        self.start = self.asked + 10 * MS
        self.now = self.start

    def adu(self, pdu: bytes, station: int = 1) -> Adu:
        return encode_adu(self.framing.mode, station, pdu)

    def receive(self, chars: bytes, *, gap: int = 0, quiet: bool = True) -> list[MasterEvent]:
        """Characters from ``gap`` ticks after the latest on, then (RTU) the silence that ends them."""
        _, end = receive_by_character(self.master, chars, self.now + gap, self.line)
        self.now = end
        if quiet and self.framing.mode is Mode.RTU:
            self.now += self.framing.quiet
            self.master.line_idle(self.now)
        return drain(self.master)

    def until_timeout(self) -> list[MasterEvent]:
        deadline = self.master.deadline()
        assert deadline == self.asked + 100 * MS
        self.master.on_deadline(deadline)
        return drain(self.master)


def outcome(events: list[MasterEvent]) -> tuple[PortError | None, int, Response | None]:
    ended = [event for event in events if isinstance(event, TransactionEnded)]
    assert len(ended) == 1
    return ended[0].error, ended[0].exception, ended[0].response

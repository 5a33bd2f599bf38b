"""A PLC's port as Modbus slave: its requests are served at END (LX slave note)."""

from __future__ import annotations

from bussim.engines.modbus.slave import Slave
from bussim.engines.modbus.states import SlaveState
from bussim.line.characters import LineTiming
from bussim.plc.ports.side import Side
from bussim.units import round_half_up

_BUSY = frozenset((SlaveState.SERVING, SlaveState.RESPONDING, SlaveState.SENDING))


class SlaveSide(Side):
    """See the base class. No RS2 drives it; damaged frames and refused requests raise no port error."""

    def __init__(self, engine: Slave, timing: LineTiming) -> None:
        self.engine = engine
        self._character = timing.character
        self._over = 0  # when the reply will have left, if nothing holds it up
        self._latest = -1  # END

    @property
    def busy(self) -> bool:
        """From a request's reception until its reply has left."""
        return self.engine.state in _BUSY

    def wanted_end(self, now: int) -> int | None:
        """See the base class."""
        if self.engine.waiting:
            return now
        return max(self._over, self._latest + 1) if self.busy else None

    def at_end(self, end: int) -> int:
        """See the base class."""
        engine = self.engine
        self._latest = end
        hints = 0
        while engine.waiting:  # after a broadcast the next request may wait already
            hints |= engine.serve(end)
        reply = engine.reply
        if reply is not None and hints:
            self._over = engine.due + round_half_up(self._character * len(reply.chars))
        return hints

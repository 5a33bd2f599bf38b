"""A PLC's port as Modbus slave: its requests are served at END (LX slave note)."""

from typing import assert_never

from bussim.engines.modbus.codes import REJECTION_ERRORS, SLAVE_ERRORS, exception_error
from bussim.engines.modbus.events import FrameRejected, RequestServed, SlaveEvent, StationRefused
from bussim.engines.modbus.slave import Slave
from bussim.engines.modbus.states import SlaveState
from bussim.line.characters import LineTiming
from bussim.plc.ports.side import Side
from bussim.plc.ports.status import PortStatus
from bussim.units import round_half_up

_BUSY = frozenset((SlaveState.SERVING, SlaveState.RESPONDING, SlaveState.SENDING))


class SlaveSide(Side):
    """See the base class. No RS2 drives it.

    Damaged frames and refused requests raise port errors of ``status``, a request that is served ends them
    (assumed); with None they raise none.
    """

    def __init__(self, engine: Slave, timing: LineTiming, status: PortStatus | None) -> None:
        self.engine = engine
        self._status = status
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

    def event(self, item: SlaveEvent, now: int) -> None:
        """See the base class."""
        status, error = self._status, None
        if status is None:
            return
        match item:
            case FrameRejected():
                error = REJECTION_ERRORS.get(item.reason)
            case RequestServed() if item.exception:
                error = exception_error(item.exception)
            case RequestServed():
                status.good()
            case StationRefused():
                pass
            case _:
                assert_never(item)
        if error in SLAVE_ERRORS:
            status.failed(error, now)

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

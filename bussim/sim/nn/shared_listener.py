"""One listener in place of the engines of all slaves that receive the same frames.

Nearly always every slave of a link has received the same frames, all of them ordinary: then the reception
state of each is the same, and keeping it once is enough. A frame costs one call instead of one for each
slave. Anything else (a repeat, a missing reply, a flag, damage) ends this: the engines are brought up to
the common state, and each receives for itself again until the next data frame of the master.
"""

from __future__ import annotations

from collections.abc import Sequence

from bussim.engines.nn.codes import NOT_IN_NETWORK
from bussim.engines.nn.frames import DATA, POLL, Frame
from bussim.engines.nn.monitor import NONE_PENDING, Reception, ReceptionState
from bussim.engines.nn.slave import Slave
from bussim.sim.nn.contract import LinkStation


class SharedListener(Reception):
    """The members are steady slaves with equal reception states; which node sent a frame plays no part.

    A member's engine lags behind until :meth:`sync`.
    """

    def __init__(self) -> None:
        self.members: tuple[LinkStation, ...] = ()
        #: The member with a station number.
        self.by_station: dict[int, LinkStation] = {}
        self._flagged: set[int] = set()
        self._current: int | None = None
        self._longest = -1
        self._longest_at = 0
        self._block_size = -1
        self._watchdog = 0
        self._stale = False  # something was received since the members' engines were brought up to date
        self.resume(ReceptionState(NONE_PENDING, 0, 0, 0, 0, None, 0))

    def form(self, ports: Sequence[LinkStation]) -> None:
        """Take in those of these ports whose slaves are steady and agree with the first such one."""
        slaves = [port.engine for port in ports if isinstance(port.engine, Slave)]
        if len({slave.config.station for slave in slaves}) < len(slaves):
            return  # two stations with one number differ in what is addressed to them
        state: ReceptionState | None = None
        members: list[LinkStation] = []
        by_station: dict[int, LinkStation] = {}
        flagged: set[int] = set()
        for port in ports:
            engine = port.engine
            if not isinstance(engine, Slave) or not engine.steady or engine.settings is None:
                continue
            if state is None:
                state = engine.reception
                if state.pending >= 0:
                    return
                self._block_size = engine.block_size
            elif engine.reception != state or engine.block_size != self._block_size:
                continue
            members.append(port)
            by_station[engine.config.station] = port
            flagged.update(number for number, on in enumerate(engine.status.flags) if on)
        if state is None or len(members) < 2:
            return
        self.members, self.by_station, self._flagged = tuple(members), by_station, flagged
        self.resume(state)
        self._current, self._longest = None, -1
        self._watchdog = min(e.watchdog for e in slaves if e.watchdog)

    @property
    def deadline(self) -> int:
        """When the first member's watchdog on the master expires if nothing more is received."""
        return self._heard_master + self._watchdog

    def release(self) -> tuple[LinkStation, ...]:
        """Bring every member's engine up to date and release it; returns the former members."""
        members = self.members
        self.sync()
        self.members = ()
        self.by_station = {}
        return members

    def sync(self) -> None:
        """Bring every member's engine up to date."""
        if not self._stale:
            return
        self._stale = False
        state = self.reception
        for port in self.members:
            engine = port.engine
            if not isinstance(engine, Slave):
                continue
            engine.resume(state)
            if self._current is not None:
                engine.status.measured(self._longest, self._longest_at)
                engine.status.current = self._current
        self._current, self._longest = None, -1

    def expects(self, station: int) -> bool:
        """Whether a first poll of this station and its reply are ordinary while no poll is pending."""
        return bool(self.members) and station not in self._flagged

    def receive(self, frame: Frame, start: int, end: int) -> bool:
        """Receive a frame for all members; returns whether it was an ordinary one.

        If not, nothing has changed: release the members and pass the frame to their engines.
        """
        self._stale = True
        kind = frame.kind
        if kind == POLL:
            pending, station = self.pending, frame.station
            if pending >= 0 or (station == ~pending and frame.counter == self._pending_counter):
                return False
            self._heard_master = end
            self._counter = self._pending_counter = frame.counter
            self.pending = station
            self._outcome = NOT_IN_NETWORK
            return True
        if kind != DATA or len(frame.data) != self._block_size:
            return False
        station = frame.station
        if station:
            if station != self.pending or frame.counter != self._pending_counter or station in self._flagged:
                return False
            self.pending = ~station
            return True
        if self.pending >= 0:
            return False
        self._heard_master = end
        counter = frame.counter
        if self._data_start is not None and counter == (self._data_counter + 1) & 15:
            duration = start - self._data_start
            self._current = duration
            if duration > self._longest:
                self._longest, self._longest_at = duration, start
        self._data_start = start
        self._data_counter = self._counter = counter
        return True

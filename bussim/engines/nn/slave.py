"""The N:N slave: replies to its polls, and notes what it receives of all other stations.

Parameters and codes: PW10 board manual, section 7.5; FX communication manual JY992D69901, chapters 4
and 12.2. That a slave without the master's mode reports 7348/7448 and stays silent until STOP is assumed.
"""

from bussim.engines.contract import DEADLINE, EVENTS, OPEN, TRANSMIT, RxChar
from bussim.engines.nn import codes
from bussim.engines.nn.contract import STORED
from bussim.engines.nn.events import ParametersRefused, ParametersTaken, PolledWithoutParameters
from bussim.engines.nn.frames import DATA, MODES, POLL, Damage, Frame, FrameReader, LinkSettings, encode_data
from bussim.engines.nn.master import Master
from bussim.engines.nn.monitor import NONE_PENDING, LinkMonitor, ReceptionState, SlaveConfig
from bussim.engines.nn.ordinary import OrdinaryScans
from bussim.engines.nn.states import SLAVE, SlaveInput, SlaveState
from bussim.engines.nn.status import LinkStatus


class Slave(LinkMonitor):
    """A station 1–7 of a link. See :mod:`bussim.engines.contract` for the methods.

    Until the master's parameter frame arrives it ignores everything, except that a poll makes it
    store code 31 about itself. ``due`` is when a reply's turnaround began, the end of its poll.
    """

    replies = True
    wants_image = True

    def __init__(self, config: SlaveConfig) -> None:
        super().__init__(config)
        self.state = SlaveState.STOPPED
        #: The master's settings, None before they arrived.
        self.settings: LinkSettings | None = None
        self._reader = FrameReader()
        self._reset()

    def _reset(self) -> None:
        self._reader.reset()
        self._reader.data_size = None
        self.settings = None
        self.due = -1
        #: Bytes of a block in the link's mode, -1 while it is unknown.
        self.block_size = -1
        self._sent_counter = 0  # of the reply sent latest
        self._reset_notes()

    @property
    def steady(self) -> bool:
        """Linked, the master not in error and no frame unfinished."""
        return self.state is SlaveState.LINKED and not self._alert and not self._reader.open

    def in_step(self, master: Master) -> bool:
        """Whether an ordinary scan of this master, whose data frame is due, is one for this slave, too."""
        return (
            self.steady
            and self.pending < 0
            and self._pending_counter != master.counter
            and self.block_size == master.block_size
            and not any(self.status.flags)
        )

    def pass_scans(self, scans: OrdinaryScans) -> None:
        """Pass ordinary scans of a master with which it is in step."""
        status, starts, latest = self.status, scans.starts, scans.latest
        if self._data_start is not None and scans.counter == (self._data_counter + 1) & 15:
            status.measured(int(starts[0]) - self._data_start, int(starts[0]))
        status.measured_each(scans.measured)
        polled = int(scans.polled[-1, -1])
        self.resume(
            ReceptionState(
                ~scans.slaves, latest, codes.NOT_IN_NETWORK, latest, polled, int(starts[-2]), latest
            )
        )
        if self.config.station <= scans.slaves:
            self.due_counter = self._sent_counter = latest
            status.running = True

    # -- what the PLC does ---------------------------------------------------------------------

    def start(self, now: int) -> int:
        """RUN; returns hints. Clears the status as STOP→RUN does."""
        self._reset()
        self.status = LinkStatus()
        self.state = SLAVE[self.state, SlaveInput.START]
        return DEADLINE

    def stop(self, now: int) -> int:
        """STOP or power-off: it sends and receives no more, the parameters are lost; returns hints."""
        self._reset()
        self.status.running = False
        self.state = SLAVE[self.state, SlaveInput.STOP]
        return DEADLINE

    # -- receiving -----------------------------------------------------------------------------

    def receive(self, char: RxChar, start: int, end: int) -> int:
        """One character; see the contract."""
        reader = self._reader
        heard = reader.character(char, start)
        if heard is None:
            return OPEN
        if type(heard) is Frame:
            self.heard, self.heard_start = heard, reader.start
            return self.receive_frame(heard, reader.start, end)
        assert type(heard) is Damage  # noqa: S101 - narrows the type; the reader returns nothing else
        return OPEN | (self._damaged(heard, end) if self.state is SlaveState.LINKED else 0)

    def receive_frame(self, frame: Frame, start: int, end: int) -> int:
        """A whole undamaged frame; the same as its characters one by one."""
        if self.state is not SlaveState.LINKED:
            return self._without_parameters(frame, end)
        kind = frame.kind
        if kind == POLL:
            hints = self._master_heard(end) if self._alert else 0
            self._heard_master = end
            station, counter = frame.station, frame.counter
            hints |= self._poll_noted(station, counter, end)
            if station == self.config.station:
                self.due = end
                self.due_counter = counter
                return hints | TRANSMIT
            return hints
        if kind == DATA:
            if len(frame.data) != self.block_size:
                self._reader.reject(frame, start)
                return OPEN
            station = frame.station
            if station == self.pending and frame.counter == self._pending_counter:
                if station == self.config.station:
                    return 0
                self.pending = ~station
                if self.status.flags[station]:
                    return STORED | self._back(station, end)
                return STORED
            if station == 0:
                return self._master_data(frame, start, end)
            return self._other_data(frame, end)
        return self._parameters(frame, end)

    def _without_parameters(self, frame: Frame, end: int) -> int:
        if self.state is not SlaveState.WAITING:
            return 0
        if frame.settings is not None:
            return self._parameters(frame, end)
        if frame.kind == POLL and frame.station == self.config.station:
            self.status.codes[self.config.station] = codes.NO_PARAMETERS
            self._events.append(PolledWithoutParameters(end))
            return EVENTS
        return 0

    def _parameters(self, frame: Frame, end: int) -> int:
        settings = frame.settings
        assert settings is not None  # noqa: S101 - narrows the type; only parameter frames come here
        if settings.mode not in self.config.modes:
            self._reset()
            self.status.running = False
            self.state = SLAVE[self.state, SlaveInput.FOREIGN_MODE]
            self._events.append(ParametersRefused(end, settings))
            return EVENTS | DEADLINE
        hints = 0
        if settings != self.settings:
            self._events.append(ParametersTaken(end, settings))
            hints = EVENTS | DEADLINE  # another timeout may bring the watchdog forward
        self.settings = settings
        self.block_size = self._reader.data_size = MODES[settings.mode].size
        self._set_watchdog(settings)
        self.state = SLAVE[self.state, SlaveInput.PARAMETERS]
        self._counter = frame.counter
        if self.pending < 0:
            self.pending = NONE_PENDING  # a master that starts again counts from 0 again
        return hints | self._master_heard(end)

    def line_idle(self, now: int) -> int:
        """Two character times of silence: an unfinished frame is damaged."""
        damage = self._reader.quiet()
        return self._damaged(damage, now) if damage is not None and self.state is SlaveState.LINKED else 0

    # -- sending -------------------------------------------------------------------------------

    def begin_transmit(self, now: int, counter: int = 0) -> Frame:
        """The reply to the poll with this counter; it carries :attr:`image`."""
        self._sent_counter = counter
        if self._reader.length:
            self._reader.reset()
        return encode_data(self.config.station, counter, self.image)

    def transmit_done(self, now: int) -> int:
        """The reply has left: its poll has its reply, as far as this station knows."""
        if self.state is SlaveState.LINKED:
            if self.pending == self.config.station and self._pending_counter == self._sent_counter:
                self.pending = ~self.pending
            self.status.running = True
        return 0

"""The N:N master: one data frame, then every slave polled in turn, again and again.

Retries, timeout and codes: PW10 board manual, sections 7.4 and 7.5; FX communication manual
JY992D69901, chapters 4 and 12.2. The order of frames follows from the published link times; when a
damaged reply fails its attempt, and the parameter frame, are assumed.
"""

from dataclasses import dataclass

from bussim.engines.contract import DEADLINE, EVENTS, OPEN, TRANSMIT, RxChar
from bussim.engines.nn import codes
from bussim.engines.nn.contract import STORED, NnEngine
from bussim.engines.nn.events import (
    AllHealthy,
    AttemptEnded,
    MasterEvent,
    ScanEnded,
    StationBack,
    StationLost,
)
from bussim.engines.nn.frames import (
    DATA,
    MODES,
    STX,
    Damage,
    Frame,
    FrameReader,
    LinkSettings,
    encode_data,
    encode_parameters,
    encode_poll,
)
from bussim.engines.nn.ordinary import OrdinaryScans
from bussim.engines.nn.states import MASTER, MasterInput, MasterState
from bussim.engines.nn.status import STATIONS, LinkStatus

# Looked up once: the engine passes these two edges for every poll.
_AFTER_POLL = MASTER[MasterState.POLL, MasterInput.SENT]
_AFTER_ATTEMPT = MASTER[MasterState.REPLY, MasterInput.MORE]


@dataclass(frozen=True, slots=True)
class MasterConfig:
    """A master's settings, as its registers and its profile give them. Times in ticks.

    ``attempts`` is how often a slave is polled before it is in error; ``probe``: only once a scan
    while its flag is on; ``count_on_edge``: errors count once a loss, not once a scan.
    """

    settings: LinkSettings
    attempts: int
    timeout: int
    gap: int
    overhead: int
    probe: bool = False
    count_on_edge: bool = False


class Master(NnEngine[MasterEvent]):
    """The station 0 of a link. See :mod:`bussim.engines.contract` for the methods.

    The reply to a poll is a valid data frame of the polled station with the scan's counter whose last
    stop bit ends at or before the deadline, ``timeout`` after the end of the poll. It receives only
    while an attempt runs.
    """

    def __init__(self, config: MasterConfig, *, traced: bool = False) -> None:
        super().__init__()
        self.config = config
        #: Whether successful attempts are reported too.
        self.traced = traced
        self.state = MasterState.STOPPED
        self.status = LinkStatus()
        #: First attempts so far.
        self.polls = 0
        #: Failed attempts by station and code, station errors by station; never cleared by STOP.
        self.failed_attempts: dict[int, dict[int, int]] = {}
        self.station_errors = dict.fromkeys(range(1, config.settings.slaves + 1), 0)
        #: Bytes of a block in the link's mode.
        self.block_size = MODES[config.settings.mode].size
        self._reader = FrameReader()
        self._reader.data_size = self.block_size
        self._reset()

    def _reset(self) -> None:
        self._deadline: int | None = None
        self._counter = 0
        self._station = 1
        self._attempt = 1
        # In this attempt: characters that are no reply; a reply that began well and was damaged.
        self._other_characters = self._reply_damaged = False
        self._poll_start = self._poll_end = 0
        self._scan_start: int | None = None
        self._scans = 0
        self._scan_attempts = 0
        self._failures: list[tuple[int, int]] = []
        self._slowest = self._slowest_station = 0
        self._with_parameters = False
        # Stations that have not replied yet or whose flag is on.
        self._trouble = set(range(1, self.config.settings.slaves + 1))

    # -- what the PLC does ---------------------------------------------------------------------

    def start(self, now: int) -> int:
        """The PLC's first END in RUN; returns hints. Clears the status as STOP→RUN does."""
        self._reset()
        self.status = LinkStatus()
        self._move(MasterInput.START)
        self.wants_image = False
        self.due = now + self.config.gap
        return TRANSMIT

    def stop(self, now: int) -> int:
        """STOP or power-off: nothing pending survives but events; returns hints."""
        self._move(MasterInput.STOP)
        self.due = -1
        self._deadline = None
        self._reader.reset()
        self.status.running = False
        return (DEADLINE | EVENTS) if self._events else DEADLINE

    def _move(self, cause: MasterInput) -> None:
        self.state = MASTER[self.state, cause]

    # -- receiving -----------------------------------------------------------------------------

    def receive(self, char: RxChar, start: int, end: int) -> int:
        """One character; see the contract. Ignored unless an attempt runs."""
        if self.state is not MasterState.REPLY:
            return 0
        reader = self._reader
        heard = reader.character(char, start)
        if isinstance(heard, Frame):
            self.heard, self.heard_start = heard, reader.start
            return self._heard(heard, reader.start, end)
        if heard is not None:
            self._note_damage(heard)
        elif not reader.in_frame:
            self._other_characters = True
        return OPEN

    def follow(self, reader: FrameReader) -> int:
        """See the base class."""
        if self.state is not MasterState.REPLY:
            return 0
        self._other_characters |= not reader.in_frame
        return super().follow(reader)

    def receive_frame(self, frame: Frame, start: int, end: int) -> int:
        """A whole undamaged frame; the same as its characters one by one."""
        if self.state is not MasterState.REPLY:
            return 0
        if frame.kind == DATA and len(frame.data) != self.block_size:
            self._reader.reject(frame, start)
            self._other_characters = True
            return OPEN
        return self._heard(frame, start, end)

    def _heard(self, frame: Frame, start: int, end: int) -> int:
        if frame.kind != DATA:
            self._other_characters = True
            return OPEN if self._reply_damaged else 0
        station = self._station
        if frame.station != station:
            return self._failed(codes.WRONG_STATION, end, start)
        if frame.counter != self._counter:
            return self._failed(codes.WRONG_COUNTER, end, start)
        if self.traced:
            self._report(end, 0, start)
        waited = start - self._poll_end
        if waited > self._slowest:
            self._slowest, self._slowest_station = waited, station
        if station in self._trouble:
            self._recovered(station, end)
        return STORED | self._next_station(end)

    def _recovered(self, station: int, now: int) -> None:
        if self.status.flags[station]:
            self.status.flags[station] = False
            self._events.append(StationBack(now, station))
        self._trouble.discard(station)
        if not self._trouble:
            self._events.append(AllHealthy(now))

    def line_idle(self, now: int) -> int:
        """Two character times of silence: a damaged reply fails its attempt now."""
        damage = self._reader.quiet()
        if self.state is not MasterState.REPLY:
            return 0
        if damage is not None:
            self._note_damage(damage)
        return self._failed(codes.DAMAGED, now, None) if self._reply_damaged else 0

    def _note_damage(self, damage: Damage) -> None:
        """A damaged or unfinished frame is over; the line may not be idle yet."""
        self._other_characters = True
        if damage.header == STX:
            self._reply_damaged = True

    def deadline(self) -> int | None:
        """The running attempt's deadline."""
        return self._deadline

    def on_deadline(self, now: int) -> int:
        """The attempt's time is over: code 01 for silence or an undamaged frame in progress, else 04.

        The master does not sense the carrier (assumed): a reply in progress does not hold it back.
        """
        self._reader.reset()
        return self._failed(codes.DAMAGED if self._other_characters else codes.NO_REPLY, now, None)

    def _report(self, now: int, code: int, reply: int | None) -> None:
        self._events.append(
            AttemptEnded(self._poll_start, self._poll_end, reply, now, self._station, self._attempt, code)
        )

    def _failed(self, code: int, now: int, reply: int | None) -> int:
        station, status = self._station, self.status
        by_code = self.failed_attempts.setdefault(station, {})
        by_code[code] = by_code.get(code, 0) + 1
        self._failures.append((station, code))
        self._report(now, code, reply)
        flagged = status.flags[station]
        allowed = 1 if flagged and self.config.probe else self.config.attempts
        if self._attempt < allowed:
            self._attempt += 1
            return EVENTS | self._to_poll(now)
        self.station_errors[station] += 1
        status.lost(station, code, count=not (flagged and self.config.count_on_edge))
        self._trouble.add(station)
        self._events.append(StationLost(now, station, code, not flagged))
        return EVENTS | self._next_station(now)

    def _to_poll(self, now: int) -> int:
        self._deadline = None
        self.state = _AFTER_ATTEMPT
        self.due = now + self.config.gap
        return TRANSMIT

    def _next_station(self, now: int) -> int:
        if self._station < self.config.settings.slaves:
            self._station += 1
            self._attempt = 1
            self._deadline = None
            self.state = _AFTER_ATTEMPT
            self.due = now + self.config.gap
            return (TRANSMIT | EVENTS) if self._events else TRANSMIT
        # The last slave: the overhead, then the next scan with the next counter.
        self._deadline = None
        self._counter = (self._counter + 1) & 15
        flagged = bool(self._trouble) and any(self.status.flags)
        self._with_parameters = flagged
        self._move(MasterInput.SCAN_OVER_FLAGGED if flagged else MasterInput.SCAN_OVER)
        self.wants_image = not flagged
        self.due = now + self.config.overhead + self.config.gap
        return (TRANSMIT | EVENTS) if self._events else TRANSMIT

    # -- ordinary scans ------------------------------------------------------------------------

    @property
    def ordinary(self) -> bool:
        """Whether its data frame is due and no slave is in error: an ordinary scan may follow."""
        return self.state is MasterState.DATA and not self._trouble

    @property
    def counter(self) -> int:
        """The counter of the link scan that is under way, or comes next."""
        return self._counter

    def pass_scans(self, scans: OrdinaryScans) -> int:
        """Pass ordinary scans, the first of which has begun; returns hints.

        The next data frame is due then. That all but the last of these scans ended is not reported.
        """
        starts, slaves = scans.starts, scans.slaves
        self.status.measured_each(scans.measured)
        self._scan_start = int(starts[-2])
        self._scans += scans.number - 1
        self._scan_attempts = slaves
        self.polls += slaves * scans.number
        polled, waited = scans.polled[:, -1], scans.replies[:, -1] - scans.polled[:, -1]
        slowest = int(waited.argmax())
        self._slowest = int(waited[slowest])
        self._slowest_station = slowest + 1 if self._slowest else 0
        self._poll_end = int(polled[-1])
        self._poll_start = self._poll_end - scans.poll
        self._station, self._attempt = slaves, 1
        self._other_characters = self._reply_damaged = self._with_parameters = False
        self._counter = (scans.latest + 1) & 15
        self.due = int(starts[-1])
        return TRANSMIT

    # -- sending -------------------------------------------------------------------------------

    def begin_transmit(self, now: int, counter: int = 0) -> Frame:
        """The frame that is due; a data frame carries :attr:`image`."""
        if self._reader.length:
            self._reader.reset()
        if self.state is MasterState.POLL:
            self._poll_start = now
            self._scan_attempts += 1
            if self._attempt == 1:
                self.polls += 1
            return encode_poll(self._station, self._counter)
        if self.state is MasterState.PARAMETERS:
            return encode_parameters(self._counter, self.config.settings)
        if self.state is not MasterState.DATA:
            raise RuntimeError(f"no frame is due while {self.state}")
        self._scan_begins(now)
        return encode_data(0, self._counter, self.image)

    def _scan_begins(self, now: int) -> None:
        status = self.status
        if self._scan_start is not None:
            duration = now - self._scan_start
            status.measured(duration, now)
            in_error = tuple(k for k in range(1, STATIONS) if status.flags[k]) if self._trouble else ()
            self._events.append(
                ScanEnded(
                    self._scans,
                    self._scan_start,
                    duration,
                    self._scan_attempts,
                    tuple(self._failures),
                    in_error,
                    self._with_parameters,
                    (self._slowest_station, self._slowest),
                )
            )
            self._scans += 1
        self._scan_start = now
        self._scan_attempts = 0
        self._failures.clear()
        self._slowest = self._slowest_station = 0
        status.running = True

    def transmit_done(self, now: int) -> int:
        """The frame has left: the next one is due, or an attempt's time runs."""
        state = self.state
        if state is MasterState.POLL:
            self.state = _AFTER_POLL
            self._poll_end = now
            self._other_characters = self._reply_damaged = False
            self._deadline = now + self.config.timeout
            return DEADLINE
        if state is MasterState.STOPPED:
            return 0
        self._move(MasterInput.SENT)
        if state is MasterState.PARAMETERS:
            self.wants_image = True
        elif state is MasterState.DATA:
            self.wants_image = False
            self._station = 1
            self._attempt = 1
        else:
            raise RuntimeError(f"no frame is sent while {state}")
        self.due = now + self.config.gap
        return (TRANSMIT | EVENTS) if self._events else TRANSMIT
